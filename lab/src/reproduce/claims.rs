//! Claims of the paper, each with a verdict computed from the tables of this run. The claims, their conditions and the results
//! shown are data, in `text.toml`.

use super::chapter::Chapter;
use super::expression::TextValues;
use super::text::{self, ClaimText};

/// Whether a claim holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClaimVerdict {
    /// The claim holds.
    Holds,
    /// A part of it holds.
    InPart,
    /// The claim does not hold.
    Fails,
}

impl ClaimVerdict {
    /// [`ClaimVerdict::Holds`] if all of `parts` hold, [`ClaimVerdict::Fails`] if none holds.
    fn of(parts: impl IntoIterator<Item = bool>) -> Self {
        let (held, failed): (Vec<bool>, Vec<bool>) = parts.into_iter().partition(|holds| *holds);
        match (held.is_empty(), failed.is_empty()) {
            (_, true) => Self::Holds,
            (true, false) => Self::Fails,
            (false, false) => Self::InPart,
        }
    }

    /// Symbol and words.
    pub fn shown(self) -> &'static str {
        match self {
            Self::Holds => "✓ holds",
            Self::InPart => "◐ in part",
            Self::Fails => "✗ does not hold",
        }
    }

    /// CSS class on a page.
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
    /// Text of the claim.
    pub claim: &'static str,
    /// Verdict.
    pub verdict: ClaimVerdict,
    /// Result of this run.
    pub found: String,
    /// Name of the table that decides the claim.
    pub sheet: &'static str,
}

/// Claims that are decided by the tables of `chapters`.
pub fn claims(chapters: &[Chapter]) -> Vec<Claim> {
    let values = TextValues::new();
    let evaluated = |claim: &'static ClaimText| {
        let mut sheets = chapters.iter().flat_map(|chapter| &chapter.sheets);
        let scope = text::scope(sheets.find(|sheet| sheet.name == claim.table)?, &values);
        Some(Claim {
            claim: &claim.claim,
            verdict: ClaimVerdict::of(claim.holds.iter().map(|part| scope.holds(part))),
            found: scope.render(&claim.found),
            sheet: &claim.table,
        })
    };
    text::claims().iter().filter_map(evaluated).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

    #[test]
    fn a_claim_holds_if_all_of_it_does() {
        assert_eq!(ClaimVerdict::of([true, true]), ClaimVerdict::Holds);
        assert_eq!(ClaimVerdict::of([true, false]), ClaimVerdict::InPart);
        assert_eq!(ClaimVerdict::of([false]), ClaimVerdict::Fails);
    }

    /// Claims about a table.
    fn evaluated(name: &str, columns: &[Column], rows: Vec<SheetRow>) -> Vec<Claim> {
        let (name, columns) = (name.to_owned(), columns.to_vec());
        let sheet = Sheet { name, columns, rows, ..Sheet::default() };
        claims(&[Chapter { sheets: vec![sheet], ..Chapter::default() }])
    }

    #[test]
    fn a_claim_is_decided_by_the_rows_of_its_table() {
        let row = |law: &str, better: u64, worse: u64| {
            let cells = vec![SheetCell::Count(better), SheetCell::Count(worse)];
            SheetRow::new(Variant::Ours, law, "against oqtal", cells)
        };
        let columns = [("better", "better by"), ("worse", "worse by")];
        let ranked = |pid, lqr| evaluated("V-ranking", &columns, vec![pid, lqr]);
        let both = ranked(row("pid", 0, 3), row("lqr", 0, 1));
        assert_eq!((both.len(), both[0].verdict), (1, ClaimVerdict::Holds));
        let one = ranked(row("pid", 4, 3), row("lqr", 0, 1));
        assert_eq!(one[0].verdict, ClaimVerdict::InPart);
        let none = ranked(row("pid", 4, 3), row("lqr", 3, 4));
        assert_eq!(none[0].verdict, ClaimVerdict::Fails);
        assert!(none[0].found.contains("better than pid by 3 figures, worse by 4"), "{none:?}");
    }

    #[test]
    fn oqtal_is_ahead_only_if_it_is_so_of_laws_with_the_rate_of_the_reference_too() {
        let columns = ["position_error", "quaternion_error_norm", "effort_norm", "riccati_solves"]
            .map(|key| (key, ""));
        let row = |variant, law: &str, settings: &str, figure: f64| {
            let cells = columns.map(|_| SheetCell::Number(figure)).to_vec();
            SheetRow::new(variant, law, settings, cells)
        };
        let verdict = |rival: f64| {
            let (printed, ours) = (Variant::AsPrinted, Variant::Ours);
            let rows = vec![
                row(printed, "pid", "", 3.0),
                row(printed, "lqr", "60 Hz hold, centred cells", 3.0),
                row(printed, "oqtal", "60 Hz hold, centred cells", 2.0),
                row(ours, "pid", "omega_e", rival),
                row(ours, "lqr", "rate error", rival),
            ];
            evaluated("IV", &columns, rows)[0].verdict
        };
        assert_eq!(verdict(2.5), ClaimVerdict::Holds);
        assert_eq!(verdict(1.5), ClaimVerdict::InPart);
    }

    #[test]
    fn the_reduction_of_the_abstract_is_decided_by_every_figure() {
        let columns = ["position_error_m", "velocity_error_m_s", "attitude_error_deg", "max_q"]
            .map(|key| (key, ""));
        let row = |variant, law: &str, scale: f64| {
            let cells = columns.map(|_| SheetCell::Number(scale)).to_vec();
            SheetRow::new(variant, law, "tuned alike", cells)
        };
        let reduction = |oqtal: f64| {
            let rows = [Variant::Paper, Variant::Ours].into_iter().flat_map(|variant| {
                [("pid", 1.0), ("lqr", 1.0), ("oqtal", oqtal)]
                    .map(|(law, scale)| row(variant, law, scale))
            });
            evaluated("V", &columns, rows.collect()).pop().unwrap()
        };
        assert_eq!(reduction(0.85).verdict, ClaimVerdict::Holds);
        assert_eq!(reduction(1.1).verdict, ClaimVerdict::Fails);
        let found = reduction(0.85).found;
        assert!(found.contains("than pid: position 15 %"), "{found}");
    }
}
