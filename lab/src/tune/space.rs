//! What is tuned, as data: every registered law, with the gains around it.

use oqtal_control::LawStack;
use oqtal_control::controller::{ControllerName, SearchRange};

/// An attitude law and its own gains. The gains around the law are tuned with them.
#[derive(Clone, Copy, Debug)]
pub struct LawSpace {
    /// Name of the law in the configuration.
    pub controller: &'static str,
    /// Gains of the law itself, with keys relative to its section; the first is the one that `max_q` raises.
    pub gains: &'static [SearchRange],
    /// Gains around the law: those of [`PREDICTOR`] for `oqtal-dt` and `mpc`, of [`SURROUNDINGS`] for every other law.
    pub around: &'static [SearchRange],
}

/// The laws that are tuned and compared: every registered law, `oqtal-dt` last.
pub const LAWS: [LawSpace; ControllerName::ALL.len()] = {
    let ours = LawSpace {
        controller: ControllerName::OqtalDt.name(),
        gains: ControllerName::OqtalDt.tuned_gains(),
        around: &PREDICTOR,
    };
    let mut laws = [ours; ControllerName::ALL.len()];
    let (mut index, mut next) = (0, 0);
    while index < laws.len() {
        let law = ControllerName::ALL[index];
        if !matches!(law, ControllerName::OqtalDt) {
            let (controller, gains) = (law.name(), law.tuned_gains());
            laws[next] = LawSpace { controller, gains, around: around(law) };
            next += 1;
        }
        index += 1;
    }
    laws
};

/// The gains around a law in its own surroundings.
const fn around(law: ControllerName) -> &'static [SearchRange] {
    if law.is_predictive() { &PREDICTOR } else { &SURROUNDINGS }
}

/// The names of the laws.
pub const LAW_NAMES: [&str; LAWS.len()] = {
    let mut names = [""; LAWS.len()];
    let mut index = 0;
    while index < LAWS.len() {
        names[index] = LAWS[index].controller;
        index += 1;
    }
    names
};

/// What can be asked for: a law, all laws, or the position loops.
pub const NAMES: [&str; LAWS.len() + 2] = {
    let mut names = ["outer"; LAWS.len() + 2];
    names[LAWS.len()] = "all";
    let mut index = 0;
    while index < LAWS.len() {
        names[index] = LAWS[index].controller;
        index += 1;
    }
    names
};

/// Estimation, prediction and the position law of `oqtal-dt`.
pub static PREDICTOR: [SearchRange; 9] = [
    SearchRange::new("control.predictive.position-gain-per-s", 0.3, 4.0),
    SearchRange::new("control.predictive.vertical-position-gain-per-s", 0.3, 6.0),
    SearchRange::new("control.predictive.velocity-gain-per-s", 2.0, 20.0),
    SearchRange::new("control.predictive.vertical-velocity-gain-per-s", 2.0, 20.0),
    SearchRange::new("control.predictive.command-bandwidth-rad-s", 4.0, 40.0),
    SearchRange::new("control.predictive.filter.rate-walk-rad-s", 0.05, 5.0),
    SearchRange::new("control.predictive.filter.demand-bias-walk", 1e-3, 0.1),
    SearchRange::new("control.predictive.filter.velocity-walk-m-s", 1e-3, 0.1),
    SearchRange::new("control.predictive.filter.acceleration-walk-m-s2", 0.01, 1.0),
];

/// The estimator and the position loops, the same for every law of the paper.
pub static SURROUNDINGS: [SearchRange; 8] = [
    SearchRange::new("control.estimator.velocity-cutoff-hz", 2.0, 20.0),
    SearchRange::new("position.horizontal-position.kp", 0.5, 4.0),
    SearchRange::new("position.horizontal-position.ki", 1e-3, 0.3),
    SearchRange::new("position.horizontal-velocity.kp", 1.0, 10.0),
    SearchRange::new("position.horizontal-velocity.ki", 0.05, 5.0),
    SearchRange::new("position.vertical-position.kp", 0.5, 6.0),
    SearchRange::new("position.vertical-velocity.kp", 1.0, 15.0),
    SearchRange::new("position.vertical-velocity.ki", 0.05, 10.0),
];

impl LawSpace {
    /// Every gain that is tuned with this law, its own first.
    #[must_use]
    pub fn parameters(&self) -> Vec<SearchRange> {
        self.parameters_within(LawStack::Default)
    }

    /// Every gain that is tuned with this law in this stack, its own first, with keys of the whole configuration.
    #[must_use]
    pub fn parameters_within(&self, stack: LawStack) -> Vec<SearchRange> {
        let around = match stack {
            LawStack::Default => self.around,
            LawStack::Predictive => &PREDICTOR,
        };
        let section = format!("control.{}", self.controller);
        let own = self.gains.iter().map(|gain| gain.within(&section));
        own.chain(around.iter().cloned()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tune::value::value_of;
    use oqtal_config::Config;

    #[test]
    fn every_law_has_a_gain_of_its_own_to_tune() {
        for law in LAWS {
            assert!(!law.gains.is_empty(), "{}: no gain to tune", law.controller);
        }
    }

    #[test]
    fn every_parameter_is_a_key_whose_shipped_value_is_within_its_bounds() {
        for law in LAWS {
            for parameter in law.parameters() {
                let value = value_of(&Config::default(), &parameter.key);
                let SearchRange { key, low, high } = parameter;
                assert!((low..=high).contains(&value), "{key} = {value}");
            }
        }
    }
}
