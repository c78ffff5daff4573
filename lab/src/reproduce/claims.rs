//! The claims of the paper, each with a verdict that follows from the tables of this run.

use super::chapter::Chapter;
use super::words::{about, figure};
use crate::sheet::{Sheet, SheetCell, SheetRow, Variant};

/// Whether a claim holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClaimVerdict {
    /// It holds.
    Holds,
    /// A part of it holds.
    InPart,
    /// It does not hold.
    Fails,
}

impl ClaimVerdict {
    /// [`ClaimVerdict::Holds`] if all of `parts` hold, [`ClaimVerdict::Fails`] if none does.
    fn of(parts: impl IntoIterator<Item = bool>) -> Self {
        let (held, failed): (Vec<bool>, Vec<bool>) = parts.into_iter().partition(|holds| *holds);
        match (held.is_empty(), failed.is_empty()) {
            (_, true) => Self::Holds,
            (true, false) => Self::Fails,
            (false, false) => Self::InPart,
        }
    }

    /// Sign and words.
    #[must_use]
    pub fn shown(self) -> &'static str {
        match self {
            Self::Holds => "✓ holds",
            Self::InPart => "◐ in part",
            Self::Fails => "✗ does not hold",
        }
    }

    /// Class in a page.
    #[must_use]
    pub fn class(self) -> &'static str {
        match self {
            Self::Holds => "good",
            Self::InPart => "warning",
            Self::Fails => "bad",
        }
    }
}

/// A claim of the paper.
#[derive(Clone, Debug, PartialEq)]
pub struct Claim {
    /// The claim.
    pub claim: &'static str,
    /// Whether it holds.
    pub verdict: ClaimVerdict,
    /// What was found.
    pub found: String,
    /// Name of the sheet that shows it.
    pub sheet: &'static str,
}

/// The claims that the tables of `chapters` judge.
#[must_use]
pub fn claims(chapters: &[Chapter]) -> Vec<Claim> {
    let sheets = || chapters.iter().flat_map(|chapter| &chapter.sheets);
    let sheet = |name: &str| sheets().find(|sheet| sheet.name == name);
    let mut claims = Vec::new();
    if let Some(table) = sheet("IV") {
        claims.extend([least(table), once(table), printed(table), linearisation(table)]);
    }
    claims.extend(sheet("sweep-claim").map(spectrum));
    claims.extend(sheet("sweep-stability").map(surfaces));
    if let Some(table) = sheet("III") {
        claims.extend([trend(table), best_tuned(table)]);
    }
    claims.extend(sheet("V-ranking").map(ranking));
    if let Some(table) = sheet("V") {
        claims.extend([greatest_weight(table), reduction(table)]);
    }
    claims
}

/// The columns of Table IV by which laws are compared.
const ERRORS: [&str; 3] = ["position_error", "quaternion_error_norm", "effort_norm"];
/// Settings of the row of Table IV that stands for a law with cells.
const CENTRED: &[&str] = &["60 Hz hold, centred cells"];

fn as_printed<const N: usize>(
    table: &Sheet,
    law: &str,
    words: &[&str],
    keys: [&str; N],
) -> [f64; N] {
    table.figures((law, Variant::AsPrinted), words, keys)
}

fn least(table: &Sheet) -> Claim {
    let oqtal = as_printed(table, "oqtal", CENTRED, ERRORS);
    let rivals = [as_printed(table, "pid", &[], ERRORS), as_printed(table, "lqr", CENTRED, ERRORS)];
    let better = (0..ERRORS.len()).map(|k| rivals.iter().all(|rival| oqtal[k] < rival[k]));
    let [position, error, effort] = oqtal.map(figure);
    Claim {
        claim: "In the gravity turn OQTAL has less position error, quaternion error and effort than PID and LQR (Table IV)",
        verdict: ClaimVerdict::of(better),
        found: format!(
            "OQTAL {position} m s, {error} s, {effort} N m s; PID {} m s, {} s, {} N m s; LQR {} m s, {} s, {} N m s",
            figure(rivals[0][0]),
            figure(rivals[0][1]),
            figure(rivals[0][2]),
            figure(rivals[1][0]),
            figure(rivals[1][1]),
            figure(rivals[1][2])
        ),
        sheet: "IV",
    }
}

fn once(table: &Sheet) -> Claim {
    let solves = |words: &[&str]| as_printed(table, "oqtal", words, ["riccati_solves"])[0];
    let (centred, floor) = (solves(CENTRED), solves(&["floor cells"]));
    Claim {
        claim: "OQTAL solves its Riccati equation once where LQR solves it again and again (Table IV)",
        verdict: ClaimVerdict::of([centred == 1.0, floor == 1.0]),
        found: format!(
            "{} with cells centred on zero, {} with the printed rule for cells",
            figure(centred),
            figure(floor)
        ),
        sheet: "IV",
    }
}

fn printed(table: &Sheet) -> Claim {
    let row = |law: &str, words: &[&str]| {
        let is_meant = |row: &&SheetRow| {
            row.controller == law && words.iter().all(|word| row.settings.contains(word))
        };
        table.of(Variant::AsPrinted).find(is_meant)
    };
    let rows = [row("pid", &[]), row("lqr", CENTRED), row("oqtal", CENTRED)];
    let marks: Vec<bool> = rows
        .into_iter()
        .flatten()
        .flat_map(|row| (0..table.columns.len()).filter_map(|column| table.mark(row, column)))
        .collect();
    let near = marks.iter().filter(|near| **near).count();
    Claim {
        claim: "The numbers printed in Table IV",
        found: format!(
            "{near} of {} come within 10 % with the printed equations and settings",
            marks.len()
        ),
        verdict: ClaimVerdict::of(marks),
        sheet: "IV",
    }
}

fn linearisation(table: &Sheet) -> Claim {
    let keys = ["position_error", "quaternion_error_norm"];
    let oqtal = as_printed(table, "oqtal", CENTRED, keys);
    let lqr = table.figures(("lqr", Variant::Ours), &["rate error"], keys);
    Claim {
        claim: "The linearisation of the quaternion error is what makes OQTAL better than the classic LQR",
        verdict: ClaimVerdict::of([lqr[0] >= oqtal[0], lqr[1] >= oqtal[1]]),
        found: format!(
            "a classic LQR that is told the rate of the reference, as OQTAL is, has {} of its position error and {} of its quaternion error",
            about(lqr[0] / oqtal[0]),
            about(lqr[1] / oqtal[1])
        ),
        sheet: "IV",
    }
}

/// The text in the last cell of each row.
fn last_words(sheet: &Sheet) -> impl Iterator<Item = (&SheetRow, bool)> {
    let holds =
        |row: &SheetRow| matches!(row.cells.last(), Some(SheetCell::Text(t)) if t == "true");
    sheet.rows.iter().map(move |row| (row, holds(row)))
}

fn spectrum(sheet: &Sheet) -> Claim {
    let fails: Vec<&str> = last_words(sheet)
        .filter(|(_, holds)| !holds)
        .map(|(row, _)| row.settings.as_str())
        .collect();
    let all = sheet.rows.len();
    let but = if fails.is_empty() { String::new() } else { format!("; not: {}", fails.join("; ")) };
    Claim {
        claim: "\"Significantly lower errors and costs across the entire testing spectrum\" than LQR (Figs. 6 to 9)",
        verdict: ClaimVerdict::of(last_words(sheet).map(|(_, holds)| holds)),
        found: format!("true of {} of {all} comparisons{but}", all - fails.len()),
        sheet: "sweep-claim",
    }
}

fn surfaces(sheet: &Sheet) -> Claim {
    let paper = sheet.rows.iter().filter(|row| row.variant == Variant::AsPrinted);
    let stable = |row: &SheetRow| {
        row.number(&sheet.columns, "stable") == row.number(&sheet.columns, "pairs")
    };
    let said = |row: &SheetRow| {
        let [stable, pairs] =
            ["stable", "pairs"].map(|key| figure(row.number(&sheet.columns, key)));
        format!("{} ({}) {stable} of {pairs}", row.controller, row.settings)
    };
    Claim {
        claim: "LQR and OQTAL fly at every pair of weights up to 2^20 (Figs. 6 to 9)",
        verdict: ClaimVerdict::of(paper.clone().map(stable)),
        found: format!(
            "pairs at which the body stays under control: {}",
            paper.map(said).collect::<Vec<_>>().join("; ")
        ),
        sheet: "sweep-stability",
    }
}

/// Rows of Table III: the paper's PID tuned by norms, in the order of the weights.
fn tuned(table: &Sheet) -> impl Iterator<Item = &SheetRow> {
    table.of(Variant::AsPrinted).filter(|row| row.settings.ends_with("norms"))
}

fn trend(table: &Sheet) -> Claim {
    let numbers = |row: &SheetRow| {
        ["quaternion_error_norm", "effort_norm"].map(|key| row.number(&table.columns, key))
    };
    let rows: Vec<[f64; 2]> = tuned(table).take(3).map(numbers).collect();
    let steps = || rows.windows(2);
    let said: Vec<String> = rows
        .iter()
        .map(|[error, effort]| format!("{} s for {} N m s", figure(*error), figure(*effort)))
        .collect();
    Claim {
        claim: "More weight on the error buys less error for more effort (Table III)",
        verdict: ClaimVerdict::of(
            steps().map(|pair| pair[1][0] < pair[0][0] && pair[1][1] > pair[0][1]),
        ),
        found: format!("with q from 1 to 100: {}", said.join(", ")),
        sheet: "III",
    }
}

fn best_tuned(table: &Sheet) -> Claim {
    let fitness = |row: &SheetRow| row.number(&table.columns, "fitness");
    // The fourth fitness is a misprint.
    let printed: Vec<f64> = table.of(Variant::Paper).take(3).map(fitness).collect();
    let times: Vec<f64> =
        tuned(table).zip(&printed).map(|(row, printed)| printed / fitness(row)).collect();
    let said: Vec<String> = times.iter().map(|times| about(*times)).collect();
    Claim {
        claim: "The PID is tuned to the best of its gains (Table III)",
        verdict: ClaimVerdict::of(times.iter().map(|times| *times <= 1.0 / 0.9)),
        found: format!("within wide bounds its fitness is {} times lower", said.join(", ")),
        sheet: "III",
    }
}

fn ranking(sheet: &Sheet) -> Claim {
    // Rows compare the first law with the second: OQTAL is the second.
    let against: Vec<&SheetRow> =
        sheet.rows.iter().filter(|row| row.settings == "against oqtal").collect();
    let counts = |row: &SheetRow| ["better", "worse"].map(|key| row.number(&sheet.columns, key));
    let leads =
        against.iter().map(|row| counts(row)).map(|[better, worse]| better == 0.0 && worse > 0.0);
    let said: Vec<String> = against
        .iter()
        .map(|row| {
            let [better, worse] = counts(row).map(figure);
            format!("better than {} by {worse} figures, worse by {better}", row.controller)
        })
        .collect();
    Claim {
        claim: "OQTAL flies the square better than PID and LQR (Table V)",
        verdict: ClaimVerdict::of(leads),
        found: format!("all tuned alike, in simulation: {}", said.join("; ")),
        sheet: "V-ranking",
    }
}

fn greatest_weight(table: &Sheet) -> Claim {
    let of = |law: &str, weight: &str| as_printed(table, law, &[weight], ["max_q"])[0];
    let paper = |law: &str| table.figures((law, Variant::Paper), &[], ["max_q"])[0];
    let (lqr, oqtal) = (of("lqr", "q 20 "), of("oqtal", "q 80"));
    let (claimed, found) = (paper("oqtal") / paper("lqr"), oqtal / lqr);
    Claim {
        claim: "OQTAL stands ten times the weight on its error that LQR stands (Table V, max q)",
        verdict: ClaimVerdict::of([found > 1.0, found >= 0.9 * claimed]),
        found: format!(
            "{} times, as algebra has it: eps is half an angle, so that four times the weight is the same gain",
            about(found)
        ),
        sheet: "V",
    }
}

/// The columns of Table V in which the abstract claims a reduction.
const SQUARE: [(&str, &str); 3] = [
    ("position_error_m", "position"),
    ("velocity_error_m_s", "velocity"),
    ("attitude_error_deg", "attitude"),
];
/// The reduction of the abstract \[%\], rounded to whole numbers.
const REDUCTION: std::ops::RangeInclusive<f64> = 10.0..=20.0;

fn reduction(table: &Sheet) -> Claim {
    let keys = SQUARE.map(|(key, _)| key);
    let of = |(variant, words): (Variant, [&[&str]; 3])| {
        let laws = ["oqtal", "pid", "lqr"];
        let [oqtal, pid, lqr] =
            [0, 1, 2].map(|k| table.figures((laws[k], variant), words[k], keys));
        let less = |rival: [f64; 3]| [0, 1, 2].map(|k| 100.0 * (1.0 - oqtal[k] / rival[k]));
        [("pid", less(pid)), ("lqr", less(lqr))]
    };
    let said = |cases: &[(&str, [f64; 3]); 2]| {
        let one = |(law, less): &(&str, [f64; 3])| {
            let parts =
                SQUARE.iter().zip(less).map(|((_, name), less)| format!("{name} {less:.0} %"));
            format!("than {law}: {}", parts.collect::<Vec<_>>().join(", "))
        };
        cases.iter().map(one).collect::<Vec<_>>().join("; ")
    };
    let printed = of((Variant::Paper, [&[], &[], &[]]));
    let tuned = of((Variant::Ours, [&["tuned alike"]; 3]));
    let parts = printed.iter().chain(&tuned).flat_map(|(_, less)| less);
    Claim {
        claim: "OQTAL has 10 to 20 % less error in the square (abstract)",
        verdict: ClaimVerdict::of(parts.map(|less| REDUCTION.contains(&less.round()))),
        found: format!(
            "less error by the printed numbers of Table V {}; here, all tuned alike, {}",
            said(&printed),
            said(&tuned)
        ),
        sheet: "V",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_claim_holds_if_all_of_it_does() {
        assert_eq!(ClaimVerdict::of([true, true]), ClaimVerdict::Holds);
        assert_eq!(ClaimVerdict::of([true, false]), ClaimVerdict::InPart);
        assert_eq!(ClaimVerdict::of([false]), ClaimVerdict::Fails);
    }

    #[test]
    fn a_claim_is_judged_by_the_rows_of_its_table() {
        let row = |law: &str, better: u64, worse: u64| {
            let cells = vec![SheetCell::Count(better), SheetCell::Count(worse)];
            SheetRow::new(Variant::Ours, law, "against oqtal", cells)
        };
        let table = |rows| Sheet {
            name: "V-ranking".to_owned(),
            columns: vec![("better", "better by"), ("worse", "worse by")],
            rows,
            ..Sheet::default()
        };
        let judged = |rows| {
            let chapter = Chapter { sheets: vec![table(rows)], ..Chapter::default() };
            claims(&[chapter])
        };
        let both = judged(vec![row("pid", 0, 3), row("lqr", 0, 1)]);
        assert_eq!((both.len(), both[0].verdict), (1, ClaimVerdict::Holds));
        assert_eq!(
            judged(vec![row("pid", 4, 3), row("lqr", 0, 1)])[0].verdict,
            ClaimVerdict::InPart
        );
        let none = judged(vec![row("pid", 4, 3), row("lqr", 3, 4)]);
        assert_eq!(none[0].verdict, ClaimVerdict::Fails);
        assert!(none[0].found.contains("better than pid by 3 figures, worse by 4"), "{none:?}");
    }
    #[test]
    fn the_reduction_of_the_abstract_is_judged_by_every_figure() {
        let row = |variant, law: &str, scale: f64| {
            let cells = SQUARE.map(|_| SheetCell::Number(scale)).to_vec();
            SheetRow::new(variant, law, "tuned alike", cells)
        };
        let judged = |oqtal: f64| {
            let rows = [Variant::Paper, Variant::Ours].into_iter().flat_map(|variant| {
                [("pid", 1.0), ("lqr", 1.0), ("oqtal", oqtal)]
                    .map(|(law, scale)| row(variant, law, scale))
            });
            let columns = SQUARE.to_vec();
            reduction(&Sheet { columns, rows: rows.collect(), ..Sheet::default() })
        };
        assert_eq!(judged(0.85).verdict, ClaimVerdict::Holds);
        assert_eq!(judged(1.1).verdict, ClaimVerdict::Fails);
        assert!(judged(0.85).found.contains("than pid: position 15 %"), "{}", judged(0.85).found);
    }
}
