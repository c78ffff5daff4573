//! The optimisers that gains can be tuned with. Both look at whole batches of points, chosen before any of them is
//! evaluated: the result does not depend on the number of threads.

use std::ops::RangeInclusive;

use super::bee_colony::{BeeColony, Best};
use clap::ValueEnum;
use fcmaes_core::{Cmaes, CmaesParams, Fitness};

/// The first standard deviation of CMA-ES, as a share of half a range.
const SPREAD: f64 = 0.3;

/// How the point with the least objective is looked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Optimiser {
    /// Active covariance matrix adaptation (fcmaes)
    #[default]
    CmaEs,
    /// The artificial bee colony, guided, which the paper tunes the PID of Table III with
    BeeColony,
}

impl Optimiser {
    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::CmaEs => "cma-es",
            Self::BeeColony => "bee-colony",
        }
    }

    /// The point within `bounds` at which the objective is least, of about `points` that are looked at, `start` first.
    ///
    /// `evaluate` gives the objective at each point of a batch, in order; a value that is not a number counts as infinite.
    pub fn minimise(
        self,
        bounds: &[RangeInclusive<f64>],
        start: Vec<f64>,
        (points, seed): (usize, u64),
        evaluate: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
    ) -> Best {
        match self {
            Self::BeeColony => {
                let colony = BeeColony::within(points, bounds.len(), seed);
                colony.minimise(bounds, &[start], evaluate)
            }
            Self::CmaEs => cma_es(bounds, start, (points, seed), evaluate),
        }
    }
}

fn cma_es(
    bounds: &[RangeInclusive<f64>],
    start: Vec<f64>,
    (points, seed): (usize, u64),
    mut evaluate: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
) -> Best {
    let low: Vec<f64> = bounds.iter().map(|axis| *axis.start()).collect();
    let high: Vec<f64> = bounds.iter().map(|axis| *axis.end()).collect();
    let mut space = Fitness::bounded(bounds.len(), 1, &low, &high);
    space.set_normalize(true);
    // No population given: that which goes with the dimensions.
    let parameters =
        CmaesParams { popsize: 0, max_evaluations: points as u64, seed, ..CmaesParams::default() };
    let mut search = Cmaes::new(space, &start, &[SPREAD], &parameters);
    let mut best = Best { point: start.clone(), value: f64::INFINITY, evaluations: 0 };
    let mut batch = vec![start];
    loop {
        let values = evaluate(&batch);
        for (point, value) in batch.iter().zip(&values) {
            if *value < best.value {
                best.point.clone_from(point);
                best.value = *value;
            }
        }
        // The start belongs to no generation.
        let converged = best.evaluations > 0 && search.tell(&values) != 0;
        best.evaluations += batch.len();
        if converged || best.evaluations + search.popsize() > points {
            return best;
        }
        batch = search.ask();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: [Optimiser; 2] = [Optimiser::CmaEs, Optimiser::BeeColony];

    fn rosenbrock(x: &[f64]) -> f64 {
        x.windows(2).map(|x| 100.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2)).sum()
    }

    fn minimum(optimiser: Optimiser, points: usize, seed: u64) -> Best {
        let bounds = [-2.0..=3.0, -1.0..=4.0];
        optimiser.minimise(&bounds, vec![-1.5, 2.0], (points, seed), |points| {
            points.iter().map(|x| rosenbrock(x)).collect()
        })
    }

    #[test]
    fn each_follows_a_bent_valley_within_its_budget() {
        for optimiser in BOTH {
            for seed in 0..5 {
                let best = minimum(optimiser, 3000, seed);
                assert!(best.value < 0.05 && best.evaluations <= 3200, "{optimiser:?}: {best:?}");
            }
        }
    }

    #[test]
    fn the_seed_decides_all() {
        for optimiser in BOTH {
            assert_eq!(minimum(optimiser, 100, 7), minimum(optimiser, 100, 7));
            assert_ne!(minimum(optimiser, 100, 7), minimum(optimiser, 100, 8));
        }
    }

    #[test]
    fn a_start_is_the_answer_if_nothing_else_has_a_value() {
        for optimiser in BOTH {
            let best =
                optimiser.minimise(&[0.0..=1.0, 0.0..=1.0], vec![0.5, 0.25], (60, 1), |points| {
                    let value = |x: &Vec<f64>| if x[..] == [0.5, 0.25] { 3.0 } else { f64::NAN };
                    points.iter().map(value).collect()
                });
            assert_eq!((best.point, best.value), (vec![0.5, 0.25], 3.0));
        }
    }
}
