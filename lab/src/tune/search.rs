//! The search for gains: the same optimiser, budget and seeds for every law.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;

use super::bee_colony::Best;
use oqtal_config::{Config, Setting};
use oqtal_control::controller::SearchRange;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use crate::campaign::flights::{Contender, NOMINAL, PlantVariant, TRAINING, Trial};
use crate::campaign::metric::Figures;
use crate::campaign::statistics::{Runs, TRAINING_SEEDS, objective};
use crate::progress::Progress;
use crate::robustness::flown::Draw;
use crate::robustness::statistics::Quantiles;

use super::optimiser::Optimiser;
use super::space::LawSpace;
use super::value::value_of;

/// Budget of a search.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// Number of points to evaluate \[-\].
    pub points: usize,
    /// Seed of the optimiser.
    pub seed: u64,
    /// The optimiser.
    pub optimiser: Optimiser,
}

impl Default for Budget {
    fn default() -> Self {
        Self { points: 300, seed: 1, optimiser: Optimiser::default() }
    }
}

/// The flights on which gains are judged.
#[derive(Clone, Debug)]
pub struct Ground {
    /// Settings that all flights have in common: the vehicle and its surroundings.
    pub settings: Vec<Setting>,
    /// Seeds of the flights; the plants of [`TRAINING`] take turns.
    pub seeds: Range<u64>,
    /// Draws of a spread that are flown in place of the plants of [`TRAINING`], each with a seed of its own; empty for those.
    pub draws: Vec<Draw>,
}

impl Default for Ground {
    fn default() -> Self {
        Self { settings: Vec::new(), seeds: TRAINING_SEEDS, draws: Vec::new() }
    }
}

impl Ground {
    /// The law `controller` with `gains` in place of the configured ones.
    #[must_use]
    pub fn contender(&self, controller: &'static str, gains: &[Setting]) -> Contender {
        Contender { controller, settings: [&self.settings, gains].concat() }
    }
}

/// Gains found by a search.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// Name of the law, or `outer`.
    pub what: String,
    /// Keys and values \[units of the keys\].
    pub values: Vec<(String, f64)>,
    /// Objective at these gains \[-\]; 1 for `oqtal` with its configured gains, lower is better.
    pub objective: f64,
    /// Objective at the configured gains, where the search starts \[-\].
    pub start: f64,
    /// The search.
    pub budget: Budget,
    /// Number of draws of a spread on which the gains were judged \[-\]; 0 for the plants of [`TRAINING`].
    pub draws: usize,
}

impl Tuned {
    /// Command and result on one line.
    #[must_use]
    pub fn headline(&self) -> String {
        let Budget { points, seed, optimiser } = self.budget;
        let (optimiser, objective) = (optimiser.name(), self.objective);
        let draws = match self.draws {
            0 => String::new(),
            draws => format!(" over {draws} draws of a spread"),
        };
        format!(
            "tune {} --optimiser {optimiser} --budget {points} --seed {seed}: objective {objective:.4}{draws}",
            self.what
        )
    }

    /// The gains as a configuration file, on top of the settings `common` of the vehicle that they were found for.
    #[must_use]
    pub fn to_toml(&self, common: &[&Setting]) -> String {
        let law = if self.what == "outer" { None } else { Some(&self.what) };
        let law = law.map(|law| ("control.controller", format!("\"{law}\"")));
        let gains = self.values.iter().map(|(key, value)| (key.as_str(), format!("{value:?}")));
        let own: Vec<_> = law.into_iter().chain(gains).collect();
        // Of a key that is set twice, the last counts.
        let mut lines: BTreeMap<&str, String> = BTreeMap::new();
        for setting in common.iter().filter(|s| own.iter().all(|(key, _)| *key != s.key)) {
            lines.insert(&setting.key, setting.value.to_string());
        }
        let line = |(key, value): (&str, String)| format!("{key} = {value}\n");
        let common: String = lines.into_iter().map(line).collect();
        format!(
            "# oqtal {}\n{common}{}",
            self.headline(),
            own.into_iter().map(line).collect::<String>()
        )
    }

    /// The gains as settings.
    #[must_use]
    pub fn settings(&self) -> Vec<Setting> {
        settings(&self.values)
    }
}

impl fmt::Display for Tuned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.headline())?;
        let (start, found) = (self.start, self.objective);
        match found < start {
            true => writeln!(f, "  {start:.4} at the configured gains; lower is better")?,
            false => {
                writeln!(f, "  no better than the configured gains, {start:.4}: they are kept")?
            }
        }
        self.values.iter().try_for_each(|(key, value)| writeln!(f, "  {key} = {value}"))
    }
}

fn settings(values: &[(String, f64)]) -> Vec<Setting> {
    values.iter().map(|(key, value)| Setting::flag("tune", key, *value)).collect()
}

/// `value` rounded to four significant digits, so that the gains evaluated are those written.
fn readable(value: f64) -> f64 {
    format!("{value:.3e}").parse().expect("a number just written")
}

/// The values of `parameters` at a point of their logarithms.
#[must_use]
pub fn values(parameters: &[SearchRange], point: &[f64]) -> Vec<(String, f64)> {
    parameters.iter().zip(point).map(|(p, log)| (p.key.to_string(), readable(log.exp()))).collect()
}

/// The values of `parameters` in `config`, within their bounds.
#[must_use]
pub fn configured(parameters: &[SearchRange], config: &Config) -> Vec<(String, f64)> {
    let value =
        |p: &SearchRange| (p.key.to_string(), value_of(config, &p.key).clamp(p.low, p.high));
    parameters.iter().map(value).collect()
}

/// Searches `parameters` in their logarithms, from the values `start`, for the least objective.
pub fn search(
    parameters: &[SearchRange],
    start: &[(String, f64)],
    budget: &Budget,
    evaluate: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
) -> Best {
    let bounds: Vec<_> = parameters.iter().map(|p| p.low.ln()..=p.high.ln()).collect();
    let start = start.iter().map(|(_, value)| value.ln()).collect();
    let Budget { points, seed, optimiser } = *budget;
    optimiser.minimise(&bounds, start, (points, seed), evaluate)
}

/// Tunes a law, with estimator and position loops around it, on `ground`.
///
/// # Errors
/// A setting is invalid.
pub fn law(
    space: &LawSpace,
    budget: &Budget,
    ground: &Ground,
    progress: &Progress,
) -> Result<Tuned, Failure> {
    let config = Config::from_settings(&ground.settings)?;
    let parameters = space.parameters_within(config.control.stack);
    let bar = progress.start(&format!("tuning {}", space.controller), budget.points);
    let reference = reference(ground)?;
    let judge = |gains: &[Setting]| {
        let contender = ground.contender(space.controller, gains);
        match ground.draws.is_empty() {
            true => Ok::<f64, Failure>(objective(&trained(&contender, ground)?, &reference)),
            false => Ok(over_draws(&on_draws(&contender, &ground.draws)?, &reference)),
        }
    };
    let start = judge(&[])?;
    let from = configured(&parameters, &config);
    let best = search(&parameters, &from, budget, |points| {
        let judge = |point: &Vec<f64>| {
            let value = judge(&settings(&values(&parameters, point))).unwrap_or(f64::INFINITY);
            bar.inc();
            value
        };
        points.par_iter().map(judge).collect()
    });
    let (values, objective) = match best.value < start {
        true => (values(&parameters, &best.point), best.value),
        false => (from, start),
    };
    Ok(Tuned {
        what: space.controller.to_owned(),
        values,
        objective,
        start,
        budget: *budget,
        draws: ground.draws.len(),
    })
}

/// The objective of a law at its shipped gains, and with those of `contender`, on the training seeds.
///
/// # Errors
/// A setting is invalid.
pub fn before_and_after(contender: &Contender) -> Result<[f64; 2], Failure> {
    let ground = Ground::default();
    let reference = trained(&ground.contender("oqtal", &[]), &ground)?;
    let shipped = trained(&ground.contender(contender.controller, &[]), &ground)?;
    let figures = [shipped, trained(contender, &ground)?];
    Ok(figures.map(|figures| objective(&figures, &reference)))
}

/// The figures by which others are divided: those of `oqtal` with its configured gains, without those of the study.
fn reference(ground: &Ground) -> Result<Figures, Failure> {
    let contender = ground.contender("oqtal", &[Setting::flag("tune", "control.stack", "default")]);
    if ground.draws.is_empty() {
        return trained(&contender, ground);
    }
    let figures = on_draws(&contender, &ground.draws)?;
    Ok(std::array::from_fn(|metric| {
        let values: Vec<f64> = figures.iter().map(|figures| figures[metric]).collect();
        Quantiles::of(&values).median
    }))
}

/// The figures of every draw.
fn on_draws(contender: &Contender, draws: &[Draw]) -> Result<Vec<Figures>, Failure> {
    let fly = |draw: &Draw| {
        let settings = [&contender.settings[..], &draw.settings].concat();
        Ok(Trial::new(&Contender { settings, ..*contender }, &NOMINAL)?.fly(draw.seed)?.0)
    };
    draws.par_iter().map(fly).collect()
}

/// A figure beyond this multiple of the reference's, and that of a flight that did not land, counts as this \[-\].
const WORST_SHARE: f64 = 20.0;

/// The objective over draws \[-\]: the weighted mean of the metrics, each as the quadratic mean over the draws, in which the worst
/// weigh most, over the reference.
#[must_use]
pub fn over_draws(figures: &[Figures], reference: &Figures) -> f64 {
    let quadratic_mean = |metric: usize| {
        let share = |figures: &Figures| figures[metric].min(WORST_SHARE * reference[metric]);
        let squares: f64 = figures.iter().map(|figures| share(figures).powi(2)).sum();
        (squares / figures.len() as f64).sqrt()
    };
    objective(&std::array::from_fn(quadratic_mean), reference)
}

/// Mean figures over the seeds, each on its plant.
fn trained(contender: &Contender, ground: &Ground) -> Result<Figures, Failure> {
    let fly = |(seed, plant): (u64, &PlantVariant)| Ok(Trial::new(contender, plant)?.fly(seed)?.0);
    let plants = TRAINING.iter().cycle();
    let flights: Vec<(u64, &PlantVariant)> = ground.seeds.clone().zip(plants).collect();
    let figures: Result<Vec<Figures>, Failure> = flights.into_par_iter().map(fly).collect();
    Ok(Runs { figures: figures?, solves: 0 }.mean())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tuned_configuration_loads_and_says_what_was_found() {
        let tuned = Tuned {
            what: "lqr".to_owned(),
            values: vec![("control.lqr.attitude-weight".to_owned(), 12.34)],
            objective: 0.5,
            start: 0.9,
            budget: Budget::default(),
            draws: 0,
        };
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("tuned.toml");
        let common = Setting::flag("--set", "vehicle.mass-kg", 0.6);
        std::fs::write(&file, tuned.to_toml(&[&common])).unwrap();
        let config = oqtal_config::Config::load(Some(&file), &[]).unwrap();
        assert_eq!((config.control.lqr.attitude_weight, config.vehicle.mass_kg), (12.34, 0.6));
        assert_eq!(config.control.controller, oqtal_control::controller::ControllerName::Lqr);
    }
}
