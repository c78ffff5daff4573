//! Every option of `oqtal`, one at a time, and the second derivative of `eps`, which the paper neglects.

use nalgebra::Vector3;
use oqtal_control::controller::{EpsDdot, OqtalOptions};
use oqtal_control::error_model::Jacobian;
use oqtal_control::quaternion::Attitude;
use oqtal_control::schedule::{Cells, Resolve};
use oqtal_control::tracking_error::AttitudeError;
use oqtal_runtime::process::Failure;

use super::body::{Manoeuvre, RotatingBody};
use super::chapter::{Chapter, invalid};
use super::expression::TextValues;
use super::lander::{Descent, Lander, RATE_HZ};
use super::roster::{self, CELLS};
use super::text;
use crate::progress::Progress;
use crate::sheet::{SheetCell, SheetRow, Variant};

/// Initial rotation \[rad, body\] and rate \[rad/s, body\] of a turn far from the target about another axis.
const FAR: Vector3<f64> = Vector3::new(0.2, 1.2, -0.3);
const TURNING: Vector3<f64> = Vector3::new(0.8, -0.2, 0.5);
const DURATION_S: f64 = 20.0;
/// Width of the cells in the table, small enough for frequent changes of the model.
const DELTA: f64 = 0.05;

struct OptionCase {
    settings: String,
    options: OqtalOptions,
}

/// Flies the turn with every option.
///
/// # Errors
/// An option of a law is invalid, or the study was interrupted (exit code 1).
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let rows = progress.each("options of oqtal", &cases(), |case| flown(lander, case))?;
    let values = TextValues::new();
    let sheets = vec![text::with_notes(text::table("options", rows), &values)];
    Ok(Chapter { sheets, ..text::chapter("options", &values) })
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

fn variant(options: &OqtalOptions) -> Variant {
    let is_printed = matches!(options.jacobian, Jacobian::Printed45 | Jacobian::Printed75)
        && options.resolve != Resolve::EveryTick
        && !options.feed_forward;
    if is_printed { Variant::AsPrinted } else { Variant::Ours }
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
    Ok(SheetRow::new(variant(&case.options), "oqtal", case.settings.clone(), cells))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_options_of_the_paper_count_as_printed() {
        let printed =
            cases().into_iter().filter(|case| variant(&case.options) == Variant::AsPrinted);
        let settings: Vec<String> = printed.map(|case| case.settings).collect();
        let cells = CELLS.map(|(_, name)| format!("cells {name}"));
        assert_eq!(settings[..2], ["jacobian printed-45", "jacobian printed-75"]);
        assert_eq!(settings[2..], cells);
    }
}
