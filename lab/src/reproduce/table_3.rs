//! Table III: the PID tuned for the gravity turn by an artificial bee colony.

use std::ops::RangeInclusive;

use crate::tune::bee_colony::BeeColony;
use oqtal_bus::message::{FNV_OFFSET, fnv1a};
use oqtal_control::controller::RateFeedback;
use oqtal_control::metrics::{CostWeights, TableTwo};
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use super::chapter::{Chapter, invalid};
use super::expression::TextValues;
use super::lander::{Descent, Lander};
use super::roster;
use super::text;
use crate::progress::{Bar, Progress};
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
/// An option of the law is invalid, or the study was interrupted (exit code 1).
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let cases: Vec<(&Reading, [f64; 2])> =
        READINGS.iter().flat_map(|reading| WEIGHTS.map(|weights| (reading, weights))).collect();
    let bar = progress.start("Table III", cases.len() * COLONY.most_evaluations());
    let row = |(number, (reading, weights)): (usize, &(&Reading, [f64; 2]))| {
        let key = |number: &usize| fnv1a(fnv1a(FNV_OFFSET, b"Table III"), &number.to_le_bytes());
        let bits = progress.kept(number, key, |_| {
            let numbers = tuned((lander, progress), reading, *weights, &bar)?;
            Ok(numbers.map(f64::to_bits))
        })?;
        let [q, r] = weights;
        let numbers = bits.map(|bits| SheetCell::Number(f64::from_bits(bits)));
        let cells = [SheetCell::Text(format!("[{q}, {r}]"))].into_iter().chain(numbers).collect();
        Ok(SheetRow::new(reading.variant, "pid", reading.settings, cells))
    };
    let rows: Result<Vec<SheetRow>, Failure> = cases.par_iter().enumerate().map(row).collect();
    let sheet = text::table("III", rows?);
    let values = TextValues::new();
    let sheets = vec![text::with_notes(sheet, &values)];
    Ok(Chapter { sheets, ..text::chapter("table-3", &values) })
}

/// Gains `c`, `k` and `T` of the best PID, followed by its position error, quaternion error, effort and fitness.
fn tuned(
    (lander, progress): (&Lander, &Progress),
    reading: &Reading,
    [q, r]: [f64; 2],
    bar: &Bar,
) -> Result<[f64; 7], Failure> {
    let fly = |point: &[f64]| {
        let options = roster::pid([point[0], point[1], point[2]], reading.rate);
        lander.fly(&options, &Descent::default(), |_| ())
    };
    let fitness = |metrics: &TableTwo| (reading.fitness)(metrics, CostWeights { q, r });
    let evaluate = |points: &[Vec<f64>]| {
        bar.add(points.len());
        let value = |point: &Vec<f64>| {
            // An interrupted search evaluates nothing more.
            let metrics = progress.check().ok().and_then(|()| fly(point).ok().flatten());
            metrics.map_or(f64::INFINITY, |metrics| fitness(&metrics))
        };
        points.iter().map(value).collect()
    };
    let best = COLONY.minimise(&BOUNDS, &[], evaluate);
    progress.check()?;
    let metrics = fly(&best.point).map_err(invalid)?.unwrap_or_default();
    let [c, k, t] = std::array::from_fn(|axis| best.point[axis]);
    let TableTwo { position_error, quaternion_error, effort, .. } = metrics;
    Ok([c, k, t, position_error, quaternion_error, effort, best.value])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

    #[test]
    fn an_interrupted_table_ends_without_a_result() {
        let last = Arc::new(AtomicU64::new(0));
        let seen = last.clone();
        let is_cancelled = Arc::new(AtomicBool::new(false));
        let cancel = is_cancelled.clone();
        let watch = move |_: &str, done: u64, _: u64| {
            seen.fetch_max(done, Ordering::Relaxed);
            cancel.store(true, Ordering::Relaxed);
        };
        let progress = Progress::watched(Box::new(watch), is_cancelled);
        let interrupted = chapter(&Lander::new().unwrap(), &progress);
        let failure = interrupted.map(|_| ()).unwrap_err();
        assert!(failure.to_string().contains("interrupted"), "{failure}");
        assert!(last.load(Ordering::Relaxed) > 0);
    }
}
