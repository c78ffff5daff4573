//! Single step of one Euler angle of the spacecraft and of the quadrotor, which the paper ran (Section V.B) and did not print.

use nalgebra::{SVector, Vector3};
use oqtal_control::controller::ClassicLqr;
use oqtal_control::euler::EulerAngles;
use oqtal_control::quaternion::Attitude;
use oqtal_control::schedule::Cells;
use oqtal_runtime::process::{Exit, Failure};

use super::body::{Manoeuvre, ManoeuvreTick, RotatingBody};
use super::chapter::{Chapter, invalid};
use super::expression::{TextValues, figure};
use super::lander::{Lander, RATE_HZ};
use super::roster::{self, Entry};
use super::text;
use crate::progress::Progress;
use crate::sheet::{Sheet, SheetCell, SheetRow, Variant};

/// Sizes of the step \[deg\].
const ANGLES_DEG: [f64; 7] = [5.0, 15.0, 30.0, 60.0, 90.0, 135.0, 170.0];
/// Duration of a run \[s\], long enough for a pole at 0.5 rad/s.
const DURATION_S: f64 = 30.0;
/// Fraction of the step within which it has settled \[-\].
const BAND: f64 = 0.05;
const AXES: [&str; 3] = ["roll", "pitch", "yaw"];

/// Index of the settling time among the columns.
const SETTLED: usize = 4;
/// Step sizes of the quadrotor \[deg\]: the paper's operating range ends at 15.
const TILTS_DEG: [f64; 4] = [5.0, 15.0, 30.0, 60.0];
/// Steps every Euler angle of both vehicles under every law.
///
/// # Errors
/// An option of a law is invalid, or the study was interrupted (exit code 1).
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let spacecraft = RotatingBody::Spacecraft(Box::new(lander.clone()), false);
    let mut rows = steps((&spacecraft, &ANGLES_DEG), &roster::each(), progress)?;
    let settled_of = settled(&rows);
    rows.push(linear(lander)?);
    let spacecraft = with_settled(text::table("step", rows), settled_of);
    let rows = steps((&RotatingBody::quadrotor()?, &TILTS_DEG), &roster::shipped(), progress)?;
    let settled_of = settled(&rows);
    let quadrotor = with_settled(text::table("step-quadrotor", rows), settled_of);
    Ok(Chapter { sheets: vec![spacecraft, quadrotor], ..text::chapter("step", &TextValues::new()) })
}

fn with_settled(sheet: Sheet, settled: String) -> Sheet {
    text::with_notes(sheet, &TextValues::from([("settled", settled.into())]))
}

/// Rows of every law on a body, with a step of each of these angles \[deg\] about each axis.
fn steps(
    (body, angles_deg): (&RotatingBody, &[f64]),
    entries: &[Entry],
    progress: &Progress,
) -> Result<Vec<SheetRow>, Failure> {
    let cases: Vec<(&Entry, usize, f64)> = entries
        .iter()
        .flat_map(|entry| {
            (0..3).flat_map(move |axis| angles_deg.iter().map(move |angle| (entry, axis, *angle)))
        })
        .collect();
    progress.each("single step", &cases, |(entry, axis, angle)| stepped(body, entry, *axis, *angle))
}

/// Number of settled steps and longest settling time of each law, as text.
fn settled(rows: &[SheetRow]) -> String {
    let said: Vec<String> = rows
        .chunk_by(|a, b| a.controller == b.controller)
        .map(|of_law| {
            let settled: Vec<f64> = of_law
                .iter()
                .filter_map(|row| match row.cells[SETTLED] {
                    SheetCell::Number(time_s) => Some(time_s),
                    _ => None,
                })
                .collect();
            let longest = settled.iter().copied().fold(0.0, f64::max);
            let (name, of) = (&of_law[0].controller, of_law.len());
            match settled.len() {
                0 => format!("{name} none of {of}"),
                count => format!("{name} {count} of {of}, the slowest in {} s", figure(longest)),
            }
        })
        .collect();
    said.join("; ")
}

/// Attitude with one Euler angle, given by index, at `angle` \[rad\].
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

/// Response of the classic law as a linear system.
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
    /// Angle about the axis of the step, as a fraction of the step \[-\].
    progress: f64,
    /// Angle to the target about any axis, as a fraction of the step \[-\].
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

    /// Cells of rise time, overshoot and settling time.
    fn cells(&self) -> Vec<SheetCell> {
        vec![self.rise_s.into(), (100.0 * self.overshoot).into(), self.settle_s.into()]
    }
}

/// Angle of a rotation about one body axis \[rad\]; exact for a rotation about that axis alone.
fn turned_about(attitude: &Attitude, axis: usize) -> f64 {
    let numbers = attitude.xyzw();
    let angle = 2.0 * numbers[axis].atan2(numbers[3]);
    // Angles beyond pi stay positive, so that an overshoot past half a turn does not wrap around.
    if angle < -std::f64::consts::FRAC_PI_2 { angle + std::f64::consts::TAU } else { angle }
}
