//! Table V: runs of every law, as rows.

use oqtal_config::Setting;
use oqtal_control::statistics::Interval;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use crate::progress::Progress;
use crate::sheet::{Column, SheetCell, SheetRow, Variant};
use crate::tune::{gains, space, value};

use super::flights::{Contender, NOMINAL, PlantVariant, Prepared, Test};
use super::metric::{ATTITUDE, METRIC, METRICS, of_path};
use super::statistics::{EVALUATION_SEEDS, Runs};

/// A law in a table.
#[derive(Clone, Debug)]
pub struct Entrant {
    /// The law with its gains.
    pub contender: Contender,
    /// Where the gains come from.
    pub variant: Variant,
    /// Remarks on the gains.
    pub settings: String,
}

impl Entrant {
    /// The law `controller` with its gains of `deploy/tuned`, on the shipped vehicle.
    #[must_use]
    pub fn tuned_alike(controller: &'static str) -> Self {
        let settings = gains::tuned(controller);
        let remark = match settings.is_empty() {
            false => "tuned alike, deploy/tuned",
            true => "shipped gains, not tuned",
        };
        Self {
            contender: Contender { controller, settings },
            variant: Variant::Ours,
            settings: remark.to_owned(),
        }
    }

    /// Whether the law is one of those that are tuned alike.
    #[must_use]
    pub fn is_tuned(&self) -> bool {
        self.variant == Variant::Ours
    }
}

/// The greatest weight, or gain, before the attitude error rises.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MaxQ {
    /// The last one before the error rises \[-\].
    Reached(f64),
    /// The last one tried: the error had not risen \[-\].
    AtLeast(f64),
    /// The one of the nominal plant, in a row of another plant \[-\].
    Nominal(f64),
}

impl MaxQ {
    /// The weight.
    #[must_use]
    pub fn weight(self) -> f64 {
        let (Self::Reached(weight) | Self::AtLeast(weight) | Self::Nominal(weight)) = self;
        weight
    }

    /// How the weight was found.
    fn is(self) -> &'static str {
        match self {
            Self::Reached(_) => "reached",
            Self::AtLeast(_) => "at least",
            Self::Nominal(_) => "the nominal plant's",
        }
    }
}

/// Scope of the flights for a row.
#[derive(Clone, Debug)]
pub struct Scope {
    /// Seeds of the runs.
    pub seeds: std::ops::Range<u64>,
    /// Whether the greatest weight is searched.
    pub raises_weights: bool,
}

/// The paper's scope.
pub const PAPER: Scope = Scope { seeds: EVALUATION_SEEDS, raises_weights: true };
/// Number of runs with the least position error that make up the paper's means \[-\].
pub const BEST: usize = 5;

/// Factor by which a weight is raised at a time \[-\].
const RAISE: f64 = std::f64::consts::SQRT_2;
/// Ratio to the least attitude error above which the error has risen \[-\].
const RISEN: f64 = 1.25;
/// Greatest number of times that a weight is raised \[-\].
const MOST_RAISES: usize = 16;
/// Seeds of the flights with raised weights.
const RAISED_SEEDS: std::ops::Range<u64> = 200..202;

/// The columns: the metrics, then counts.
pub const COLUMNS: [Column; METRICS + 5] = {
    let mut columns = [("", ""); METRICS + 5];
    let mut index = 0;
    while index < METRICS {
        columns[index] = (METRIC[index].key, METRIC[index].title);
        index += 1;
    }
    columns[METRICS] = ("riccati_solves", "Riccati solves");
    columns[METRICS + 1] = ("max_q", "max q");
    columns[METRICS + 2] = ("max_q_is", "max q is");
    columns[METRICS + 3] = ("runs", "runs");
    columns[METRICS + 4] = ("best", "best");
    columns
};

/// Of the metrics, the first few have a spread in the paper's Table V.
const SPREADS: usize = 3;

/// The laws of Table V: with the paper's gains, and all tuned alike, on the shipped vehicle.
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
    let tuned = space::LAWS.iter().map(|law| Entrant::tuned_alike(law.controller));
    printed.chain(tuned).collect()
}

/// A law with what came of its runs.
#[derive(Clone, Debug)]
pub struct Flown {
    /// The law.
    pub entrant: Entrant,
    /// Its runs.
    pub runs: Runs,
    max_q: Option<MaxQ>,
}

/// Flies every entrant on `plant`.
///
/// # Errors
/// A setting is invalid.
pub fn fly(
    entrants: &[Entrant],
    plant: &PlantVariant,
    scope: &Scope,
    progress: &Progress,
) -> Result<Vec<Flown>, Failure> {
    let bar = progress.start(plant.name, entrants.len());
    let fly = |entrant: &Entrant| {
        let runs = Runs::fly(&entrant.contender, plant, scope.seeds.clone())?;
        let max_q = match scope.raises_weights {
            true => Some(greatest_weight(entrant)?),
            false => None,
        };
        bar.inc();
        Ok(Flown { entrant: entrant.clone(), runs, max_q })
    };
    entrants.iter().map(fly).collect()
}

/// The rows of what was flown, with the `best` runs of each law averaged.
#[must_use]
pub fn rows(flown: &[Flown], best: usize) -> Vec<SheetRow> {
    flown.iter().map(|flown| flown.row(best)).collect()
}

impl Flown {
    /// The runs of a law whose greatest weight was not searched.
    #[must_use]
    pub fn new(entrant: Entrant, runs: Runs) -> Self {
        Self { entrant, runs, max_q: None }
    }

    /// The name of the law.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.entrant.contender.controller
    }

    /// Whether the law is one of those that are tuned alike.
    #[must_use]
    pub fn is_tuned(&self) -> bool {
        self.entrant.is_tuned()
    }

    /// The mean of a metric over all runs.
    #[must_use]
    pub fn interval(&self, metric: usize) -> Interval {
        Interval::of(&self.runs.values(metric))
    }

    /// The greatest weight, where it was searched.
    #[must_use]
    pub fn max_q(&self) -> Option<MaxQ> {
        self.max_q
    }

    /// Has the greatest weight of the same entrant on the nominal plant.
    pub fn take_max_q_of(&mut self, nominal: &Self) {
        self.max_q = nominal.max_q.map(|max_q| MaxQ::Nominal(max_q.weight()));
    }

    fn row(&self, best: usize) -> SheetRow {
        let best = self.runs.best(best);
        let of_best = self.runs.spread(&best);
        let of_all = self.runs.mean();
        let cell = |index: usize| match index {
            _ if index < SPREADS => SheetCell::Spread(of_best[index].0, of_best[index].1),
            // All runs: choosing some by their position error would choose the others' luck.
            _ => SheetCell::Number(of_all[index]),
        };
        let counts = [
            SheetCell::Count(self.runs.solves),
            self.max_q.map(MaxQ::weight).into(),
            self.max_q.map(MaxQ::is).into(),
            SheetCell::Count(self.runs.figures.len() as u64),
            SheetCell::Count(best.len() as u64),
        ];
        let cells = (0..METRICS).map(cell).chain(counts).collect();
        let Entrant { contender, variant, settings } = &self.entrant;
        SheetRow::new(*variant, contender.controller, settings.clone(), cells)
    }
}

/// The greatest weight, or gain, of a law before the attitude error rises: "incremented until the system started to lose
/// stability".
fn greatest_weight(entrant: &Entrant) -> Result<MaxQ, Failure> {
    let controller = entrant.contender.controller;
    let law = space::LAWS.iter().find(|law| law.controller == controller);
    let key = &law.expect("every entrant is a law").parameters()[0].key;
    let set = entrant.contender.settings.iter().find(|setting| setting.key == *key);
    let start = set.and_then(|setting| setting.value.as_float());
    let start = start.unwrap_or_else(|| value::value_of(&oqtal_config::Config::default(), key));
    let weights: Vec<f64> = (0..MOST_RAISES).map(|k| start * RAISE.powi(k as i32)).collect();
    let errors: Result<Vec<f64>, Failure> =
        weights.par_iter().map(|weight| attitude_error(&entrant.contender, key, *weight)).collect();
    let (mut least, mut greatest) = (f64::INFINITY, start);
    for (weight, error) in weights.iter().zip(errors?) {
        least = error.min(least);
        if error > RISEN * least || !error.is_finite() {
            return Ok(MaxQ::Reached(greatest));
        }
        greatest = *weight;
    }
    Ok(MaxQ::AtLeast(greatest))
}

fn attitude_error(contender: &Contender, key: &str, weight: f64) -> Result<f64, Failure> {
    let mut contender = contender.clone();
    contender.settings.push(Setting::flag("max q", key, weight));
    let square = Prepared::new(&contender, Test::Path, &NOMINAL)?;
    let mut sum = 0.0;
    for seed in RAISED_SEEDS {
        let flown = square.fly(seed)?;
        sum += flown.map_or(f64::INFINITY, |(flight, _)| of_path(&flight)[ATTITUDE]);
    }
    Ok(sum / (RAISED_SEEDS.end - RAISED_SEEDS.start) as f64)
}
