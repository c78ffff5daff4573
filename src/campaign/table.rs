//! Table V: runs of every law, as rows.

use oqtal_bus::config::Setting;
use oqtal_bus::process::Failure;
use rayon::prelude::*;

use crate::reproduce::progress::Progress;
use crate::reproduce::sheet::{Cell, Column, Row, Variant};
use crate::tune::{gains, search, space};

use super::flights::{Contender, NOMINAL, Plant, Prepared, Test};
use super::metric::{ATTITUDE, METRIC, METRICS, of_square};
use super::statistics::{EVALUATION_SEEDS, Runs};

/// A law in a table.
#[derive(Clone, Debug)]
pub struct Entrant {
    /// The law with its gains.
    pub contender: Contender,
    /// Where the gains come from.
    pub variant: Variant,
    /// What is to be known of them.
    pub settings: String,
}

/// How much is flown for a row.
#[derive(Clone, Copy, Debug)]
pub struct Scope {
    /// Runs, one for each seed.
    pub runs: u64,
    /// Of them, the best that make up the mean.
    pub best: usize,
    /// Whether the greatest weight is searched.
    pub raises_weights: bool,
}

/// The paper's scope.
pub const PAPER: Scope = Scope { runs: 25, best: 5, raises_weights: true };

/// A weight is raised by this factor until the attitude error rises.
const RAISE: f64 = std::f64::consts::SQRT_2;
/// The attitude error has risen when it is this much above the least seen.
const RISEN: f64 = 1.25;
/// No weight is raised more often.
const MOST_RAISES: usize = 16;
/// Seeds of the flights with raised weights.
const RAISED_SEEDS: std::ops::Range<u64> = 200..202;

/// The columns: the metrics, then counts.
pub const COLUMNS: [Column; METRICS + 4] = {
    let mut columns = [("", ""); METRICS + 4];
    let mut index = 0;
    while index < METRICS {
        columns[index] = (METRIC[index].key, METRIC[index].title);
        index += 1;
    }
    columns[METRICS] = ("riccati_solves", "Riccati solves");
    columns[METRICS + 1] = ("max_q", "max q");
    columns[METRICS + 2] = ("runs", "runs");
    columns[METRICS + 3] = ("best", "best");
    columns
};

/// Of the metrics, the first few have a spread in the paper's Table V.
const SPREADS: usize = 3;

/// The laws of Table V: with the paper's gains, and all tuned alike.
#[must_use]
pub fn entrants() -> Vec<Entrant> {
    let printed = [
        ("pid", "shipped gains, k 8, T 2: the paper prints none", None),
        ("lqr", "q 20 (Table V), delta 0.5 rad", Some(("control.lqr.attitude-weight", 20.0))),
        (
            "oqtal",
            "q 80: four times the classic one",
            Some(("control.oqtal.attitude-weight", 80.0)),
        ),
        ("oqtal", "q 200 (Table V), delta 0.5 rad", Some(("control.oqtal.attitude-weight", 200.0))),
    ];
    let printed = printed.into_iter().map(|(controller, settings, weight)| {
        let setting = |(key, value): (&str, f64)| Setting::flag("Table V", key, value);
        let contender =
            Contender { controller, settings: weight.map(setting).into_iter().collect() };
        Entrant { contender, variant: Variant::AsPrinted, settings: settings.to_owned() }
    });
    let tuned = space::LAWS.iter().map(|law| Entrant {
        contender: Contender { controller: law.controller, settings: gains::tuned(law.controller) },
        variant: Variant::Ours,
        settings: "tuned alike, deploy/tuned".to_owned(),
    });
    printed.chain(tuned).collect()
}

/// Flies every entrant on `plant`.
///
/// # Errors
/// A setting has no meaning.
pub fn rows(
    entrants: &[Entrant],
    plant: &Plant,
    scope: &Scope,
    progress: &Progress,
) -> Result<Vec<Row>, Failure> {
    let bar = progress.start(plant.name, entrants.len());
    let fly = |entrant: &Entrant| {
        let row = row(entrant, plant, scope)?;
        bar.inc();
        Ok(row)
    };
    entrants.iter().map(fly).collect()
}

fn row(entrant: &Entrant, plant: &Plant, scope: &Scope) -> Result<Row, Failure> {
    let seeds = EVALUATION_SEEDS.start..EVALUATION_SEEDS.start + scope.runs;
    let runs = Runs::fly(&entrant.contender, plant, seeds)?;
    let (best, all) = (runs.best(scope.best), runs.best(usize::MAX));
    let (of_best, of_all) = (runs.spread(&best), runs.spread(&all));
    let cell = |index: usize| match index {
        _ if index < SPREADS => Cell::Spread(of_best[index].0, of_best[index].1),
        // All runs: choosing some by their position error would choose the others' luck.
        _ => Cell::Number(of_all[index].0),
    };
    let max_q = match scope.raises_weights {
        true => Cell::Number(greatest_weight(entrant)?),
        false => Cell::None,
    };
    let counts =
        [Cell::Count(runs.solves), max_q, Cell::Count(scope.runs), Cell::Count(best.len() as u64)];
    let cells = (0..METRICS).map(cell).chain(counts).collect();
    let controller = entrant.contender.controller;
    Ok(Row::new(entrant.variant, controller, entrant.settings.clone(), cells))
}

/// The greatest weight, or gain, of a law before the attitude error rises: "incremented until the system started to lose
/// stability".
fn greatest_weight(entrant: &Entrant) -> Result<f64, Failure> {
    let controller = entrant.contender.controller;
    let law = space::LAWS.iter().find(|law| law.controller == controller);
    let key = law.expect("every entrant is a law").gains[0].key;
    let set = entrant.contender.settings.iter().find(|setting| setting.key == key);
    let start = set.and_then(|setting| setting.value.as_float());
    let start = start.unwrap_or_else(|| search::shipped(key));
    let weights: Vec<f64> = (0..MOST_RAISES).map(|k| start * RAISE.powi(k as i32)).collect();
    let errors: Result<Vec<f64>, Failure> =
        weights.par_iter().map(|weight| attitude_error(&entrant.contender, key, *weight)).collect();
    let (mut least, mut greatest) = (f64::INFINITY, start);
    for (weight, error) in weights.iter().zip(errors?) {
        least = error.min(least);
        if error > RISEN * least || !error.is_finite() {
            break;
        }
        greatest = *weight;
    }
    Ok(greatest)
}

fn attitude_error(contender: &Contender, key: &str, weight: f64) -> Result<f64, Failure> {
    let mut contender = contender.clone();
    contender.settings.push(Setting::flag("max q", key, weight));
    let square = Prepared::new(&contender, Test::Square, &NOMINAL)?;
    let mut sum = 0.0;
    for seed in RAISED_SEEDS {
        let flown = square.fly(seed)?;
        sum += flown.map_or(f64::INFINITY, |(flight, _)| of_square(&flight)[ATTITUDE]);
    }
    Ok(sum / (RAISED_SEEDS.end - RAISED_SEEDS.start) as f64)
}
