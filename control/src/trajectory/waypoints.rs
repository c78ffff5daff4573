//! A path through given points, read from a table.

use std::f64::consts::{PI, TAU};
use std::fmt;
use std::sync::Arc;

use nalgebra::{Matrix3, Matrix3x4, Vector3, Vector4};
use serde::{Deserialize, Serialize};

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
/// world, yaw in degrees relative to that at the start. The column `yaw_deg` may be absent. Yaw turns as written: from 0 by 90, 180 and 270 to
/// 360 once; only from one angle in -180..180 to another, more than 180 apart, it turns the shorter way. A column
/// without the unit in its name is refused: a yaw of 90 would be flown as 14 turns.
///
/// The path is at rest at the first and the last point. Between the points each coordinate follows a [`WaypointCurve`].
#[derive(Clone, Debug, PartialEq)]
pub struct Waypoints {
    /// At least two, the first at time 0. Reference-counted, so that a plan can be copied without allocation.
    knots: Arc<[Knot]>,
}

/// The curve of each coordinate between waypoints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WaypointCurve {
    /// The piecewise cubic of Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5 (1984) 300): the velocity is continuous and every
    /// coordinate stays in the interval between two neighbouring points, so the path does not overshoot.
    #[default]
    Monotone,
    /// The piecewise polynomial of seventh degree of least integral of the squared snap (Mellinger and Kumar, ICRA 2011): continuous up
    /// to the sixth derivative, for fast flights. It may leave the interval between two points.
    MinimumSnap,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Knot {
    t_s: f64,
    /// x, y, z \[m\] and yaw \[rad\].
    value: Vector4<f64>,
    /// Their first three derivatives; of the cubic only the first.
    rates: [Vector4<f64>; 3],
    curve: WaypointCurve,
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
    /// The first invalid line, with the reason.
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
        unwrap_yaw(&mut knots);
        set_slopes(&mut knots);
        Ok(Self { knots: knots.into() })
    }

    /// The path through the same points along `curve`.
    pub fn along(self, curve: WaypointCurve) -> Self {
        let mut knots = self.knots.to_vec();
        knots.iter_mut().for_each(|knot| (knot.curve, knot.rates) = (curve, Default::default()));
        match curve {
            WaypointCurve::Monotone => set_slopes(&mut knots),
            WaypointCurve::MinimumSnap => minimise_snap(&mut knots),
        }
        Self { knots: knots.into() }
    }

    /// Time of the last point \[s\].
    pub(super) fn duration_s(&self) -> f64 {
        self.knots[self.knots.len() - 1].t_s
    }

    /// Times of the points \[s\].
    pub(super) fn times_s(&self) -> impl Iterator<Item = f64> {
        self.knots.iter().map(|knot| knot.t_s)
    }

    /// The reference at `t_s` \[s\] in 0..duration.
    pub(super) fn sample(&self, t_s: f64) -> Reference {
        let next =
            self.knots.partition_point(|knot| knot.t_s <= t_s).clamp(1, self.knots.len() - 1);
        let course = self.knots[next - 1].towards(&self.knots[next], t_s);
        let [yaw_rad, yaw_rate_rad_s, yaw_acceleration_rad_s2] = [0, 1, 2].map(|k| course[k].w);
        Reference {
            yaw_rad,
            yaw_rate_rad_s,
            yaw_acceleration_rad_s2,
            ..Reference::moving(course.map(|value| value.xyz()), Phase::Trajectory)
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
    if z < 0.0 {
        return Err(WaypointProblem::BelowFloor);
    }
    match previous {
        None if t_s != 0.0 => return Err(WaypointProblem::FirstTime),
        Some(previous) if t_s - previous.t_s < LEAST_SPACING_S => {
            return Err(WaypointProblem::TimeOrder);
        }
        _ => {}
    }
    let value = Vector4::new(x, y, z, yaw_deg.to_radians());
    Ok(Knot { t_s, value, rates: Default::default(), curve: WaypointCurve::default() })
}

/// Makes the yaw continuous where it was wrapped to -180..180 degrees.
fn unwrap_yaw(knots: &mut [Knot]) {
    let (mut last, mut offset) = (knots[0].value.w, 0.0);
    for knot in knots {
        let yaw = knot.value.w;
        if (yaw - last).abs() > PI && yaw.abs().max(last.abs()) <= PI {
            offset -= TAU.copysign(yaw - last);
        }
        last = yaw;
        knot.value.w += offset;
    }
}

/// The slopes at the inner points; those at the ends stay zero.
fn set_slopes(knots: &mut [Knot]) {
    for k in 1..knots.len() - 1 {
        let (before, here, after) = (knots[k - 1], knots[k], knots[k + 1]);
        let (h0, h1) = (here.t_s - before.t_s, after.t_s - here.t_s);
        let chord0 = (here.value - before.value) / h0;
        let chord1 = (after.value - here.value) / h1;
        knots[k].rates[0] = chord0.zip_map(&chord1, |d0, d1| {
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

impl Knot {
    /// Value and first four derivatives at `t_s` \[s\], between this point and the next, `to`.
    fn towards(&self, to: &Self, t_s: f64) -> [Vector4<f64>; 5] {
        let h = to.t_s - self.t_s;
        let s = (t_s - self.t_s) / h;
        match self.curve {
            WaypointCurve::Monotone => self.cubic(to, h, s),
            WaypointCurve::MinimumSnap => {
                let terms = septic(h, to.value - self.value, [&self.rates, &to.rates]);
                let mut course = derivatives(&terms, h, s);
                course[0] += self.value;
                std::array::from_fn(|order| course[order])
            }
        }
    }

    /// The cubic with the values and slopes of two points (Hermite's form).
    fn cubic(&self, to: &Self, h: f64, s: f64) -> [Vector4<f64>; 5] {
        let (r, rise) = (1.0 - s, to.value - self.value);
        let [from_slope, to_slope] = [self.rates[0], to.rates[0]];
        let value = self.value + rise * (s * s * (3.0 - 2.0 * s)) + from_slope * (h * s * r * r)
            - to_slope * (h * s * s * r);
        let rate = rise * (6.0 * s * r / h)
            + from_slope * (r * (1.0 - 3.0 * s))
            + to_slope * (s * (3.0 * s - 2.0));
        let second = rise * (6.0 * (r - s) / (h * h))
            + (from_slope * (6.0 * s - 4.0) + to_slope * (6.0 * s - 2.0)) / h;
        let third = (rise * (-2.0 / h) + from_slope + to_slope) * (6.0 / (h * h));
        [value, rate, second, third, Vector4::zeros()]
    }
}

/// Coefficients, of the share of the interval `h` \[s\], of the polynomial of seventh degree from 0 to `rise` with these first three
/// derivatives at its ends.
fn septic(h: f64, rise: Vector4<f64>, [from, to]: [&[Vector4<f64>; 3]; 2]) -> [Vector4<f64>; 8] {
    let (a1, a2, a3) = (from[0] * h, from[1] * (h * h / 2.0), from[2] * (h * h * h / 6.0));
    let p = rise - a1 - a2 - a3;
    let v = to[0] * h - a1 - a2 * 2.0 - a3 * 3.0;
    let a = to[1] * (h * h) - a2 * 2.0 - a3 * 6.0;
    let j = to[2] * (h * h * h) - a3 * 6.0;
    [
        Vector4::zeros(),
        a1,
        a2,
        a3,
        p * 35.0 - v * 15.0 + a * 2.5 - j / 6.0,
        p * -84.0 + v * 39.0 - a * 7.0 + j / 2.0,
        p * 70.0 - v * 34.0 + a * 6.5 - j / 2.0,
        p * -20.0 + v * 10.0 - a * 2.0 + j / 6.0,
    ]
}

/// Value and first six derivatives of the polynomial `terms` of the share of the interval `h` \[s\], at the share `s`.
fn derivatives(terms: &[Vector4<f64>; 8], h: f64, s: f64) -> [Vector4<f64>; 7] {
    let mut terms = *terms;
    let mut scale = 1.0;
    std::array::from_fn(|_| {
        let value = terms.iter().rev().fold(Vector4::zeros(), |sum, term| sum * s + term) * scale;
        for order in 1..terms.len() {
            terms[order - 1] = terms[order] * order as f64;
        }
        terms[7] = Vector4::zeros();
        scale /= h;
        value
    })
}

/// The derivatives at the inner points with which the fourth to sixth derivatives are continuous too: the condition of least squared
/// snap. A block-tridiagonal system, solved from the first point to the last and back.
fn minimise_snap(knots: &mut [Knot]) {
    let none = [Vector4::zeros(); 3];
    // The fourth to sixth derivatives at one end of an interval, for a unit in each of the three derivatives at the start or end.
    let block = |h: f64, of_end: bool, at: f64| {
        let column = |index: usize| {
            let mut unit = none;
            unit[index].x = 1.0;
            let ends = if of_end { [&none, &unit] } else { [&unit, &none] };
            let course = derivatives(&septic(h, Vector4::zeros(), ends), h, at);
            Vector3::new(course[4].x, course[5].x, course[6].x)
        };
        Matrix3::from_columns(&[column(0), column(1), column(2)])
    };
    let forced = |h: f64, rise: Vector4<f64>, at: f64| {
        let course = derivatives(&septic(h, rise, [&none, &none]), h, at);
        Matrix3x4::from_rows(&[4, 5, 6].map(|order| course[order].transpose()))
    };
    let mut swept: Vec<(Matrix3<f64>, Matrix3x4<f64>)> = Vec::with_capacity(knots.len());
    for points in knots.windows(3) {
        let [h0, h1] = [points[1].t_s - points[0].t_s, points[2].t_s - points[1].t_s];
        let right = forced(h1, points[2].value - points[1].value, 0.0)
            - forced(h0, points[1].value - points[0].value, 1.0);
        let before = block(h0, false, 1.0);
        let (chain, known) = swept.last().copied().unwrap_or_default();
        let here = block(h0, true, 1.0) - block(h1, false, 0.0) - before * chain;
        let inverse = here.try_inverse().unwrap_or_default();
        swept.push((inverse * -block(h1, true, 0.0), inverse * (right - before * known)));
    }
    let mut next = Matrix3x4::zeros();
    for (knot, (chain, known)) in knots[1..].iter_mut().zip(&swept).rev() {
        next = known - chain * next;
        knot.rates = std::array::from_fn(|order| next.row(order).transpose());
    }
}
