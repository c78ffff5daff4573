//! The search for gains: the same optimiser, budget and seeds for every law.

use super::bee_colony::Best;
use oqtal_config::Setting;
use oqtal_control::controller::SearchRange;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use crate::campaign::flights::{Contender, PlantVariant, TRAINING, Trial};
use crate::campaign::metric::Figures;
use crate::campaign::statistics::{Runs, TRAINING_SEEDS, objective};
use crate::progress::Progress;

use super::optimiser::Optimiser;
use super::shipped::shipped;
use super::space::LawSpace;

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

/// Gains found by a search.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// Name of the law, or `outer`.
    pub what: String,
    /// Keys and values \[units of the keys\].
    pub values: Vec<(&'static str, f64)>,
    /// Objective at these gains \[-\]; 1 for the shipped `oqtal`.
    pub objective: f64,
    /// The search.
    pub budget: Budget,
}

impl Tuned {
    /// Command and result on one line.
    #[must_use]
    pub fn headline(&self) -> String {
        let Budget { points, seed, optimiser } = self.budget;
        let (optimiser, objective) = (optimiser.name(), self.objective);
        format!(
            "tune {} --optimiser {optimiser} --budget {points} --seed {seed}: objective {objective:.4}",
            self.what
        )
    }

    /// The gains as a configuration file.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let law = if self.what == "outer" { None } else { Some(&self.what) };
        let law = law.map_or_else(String::new, |law| format!("control.controller = \"{law}\"\n"));
        let values = self.values.iter().map(|(key, value)| format!("{key} = {value:?}\n"));
        format!("# oqtal {}\n{law}{}", self.headline(), values.collect::<String>())
    }

    /// The gains as settings.
    #[must_use]
    pub fn settings(&self) -> Vec<Setting> {
        settings(&self.values)
    }
}

fn settings(values: &[(&'static str, f64)]) -> Vec<Setting> {
    values.iter().map(|(key, value)| Setting::flag("tune", key, *value)).collect()
}

/// `value` rounded to four significant digits, so that the gains evaluated are those written.
fn readable(value: f64) -> f64 {
    format!("{value:.3e}").parse().expect("a number just written")
}

/// The values of `parameters` at a point of their logarithms.
#[must_use]
pub fn values(parameters: &[SearchRange], point: &[f64]) -> Vec<(&'static str, f64)> {
    parameters.iter().zip(point).map(|(p, log)| (p.key, readable(log.exp()))).collect()
}

/// Searches `parameters` in their logarithms, from their shipped values, for the least objective.
pub fn search(
    parameters: &[SearchRange],
    budget: Budget,
    evaluate: impl FnMut(&[Vec<f64>]) -> Vec<f64>,
) -> Best {
    let bounds: Vec<_> = parameters.iter().map(|p| p.low.ln()..=p.high.ln()).collect();
    let start = parameters.iter().map(|p| shipped(p.key).clamp(p.low, p.high).ln()).collect();
    let Budget { points, seed, optimiser } = budget;
    optimiser.minimise(&bounds, start, (points, seed), evaluate)
}

/// Tunes a law, with estimator and position loops around it, on the training seeds.
///
/// # Errors
/// A setting has no meaning.
pub fn law(space: &LawSpace, budget: Budget, progress: &Progress) -> Result<Tuned, Failure> {
    let parameters = space.parameters();
    let bar = progress.start(&format!("tuning {}", space.controller), budget.points);
    let reference = trained(&Contender { controller: "oqtal", settings: Vec::new() })?;
    let best = search(&parameters, budget, |points| {
        let judge = |point: &Vec<f64>| {
            let settings = settings(&values(&parameters, point));
            let contender = Contender { controller: space.controller, settings };
            let value = trained(&contender).map_or(f64::INFINITY, |f| objective(&f, &reference));
            bar.inc();
            value
        };
        points.par_iter().map(judge).collect()
    });
    Ok(Tuned {
        what: space.controller.to_owned(),
        values: values(&parameters, &best.point),
        objective: best.value,
        budget,
    })
}

/// The objective of a law at its shipped gains, and with those of `contender`, on the training seeds.
///
/// # Errors
/// A setting has no meaning.
pub fn before_and_after(contender: &Contender) -> Result<[f64; 2], Failure> {
    let shipped = |controller| Contender { controller, settings: Vec::new() };
    let reference = trained(&shipped("oqtal"))?;
    let figures = [trained(&shipped(contender.controller))?, trained(contender)?];
    Ok(figures.map(|figures| objective(&figures, &reference)))
}

/// Mean figures over the training seeds, each on its plant.
fn trained(contender: &Contender) -> Result<Figures, Failure> {
    let fly = |(seed, plant): (u64, &PlantVariant)| Ok(Trial::new(contender, plant)?.fly(seed)?.0);
    let flights: Vec<(u64, &PlantVariant)> = TRAINING_SEEDS.zip(&TRAINING).collect();
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
            values: vec![("control.lqr.attitude-weight", 12.34)],
            objective: 0.5,
            budget: Budget::default(),
        };
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("tuned.toml");
        std::fs::write(&file, tuned.to_toml()).unwrap();
        let config = oqtal_config::Config::load(Some(&file), &[]).unwrap();
        assert_eq!(config.control.lqr.attitude_weight, 12.34);
        assert_eq!(config.control.controller, oqtal_control::controller::ControllerName::Lqr);
    }
}
