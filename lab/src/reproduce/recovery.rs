//! Recovery from attitudes and rates far outside normal flight.

use nalgebra::Vector3;
use oqtal_control::quaternion::Attitude;
use oqtal_runtime::process::Failure;

use super::body::{Manoeuvre, ManoeuvreRecord, RotatingBody};
use super::chapter::{Chapter, invalid};
use super::expression::TextValues;
use super::lander::Lander;
use super::roster::{self, Entry};
use super::text::{self, listed};
use crate::progress::Progress;
use crate::sheet::{Sheet, SheetCell, SheetRow};

/// Initial angle to the target \[rad\].
const FAR_RAD: f64 = 175.0 * std::f64::consts::PI / 180.0;
/// Initial rate of a tumbling body \[rad/s\].
const TUMBLE_RAD_S: f64 = 20.0;
/// Duration of a run \[s\].
const DURATION_S: f64 = 60.0;
/// Angle below which a recovered body stays \[rad\].
const NEAR_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// Axis of the rotation, oblique to the body axes \[-, body\].
const AXIS: Vector3<f64> = Vector3::new(0.6, -0.48, 0.64);

/// Tests the recovery of both vehicles from both initial states under every law.
///
/// # Errors
/// An option of a law is invalid, or the study was interrupted (exit code 1).
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let spacecraft = RotatingBody::Spacecraft(Box::new(lander.clone()), true);
    let quadrotor = RotatingBody::quadrotor()?;
    let mut cases: Vec<(&str, &RotatingBody, Entry)> =
        roster::each().into_iter().map(|entry| ("spacecraft, 5 N m", &spacecraft, entry)).collect();
    cases.extend(roster::shipped().into_iter().map(|entry| ("quadrotor", &quadrotor, entry)));
    let recover = |(vehicle, body, entry): &(&str, &RotatingBody, Entry)| {
        let rows: [Result<SheetRow, Failure>; 2] =
            [("175° off", FAR_RAD, 0.0), ("tumble of 20 rad/s", 0.0, TUMBLE_RAD_S)].map(
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
        rows.into_iter().collect::<Result<Vec<_>, _>>()
    };
    let rows = progress.each("recovery", &cases, recover)?.concat();
    let sheet = text::table("recovery", rows);
    let values = TextValues::from([("lost", listed(&lost(&sheet)).into())]);
    let sheets = vec![text::with_notes(sheet, &values)];
    Ok(Chapter { sheets, ..text::chapter("recovery", &values) })
}

/// Laws that do not recover, each with vehicle and initial state.
fn lost(sheet: &Sheet) -> Vec<String> {
    let is_lost = |row: &&SheetRow| !row.number(&sheet.columns, "recovered_s").is_finite();
    let name = |row: &SheetRow| {
        format!("{} ({}, {})", row.controller, row.cells[0].show(), row.cells[1].show())
    };
    sheet.rows.iter().filter(is_lost).map(name).collect()
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
