//! Optimisers for tuning. All evaluate whole batches of points, chosen before any of them is evaluated, so that the result does
//! not depend on the number of threads.

use std::ops::RangeInclusive;

use clap::ValueEnum;

use super::bee_colony::{BeeColony, Best};
use super::cma_es::CmaEs;
use super::quasi_newton;

/// Initial standard deviation of CMA-ES, over the range of a parameter \[-\].
const SPREAD: f64 = 0.15;
/// The same from the best of several starts, one of which is near the optimum.
const NEAR_SPREAD: f64 = 0.08;

/// An optimiser.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Optimiser {
    /// Evolution strategy with active covariance matrix adaptation
    #[default]
    CmaEs,
    /// The artificial bee colony, guided, which the paper tunes the PID of Table III with
    BeeColony,
    /// A quadratic model from differences along every gain
    QuasiNewton,
}

impl Optimiser {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::CmaEs => "cma-es",
            Self::BeeColony => "bee-colony",
            Self::QuasiNewton => "quasi-newton",
        }
    }

    /// Returns the point within `bounds` with the least objective among about `points` evaluated ones, the `starts` first.
    ///
    /// `evaluate` returns the objective at each point of a batch, in order; NaN counts as infinite.
    pub fn minimise(
        self,
        bounds: &[RangeInclusive<f64>],
        starts: &[Vec<f64>],
        (points, seed): (usize, u64),
        evaluate: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
    ) -> Best {
        match self {
            Self::BeeColony => {
                let colony = BeeColony::within(points, bounds.len(), seed);
                colony.minimise(bounds, starts, evaluate)
            }
            _ => self.minimise_in_cube(bounds, starts, (points, seed), evaluate),
        }
    }

    /// Searches within the unit cube, onto which `bounds` are mapped.
    fn minimise_in_cube(
        self,
        bounds: &[RangeInclusive<f64>],
        starts: &[Vec<f64>],
        (points, seed): (usize, u64),
        mut evaluate: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
    ) -> Best {
        let mut best = Best { point: starts[0].clone(), value: f64::INFINITY, evaluations: 0 };
        // The starts are not part of a batch of the search, which begins at the best of them.
        best.note(starts, &evaluate(starts));
        let start = best.point.clone();
        best.point = into_cube(bounds, &start);
        let from = best.clone();
        let in_cube = |points: &[Vec<f64>]| {
            let batch: Vec<_> = points.iter().map(|point| from_cube(bounds, point)).collect();
            evaluate(&batch)
        };
        match self {
            // Without a value at the start there is no model.
            Self::QuasiNewton if best.value.is_finite() => {
                quasi_newton::minimise(&mut best, points, in_cube);
            }
            _ => {
                let spread = if starts.len() > 1 { NEAR_SPREAD } else { SPREAD };
                cma_es(&mut best, CmaEs::new(&from.point, spread, seed), points, in_cube);
            }
        }
        // The start is not rounded by the mappings.
        let point = if best.point == from.point { start } else { from_cube(bounds, &best.point) };
        Best { point, ..best }
    }
}

/// Point of the unit cube, within `bounds`.
fn from_cube(bounds: &[RangeInclusive<f64>], point: &[f64]) -> Vec<f64> {
    let axis = |(x, axis): (&f64, &RangeInclusive<f64>)| {
        (axis.start() + x * (axis.end() - axis.start())).clamp(*axis.start(), *axis.end())
    };
    point.iter().zip(bounds).map(axis).collect()
}

/// Point within `bounds`, in the unit cube.
fn into_cube(bounds: &[RangeInclusive<f64>], point: &[f64]) -> Vec<f64> {
    let axis = |(x, axis): (&f64, &RangeInclusive<f64>)| match axis.end() - axis.start() {
        0.0 => 0.0,
        width => (x - axis.start()) / width,
    };
    point.iter().zip(bounds).map(axis).collect()
}

/// Searches by generations; points outside the unit cube are moved to its faces.
fn cma_es(
    best: &mut Best,
    mut search: CmaEs,
    points: usize,
    mut evaluate: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
) {
    while best.evaluations + search.points() <= points && !search.has_converged() {
        let mut asked = search.ask();
        asked.iter_mut().flatten().for_each(|x| *x = x.clamp(0.0, 1.0));
        let values = evaluate(&asked);
        best.note(&asked, &values);
        search.tell(&asked, &values);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Optimiser; 3] = [Optimiser::CmaEs, Optimiser::BeeColony, Optimiser::QuasiNewton];

    fn rosenbrock(x: &[f64]) -> f64 {
        x.windows(2).map(|x| 100.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2)).sum()
    }

    fn minimum(optimiser: Optimiser, points: usize, seed: u64) -> Best {
        let bounds = [-2.0..=3.0, -1.0..=4.0];
        optimiser.minimise(&bounds, &[vec![-1.5, 2.0]], (points, seed), |points| {
            points.iter().map(|x| rosenbrock(x)).collect()
        })
    }

    #[test]
    fn each_follows_a_bent_valley_within_its_budget() {
        for optimiser in ALL {
            for seed in 0..5 {
                let best = minimum(optimiser, 3140, seed);
                assert!(best.value < 0.05 && best.evaluations <= 3140, "{optimiser:?}: {best:?}");
            }
        }
    }

    #[test]
    fn the_seed_decides_all() {
        for optimiser in ALL {
            assert_eq!(minimum(optimiser, 100, 7), minimum(optimiser, 100, 7));
            let is_random = optimiser != Optimiser::QuasiNewton;
            let differs = minimum(optimiser, 100, 7) != minimum(optimiser, 100, 8);
            assert_eq!(differs, is_random, "{optimiser:?}");
        }
    }

    #[test]
    fn a_start_is_the_answer_if_nothing_else_has_a_value() {
        for optimiser in ALL {
            let best = optimiser.minimise(
                &[0.0..=1.0, 0.0..=1.0],
                &[vec![0.5, 0.25]],
                (60, 1),
                |points| {
                    let value = |x: &Vec<f64>| if x[..] == [0.5, 0.25] { 3.0 } else { f64::NAN };
                    points.iter().map(value).collect()
                },
            );
            assert_eq!((best.point, best.value), (vec![0.5, 0.25], 3.0));
        }
    }
}
