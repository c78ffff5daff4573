//! `oqtal-dt` against the best of the other laws, draw by draw.

use oqtal_control::statistics::{mean, median};

use crate::bootstrap::BootstrapInterval;
use crate::sheet::Sheet;
use crate::study::Flown;
use crate::study::flights::Test;
use crate::study::metric::{CHIRP, DOUBLET, HOVER};
use crate::study::table::{column, not_flown};

/// Law that is compared with all others.
pub(super) const OURS: &str = "oqtal-dt";

const NOTE: &str = "In each draw the best of the others in that figure, whatever its gains: another law may be the best in another figure or draw. \
     The settings name the others.";

/// One row of gains of `oqtal-dt`, and a group of other laws.
struct GroupComparison<'a> {
    own: &'a Flown,
    group: &'static str,
    others: Vec<&'a Flown>,
}

/// Table of the comparison; without rows if only one law flies.
pub fn table(flown: &[Flown]) -> Sheet {
    let (ours, others): (Vec<&Flown>, Vec<&Flown>) =
        flown.iter().partition(|law| law.law.controller == OURS);
    let outside: Vec<&Flown> =
        others.iter().copied().filter(|law| !law.law.is_predictive()).collect();
    let are_all_outside = outside.len() == others.len();
    let mut groups = vec![("laws on the default stack", outside)];
    if !are_all_outside {
        groups.push(("all other laws, those on the predictive stack too", others));
    }
    let of_groups = |own| {
        groups
            .iter()
            .filter(|(_, others)| !others.is_empty())
            .map(move |(group, others)| GroupComparison { own, group, others: others.clone() })
    };
    let rows: Vec<GroupComparison<'_>> = ours.into_iter().flat_map(of_groups).collect();
    let columns = [
        column("hover_p95_mm", "hover, 95 % point [mm]", |row: &GroupComparison<'_>| {
            row.own.quantile_interval(HOVER, 0.95)
        }),
        column("hover_ratio", "hover of the best other over its own, median", ratio(HOVER)),
        column("hover_worse_percent", "worse in hover [% of draws]", worse_percent(HOVER)),
        column("chirp_ratio", "chirp of the best other over its own, median", ratio(CHIRP)),
        column("chirp_worse_percent", "worse at the chirp [% of draws]", worse_percent(CHIRP)),
        column("doublet_ratio", "doublet of the best other over its own, median", ratio(DOUBLET)),
        column(
            "only_loser",
            "draws with a flight that it did not land as planned and another law did",
            GroupComparison::lost_alone,
        ),
    ];
    let title = "oqtal-dt against the best of the others";
    let names = |row: &GroupComparison<'_>| row.own.names_with(format!("against {}", row.group));
    Sheet::tabulate(("against", title), &columns, &rows, names)
        .with_note(NOTE)
        .without(&not_flown(flown, &columns))
}

/// Median over the draws of the best other figure over that of [`OURS`]; draws without a landing of either are left out.
fn ratio(metric: usize) -> impl Fn(&GroupComparison<'_>) -> BootstrapInterval {
    let middle = |ratios: &[f64]| median(ratios.iter().copied()).unwrap_or(f64::NAN);
    move |row| {
        let ratios = row.pairs(metric).map(|[own, other]| other / own);
        BootstrapInterval::of(&ratios.collect::<Vec<_>>(), middle)
    }
}

/// Percentage of draws in which the best other law is better \[%\].
fn worse_percent(metric: usize) -> impl Fn(&GroupComparison<'_>) -> BootstrapInterval {
    move |row| {
        let worse = row.pairs(metric).map(|[own, other]| if own > other { 1e2 } else { 0.0 });
        BootstrapInterval::of(&worse.collect::<Vec<_>>(), mean)
    }
}

impl GroupComparison<'_> {
    /// Figures of each draw: [`OURS`], and the best other law.
    fn pairs(&self, metric: usize) -> impl Iterator<Item = [f64; 2]> {
        let own = self.own.values(metric).into_iter().enumerate();
        own.map(move |(draw, own)| [own, best(&self.others, (draw, metric))])
    }

    /// Number of draws with a test that this law did not land as planned and another law did.
    fn lost_alone(&self) -> u64 {
        let others_land =
            |draw: usize, test| self.others.iter().any(|law| law.runs[draw].is_as_planned(test));
        let is_lost = |draw: &usize| {
            let own = &self.own.runs[*draw];
            Test::ALL.into_iter().any(|test| !own.is_as_planned(test) && others_land(*draw, test))
        };
        (0..self.own.runs.len()).filter(is_lost).count() as u64
    }
}

/// Least value of a figure among `laws` in a draw.
pub(super) fn best(laws: &[&Flown], (draw, metric): (usize, usize)) -> f64 {
    laws.iter().map(|law| law.runs[draw].figures[metric]).fold(f64::NAN, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::tests::flown;

    #[test]
    fn each_draw_is_compared_with_the_best_of_each_group() {
        let lost = f64::INFINITY;
        let laws = [
            flown("oqtal-dt", &[1.0, 2.0, lost, lost]),
            flown("pid", &[2.0, 8.0, 5.0, lost]),
            flown("lqr", &[3.0, 4.0, lost, lost]),
            flown("mpc", &[0.5, 9.0, lost, lost]),
        ];
        let sheet = table(&laws);
        let number = |row: usize, key: &str| sheet.rows[row].number(&sheet.columns, key);
        // Ratios: 2/1, 4/2, 5/inf; the last draw, which no law landed, is left out.
        assert_eq!([number(0, "hover_ratio"), number(1, "hover_ratio")], [2.0, 0.5]);
        assert_eq!(
            [number(0, "hover_worse_percent"), number(1, "chirp_worse_percent")],
            [25.0, 50.0]
        );
        assert_eq!(sheet.rows[0].cells[6].show(), "1");
        assert_eq!(table(&laws[..3]).rows.len(), 1, "no other law is on the predictive stack");
        assert!(table(&laws[..1]).rows.is_empty());
    }
}
