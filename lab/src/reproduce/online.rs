//! In-flight tuning of the six PIDs of Fig. 16, as in the paper's reference \[27\].

use oqtal_observe::flight::Outcome;
use oqtal_runtime::process::Failure;

use super::chapter::Chapter;
use super::expression::TextValues;
use super::text;
use crate::progress::Progress;
use crate::sheet::{SheetCell, SheetRow, Variant};
use crate::tune::online::{LOOPS, TunedLoop, tune};

/// Tunes the position loops around the shipped `oqtal`.
///
/// # Errors
/// The flight ended before all loops were tuned.
pub fn chapter(progress: &Progress) -> Result<Chapter, Failure> {
    let tuned = tune(&[], &LOOPS, progress)?;
    let sheet = text::table("outer-in-flight", tuned.loops.iter().map(row).collect());
    let lower = tuned.loops.iter().filter(|one| one.error[1] < one.error[0]).count();
    let [before, after] = tuned.jitter;
    let values = TextValues::from([
        ("flown_s", tuned.flown_s.into()),
        ("landed", f64::from(u8::from(tuned.outcome == Outcome::Landed)).into()),
        ("furthest_m", tuned.furthest_m.into()),
        ("lower", (lower as f64).into()),
        ("loops", (tuned.loops.len() as f64).into()),
        ("jitter", (after / before).into()),
    ]);
    let sheets = vec![text::with_notes(sheet, &values)];
    Ok(Chapter { sheets, ..text::chapter("outer-in-flight", &values) })
}

fn row(tuned: &TunedLoop) -> SheetRow {
    let [before, after] = tuned.gains;
    let cells = vec![
        tuned.name.into(),
        before.kp.into(),
        after.kp.into(),
        before.ki.into(),
        after.ki.into(),
        tuned.error[0].into(),
        tuned.error[1].into(),
        SheetCell::Count(tuned.bees as u64),
        SheetCell::Count(tuned.strayed as u64),
    ];
    SheetRow::new(Variant::Ours, "oqtal", "q 80, shipped", cells)
}
