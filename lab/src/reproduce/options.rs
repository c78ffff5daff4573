//! Every option of `oqtal`, one at a time, and the second derivative of `eps`, which the paper drops.

use nalgebra::Vector3;
use oqtal_control::controller::{EpsDdot, OqtalOptions};
use oqtal_control::error_model::Jacobian;
use oqtal_control::quaternion::Attitude;
use oqtal_control::schedule::{Cells, Resolve};
use oqtal_control::tracking_error::AttitudeError;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use super::body::{Manoeuvre, RotatingBody};
use super::chapter::{Chapter, invalid};
use super::lander::{Descent, Lander, RATE_HZ};
use super::roster::{self, CELLS};
use super::words::{about, figure, listed};
use crate::progress::Progress;
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

/// Initial rotation \[rad, body\] and rate \[rad/s, body\] of a turn far from the target about another axis.
const FAR: Vector3<f64> = Vector3::new(0.2, 1.2, -0.3);
const TURNING: Vector3<f64> = Vector3::new(0.8, -0.2, 0.5);
const DURATION_S: f64 = 20.0;
/// Width of the cells in the table, small enough that the model changes often.
const DELTA: f64 = 0.05;

const COLUMNS: [Column; 7] = [
    ("position_error", "turn: ∫|x̃| [m s]"),
    ("quaternion_error_norm", "turn: ∫|ε| [s]"),
    ("effort_norm", "turn: ∫|τ| [N m s]"),
    ("riccati_solves", "turn: solves"),
    ("far_quaternion_error_norm", "far: ∫|ε| [s]"),
    ("far_effort_norm", "far: ∫|τ| [N m s]"),
    ("far_riccati_solves", "far: solves"),
];

struct OptionCase {
    settings: String,
    options: OqtalOptions,
}

/// Flies every option.
///
/// # Errors
/// An option of a law is invalid.
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let cases = cases();
    let bar = progress.start("options of oqtal", cases.len());
    let fly = |case: &OptionCase| {
        let row = flown(lander, case)?;
        bar.inc();
        Ok(row)
    };
    let rows: Result<Vec<SheetRow>, Failure> = cases.par_iter().map(fly).collect();
    let mut sheet = Sheet {
        name: "options".to_owned(),
        title: "Every option".to_owned(),
        columns: COLUMNS.to_vec(),
        rows: rows?,
        ..Sheet::default()
    };
    sheet.notes = vec![NOTE.to_owned(), models(&sheet), second_derivative(&sheet)];
    Ok(Chapter { title: "Options of OQTAL", sheets: vec![sheet], ..Chapter::default() })
}

const NOTE: &str = "q 256, r 1, 60 Hz hold; \"turn\" is the gravity turn, \"far\" a body 72 degrees from rest that turns at 1 rad/s \
     about another axis, with cells of 0.05.";

/// The differences between the error models, as text.
fn models(sheet: &Sheet) -> String {
    let keys = ["position_error", "riccati_solves", "far_quaternion_error_norm"];
    let of = |name: &str| {
        let settings = format!("jacobian {name}");
        let row = sheet.rows.iter().find(|row| row.settings == settings);
        keys.map(|key| row.map_or(f64::NAN, |row| row.number(&sheet.columns, key)))
    };
    let models = JACOBIANS.map(|(_, name)| (name, of(name)));
    let turns = models.map(|(_, figures)| figures[0]);
    let [least, most] = [f64::min, f64::max].map(|pick| turns.into_iter().fold(turns[0], pick));
    let mut far = models.map(|(name, figures)| (name, figures[2]));
    far.sort_by(|a, b| a.1.total_cmp(&b.1));
    let far = far.map(|(name, error)| format!("{name} {}", figure(error)));
    format!(
        "Jacobians: in the gravity turn, where each solves {} times, the position errors lie within {} % of each other. Far off the \
         models differ; by error, the least first: {}.",
        models[0].1[1],
        about(100.0 * (most / least - 1.0)),
        listed(&far)
    )
}

/// The effect of the second derivative of eps, with and without filter, as text.
fn second_derivative(sheet: &Sheet) -> String {
    let far = |words: &str| {
        let keys = ["far_quaternion_error_norm", "far_effort_norm"];
        sheet.figures(("oqtal", Variant::AsPrinted), &[words], keys)
    };
    let (without, with) = (far("without filter"), far("through 2 Hz"));
    let [none] = sheet
        .of(Variant::AsPrinted)
        .find(|row| row.settings == "jacobian exact, lambda of eps")
        .map_or([f64::NAN], |row| [row.number(&sheet.columns, "far_quaternion_error_norm")]);
    format!(
        "The second derivative of eps, from differences of noise-free rates: error {} and effort {} far off, {} and {} through the \
         filter, error {} without the term.",
        figure(without[0]),
        figure(without[1]),
        figure(with[0]),
        figure(with[1]),
        figure(none)
    )
}

fn cases() -> Vec<OptionCase> {
    let base = roster::oqtal_as_printed([256.0, 1.0], Cells::Centred).oqtal;
    let case = |settings: &str, options: OqtalOptions| OptionCase {
        settings: settings.to_owned(),
        options: options.with_cell_width(DELTA),
    };
    let mut cases = Vec::new();
    for (jacobian, name) in JACOBIANS {
        cases.push(case(&format!("jacobian {name}"), OqtalOptions { jacobian, ..base }));
    }
    for (cells, name) in CELLS {
        cases.push(case(&format!("cells {name}"), OqtalOptions { cells, ..base }));
    }
    let every = OqtalOptions { resolve: Resolve::EveryTick, ..base };
    cases.push(case("solved every tick", every));
    for (eps_ddot, name) in
        [(EpsDdot::Differenced, "without filter"), (EpsDdot::Filtered, "through 2 Hz")]
    {
        let exact = OqtalOptions { jacobian: Jacobian::Exact, eps_ddot, ..base };
        let settings = format!("jacobian exact, with the second derivative of eps, {name}");
        cases.push(case(&settings, exact));
    }
    let fed = OqtalOptions { feed_forward: true, ..base };
    cases.push(case("with feed-forward (not in the paper)", fed));
    cases
}

const JACOBIANS: [(Jacobian, &str); 5] = [
    (Jacobian::Decoupled, "decoupled"),
    (Jacobian::Printed45, "printed-45"),
    (Jacobian::Printed75, "printed-75"),
    (Jacobian::ExactConstantLambda, "exact, lambda constant"),
    (Jacobian::Exact, "exact, lambda of eps"),
];

fn flown(lander: &Lander, case: &OptionCase) -> Result<SheetRow, Failure> {
    let manoeuvre = Manoeuvre {
        attitude: Attitude::from_rotation_vector(FAR),
        rate: TURNING,
        target: Attitude::LEVEL,
        duration_s: DURATION_S,
    };
    let mut options = roster::oqtal([256.0, 1.0], Cells::Centred);
    options.oqtal = case.options;
    let turn = lander.fly(&options, &Descent::default(), |_| ()).map_err(invalid)?;
    let body = RotatingBody::Spacecraft(Box::new(lander.clone()), false);
    let far = body.turn(&options, &manoeuvre).map_err(invalid)?;
    let eps = |attitude| AttitudeError::between(&Attitude::LEVEL, attitude).eps().norm();
    let far_error: f64 = far.ticks.iter().map(|tick| eps(&tick.attitude) / RATE_HZ).sum();
    let far_effort: f64 = far.ticks.iter().map(|tick| tick.input.norm() / RATE_HZ).sum();
    let cells = vec![
        turn.map(|m| m.position_error).into(),
        turn.map(|m| m.quaternion_error).into(),
        turn.map(|m| m.effort).into(),
        turn.map(|m| m.riccati_solves).into(),
        far_error.into(),
        far_effort.into(),
        SheetCell::Count(far.riccati_solves.into()),
    ];
    let is_ours = case.options.feed_forward || case.options.jacobian == Jacobian::Decoupled;
    let variant = if is_ours { Variant::Ours } else { Variant::AsPrinted };
    Ok(SheetRow::new(variant, "oqtal", case.settings.clone(), cells))
}
