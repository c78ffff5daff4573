//! Distributions of figures over draws, comparisons draw by draw, and what a figure depends on.

use toml::Value;

use super::flown::{Draw, Judged};

/// Median, 95 % point and worst of a figure, and the draw of the worst.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantiles {
    /// Value that half of the draws do not exceed \[unit of the figure\].
    pub median: f64,
    /// Value that 95 of 100 draws do not exceed \[unit of the figure\].
    pub p95: f64,
    /// Greatest value \[unit of the figure\].
    pub worst: f64,
    /// Index of the draw with the greatest value \[-\].
    pub worst_draw: usize,
}

impl Quantiles {
    /// Those of `values`, of which there is at least one; infinite ones, of flights that did not land, are the greatest.
    #[must_use]
    pub fn of(values: &[f64]) -> Self {
        let order = ascending(values);
        let rank = |share: f64| (share * values.len() as f64).ceil() as usize;
        let at = |share: f64| values[order[rank(share).clamp(1, values.len()) - 1]];
        // The first of equal ones, so that it does not depend on the order of sorting.
        let worst_draw = *order.last().expect("there is a draw");
        let worst = values[worst_draw];
        let worst_draw = values.iter().position(|value| *value == worst).unwrap_or(worst_draw);
        Self { median: at(0.5), p95: at(0.95), worst, worst_draw }
    }
}

fn ascending(values: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    order
}

/// Share of the draws in which `law` is worse by a figure than the best of the others \[-\]; NaN without another.
#[must_use]
pub fn worse_than_the_best_other(judged: &[Judged], law: usize, metric: usize) -> f64 {
    let others = |draw: usize| {
        let figures = judged.iter().enumerate().filter(|(index, _)| *index != law);
        figures.map(|(_, other)| other.figures[draw][metric]).fold(f64::NAN, f64::min)
    };
    let own = &judged[law].figures;
    if judged.len() < 2 || own.is_empty() {
        return f64::NAN;
    }
    let worse = own.iter().enumerate().filter(|(draw, figures)| figures[metric] > others(*draw));
    worse.count() as f64 / own.len() as f64
}

/// Spearman's rank correlation of a figure with a drawn key \[-\]; NaN if either is the same in all draws.
#[must_use]
pub fn dependence(values: &[f64], draws: &[Draw], key: &str) -> f64 {
    let drawn = draws.iter().filter_map(|draw| draw.value(key)).map(mean_of).collect::<Vec<_>>();
    if drawn.len() != values.len() {
        return f64::NAN;
    }
    correlation(&ranks(values), &ranks(&drawn))
}

/// A drawn value as one number: the mean of a list's numbers, 0 and 1 of a truth value, the length of a word.
fn mean_of(value: &Value) -> f64 {
    match value {
        Value::Array(values) => values.iter().map(mean_of).sum::<f64>() / values.len() as f64,
        Value::Boolean(truth) => f64::from(u8::from(*truth)),
        Value::String(word) => word.len() as f64,
        other => other.as_float().or(other.as_integer().map(|n| n as f64)).unwrap_or(f64::NAN),
    }
}

/// Ranks of the values; equal ones share the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let order = ascending(values);
    let mut ranks = vec![0.0; values.len()];
    for equal in order.chunk_by(|a, b| values[*a] == values[*b]) {
        let first = order.iter().position(|index| index == &equal[0]).unwrap_or(0);
        let rank = first as f64 + 0.5 * (equal.len() - 1) as f64;
        equal.iter().for_each(|index| ranks[*index] = rank);
    }
    ranks
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let sum = |f: &dyn Fn(f64, f64) -> f64| {
        a.iter().zip(b).map(|(x, y)| f(x - mean_a, y - mean_b)).sum::<f64>()
    };
    sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::metric::{HOVER, METRICS};
    use crate::robustness::flown::Rival;
    use oqtal_config::Setting;

    fn judged(name: &'static str, hover: &[f64]) -> Judged {
        let rival = Rival {
            name: name.to_owned(),
            controller: name,
            settings: Vec::new(),
            remark: String::new(),
            is_predictive: false,
        };
        let figures = hover.iter().map(|value| [*value; METRICS]).collect();
        Judged { rival, figures }
    }

    #[test]
    fn flights_that_did_not_land_are_the_worst() {
        let mut values: Vec<f64> = (0..100).map(f64::from).collect();
        values[17] = f64::INFINITY;
        let quantiles = Quantiles::of(&values);
        assert_eq!((quantiles.median, quantiles.p95), (50.0, 95.0));
        assert_eq!((quantiles.worst, quantiles.worst_draw), (f64::INFINITY, 17));
        assert_eq!(Quantiles::of(&[3.0]).p95, 3.0);
    }

    #[test]
    fn laws_are_compared_draw_by_draw_with_the_best_of_the_others() {
        let laws = [
            judged("a", &[1.0, 5.0, f64::INFINITY]),
            judged("b", &[2.0, 4.0, 9.0]),
            judged("c", &[3.0, 3.0, 1.0]),
        ];
        assert_eq!(worse_than_the_best_other(&laws, 0, HOVER), 2.0 / 3.0);
        assert_eq!(worse_than_the_best_other(&laws, 2, HOVER), 1.0 / 3.0);
        assert!(worse_than_the_best_other(&laws[..1], 0, HOVER).is_nan());
    }

    #[test]
    fn a_figure_depends_on_what_it_rises_with() {
        let draw = |run: u64, lag: f64| Draw {
            run,
            seed: run,
            settings: vec![Setting::flag("", "plant.rate-lag-ms", lag)],
        };
        let draws: Vec<Draw> = (0..9).map(|run| draw(run, (run * run) as f64)).collect();
        let rising: Vec<f64> = (0..9).map(|run| f64::from(run).exp()).collect();
        let falling: Vec<f64> = rising.iter().map(|value| -value).collect();
        assert!((dependence(&rising, &draws, "plant.rate-lag-ms") - 1.0).abs() < 1e-12);
        assert!((dependence(&falling, &draws, "plant.rate-lag-ms") + 1.0).abs() < 1e-12);
        assert!(dependence(&rising, &draws, "plant.mass-kg").is_nan());
    }
}
