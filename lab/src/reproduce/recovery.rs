//! Recovery from attitudes and rates far outside normal flight.

use nalgebra::Vector3;
use oqtal_control::quaternion::Attitude;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use super::body::{Manoeuvre, ManoeuvreRecord, RotatingBody};
use super::chapter::{Chapter, invalid};
use super::lander::Lander;
use super::roster::{self, Entry};
use super::words::{either, listed};
use crate::progress::Progress;
use crate::sheet::{Column, Sheet, SheetCell, SheetRow};

/// Initial angle to the target \[rad\].
const FAR_RAD: f64 = 175.0 * std::f64::consts::PI / 180.0;
/// Initial rate of a tumbling body \[rad/s\].
const TUMBLE_RAD_S: f64 = 20.0;
/// Duration of a run \[s\].
const DURATION_S: f64 = 60.0;
/// Angle below which the body stays once it has recovered \[rad\].
const NEAR_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// Axis of the rotation, which is no axis of the body \[-, body\].
const AXIS: Vector3<f64> = Vector3::new(0.6, -0.48, 0.64);

const COLUMNS: [Column; 6] = [
    ("vehicle", "vehicle"),
    ("start", "start"),
    ("recovered_s", "within 5° after [s]"),
    ("commands_finite", "every command a number"),
    ("riccati_solves", "Riccati solves"),
    ("failed_solves", "of them failed"),
];

/// Lets every law recover both vehicles from both initial states.
///
/// # Errors
/// An option of a law is invalid.
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let spacecraft = RotatingBody::Spacecraft(Box::new(lander.clone()), true);
    let quadrotor = RotatingBody::quadrotor()?;
    let mut cases: Vec<(&str, &RotatingBody, Entry)> =
        roster::each().into_iter().map(|entry| ("spacecraft, 5 N m", &spacecraft, entry)).collect();
    cases.extend(roster::shipped().into_iter().map(|entry| ("quadrotor", &quadrotor, entry)));
    let bar = progress.start("recovery", cases.len());
    let recover = |(vehicle, body, entry): &(&str, &RotatingBody, Entry)| {
        let rows = [("175° off", FAR_RAD, 0.0), ("tumble of 20 rad/s", 0.0, TUMBLE_RAD_S)].map(
            |(start, angle, rate)| {
                let manoeuvre = Manoeuvre {
                    attitude: Attitude::from_rotation_vector(AXIS * angle),
                    rate: AXIS * rate,
                    target: Attitude::LEVEL,
                    duration_s: DURATION_S,
                };
                let turned = body.turn(&entry.options, &manoeuvre).map_err(invalid)?;
                Ok(row(entry, [vehicle, start], &turned))
            },
        );
        bar.inc();
        rows.into_iter().collect()
    };
    let rows: Result<Vec<Vec<SheetRow>>, Failure> = cases.par_iter().map(recover).collect();
    let rows = rows?.concat();
    let sheet = Sheet {
        name: "recovery".to_owned(),
        title: "Recovery from 175 degrees and from a tumble of 20 rad/s".to_owned(),
        notes: vec![NOTE.to_owned(), verdict(&rows)],
        columns: COLUMNS.to_vec(),
        rows,
        ..Sheet::default()
    };
    Ok(Chapter { title: "Recovery", sheets: vec![sheet], ..Chapter::default() })
}

const NOTE: &str = "Not in the paper. On the spacecraft each law has the gains of the single step, on the quadrotor those it is \
     shipped with, not the tuned ones; about an axis that is none of the body's, within 60 s. A dash stands where the body is not recovered by then. The quadrotor's rate is held by its own loop, \
     not by these laws.";

/// The laws that do not recover, and whether every command was finite, as text.
fn verdict(rows: &[SheetRow]) -> String {
    let lost: Vec<String> = rows
        .iter()
        .filter(|row| !row.number(&COLUMNS, "recovered_s").is_finite())
        .map(|row| format!("{} ({}, {})", row.controller, row.cells[0].show(), row.cells[1].show()))
        .collect();
    let finite = rows.iter().all(|row| row.cells[3].show() == "yes");
    let commands = either(
        finite,
        "Every command of every law was a number.",
        "Not every command was a number.",
    );
    format!("Not recovered: {}. {commands}", listed(&lost))
}

fn row(entry: &Entry, [vehicle, start]: [&str; 2], turned: &ManoeuvreRecord) -> SheetRow {
    let away =
        turned.ticks.iter().rfind(|tick| tick.attitude.angle_to(&Attitude::LEVEL) > NEAR_RAD);
    let since = away.map_or(0.0, |tick| tick.time_s);
    let near =
        turned.ticks.last().filter(|tick| tick.attitude.angle_to(&Attitude::LEVEL) <= NEAR_RAD);
    let finite = if turned.commands_finite { "yes" } else { "no" };
    let cells = vec![
        vehicle.into(),
        start.into(),
        near.map(|_| since).into(),
        finite.into(),
        SheetCell::Count(turned.riccati_solves.into()),
        SheetCell::Count(turned.failed_solves.into()),
    ];
    SheetRow::new(entry.variant, entry.controller, entry.settings.clone(), cells)
}
