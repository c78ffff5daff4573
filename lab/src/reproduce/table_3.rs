//! Table III: the PID tuned for the gravity turn by an artificial bee colony.

use std::ops::RangeInclusive;

use crate::tune::bee_colony::BeeColony;
use oqtal_control::controller::RateFeedback;
use oqtal_control::metrics::{CostWeights, TableTwo};
use oqtal_control::options::OptionError;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use super::chapter::{Chapter, invalid};
use super::expression::TextValues;
use super::lander::{Descent, Lander};
use super::roster;
use super::text;
use crate::progress::Progress;
use crate::sheet::{SheetCell, SheetRow, Variant};

/// Bounds of the search for the gains `c` \[1/s\], `k` \[1/s^2\] and `T` \[s\]. Not in the paper.
const BOUNDS: [RangeInclusive<f64>; 3] = [0.1..=50.0, 0.1..=50.0, 0.1..=20.0];
/// The colony: 10 sources for 100 cycles.
const COLONY: BeeColony = BeeColony { sources: 10, cycles: 100, limit: 30, pull: 0.0, seed: 1 };
/// Weights `[q, r]` of the paper's columns.
const WEIGHTS: [[f64; 2]; 4] = [[1.0, 1.0], [10.0, 1.0], [100.0, 1.0], [1.0, 0.0]];

/// Interpretation of "tuned PID".
struct Reading {
    variant: Variant,
    settings: &'static str,
    rate: RateFeedback,
    fitness: fn(&TableTwo, CostWeights) -> f64,
}

const READINGS: [Reading; 3] = [
    Reading {
        variant: Variant::AsPrinted,
        settings: "c omega, fitness of norms",
        rate: RateFeedback::Omega,
        fitness: TableTwo::cost_of_norms,
    },
    Reading {
        variant: Variant::AsPrinted,
        settings: "c omega, fitness of squares, Eq. (60)",
        rate: RateFeedback::Omega,
        fitness: TableTwo::cost,
    },
    Reading {
        variant: Variant::Ours,
        settings: "c omega_e, fitness of norms",
        rate: RateFeedback::OmegaE,
        fitness: TableTwo::cost_of_norms,
    },
];

/// Tunes the PID for every pair of weights.
///
/// # Errors
/// An option of the law is invalid.
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let bar = progress.start("Table III", 12 * COLONY.most_evaluations());
    let cases: Vec<(&Reading, [f64; 2])> =
        READINGS.iter().flat_map(|reading| WEIGHTS.map(|weights| (reading, weights))).collect();
    let tune = |(reading, weights): &(&Reading, [f64; 2])| tuned(lander, reading, *weights, &bar);
    let rows: Result<Vec<SheetRow>, OptionError> = cases.par_iter().map(tune).collect();
    let sheet = text::table("III", rows.map_err(invalid)?);
    let values = TextValues::new();
    let sheets = vec![text::with_notes(sheet, &values)];
    Ok(Chapter { sheets, ..text::chapter("table-3", &values) })
}

fn tuned(
    lander: &Lander,
    reading: &Reading,
    weights: [f64; 2],
    bar: &crate::progress::Bar,
) -> Result<SheetRow, OptionError> {
    let [q, r] = weights;
    let fly = |point: &[f64]| {
        let options = roster::pid([point[0], point[1], point[2]], reading.rate);
        lander.fly(&options, &Descent::default(), |_| ())
    };
    let fitness = |metrics: &TableTwo| (reading.fitness)(metrics, CostWeights { q, r });
    let evaluate = |points: &[Vec<f64>]| {
        bar.add(points.len());
        let value = |point: &Vec<f64>| {
            let metrics = fly(point).ok().flatten();
            metrics.map_or(f64::INFINITY, |metrics| fitness(&metrics))
        };
        points.iter().map(value).collect()
    };
    let best = COLONY.minimise(&BOUNDS, &[], evaluate);
    let metrics = fly(&best.point)?.unwrap_or_default();
    let figures = [metrics.position_error, metrics.quaternion_error, metrics.effort, best.value];
    let numbers = best.point.iter().copied().chain(figures).map(SheetCell::from);
    let cells = [SheetCell::Text(format!("[{q}, {r}]"))].into_iter().chain(numbers).collect();
    Ok(SheetRow::new(reading.variant, "pid", reading.settings, cells))
}
