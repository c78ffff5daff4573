//! The objective of a search: figures of a law over those of the reference.

use oqtal_control::statistics::mean;

use super::trade::{MetricWeights, WORST_SHARE};
use crate::study::Flown;
use crate::study::metric::{Figures, METRICS};

/// Figures of a law over `draws` of the vehicle, 0 for plants near the configured one, of which the objective is made; infinite if a
/// flight near the configured plant did not land, NaN for one without a meaning for the flights.
pub(super) fn figures(draws: usize, flown: &Flown, reference: &Figures) -> Figures {
    std::array::from_fn(|metric| {
        let figures = flown.bounded_values(metric);
        match draws {
            0 => mean(&figures),
            _ => quadratic_mean(&figures, WORST_SHARE * reference[metric]),
        }
    })
}

/// Weighted mean of the metrics, each divided by the reference \[-\]; lower is better. Metrics without a meaning for the flights
/// are left out: the reference may have figures of the shipped vehicle there.
pub(super) fn objective(figures: &Figures, reference: &Figures, weights: &MetricWeights) -> f64 {
    let has_meaning = |metric: &usize| !reference[*metric].is_nan() && !figures[*metric].is_nan();
    let counted = (0..METRICS).filter(has_meaning);
    let total: f64 = counted.clone().map(|metric| weights[metric]).sum();
    // A weight of zero leaves out an infinite figure, too.
    let share = |k: usize| match weights[k] {
        0.0 => 0.0,
        weight => weight * figures[k] / reference[k].max(1e-9),
    };
    counted.map(share).sum::<f64>() / total
}

/// Quadratic mean of a figure over the draws, each at most `greatest`; the worst draws have the greatest weight. NaN if one is NaN.
fn quadratic_mean(figures: &[f64], greatest: f64) -> f64 {
    let bounded = |figure: f64| if figure > greatest { greatest } else { figure };
    let squares: f64 = figures.iter().map(|figure| bounded(*figure).powi(2)).sum();
    (squares / figures.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tune::trade::default_weights;

    #[test]
    fn the_objective_of_the_reference_is_one() {
        let figures = std::array::from_fn(|index| 1.0 + index as f64);
        assert!((objective(&figures, &figures, &default_weights()) - 1.0).abs() < 1e-12);
    }
}
