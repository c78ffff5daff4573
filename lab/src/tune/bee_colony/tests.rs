//! Tests of the colony on functions with a known minimum.

use std::cell::Cell;
use std::f64::consts::TAU;

use proptest::prelude::*;

use super::*;

/// Plain and guided colonies, each from three seeds.
const COLONIES: [(f64, u64); 6] = [(0.0, 0), (0.0, 1), (0.0, 2), (1.5, 0), (1.5, 1), (1.5, 2)];

fn sphere(x: &[f64]) -> f64 {
    x.iter().map(|xi| xi * xi).sum()
}

fn rastrigin(x: &[f64]) -> f64 {
    x.iter().map(|xi| xi * xi - 10.0 * (TAU * xi).cos() + 10.0).sum()
}

fn minimum(
    objective: fn(&[f64]) -> f64,
    dimensions: usize,
    budget: usize,
    (pull, seed): (f64, u64),
) -> Best {
    let bounds = vec![-5.0..=5.0; dimensions];
    let colony = BeeColony { pull, ..BeeColony::within(budget, dimensions, seed) };
    colony.minimise(&bounds, &[], |points| points.iter().map(|x| objective(x)).collect())
}

#[test]
fn the_search_finds_the_minimum_of_a_paraboloid() {
    for colony in COLONIES {
        let best = minimum(sphere, 4, 4200, colony);
        assert!(best.value < 1e-6, "{best:?}");
    }
}

#[test]
fn the_search_leaves_local_minima() {
    for colony in COLONIES {
        let best = minimum(rastrigin, 4, 8400, colony);
        assert!(best.value < 1e-3, "{best:?}");
    }
}

#[test]
fn a_good_start_is_never_lost() {
    let bounds = vec![-5.0..=5.0; 6];
    let colony = BeeColony::within(60, 6, 3);
    let start = vec![vec![1e-3; 6]];
    let evaluate = |points: &[Vec<f64>]| points.iter().map(|x| sphere(x)).collect();
    assert!(colony.minimise(&bounds, &start, evaluate).value <= sphere(&start[0]));
}

#[test]
fn an_objective_without_values_leaves_no_best_value() {
    let colony = BeeColony::within(100, 2, 1);
    let bounds = [0.0..=1.0, 0.0..=1.0];
    let best = colony.minimise(&bounds, &[], |points| vec![f64::NAN; points.len()]);
    assert_eq!(best.value, f64::INFINITY);
    assert_eq!(best.point.len(), 2);
}

proptest! {
    #[test]
    fn the_search_stays_within_bounds_and_budget_and_repeats(
        seed in any::<u64>(),
        budget in 2_usize..400,
        low in -3.0..0.0_f64,
        width in 0.0..4.0_f64,
    ) {
        let bounds = [low..=low + width, 0.5..=0.5, -1.0..=1.0];
        let colony = BeeColony::within(budget, 3, seed);
        let seen = Cell::new(0);
        let search = || {
            colony.minimise(&bounds, &[], |points| {
                seen.set(seen.get() + points.len());
                for point in points {
                    assert!(point.iter().zip(&bounds).all(|(x, axis)| axis.contains(x)));
                }
                points.iter().map(|x| sphere(x)).collect()
            })
        };
        let best = search();
        prop_assert_eq!(best.evaluations, seen.get());
        prop_assert!(best.evaluations <= budget);
        prop_assert_eq!(best.value, sphere(&best.point));
        prop_assert_eq!(search(), best);
    }
}

#[test]
fn guidance_saves_evaluations() {
    let values =
        |pull: f64| (0..20).map(move |seed| minimum(sphere, 7, 410, (pull, seed)).value.ln());
    assert!(values(1.5).sum::<f64>() < values(0.0).sum::<f64>());
}
