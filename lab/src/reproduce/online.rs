//! The six PIDs of Fig. 16 tuned in flight, as the paper's reference \[27\] does.

use oqtal_observe::flight::Outcome;
use oqtal_runtime::process::Failure;

use super::chapter::Chapter;
use super::words::{about, either, figure};
use crate::progress::Progress;
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};
use crate::tune::online::{LOOPS, TunedInFlight, TunedLoop, tune};

const COLUMNS: [Column; 9] = [
    ("loop", "PID"),
    ("kp_before", "kp before"),
    ("kp", "kp"),
    ("ki_before", "ki before"),
    ("ki", "ki"),
    ("error_before", "mean error before [m, m/s]"),
    ("error", "mean error after [m, m/s]"),
    ("bees", "bees"),
    ("strayed", "broken off"),
];

/// Tunes the loops around the shipped `oqtal`.
///
/// # Errors
/// The flight ended before its loops were tuned.
pub fn chapter(progress: &Progress) -> Result<Chapter, Failure> {
    let tuned = tune(&[], &LOOPS, progress)?;
    let sheet = Sheet {
        name: "outer-in-flight".to_owned(),
        title: "The six PIDs of Fig. 16, tuned in flight".to_owned(),
        notes: vec![NOTE.to_owned(), found(&tuned)],
        columns: COLUMNS.to_vec(),
        rows: tuned.loops.iter().map(row).collect(),
        ..Sheet::default()
    };
    Ok(Chapter { title: "Outer loops tuned in flight", sheets: vec![sheet], ..Chapter::default() })
}

const NOTE: &str = "The paper's reference [27] tunes the loops online by an artificial bee colony, one input and one output at a time; \
     it prints neither gains nor settings. Here one simulated flight goes on from the first bee to the last: every 4 s the vehicle \
     moves 0.3 m along x and y and 0.2 m along z and back, under the shipped OQTAL, and a bee is a pair of gains of one loop that is \
     flown for such a window. Judged are the error of the loop's own variable, as the daemon measures it, and with half the weight \
     the change of the sticks from tick to tick; a bee that lets the vehicle stray by 0.5 m is broken off. The errors before and \
     after are those of six windows each, with the shipped gains and with all that was found.";

fn found(tuned: &TunedInFlight) -> String {
    let lower = tuned.loops.iter().filter(|one| one.error[1] < one.error[0]).count();
    let [before, after] = tuned.jitter;
    format!(
        "One flight of {} s, {}, never further than {} m from its reference. The error fell in {lower} of {} loops; the jitter of the \
         sticks is {} times what it was.",
        figure(tuned.flown_s),
        either(tuned.outcome == Outcome::Landed, "which landed", "which did not land"),
        figure(tuned.furthest_m),
        tuned.loops.len(),
        about(after / before)
    )
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
