//! Artificial bee colony, a derivative-free optimiser.
//!
//! D. Karaboga and B. Basturk, *J. Global Optimization* 39 (2007) 459; the paper uses it to tune the other laws. A *source* is a
//! point of the search space. In every cycle each source sends out one *employed* bee and, more often the better it is,
//! *onlookers*: each bee evaluates a point that differs from its source in one coordinate, and the source moves there if that is
//! better. A source without improvement for too long is replaced by a *scout*: a point drawn anywhere.
//!
//! All points of a batch are chosen before any of them is evaluated, so that a caller may evaluate a batch in parallel without
//! changing the result.

use std::ops::RangeInclusive;

use crate::random::SplitMix64;

/// An artificial bee colony: extent of its search, and seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeeColony {
    /// Sources, employed bees and onlookers; at least 2.
    pub sources: usize,
    /// Cycles after the first evaluation of every source.
    pub cycles: usize,
    /// Number of bees without improvement after which a source is abandoned.
    pub limit: usize,
    /// Attraction of every bee to the best point so far \[-\]: 0 is Karaboga's colony; 1.5 is the guided one of G.
    /// Zhu and S. Kwong, *Appl. Math. Comput.* 217 (2010) 3166, which needs fewer evaluations.
    pub pull: f64,
    /// Seed of all random choices.
    pub seed: u64,
}

/// The best point found.
#[derive(Clone, Debug, PartialEq)]
pub struct Best {
    /// Coordinates \[units of the searched parameters\].
    pub point: Vec<f64>,
    /// Objective \[-\]; infinite if no point had a value.
    pub value: f64,
    /// Number of points that were evaluated.
    pub evaluations: usize,
}

/// A point under search.
#[derive(Clone, Debug)]
struct FoodSource {
    point: Vec<f64>,
    value: f64,
    /// Number of bees that did not improve it.
    trials: usize,
}

impl Best {
    /// Updates the best point with a batch of points and their values.
    pub(super) fn note(&mut self, points: &[Vec<f64>], values: &[f64]) {
        for (point, value) in points.iter().zip(values) {
            if *value < self.value {
                self.point.clone_from(point);
                self.value = *value;
            }
        }
        self.evaluations += points.len();
    }
}

impl BeeColony {
    /// Guided colony that evaluates at most `budget` points in total, but at least 2, with Karaboga's limit: as many bees as are needed
    /// to try every coordinate of every source.
    pub fn within(budget: usize, dimensions: usize, seed: u64) -> Self {
        let sources = budget.clamp(2, 10);
        // A cycle may have a scout.
        let cycles = budget.saturating_sub(sources) / (2 * sources + 1);
        Self { sources, cycles, limit: sources * dimensions, pull: 1.5, seed }
    }

    /// Greatest number of evaluated points.
    pub fn most_evaluations(&self) -> usize {
        // At most one scout per cycle.
        self.sources + self.cycles * (2 * self.sources + 1)
    }

    /// Returns the point within `bounds` with the least objective of those evaluated.
    ///
    /// `starts` are the first sources; the others are drawn. `evaluate` returns the objective at each point of a batch, in
    /// order; a value that is not a number counts as infinite.
    ///
    /// # Panics
    /// `bounds` is empty.
    pub fn minimise(
        &self,
        bounds: &[RangeInclusive<f64>],
        starts: &[Vec<f64>],
        evaluate: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
    ) -> Best {
        let mut search = ColonySearch::begin(self, bounds, starts, evaluate);
        for _ in 0..self.cycles {
            let everyone = (0..search.sources.len()).collect();
            search.send(everyone);
            let chosen = search.choose();
            search.send(chosen);
            search.scout(self.limit);
        }
        search.best
    }
}

/// Search in progress.
struct ColonySearch<'a, F> {
    pull: f64,
    bounds: &'a [RangeInclusive<f64>],
    evaluate: F,
    random: SplitMix64,
    sources: Vec<FoodSource>,
    best: Best,
}

impl<'a, F: FnMut(&[Vec<f64>]) -> Vec<f64>> ColonySearch<'a, F> {
    fn begin(
        colony: &BeeColony,
        bounds: &'a [RangeInclusive<f64>],
        starts: &[Vec<f64>],
        evaluate: F,
    ) -> Self {
        let mut random = SplitMix64::new(colony.seed);
        let count = colony.sources.max(2);
        let mut points: Vec<Vec<f64>> = starts.iter().take(count).cloned().collect();
        while points.len() < count {
            points.push(anywhere(bounds, &mut random));
        }
        let best = Best { point: points[0].clone(), value: f64::INFINITY, evaluations: 0 };
        let pull = colony.pull;
        let mut search = Self { pull, bounds, evaluate, random, sources: Vec::new(), best };
        let values = search.values_at(&points);
        let source = |(point, value)| FoodSource { point, value, trials: 0 };
        search.sources = points.into_iter().zip(values).map(source).collect();
        search
    }

    /// The objective at `points`.
    fn values_at(&mut self, points: &[Vec<f64>]) -> Vec<f64> {
        let mut values = (self.evaluate)(points);
        values.resize(points.len(), f64::INFINITY);
        values.iter_mut().filter(|value| value.is_nan()).for_each(|value| *value = f64::INFINITY);
        self.best.note(points, &values);
        values
    }

    /// Sends one bee from each of these sources; a source may occur several times.
    fn send(&mut self, from: Vec<usize>) {
        let points: Vec<_> = from.iter().map(|index| self.near(*index)).collect();
        let values = self.values_at(&points);
        for ((index, point), value) in from.into_iter().zip(points).zip(values) {
            let source = &mut self.sources[index];
            if value < source.value {
                *source = FoodSource { point, value, trials: 0 };
            } else {
                source.trials += 1;
            }
        }
    }

    /// Point that differs from a source in one coordinate, by a fraction of the distance to another source and, if the colony is
    /// guided, of the distance to the best point.
    fn near(&mut self, index: usize) -> Vec<f64> {
        let axis = self.random.below(self.bounds.len());
        let other = (index + 1 + self.random.below(self.sources.len() - 1)) % self.sources.len();
        let mut point = self.sources[index].point.clone();
        let distance = point[axis] - self.sources[other].point[axis];
        let bounds = &self.bounds[axis];
        let to_best = self.best.point[axis] - point[axis];
        let moved = point[axis]
            + self.random.between(-1.0, 1.0) * distance
            + self.random.between(0.0, self.pull) * to_best;
        point[axis] = moved.clamp(*bounds.start(), *bounds.end());
        point
    }

    /// Sources of the onlookers, drawn with probabilities proportional to their fitness.
    fn choose(&mut self) -> Vec<usize> {
        let fitness: Vec<f64> = self.sources.iter().map(|source| fitness(source.value)).collect();
        let total: f64 = fitness.iter().sum();
        let mut chosen = Vec::with_capacity(fitness.len());
        for _ in 0..fitness.len() {
            let mut ticket = self.random.between(0.0, total);
            let mut index = 0;
            while index + 1 < fitness.len() && ticket >= fitness[index] {
                ticket -= fitness[index];
                index += 1;
            }
            chosen.push(index);
        }
        chosen
    }

    /// Replaces the source with the most bees without improvement, if their number exceeds `limit`.
    fn scout(&mut self, limit: usize) {
        let exhausted = (0..self.sources.len()).max_by_key(|index| self.sources[*index].trials);
        let Some(index) = exhausted.filter(|index| self.sources[*index].trials > limit) else {
            return;
        };
        let point = anywhere(self.bounds, &mut self.random);
        let value = self.values_at(std::slice::from_ref(&point))[0];
        self.sources[index] = FoodSource { point, value, trials: 0 };
    }
}

/// Point drawn uniformly within the bounds.
fn anywhere(bounds: &[RangeInclusive<f64>], random: &mut SplitMix64) -> Vec<f64> {
    bounds.iter().map(|axis| random.between(*axis.start(), *axis.end())).collect()
}

/// Attraction of a source to onlookers \[-\]: positive, and greater for a lower value.
fn fitness(value: f64) -> f64 {
    if value >= 0.0 { 1.0 / (1.0 + value) } else { 1.0 - value }
}

#[cfg(test)]
mod tests;
