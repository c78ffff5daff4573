//! The single step of one Euler angle of the spacecraft and of the quadrotor, which the paper ran (Section V.B) and did not print.

use nalgebra::{SVector, Vector3};
use oqtal_control::controller::ClassicLqr;
use oqtal_control::euler::EulerAngles;
use oqtal_control::quaternion::Attitude;
use oqtal_control::schedule::Cells;
use oqtal_runtime::process::{Exit, Failure};
use rayon::prelude::*;

use super::body::{Manoeuvre, ManoeuvreTick, RotatingBody};
use super::chapter::{Chapter, invalid};
use super::lander::{Lander, RATE_HZ};
use super::roster::{self, Entry};
use super::words::figure;
use crate::progress::{Bar, Progress};
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

/// Sizes of the step \[deg\].
const ANGLES_DEG: [f64; 7] = [5.0, 15.0, 30.0, 60.0, 90.0, 135.0, 170.0];
/// Duration of a run \[s\], long enough for a pole at 0.5 rad/s.
const DURATION_S: f64 = 30.0;
/// Fraction of the step within which it has settled \[-\].
const BAND: f64 = 0.05;
const AXES: [&str; 3] = ["roll", "pitch", "yaw"];

const COLUMNS: [Column; 7] = [
    ("axis", "axis"),
    ("angle_deg", "step [°]"),
    ("rise_s", "rise, 10 to 90 % [s]"),
    ("overshoot_percent", "overshoot [%]"),
    ("settle_s", "settled within 5 % [s]"),
    ("effort_norm", "effort ∫|τ| [N m s]"),
    ("riccati_solves", "Riccati solves"),
];

/// Index of the effort among the columns.
const EFFORT: usize = 5;
/// Sizes of the step of the quadrotor \[deg\]: the paper's range of operation ends at 15.
const TILTS_DEG: [f64; 4] = [5.0, 15.0, 30.0, 60.0];
/// Unit of the effort of the quadrotor, which is commanded by sticks.
const STICK_EFFORT: Column = ("effort_norm", "effort ∫|u| [s]");

/// Steps every Euler angle of both vehicles under every law.
///
/// # Errors
/// An option of a law is invalid.
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let spacecraft = RotatingBody::Spacecraft(Box::new(lander.clone()), false);
    let entries = roster::each();
    let bar =
        progress.start("single step", 3 * entries.len() * (ANGLES_DEG.len() + TILTS_DEG.len()));
    let mut rows = steps((&spacecraft, &ANGLES_DEG), &entries, &bar)?;
    let settled_of = settled(&rows);
    rows.push(linear(lander)?);
    let sheet = Sheet {
        name: "step".to_owned(),
        title: "Single step of each Euler angle".to_owned(),
        notes: vec![NOTE.to_owned(), settled_of],
        columns: COLUMNS.to_vec(),
        rows,
        ..Sheet::default()
    };
    let rows = steps((&RotatingBody::quadrotor()?, &TILTS_DEG), &roster::shipped(), &bar)?;
    let mut columns = COLUMNS.to_vec();
    columns[EFFORT] = STICK_EFFORT;
    let quadrotor = Sheet {
        name: "step-quadrotor".to_owned(),
        title: "Single step of each Euler angle of the quadrotor".to_owned(),
        notes: vec![QUADROTOR_NOTE.to_owned(), settled(&rows)],
        columns,
        rows,
        ..Sheet::default()
    };
    Ok(Chapter { title: "Single step", sheets: vec![sheet, quadrotor], ..Chapter::default() })
}

/// The rows of every law on a body, stepped by each of these angles \[deg\] about each axis.
fn steps(
    (body, angles_deg): (&RotatingBody, &[f64]),
    entries: &[Entry],
    bar: &Bar,
) -> Result<Vec<SheetRow>, Failure> {
    let cases: Vec<(&Entry, usize, f64)> = entries
        .iter()
        .flat_map(|entry| {
            (0..3).flat_map(move |axis| angles_deg.iter().map(move |angle| (entry, axis, *angle)))
        })
        .collect();
    let step = |(entry, axis, angle): &(&Entry, usize, f64)| {
        let row = stepped(body, entry, *axis, *angle)?;
        bar.inc();
        Ok(row)
    };
    cases.par_iter().map(step).collect()
}

const NOTE: &str = "The spacecraft, at rest and level, is told to roll, pitch or yaw by an angle; torque without limit, 60 Hz. \
     The paper ran this experiment and prints nothing of it. A dash under settling: not settled within 30 s; under rise: 90 % not \
     reached; the overshoot is that of 30 s, settled or not. Beyond a pitch of 90 degrees the Euler angles of the target are \
     others. With equal weights on error and rate, the slow pole tends to 1 rad/s for lqr and to 0.5 rad/s for oqtal, whose \
     error is half an angle, as the weights grow. The rows of Eqs. (26) and (27) are the classic law and its model at rest as one \
     linear system, whose response in shares of the step is the same about every axis and for every angle.";

const QUADROTOR_NOTE: &str = "The quadrotor of Eq. (61), whose rate follows the sticks with a lag, without radio delay, cameras or \
     noise, under each law with its shipped gains. Euler angles of 15 degrees are the paper's range of operation. The classic law's \
     and OQTAL's integral action makes the slow end of each step: its weight is 0.01 of that of the error, Eq. (62).";

/// Number of settled steps and longest settling time of each law, as text.
fn settled(rows: &[SheetRow]) -> String {
    let said: Vec<String> = rows
        .chunk_by(|a, b| a.controller == b.controller)
        .map(|of_law| {
            let times = of_law.iter().map(|row| row.number(&COLUMNS, "settle_s"));
            let settled: Vec<f64> = times.filter(|time| time.is_finite()).collect();
            let longest = settled.iter().copied().fold(0.0, f64::max);
            let (name, of) = (&of_law[0].controller, of_law.len());
            match settled.len() {
                0 => format!("{name} none of {of}"),
                count => format!("{name} {count} of {of}, the slowest in {} s", figure(longest)),
            }
        })
        .collect();
    format!("Steps settled: {}.", said.join("; "))
}

/// The attitude with one Euler angle, by index, at `angle` \[rad\].
fn target(axis: usize, angle: f64) -> Attitude {
    let mut theta = Vector3::zeros();
    theta[axis] = angle;
    Attitude::from_xyzw(EulerAngles::from_vector(&theta).xyzw()).unwrap_or_default()
}

fn stepped(
    body: &RotatingBody,
    entry: &Entry,
    axis: usize,
    angle_deg: f64,
) -> Result<SheetRow, Failure> {
    let size = angle_deg.to_radians();
    let target = target(axis, size);
    let manoeuvre = Manoeuvre {
        attitude: Attitude::LEVEL,
        rate: Vector3::zeros(),
        target,
        duration_s: DURATION_S,
    };
    let turned = body.turn(&entry.options, &manoeuvre).map_err(invalid)?;
    let moment = |tick: &ManoeuvreTick| StepMoment {
        time_s: tick.time_s,
        progress: turned_about(&tick.attitude, axis) / size,
        left: tick.attitude.angle_to(&target) / size,
    };
    let moments: Vec<StepMoment> = turned.ticks.iter().map(moment).collect();
    let effort: f64 = turned.ticks.iter().map(|tick| tick.input.norm() / RATE_HZ).sum();
    let cells = [
        vec![AXES[axis].into(), angle_deg.into()],
        StepResponse::of(&moments).cells(),
        vec![effort.into(), SheetCell::Count(turned.riccati_solves.into())],
    ];
    Ok(SheetRow::new(entry.variant, entry.controller, entry.settings.clone(), cells.concat()))
}

/// The response of the classic law as a linear system.
fn linear(lander: &Lander) -> Result<SheetRow, Failure> {
    let options = roster::lqr([128.0, 1.0], Cells::Truncated).lqr;
    let input = lander.input(false);
    let closed = ClassicLqr::set_point_loop(&options, &input, &SVector::zeros());
    let closed = closed.map_err(|error| Failure::new(Exit::Internal, error.to_string()))?;
    let count = (DURATION_S * RATE_HZ) as usize;
    let angles = closed.step_response(&Vector3::x(), RATE_HZ.recip(), count);
    let moment = |(tick, angle): (usize, Vector3<f64>)| StepMoment {
        time_s: tick as f64 / RATE_HZ,
        progress: angle.x,
        left: (1.0 - angle.x).abs(),
    };
    let moments: Vec<StepMoment> = angles.enumerate().map(moment).collect();
    let cells = [
        vec!["any".into(), SheetCell::None],
        StepResponse::of(&moments).cells(),
        vec![SheetCell::None, SheetCell::Count(1)],
    ];
    let settings = "q 128, r 1, linear: Eqs. (26), (27)";
    Ok(SheetRow::new(Variant::AsPrinted, "lqr", settings, cells.concat()))
}

/// An instant of a step.
struct StepMoment {
    /// Time since the start \[s\].
    time_s: f64,
    /// Angle about the axis of the step, over the step \[-\].
    progress: f64,
    /// Angle to the target about any axis, over the step \[-\].
    left: f64,
}

/// The response to a step.
struct StepResponse {
    rise_s: Option<f64>,
    overshoot: f64,
    settle_s: Option<f64>,
}

impl StepResponse {
    fn of(moments: &[StepMoment]) -> Self {
        let reached =
            |share: f64| moments.iter().find(|at| at.progress >= share).map(|at| at.time_s);
        let outside = |at: &&StepMoment| at.left > BAND;
        let last_outside = moments.iter().rfind(outside).map_or(0.0, |at| at.time_s);
        let settled = moments.last().filter(|last| !outside(last)).map(|_| last_outside);
        let furthest = moments.iter().map(|at| at.progress).fold(0.0, f64::max);
        Self {
            rise_s: reached(0.9).zip(reached(0.1)).map(|(late, early)| late - early),
            overshoot: (furthest - 1.0).max(0.0),
            settle_s: settled,
        }
    }

    /// The cells of rise, overshoot and settling.
    fn cells(&self) -> Vec<SheetCell> {
        vec![self.rise_s.into(), (100.0 * self.overshoot).into(), self.settle_s.into()]
    }
}

/// Angle of a rotation about one body axis \[rad\]; exact if the body turned about no other.
fn turned_about(attitude: &Attitude, axis: usize) -> f64 {
    let numbers = attitude.xyzw();
    let angle = 2.0 * numbers[axis].atan2(numbers[3]);
    // Angles beyond pi stay positive, so that an overshoot past half a turn does not wrap around.
    if angle < -std::f64::consts::FRAC_PI_2 { angle + std::f64::consts::TAU } else { angle }
}
