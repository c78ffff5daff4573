//! Table IV: the laws in the gravity turn.

use oqtal_control::metrics::{CostWeights, TableTwo};
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use super::chapter::{Chapter, invalid};
use super::figures;
use super::lander::Lander;
use super::roster::{self, Entry};
use super::words::{about, either, reproduced};
use crate::progress::Progress;
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

/// The columns of Table IV: both forms of every integral.
pub const COLUMNS: [Column; 7] = [
    ("position_error", "position ∫|x̃| [m s]"),
    ("quaternion_error_norm", "error ∫|ε| [s]"),
    ("quaternion_error_square", "∫ε'ε [s]"),
    ("effort_norm", "effort ∫|τ| [N m s]"),
    ("effort_square", "∫τ'τ [N² m² s]"),
    ("riccati_solves", "Riccati solves"),
    ("cost", "cost, Eq. (60)"),
];

/// The printed rows: law, settings, position error, quaternion error, effort, calculations.
const PAPER: [(&str, &str, [f64; 3], Option<u64>); 3] = [
    (
        "pid",
        "c 50, k 5.95, T 1.15; effort printed as 1.1744, see above",
        [29.78, 0.0349, 0.8252],
        None,
    ),
    ("lqr", "q 128, r 1", [298.1, 0.8256, 7.13], Some(23)),
    ("oqtal", "q 256, r 1", [26.13, 0.0052, 0.2045], Some(1)),
];

/// Flies all laws through the gravity turn.
///
/// # Errors
/// An option of a law is invalid.
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let entries = roster::table_4();
    let bar = progress.start("Table IV", entries.len());
    let fly = |entry: &Entry| {
        let metrics = lander.fly(&entry.options, &entry.descent, |_| ()).map_err(invalid)?;
        bar.inc();
        let (name, settings) = (entry.controller, entry.settings.clone());
        Ok(SheetRow::new(entry.variant, name, settings, cells(metrics.as_ref(), entry.weights)))
    };
    let flown: Result<Vec<SheetRow>, Failure> = entries.par_iter().map(fly).collect();
    let mut sheet = Sheet {
        name: "IV".to_owned(),
        title: "Table IV: best-tuned controllers in the gravity turn".to_owned(),
        columns: COLUMNS.to_vec(),
        rows: paper().chain(flown?).collect(),
        is_marked: true,
        ..Sheet::default()
    };
    sheet.notes = NOTES.map(str::to_owned).into_iter().chain(verdicts(&sheet)).collect();
    Ok(Chapter {
        title: "Gravity turn",
        intro: INTRO.map(str::to_owned).to_vec(),
        sheets: vec![sheet],
        figures: figures::turn::all(lander).map_err(invalid)?,
    })
}

const INTRO: [&str; 1] = [
    "The lander of Table I flies level at 70 m/s and is turned by constant thrust against its velocity until it hovers: \
     after 22.7027 s, 264.865 m lower and 496.622 m down range. The closed form of that turn, which the paper says does not \
     exist, is the reference. Simulated without delay, noise or torque limit; integrated by Runge-Kutta of fourth order at \
     240 Hz or faster; the torque is held between the ticks of the loop. Cells are 0.2 wide. Below v_min = 1 m/s the command stands still.",
];

const NOTES: [&str; 2] = [
    "Table II defines the figures as integrals of norms, Eq. (60) has squares. Of the printed numbers the \
     quaternion errors of lqr and oqtal agree with norms; both forms are here. A dash stands where the body got out of control.",
    "The paper contradicts itself on the PID: the printed torque of 1.1744 is the fitness of Table III for [10, 1]; the effort \
     there is 0.8252.",
];

/// The notes that compare the computed figures with the printed ones.
fn verdicts(sheet: &Sheet) -> [String; 3] {
    let printed = Variant::AsPrinted;
    let compared = |index: usize, words: &[&str]| {
        let (law, _, [position, error, effort], solves) = PAPER[index];
        let [p, e, u, n] = sheet.figures((law, printed), words, MEASURED);
        let mut figures = vec![
            ("quaternion error", e, error),
            ("position error", p, position),
            ("effort", u, effort),
        ];
        figures.extend(solves.map(|solves| ("calculations", n, solves as f64)));
        format!("{law}, {}", reproduced(&figures))
    };
    let cells = ["60 Hz hold, centred cells"];
    let reproduces = format!(
        "A mark behind a number says whether it is the printed one within 10 %. Cells centred on zero: {}. {}. {}. With the printed rule for cells (floor) oqtal takes {} calculations.",
        compared(0, &[]),
        compared(1, &cells),
        compared(2, &cells),
        sheet.figures(("oqtal", printed), &["floor cells"], MEASURED)[3]
    );
    [reproduces, singular(sheet), told_the_rate(sheet)]
}

/// The columns that the paper prints.
const MEASURED: [&str; 4] =
    ["position_error", "quaternion_error_norm", "effort_norm", "riccati_solves"];

/// The effect of the singular start of the turn on the classic law.
fn singular(sheet: &Sheet) -> String {
    let lqr = ("lqr", Variant::AsPrinted);
    let effort = |words: &[&str]| sheet.figures(lqr, words, MEASURED)[2];
    let centred = effort(&["60 Hz hold, centred cells"]);
    let planar = effort(&["in the plane"]);
    format!(
        "The turn begins at a pitch of 90 degrees, where Euler angles are singular; cells centred on zero linearise beyond it, and \
         rounding decides what the classic law does. Kept in its plane to the last bit it comes to an effort of {} in place of {} N m s.",
        about(planar),
        about(centred)
    )
}

/// The effect of the rate of the reference on OQTAL.
fn told_the_rate(sheet: &Sheet) -> String {
    let oqtal = ("oqtal", Variant::AsPrinted);
    let with = sheet.figures(oqtal, &["60 Hz hold, centred cells"], MEASURED);
    let without = sheet.figures(oqtal, &["without omega_d"], MEASURED);
    let lqr = sheet.figures(("lqr", Variant::Ours), &["rate error"], MEASURED);
    format!(
        "OQTAL is told the rate of the reference: without omega_d its position error is {} times as great. The classic LQR that is \
         given the rate error at the same weights has {} of OQTAL's position error and {} of its quaternion error, so OQTAL's \
         advantage over the classic law {} its linearisation.",
        about(without[0] / with[0]),
        about(lqr[0] / with[0]),
        about(lqr[1] / with[1]),
        either(lqr[0] < with[0] && lqr[1] < with[1], "is not owed to", "may be owed to")
    )
}

fn paper() -> impl Iterator<Item = SheetRow> {
    PAPER.into_iter().map(|(name, settings, [position, error, effort], solves)| {
        let cells = vec![
            position.into(),
            error.into(),
            SheetCell::None,
            effort.into(),
            SheetCell::None,
            solves.into(),
            SheetCell::None,
        ];
        SheetRow::new(Variant::Paper, name, settings, cells)
    })
}

/// The cells of [`COLUMNS`] for a descent; empty ones if the body got out of control.
#[must_use]
pub fn cells(metrics: Option<&TableTwo>, [q, r]: [f64; 2]) -> Vec<SheetCell> {
    let Some(metrics) = metrics else { return vec![SheetCell::None; COLUMNS.len()] };
    vec![
        metrics.position_error.into(),
        metrics.quaternion_error.into(),
        metrics.quaternion_error_squared.into(),
        metrics.effort.into(),
        metrics.effort_squared.into(),
        metrics.riccati_solves.into(),
        metrics.cost(CostWeights { q, r }).into(),
    ]
}
