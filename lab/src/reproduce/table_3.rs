//! Table III: the PID tuned for the gravity turn by an artificial bee colony.

use std::ops::RangeInclusive;

use crate::tune::bee_colony::BeeColony;
use oqtal_control::controller::RateFeedback;
use oqtal_control::metrics::{CostWeights, TableTwo};
use oqtal_control::options::OptionError;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use super::lander::{Descent, Lander};
use super::progress::Progress;
use super::sheet::{Cell, Column, Row, Sheet, Variant};
use super::words::{about, either};
use super::{Chapter, invalid, roster};

/// The gains `c`, `k` \[1/s^2\] and `T` \[s\] are searched within these. Not in the paper.
const BOUNDS: [RangeInclusive<f64>; 3] = [0.1..=50.0, 0.1..=50.0, 0.1..=20.0];
/// The colony: 10 sources for 100 cycles.
const COLONY: BeeColony = BeeColony { sources: 10, cycles: 100, limit: 30, pull: 0.0, seed: 1 };
/// The weights `[q, r]` of the paper's columns.
const WEIGHTS: [[f64; 2]; 4] = [[1.0, 1.0], [10.0, 1.0], [100.0, 1.0], [1.0, 0.0]];

const COLUMNS: [Column; 8] = [
    ("weights", "[q, r]"),
    ("c", "c [1/s]"),
    ("k", "k [1/s²]"),
    ("t", "T [s]"),
    ("position_error", "position ∫|x̃| [m s]"),
    ("quaternion_error_norm", "error ∫|ε| [s]"),
    ("effort_norm", "effort ∫|τ| [N m s]"),
    ("fitness", "fitness"),
];

/// Position error, quaternion error, effort, fitness: as printed.
const PAPER: [[f64; 4]; 4] = [
    [80.3, 0.1280, 0.2609, 0.3889],
    [29.78, 0.0349, 0.8252, 1.1744],
    [29.8, 0.0328, 0.9476, 4.2286],
    [49.1, 0.0754, 0.3955, 0.4709],
];

/// A way to read "tuned PID".
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
/// An option of the law has no meaning.
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let bar = progress.start("Table III", 12 * COLONY.most_evaluations());
    let cases: Vec<(&Reading, [f64; 2])> =
        READINGS.iter().flat_map(|reading| WEIGHTS.map(|weights| (reading, weights))).collect();
    let tune = |(reading, weights): &(&Reading, [f64; 2])| tuned(lander, reading, *weights, &bar);
    let rows: Result<Vec<Row>, OptionError> = cases.par_iter().map(tune).collect();
    let mut sheet = Sheet {
        name: "III".to_owned(),
        title: "Table III: the PID tuned by an artificial bee colony".to_owned(),
        columns: COLUMNS.to_vec(),
        rows: paper().chain(rows.map_err(invalid)?).collect(),
        ..Sheet::default()
    };
    sheet.notes = NOTES.map(str::to_owned).into_iter().chain([verdict(&sheet)]).collect();
    Ok(Chapter { title: "Tuning of the PID", sheets: vec![sheet], ..Chapter::default() })
}

const NOTES: [&str; 2] = [
    "The colony has 10 sources and flies 100 cycles from one seed; c and k are searched in 0.1..50, T in 0.1..20 s. The paper \
     prints neither bounds nor budget.",
    "The paper contradicts itself in the last column: the fitness for [1, 0] must equal the quaternion error, 0.0754; printed \
     is the fitness for [1, 1] of those figures. And its quaternion error is worse than those of [10, 1] and [100, 1], which \
     weigh effort too: it is no optimum.",
];

/// What the tuned PIDs come to beside the printed ones.
fn verdict(sheet: &Sheet) -> String {
    // The rows of a reading, in the order of the weights: error, effort, fitness.
    let read = |reading: &Reading| -> Vec<[f64; 3]> {
        let rows = sheet.of(reading.variant).filter(|row| row.settings == reading.settings);
        let keys = ["quaternion_error_norm", "effort_norm", "fitness"];
        rows.map(|row| keys.map(|key| row.number(&sheet.columns, key))).collect()
    };
    let (printed, omega_e) = (read(&READINGS[0]), read(&READINGS[2]));
    // Of the printed figures, not the printed one: the latter is a misprint for [1, 0].
    let fitness = |[q, r]: [f64; 2], paper: [f64; 4]| q * paper[1] + r * paper[2];
    let times: Vec<f64> = printed
        .iter()
        .zip(WEIGHTS.into_iter().zip(PAPER))
        .map(|(row, (weights, paper))| fitness(weights, paper) / row[2])
        .collect();
    let [least, most] = [f64::min, f64::max].map(|pick| times.iter().copied().fold(times[0], pick));
    // The first three columns: q rises.
    let trend =
        printed[..3].windows(2).all(|pair| pair[1][0] < pair[0][0] && pair[1][1] > pair[0][1]);
    let ahead =
        omega_e.iter().zip(PAPER).filter(|(row, paper)| row[0] < paper[1] && row[1] < paper[2]);
    format!(
        "Tuned within wide bounds, the paper's own PID has a fitness {} to {} times lower than that of the printed errors and efforts. Less error for more effort \
         as q rises: {}. Given the rate error, the PID has less error for less effort than printed in {} of {} columns.",
        about(least),
        about(most),
        either(trend, "reproduces", "does not reproduce"),
        ahead.count(),
        PAPER.len()
    )
}

fn paper() -> impl Iterator<Item = Row> {
    WEIGHTS.into_iter().zip(PAPER).map(|(weights, [position, error, effort, fitness])| {
        let gains = [Cell::None, Cell::None, Cell::None];
        let numbers = [position, error, effort, fitness].map(Cell::from);
        Row::new(Variant::Paper, "pid", "", cells(weights, gains, numbers))
    })
}

fn cells(weights: [f64; 2], gains: [Cell; 3], numbers: [Cell; 4]) -> Vec<Cell> {
    let [q, r] = weights;
    [Cell::Text(format!("[{q}, {r}]"))].into_iter().chain(gains).chain(numbers).collect()
}

fn tuned(
    lander: &Lander,
    reading: &Reading,
    weights: [f64; 2],
    bar: &super::progress::Bar,
) -> Result<Row, OptionError> {
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
    let gains = [0, 1, 2].map(|axis| Cell::from(best.point[axis]));
    let numbers = [metrics.position_error, metrics.quaternion_error, metrics.effort, best.value]
        .map(Cell::from);
    Ok(Row::new(reading.variant, "pid", reading.settings, cells(weights, gains, numbers)))
}
