//! Gains found by a search: as text, as a configuration file, as settings.

use std::collections::BTreeMap;
use std::fmt;

use oqtal_config::Setting;
use oqtal_control::controller::SearchRange;

use super::optimiser::Optimiser;
use super::space;
use super::trade::{self, TradedFigure};

/// First of the options of a live search.
pub const LIVE: &str = " --live";

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
        Self { points: trade::DEFAULT_POINTS, seed: 1, optimiser: Optimiser::default() }
    }
}

/// Gains found by a search.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// Name of the law, or `outer`.
    pub target: String,
    /// Keys and values \[units of the keys\]: those searched for, then those computed.
    pub values: Vec<(String, f64)>,
    /// Objective at these gains \[-\]; 1 for `oqtal` with its configured gains and the computed values; lower is better.
    pub objective: f64,
    /// Objective at the configured gains, the start of the search \[-\].
    pub start: f64,
    /// Budget of the search.
    pub budget: Budget,
    /// Number of draws of a spread on which the gains were evaluated \[-\]; 0 for plants near the configured one.
    pub draws: usize,
    /// Arguments that select the flights and the weights.
    pub options: String,
    /// Components of the objective and margins, at the configured gains and at those found; empty for the outer loops.
    pub components: Vec<TradedFigure>,
    /// Number of flights that did not land as planned, at the configured gains and at those found, and of all \[-\].
    pub failed: [usize; 3],
    /// Path of the search; empty for the outer loops.
    pub path: SearchPath,
}

/// The points of a search that were flown, in order of their evaluation.
#[derive(Clone, Debug, Default)]
pub struct SearchPath {
    /// Objective at each point \[-\].
    pub objectives: Vec<f64>,
    /// Gains at each point \[units of the keys\].
    pub gains: Vec<Vec<f64>>,
}

impl SearchPath {
    /// Adds those of `points`, given by the logarithms of their gains, that have an objective: that were flown.
    pub fn add(&mut self, points: &[Vec<f64>], objectives: &[Option<f64>]) {
        for (point, objective) in points.iter().zip(objectives) {
            self.objectives.extend(objective);
            self.gains.extend(objective.map(|_| point.iter().map(|log| log.exp()).collect()));
        }
    }
}

impl Tuned {
    /// Command and result on one line.
    pub fn headline(&self) -> String {
        let Budget { points, seed, optimiser } = self.budget;
        let (optimiser, objective) = (optimiser.name(), self.objective);
        // A live search names no law: it is that which flies.
        let (target, options) = match self.options.strip_prefix(LIVE) {
            Some(options) => ("--live", options),
            None => (&*self.target, &*self.options),
        };
        let draws = match self.draws {
            0 => String::new(),
            draws => format!(" over {draws} draws of a spread"),
        };
        format!(
            "tune {target} --optimiser {optimiser} --budget {points} --seed {seed}{options}: objective {objective:.4}{draws}"
        )
    }

    /// The objective at the configured gains, as text, and whether these are kept.
    pub fn comparison(&self) -> String {
        // For the position loops it is 1 by definition.
        let unit = match &*self.target {
            "outer" => "",
            _ if self.options.starts_with(LIVE) => {
                " (1 is `oqtal` with its configured gains and the computed integral limit in the same flights)"
            }
            _ => " (1 is `oqtal` with its configured gains in the same flights)",
        };
        let start = match self.start.is_finite() {
            true => format!("{:.4} at the configured gains{unit}", self.start),
            false => "none at the configured gains, with which a flight does not land as planned"
                .to_owned(),
        };
        match self.objective < self.start {
            true => format!("{start}; lower is better"),
            false if self.path.objectives.len() == 1 => format!(
                "{start}: no others were tried, since --budget {} has no room for a first generation of the search; they are kept",
                self.budget.points
            ),
            false => format!("{start}: no better ones were found, they are kept"),
        }
    }

    /// Flights that did not land as planned, as text.
    pub fn failures(&self) -> String {
        let [before, after, all] = self.failed;
        format!("not landed as planned: {before} of {all} flights before, {after} after")
    }

    /// Whether the law flew on the predictive stack, whose gains were then searched, too.
    pub fn is_predictive(&self) -> bool {
        self.values.iter().any(|(key, _)| key.starts_with("control.predictive."))
    }

    /// Ranges with a gain on a bound.
    pub fn on_a_bound(&self) -> Vec<SearchRange> {
        space::on_a_bound(&self.target, &self.settings())
    }

    /// Warnings about gains on a bound of their range, and about components that got worse.
    pub fn warnings(&self) -> Vec<String> {
        let on_a_bound = self.on_a_bound().into_iter().map(|SearchRange { key, low, high }| {
            format!(
                "{key} is on a bound of its range, {low} to {high}: a better value may lie beyond; set it by hand and compare with `oqtal campaign`"
            )
        });
        let (is_predictive, points) = (self.is_predictive(), self.budget.points);
        on_a_bound.chain(trade::warnings(&self.components, is_predictive, points)).collect()
    }

    /// Gains as a configuration file: those found, and of the settings `common` of the search those of the law and the position
    /// loops, except those of environment variables, which apply to every command. `note` is a comment after the first line; empty
    /// for none.
    pub fn to_toml(&self, common: &[Setting], note: &str) -> String {
        let law = Some(&self.target).filter(|target| *target != "outer");
        let law = law.map(|law| ("control.controller", format!("\"{law}\"")));
        let gains = self.values.iter().map(|(key, value)| (key.as_str(), format!("{value:?}")));
        let own: Vec<_> = law.into_iter().chain(gains).collect();
        // The last setting of a key takes precedence.
        let mut lines: BTreeMap<&str, String> = BTreeMap::new();
        let is_kept = |setting: &&Setting| {
            let is_of_law = ["control.", "position."].iter().any(|s| setting.key.starts_with(s));
            let is_variable = setting.origin.starts_with("OQTAL_");
            is_of_law && !is_variable && own.iter().all(|(key, _)| *key != setting.key)
        };
        for setting in common.iter().filter(is_kept) {
            lines.insert(&setting.key, setting.value.to_string());
        }
        let line = |(key, value): (&str, String)| format!("{key} = {value}\n");
        let common: String = lines.into_iter().map(line).collect();
        let note = if note.is_empty() { String::new() } else { format!("# {note}\n") };
        format!(
            "# oqtal {}\n{note}{common}{}",
            self.headline(),
            own.into_iter().map(line).collect::<String>()
        )
    }

    /// The gains as settings.
    pub fn settings(&self) -> Vec<Setting> {
        settings(&self.values)
    }
}

impl fmt::Display for Tuned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}\n  {}", self.headline(), self.comparison())?;
        self.values.iter().try_for_each(|(key, value)| writeln!(f, "  {key} = {value}"))?;
        if !self.components.is_empty() {
            let sheet = trade::sheet(&self.components, self.draws > 0);
            writeln!(f, "{}\n{}", sheet.to_text(), self.failures())?;
        }
        self.warnings().iter().try_for_each(|warning| writeln!(f, "warning: {warning}"))
    }
}

/// Gains as settings.
pub fn settings(values: &[(String, f64)]) -> Vec<Setting> {
    values.iter().map(|(key, value)| Setting::flag("tune", key, *value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tuned_configuration_loads_with_the_gains_that_were_found() {
        let tuned = Tuned {
            target: "lqr".to_owned(),
            values: vec![("control.lqr.attitude-weight".to_owned(), 12.34)],
            objective: 0.5,
            start: 0.9,
            budget: Budget::default(),
            draws: 0,
            options: String::new(),
            components: Vec::new(),
            failed: [0; 3],
            path: SearchPath::default(),
        };
        let own = "0.9000 at the configured gains (1 is `oqtal` with its configured gains";
        assert!(tuned.comparison().starts_with(own), "{}", tuned.comparison());
        let on_a_bound = Tuned {
            values: vec![("control.lqr.attitude-weight".to_owned(), 1e9)],
            ..tuned.clone()
        };
        let told = "\nwarning: control.lqr.attitude-weight is on a bound of its range, ";
        assert!(on_a_bound.to_string().contains(told), "{on_a_bound}");
        assert!(!tuned.to_string().contains(told), "{tuned}");
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("tuned.toml");
        let common = [
            Setting::flag("--set", "vehicle.mass-kg", 0.6),
            Setting::flag("--set", "position.velocity-integral-limit-m-s2", 4.0),
            Setting::flag("--set", "control.lqr.attitude-weight", 1.0),
        ];
        let text = tuned.to_toml(&common, "a note");
        assert!(text.contains("\n# a note\n"), "{text}");
        std::fs::write(&file, text).unwrap();
        let config = oqtal_config::Config::load(std::slice::from_ref(&file), &[]).unwrap();
        let limit = config.position.velocity_integral_limit_m_s2;
        assert_eq!((config.control.lqr.attitude_weight, limit), (12.34, 4.0));
        let shipped = oqtal_config::Config::default();
        assert_eq!(config.vehicle, shipped.vehicle, "the file has gains, and no vehicle");
        assert_eq!(config.control.controller, oqtal_control::controller::ControllerName::Lqr);
    }
}
