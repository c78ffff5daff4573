//! `oqtal-dt` against the best of the others, draw by draw.

use super::flown::Judged;
use super::statistics::Quantiles;
use crate::campaign::flights::Test;
use crate::campaign::metric::{CHIRP, DOUBLET, HOVER};
use crate::sheet::{Column, Sheet, SheetCell, SheetRow, Variant};

/// The law that is compared with all others.
const OURS: &str = "oqtal-dt";

const COLUMNS: [Column; 7] = [
    ("hover_p95_mm", "hover, 95 % point [mm]"),
    ("hover_ratio", "hover of the best other over its own, median"),
    ("hover_worse_percent", "worse in hover [% of draws]"),
    ("chirp_ratio", "chirp of the best other over its own, median"),
    ("chirp_worse_percent", "worse at the chirp [% of draws]"),
    ("doublet_ratio", "doublet of the best other over its own, median"),
    ("only_loser", "draws with a flight that it did not land and another law did"),
];

/// The table; without rows if only one law flies.
#[must_use]
pub fn table(judged: &[Judged]) -> Sheet {
    let ours = judged.iter().filter(|law| law.rival.controller == OURS);
    let rows = ours.flat_map(|own| {
        let others = || judged.iter().filter(|law| law.rival.controller != OURS);
        let outside: Vec<&Judged> = others().filter(|law| !law.rival.is_predictive).collect();
        [
            ("laws in surroundings of their own", outside),
            ("all other laws, those within its prediction too", others().collect()),
        ]
        .into_iter()
        .filter(|(_, others)| !others.is_empty())
        .map(|(name, others)| row(own, (name, &others)))
        .collect::<Vec<_>>()
    });
    Sheet {
        name: "against".to_owned(),
        title: "oqtal-dt against the best of the others".to_owned(),
        notes: vec![NOTE.to_owned()],
        columns: COLUMNS.to_vec(),
        rows: rows.collect(),
        ..Sheet::default()
    }
}

const NOTE: &str = "In each draw the best of the others in that figure, whatever its gains: no single law has all of these figures. \
     The settings say who the others are.";

fn row(own: &Judged, (name, others): (&str, &[&Judged])) -> SheetRow {
    let compared = |metric: usize| -> (SheetCell, SheetCell) {
        let pairs: Vec<[f64; 2]> = own
            .figures
            .iter()
            .enumerate()
            .map(|(draw, figures)| [figures[metric], best(others, (draw, metric))])
            .collect();
        let worse = pairs.iter().filter(|[own, other]| own > other).count();
        let share = 1e2 * worse as f64 / pairs.len() as f64;
        (ratio(&pairs).into(), SheetCell::Number(share))
    };
    let (hover, hover_worse) = compared(HOVER);
    let (chirp, chirp_worse) = compared(CHIRP);
    let p95 = Quantiles::of(&own.values(HOVER)).p95;
    let lost = SheetCell::Count(lost_alone(own, others) as u64);
    let cells = vec![p95.into(), hover, hover_worse, chirp, chirp_worse, compared(DOUBLET).0, lost];
    SheetRow::new(Variant::Ours, own.rival.name.clone(), format!("against {name}"), cells)
}

/// The least of a figure among the others in a draw.
fn best(others: &[&Judged], (draw, metric): (usize, usize)) -> f64 {
    others.iter().map(|law| law.figures[draw][metric]).fold(f64::INFINITY, f64::min)
}

/// Median of the other's figure over the own one; NaN where neither landed is left out.
fn ratio(pairs: &[[f64; 2]]) -> f64 {
    let mut ratios: Vec<f64> =
        pairs.iter().map(|[own, other]| other / own).filter(|ratio| !ratio.is_nan()).collect();
    ratios.sort_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Number of draws in which some test was not landed by this law, and was by another.
fn lost_alone(own: &Judged, others: &[&Judged]) -> usize {
    let lost = |draw: &usize| {
        let own = Judged::landed(&own.figures[*draw]);
        (0..Test::ALL.len()).any(|test| {
            !own[test].1 && others.iter().any(|law| Judged::landed(&law.figures[*draw])[test].1)
        })
    };
    (0..own.figures.len()).filter(lost).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::metric::METRICS;
    use crate::robustness::flown::Rival;

    fn judged(controller: &'static str, is_predictive: bool, figures: &[f64]) -> Judged {
        let rival = Rival {
            name: controller.to_owned(),
            controller,
            settings: Vec::new(),
            remark: String::new(),
            is_predictive,
        };
        Judged { rival, figures: figures.iter().map(|figure| [*figure; METRICS]).collect() }
    }

    #[test]
    fn each_draw_is_compared_with_the_best_of_each_group() {
        let lost = f64::INFINITY;
        let laws = [
            judged("oqtal-dt", true, &[1.0, 2.0, lost, lost]),
            judged("pid", false, &[2.0, 8.0, 5.0, lost]),
            judged("lqr", false, &[3.0, 4.0, lost, lost]),
            judged("mpc", true, &[0.5, 9.0, lost, lost]),
        ];
        let sheet = table(&laws);
        let number = |row: usize, key: &str| sheet.rows[row].number(&sheet.columns, key);
        // 2/1, 4/2, 5/inf; of the last draw, which nobody landed, nothing is said.
        assert_eq!([number(0, "hover_ratio"), number(1, "hover_ratio")], [2.0, 0.5]);
        assert_eq!(
            [number(0, "hover_worse_percent"), number(1, "chirp_worse_percent")],
            [25.0, 50.0]
        );
        assert_eq!(sheet.rows[0].cells[6].show(), "1");
        assert!(table(&laws[..1]).rows.is_empty());
    }
}
