//! The single step of one Euler angle, which the paper ran (Section V.B) and did not print.

use nalgebra::Vector3;
use oqtal_control::euler::EulerAngles;
use oqtal_control::quaternion::Attitude;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use super::body::{Manoeuvre, ManoeuvreTick, RotatingBody};
use super::chapter::{Chapter, invalid};
use super::lander::{Lander, RATE_HZ};
use super::roster::{self, Entry};
use super::words::figure;
use crate::progress::Progress;
use crate::sheet::{Column, Sheet, SheetCell, SheetRow};

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

/// Steps every Euler angle under every law.
///
/// # Errors
/// An option of a law is invalid.
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let entries = roster::each();
    let steps = || (0..3).flat_map(|axis| ANGLES_DEG.map(|angle| (axis, angle)));
    let cases: Vec<(&Entry, usize, f64)> = entries
        .iter()
        .flat_map(|entry| steps().map(move |(axis, angle)| (entry, axis, angle)))
        .collect();
    let bar = progress.start("single step", cases.len());
    let body = RotatingBody::Spacecraft(Box::new(lander.clone()), false);
    let step = |(entry, axis, angle): &(&Entry, usize, f64)| {
        let row = stepped(&body, entry, *axis, *angle)?;
        bar.inc();
        Ok(row)
    };
    let rows: Result<Vec<SheetRow>, Failure> = cases.par_iter().map(step).collect();
    let rows = rows?;
    let sheet = Sheet {
        name: "step".to_owned(),
        title: "Single step of each Euler angle".to_owned(),
        notes: vec![NOTE.to_owned(), settled(&rows)],
        columns: COLUMNS.to_vec(),
        rows,
        ..Sheet::default()
    };
    Ok(Chapter { title: "Single step", sheets: vec![sheet], ..Chapter::default() })
}

const NOTE: &str = "The spacecraft, at rest and level, is told to roll, pitch or yaw by an angle; torque without limit, 60 Hz. \
     The paper ran this experiment and prints nothing of it. A dash under settling: not settled within 30 s; under rise: 90 % not \
     reached; the overshoot is that of 30 s, settled or not. Beyond a pitch of 90 degrees the Euler angles of the target are \
     others. With equal weights on error and rate, the slow pole tends to 1 rad/s for lqr and to 0.5 rad/s for oqtal, whose \
     error is half an angle, as the weights grow.";

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
    let target = target(axis, angle_deg.to_radians());
    let manoeuvre = Manoeuvre {
        attitude: Attitude::LEVEL,
        rate: Vector3::zeros(),
        target,
        duration_s: DURATION_S,
    };
    let turned = body.turn(&entry.options, &manoeuvre).map_err(invalid)?;
    let size = angle_deg.to_radians();
    let response = Response::of(&turned.ticks, axis, size, &target);
    let effort: f64 = turned.ticks.iter().map(|tick| tick.input.norm() / RATE_HZ).sum();
    let cells = vec![
        AXES[axis].into(),
        angle_deg.into(),
        response.rise_s.into(),
        (100.0 * response.overshoot).into(),
        response.settle_s.into(),
        effort.into(),
        SheetCell::Count(turned.riccati_solves.into()),
    ];
    Ok(SheetRow::new(entry.variant, entry.controller, entry.settings.clone(), cells))
}

/// The response to a step.
struct Response {
    rise_s: Option<f64>,
    overshoot: f64,
    settle_s: Option<f64>,
}

impl Response {
    fn of(ticks: &[ManoeuvreTick], axis: usize, size: f64, target: &Attitude) -> Self {
        let progress = |tick: &ManoeuvreTick| turned_about(&tick.attitude, axis) / size;
        let reached =
            |share: f64| ticks.iter().find(|tick| progress(tick) >= share).map(|tick| tick.time_s);
        let outside = |tick: &&ManoeuvreTick| tick.attitude.angle_to(target) > BAND * size;
        let last_outside = ticks.iter().rfind(outside).map_or(0.0, |tick| tick.time_s);
        let settled = ticks.last().filter(|last| !outside(last)).map(|_| last_outside);
        let furthest = ticks.iter().map(progress).fold(0.0, f64::max);
        Self {
            rise_s: reached(0.9).zip(reached(0.1)).map(|(late, early)| late - early),
            overshoot: (furthest - 1.0).max(0.0),
            settle_s: settled,
        }
    }
}

/// Angle of a rotation about one body axis \[rad\]; exact if the body turned about no other.
fn turned_about(attitude: &Attitude, axis: usize) -> f64 {
    let numbers = attitude.xyzw();
    let angle = 2.0 * numbers[axis].atan2(numbers[3]);
    // Angles beyond pi stay positive, so that an overshoot past half a turn does not wrap around.
    if angle < -std::f64::consts::FRAC_PI_2 { angle + std::f64::consts::TAU } else { angle }
}
