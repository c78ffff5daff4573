//! Runs of one law, and their statistics.

use oqtal_control::statistics::{mean, standard_deviation};
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use super::flights::{Contender, FlyMission, PlantVariant, Trial};
use super::metric::{Figures, METRIC, METRICS, POSITION};

/// Seeds of the flights by which gains are compared; none of them is used for tuning.
pub const EVALUATION_SEEDS: std::ops::Range<u64> = 200..225;
/// Seeds of the flights on which gains are tuned.
pub const TRAINING_SEEDS: std::ops::Range<u64> = 101..107;

/// The runs of one law on one plant.
#[derive(Clone, Debug)]
pub struct Runs {
    /// The figures of each seed.
    pub figures: Vec<Figures>,
    /// Greatest number of Riccati equations solved in a square \[-\].
    pub solves: u64,
}

impl Runs {
    /// Flies every test with every seed, in parallel.
    ///
    /// # Errors
    /// A setting is wrong.
    pub fn fly(
        contender: &Contender,
        plant: &PlantVariant,
        seeds: std::ops::Range<u64>,
    ) -> Result<Self, Failure> {
        let trial = Trial::new(contender, plant)?;
        let flown: Result<Vec<(Figures, u64)>, Failure> =
            seeds.into_par_iter().map(|seed| trial.fly(seed)).collect();
        Ok(Self::from_iter(flown?))
    }

    /// Flies every test with every seed, one after the other, each flown by `fly`.
    ///
    /// # Errors
    /// A setting is wrong, or `fly` failed.
    pub fn fly_in_turn(
        contender: &Contender,
        plant: &PlantVariant,
        seeds: std::ops::Range<u64>,
        fly: &mut FlyMission<'_>,
    ) -> Result<Self, Failure> {
        let trial = Trial::new(contender, plant)?;
        seeds.map(|seed| trial.fly_by(seed, fly)).collect()
    }

    /// The `count` runs with the least position error.
    #[must_use]
    pub fn best(&self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.figures.len()).collect();
        order.sort_by(|a, b| self.figures[*a][POSITION].total_cmp(&self.figures[*b][POSITION]));
        order.truncate(count);
        order
    }

    /// Mean and standard deviation of each metric over `runs`.
    #[must_use]
    pub fn spread(&self, runs: &[usize]) -> [(f64, f64); METRICS] {
        std::array::from_fn(|metric| {
            let values: Vec<f64> = runs.iter().map(|run| self.figures[*run][metric]).collect();
            (mean(&values), standard_deviation(&values))
        })
    }

    /// One metric of every run.
    #[must_use]
    pub fn values(&self, metric: usize) -> Vec<f64> {
        self.figures.iter().map(|figures| figures[metric]).collect()
    }

    /// Mean of each metric over all runs.
    #[must_use]
    pub fn mean(&self) -> Figures {
        let all: Vec<usize> = (0..self.figures.len()).collect();
        self.spread(&all).map(|(mean, _)| mean)
    }
}

impl FromIterator<(Figures, u64)> for Runs {
    fn from_iter<I: IntoIterator<Item = (Figures, u64)>>(flown: I) -> Self {
        let (figures, solves): (Vec<Figures>, Vec<u64>) = flown.into_iter().unzip();
        Self { figures, solves: solves.into_iter().max().unwrap_or(0) }
    }
}

/// The objective of tuning \[-\]: the weighted mean of the metrics, each over that of a reference.
#[must_use]
pub fn objective(figures: &Figures, reference: &Figures) -> f64 {
    let weights: f64 = METRIC.iter().map(|metric| metric.weight).sum();
    let share = |index: usize| METRIC[index].weight * figures[index] / reference[index].max(1e-9);
    (0..METRICS).map(share).sum::<f64>() / weights
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_runs_are_those_with_the_least_position_error() {
        let figures = [0.3, 0.1, f64::INFINITY, 0.2].map(|error| {
            let mut figures = [1.0; METRICS];
            figures[POSITION] = error;
            figures
        });
        let runs = Runs { figures: figures.to_vec(), solves: 1 };
        assert_eq!(runs.best(2), [1, 3]);
        let (mean, sd) = runs.spread(&runs.best(2))[POSITION];
        assert!((mean - 0.15).abs() < 1e-12 && (sd - 0.005_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn seeds_for_judging_are_not_those_for_tuning() {
        assert!(TRAINING_SEEDS.clone().all(|seed| !EVALUATION_SEEDS.contains(&seed)));
    }

    #[test]
    fn the_objective_of_the_reference_is_one() {
        let figures = std::array::from_fn(|index| 1.0 + index as f64);
        assert!((objective(&figures, &figures) - 1.0).abs() < 1e-12);
    }
}
