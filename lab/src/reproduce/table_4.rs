//! Table IV: the laws in the gravity turn.

use oqtal_control::metrics::{CostWeights, TableTwo};
use oqtal_runtime::process::Failure;

use super::chapter::{Chapter, invalid};
use super::expression::TextValues;
use super::figures;
use super::lander::Lander;
use super::roster::{self, Entry};
use super::text;
use crate::progress::Progress;
use crate::sheet::{Sheet, SheetCell, SheetRow};

/// Number of columns.
const COLUMNS: usize = 7;
/// Weights of the cost: those of Table III for which the PID of Table IV is tuned, so that the laws can be compared.
const WEIGHTS: CostWeights = CostWeights { q: 10.0, r: 1.0 };

/// Flies all laws through the gravity turn.
///
/// # Errors
/// An option of a law is invalid, or the study was interrupted (exit code 1).
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let fly = |entry: &Entry| {
        let metrics = lander.fly(&entry.options, &entry.descent, |_| ()).map_err(invalid)?;
        let (name, settings) = (entry.controller, entry.settings.clone());
        Ok(SheetRow::new(entry.variant, name, settings, cells(metrics.as_ref())))
    };
    let flown = progress.each("Table IV", &roster::table_4(), fly)?;
    let values = TextValues::new();
    let sheet = Sheet { is_marked: true, ..text::table("IV", flown) };
    Ok(Chapter {
        sheets: vec![text::with_notes(sheet, &values)],
        figures: figures::turn::all(lander).map_err(invalid)?,
        ..text::chapter("gravity-turn", &values)
    })
}

/// Cells of a descent; empty if the law lost control.
fn cells(metrics: Option<&TableTwo>) -> Vec<SheetCell> {
    let Some(metrics) = metrics else { return vec![SheetCell::None; COLUMNS] };
    vec![
        metrics.position_error.into(),
        metrics.quaternion_error.into(),
        metrics.quaternion_error_squared.into(),
        metrics.effort.into(),
        metrics.effort_squared.into(),
        metrics.riccati_solves.into(),
        metrics.cost(WEIGHTS).into(),
    ]
}
