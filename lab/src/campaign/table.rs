//! Table V: a row of figures for each law.

use crate::sheet::{Column, SheetCell, SheetRow};
use crate::study::Flown;
use crate::study::metric::{METRIC, METRICS, POSITION};
use crate::study::table::{marked, mean_of, spread};

/// The columns: the metrics, then counts.
pub const COLUMNS: [Column; METRICS + 5] = {
    let mut columns = [("", ""); METRICS + 5];
    let mut index = 0;
    while index < METRICS {
        columns[index] = (METRIC[index].key, METRIC[index].title);
        index += 1;
    }
    columns[METRICS] = ("riccati_solves", "Riccati solves");
    columns[METRICS + 1] = ("max_q", "max q");
    columns[METRICS + 2] = ("max_q_is", "max q is");
    columns[METRICS + 3] = ("runs", "runs");
    columns[METRICS + 4] = ("best", "best");
    columns
};

/// Number of leading metrics with a spread in the paper's Table V.
const SPREADS: usize = 3;

/// The greatest weight, or gain, of a law before its attitude error rises.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaxQ {
    /// The weight \[-\].
    pub weight: f64,
    /// Method by which the weight was found, as text.
    pub found: &'static str,
}

/// Row of a law. For the metrics with a spread, the `best` runs are averaged. Flights that did not land are left out.
pub fn row(flown: &Flown, best: usize, max_q: Option<MaxQ>) -> SheetRow {
    let wanted = best.min(flown.runs.len());
    let best = best_runs(flown, wanted);
    let cell = |metric: usize| match metric {
        _ if metric < SPREADS => {
            let values = flown.values(metric);
            let values: Vec<f64> = best.iter().map(|run| values[*run]).collect();
            marked(spread(&values), best.len() < wanted)
        }
        // All runs: a choice of runs by position error would bias the other metrics.
        _ => mean_of(&flown.values(metric)),
    };
    let counts = [
        SheetCell::Count(flown.riccati_solves()),
        max_q.map(|it| it.weight).into(),
        max_q.map(|it| it.found).into(),
        SheetCell::Count(flown.runs.len() as u64),
        SheetCell::Count(best.len() as u64),
    ];
    let (_, variant, settings) = flown.names();
    let cells = (0..METRICS).map(cell).chain(counts).collect();
    SheetRow::new(variant, flown.law.controller, settings, cells)
}

/// The `count` runs with the least position error; fewer if fewer landed.
fn best_runs(flown: &Flown, count: usize) -> Vec<usize> {
    let errors = flown.values(POSITION);
    let mut order: Vec<usize> = (0..errors.len()).filter(|run| errors[*run].is_finite()).collect();
    order.sort_by(|a, b| errors[*a].total_cmp(&errors[*b]));
    order.truncate(count);
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::tests::flown;

    #[test]
    fn the_best_runs_are_those_with_the_least_position_error() {
        let flown = flown("pid", &[0.3, 0.1, f64::INFINITY, 0.2]);
        assert_eq!(best_runs(&flown, 2), [1, 3]);
        let SheetCell::Spread(mean, sd) = row(&flown, 2, None).cells[POSITION] else {
            panic!("no spread")
        };
        assert!((mean - 0.15).abs() < 1e-12 && (sd - 0.005_f64.sqrt()).abs() < 1e-12);
        assert_eq!(best_runs(&flown, 4), [1, 3, 0], "a flight that did not land is not averaged");
        assert_eq!(row(&flown, 4, None).cells[POSITION].show(), "0.2000 ± 0.10 *");
    }

    #[test]
    fn a_single_run_has_no_standard_deviation() {
        let cell = &row(&flown("pid", &[0.3]), 1, None).cells[POSITION];
        assert_eq!(cell.show(), "0.3000");
        assert_eq!(cell.to_json(), serde_json::json!({ "mean": 0.3, "sd": null }));
    }
}
