//! A path through given points, read from a table.

use std::f64::consts::TAU;
use std::fmt;
use std::sync::Arc;

use nalgebra::Vector4;

use super::reference::{Phase, Reference};

/// Columns of the table; the last may be absent.
const COLUMNS: [&str; 5] = ["t", "x", "y", "z", "yaw_deg"];

/// Greatest magnitude of any number in the table.
const GREATEST: f64 = 1e4;

/// Least time between two points \[s\].
const LEAST_SPACING_S: f64 = 1e-3;

/// A path through points at given times, from a table in comma-separated text:
///
/// ```text
/// t,x,y,z,yaw_deg
/// 0,0,0,1,0
/// 4,1,0,1.2,0
/// 9,1,1,1,90
/// ```
///
/// Times in s from the start of the trajectory, positions in m from the start of the flight on the floor along the axes of the
/// world, yaw in degrees relative to that at the start. The column `yaw_deg` may be absent. Yaw turns the shorter way. A column
/// without the unit in its name is refused: a yaw of 90 would be flown as 14 turns.
///
/// Between the points each coordinate follows the piecewise cubic of Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5
/// (1984) 300), at rest at the first and the last: the velocity is continuous and every coordinate stays in the
/// interval between two neighbouring points, so the path does not overshoot.
#[derive(Clone, Debug, PartialEq)]
pub struct Waypoints {
    /// At least two, the first at time 0. Reference-counted, so that a plan can be copied without allocation.
    knots: Arc<[Knot]>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Knot {
    t_s: f64,
    /// x, y, z \[m\] and yaw \[rad\].
    value: Vector4<f64>,
    /// Rate of change of `value` \[m/s, rad/s\].
    slope: Vector4<f64>,
}

/// Error in a table of waypoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WaypointError {
    /// Line of the error, from 1 \[-\].
    pub line: usize,
    /// The problem in that line.
    pub problem: WaypointProblem,
}

/// Problem in a table of waypoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaypointProblem {
    /// The first line does not name the columns.
    Header,
    /// The first line names a column of yaw without its unit, or with another one.
    YawUnit,
    /// A line has another number of fields than the header.
    FieldCount {
        /// Fields of the header.
        expected: usize,
        /// Fields of the line.
        found: usize,
    },
    /// A field is not a number, or not one of plausible size.
    Number {
        /// Column of the field.
        column: &'static str,
    },
    /// A point is below the floor, from which the flight starts.
    BelowFloor,
    /// The first time is not 0.
    FirstTime,
    /// A time is not later than the one before it.
    TimeOrder,
    /// There are fewer than two points.
    TooFew,
}

impl fmt::Display for WaypointError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.problem)
    }
}

impl fmt::Display for WaypointProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Header => write!(f, "the first line must be t,x,y,z or t,x,y,z,yaw_deg"),
            Self::YawUnit => {
                write!(f, "yaw is given in degrees; name its column yaw_deg")
            }
            Self::FieldCount { expected, found } => {
                write!(f, "{found} fields where the header has {expected}")
            }
            Self::Number { column } => {
                write!(f, "{column} must be a number between -{GREATEST} and {GREATEST}")
            }
            Self::BelowFloor => {
                write!(f, "z must not be negative: the flight starts on the floor, at z = 0")
            }
            Self::FirstTime => write!(f, "the first point must be at t = 0"),
            Self::TimeOrder => {
                write!(f, "t must be at least {LEAST_SPACING_S} s later than in the line before")
            }
            Self::TooFew => write!(f, "there must be at least two points"),
        }
    }
}

impl std::error::Error for WaypointError {}

impl Waypoints {
    /// Reads a table as described at [`Waypoints`]. Empty lines are skipped.
    ///
    /// # Errors
    /// The first line at fault and what is wrong with it.
    pub fn parse(text: &str) -> Result<Self, WaypointError> {
        // Spreadsheets write a byte order mark before the header.
        let text = text.trim_start_matches('\u{feff}');
        let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
        let (mut last_line, header) = lines.next().unwrap_or((1, ""));
        let fields = header.split(',').count();
        let columns = &COLUMNS[..fields.clamp(4, 5)];
        if !header.split(',').map(str::trim).eq(columns.iter().copied()) {
            return Err(WaypointError { line: last_line, problem: header_problem(header) });
        }
        let mut knots = Vec::new();
        for (line, text) in lines {
            last_line = line;
            let knot = parse_knot(text, fields, knots.last())
                .map_err(|problem| WaypointError { line, problem })?;
            knots.push(knot);
        }
        if knots.len() < 2 {
            return Err(WaypointError { line: last_line, problem: WaypointProblem::TooFew });
        }
        set_slopes(&mut knots);
        Ok(Self { knots: knots.into() })
    }

    /// Time of the last point \[s\].
    pub(super) fn duration_s(&self) -> f64 {
        self.knots[self.knots.len() - 1].t_s
    }

    /// The reference at `t_s` \[s\] in 0..duration.
    pub(super) fn sample(&self, t_s: f64) -> Reference {
        let next =
            self.knots.partition_point(|knot| knot.t_s <= t_s).clamp(1, self.knots.len() - 1);
        let (value, rate) = interpolate(&self.knots[next - 1], &self.knots[next], t_s);
        Reference {
            velocity: rate.xyz(),
            yaw_rad: value.w,
            ..Reference::rest(value.xyz(), Phase::Trajectory)
        }
    }
}

/// Error of a first line that does not name the columns.
fn header_problem(header: &str) -> WaypointProblem {
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    match names.split_last() {
        Some((last, others)) if last.starts_with("yaw") && *others == COLUMNS[..4] => {
            WaypointProblem::YawUnit
        }
        _ => WaypointProblem::Header,
    }
}

fn parse_knot(text: &str, fields: usize, previous: Option<&Knot>) -> Result<Knot, WaypointProblem> {
    let found = text.split(',').count();
    if found != fields {
        return Err(WaypointProblem::FieldCount { expected: fields, found });
    }
    let mut numbers = [0.0; 5];
    for ((number, field), column) in numbers.iter_mut().zip(text.split(',')).zip(COLUMNS) {
        let plausible = field.trim().parse().ok().filter(|value: &f64| value.abs() <= GREATEST);
        *number = plausible.ok_or(WaypointProblem::Number { column })?;
    }
    let [t_s, x, y, z, yaw_deg] = numbers;
    let mut yaw = yaw_deg.to_radians();
    if z < 0.0 {
        return Err(WaypointProblem::BelowFloor);
    }
    match previous {
        None if t_s != 0.0 => return Err(WaypointProblem::FirstTime),
        Some(previous) if t_s - previous.t_s < LEAST_SPACING_S => {
            return Err(WaypointProblem::TimeOrder);
        }
        Some(previous) => yaw -= TAU * ((yaw - previous.value.w) / TAU).round(),
        None => {}
    }
    Ok(Knot { t_s, value: Vector4::new(x, y, z, yaw), slope: Vector4::zeros() })
}

/// The slopes at the inner points; those at the ends stay zero.
fn set_slopes(knots: &mut [Knot]) {
    for k in 1..knots.len() - 1 {
        let (before, here, after) = (knots[k - 1], knots[k], knots[k + 1]);
        let (h0, h1) = (here.t_s - before.t_s, after.t_s - here.t_s);
        let chord0 = (here.value - before.value) / h0;
        let chord1 = (after.value - here.value) / h1;
        knots[k].slope = chord0.zip_map(&chord1, |d0, d1| {
            // A coordinate that turns or stands still at the point has no slope there.
            if d0 * d1 <= 0.0 {
                return 0.0;
            }
            // The weighted harmonic mean of the chords.
            let (w0, w1) = (2.0 * h1 + h0, h1 + 2.0 * h0);
            (w0 + w1) / (w0 / d0 + w1 / d1)
        });
    }
}

/// Value and rate of the cubic with the values and slopes of two points (Hermite's form).
fn interpolate(from: &Knot, to: &Knot, t_s: f64) -> (Vector4<f64>, Vector4<f64>) {
    let h = to.t_s - from.t_s;
    let s = (t_s - from.t_s) / h;
    let r = 1.0 - s;
    let rise = to.value - from.value;
    let value = from.value + rise * (s * s * (3.0 - 2.0 * s)) + from.slope * (h * s * r * r)
        - to.slope * (h * s * s * r);
    let rate = rise * (6.0 * s * r / h)
        + from.slope * (r * (1.0 - 3.0 * s))
        + to.slope * (s * (3.0 * s - 2.0));
    (value, rate)
}
