//! Search space of each law: its own gains, and the gains of estimator and position loops.

use oqtal_config::{Config, Setting};
use oqtal_control::LawStack;
use oqtal_control::controller::{ControllerName, SearchRange};

use crate::study::flights::{readable, table, value_at};
use crate::study::law;

/// Arguments of `oqtal tune`: a law, all laws, or the position loops.
pub fn names() -> impl Iterator<Item = &'static str> {
    law::names().chain(["all", "outer"])
}

/// Gains of estimation, prediction and the position law of `oqtal-dt`.
static PREDICTOR: [SearchRange; 9] = [
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

/// Gains of the estimator and the position loops, the same for every law of the paper.
static LOOPS: [SearchRange; 8] = [
    SearchRange::new("control.estimator.velocity-cutoff-hz", 2.0, 20.0),
    SearchRange::new("position.horizontal-position.kp", 0.5, 4.0),
    SearchRange::new("position.horizontal-position.ki", 1e-3, 0.3),
    SearchRange::new("position.horizontal-velocity.kp", 1.0, 10.0),
    SearchRange::new("position.horizontal-velocity.ki", 0.05, 5.0),
    SearchRange::new("position.vertical-position.kp", 0.5, 6.0),
    SearchRange::new("position.vertical-velocity.kp", 1.0, 15.0),
    SearchRange::new("position.vertical-velocity.ki", 0.05, 10.0),
];

/// Gains of the position loops, tuned one loop after the other: vertical velocity, horizontal velocity, height, horizontal position.
pub static OUTER: [[SearchRange; 2]; 4] = [
    [
        SearchRange::new("position.vertical-velocity.kp", 0.5, 12.0),
        SearchRange::new("position.vertical-velocity.ki", 0.05, 5.0),
    ],
    [
        SearchRange::new("position.horizontal-velocity.kp", 0.5, 12.0),
        SearchRange::new("position.horizontal-velocity.ki", 0.05, 5.0),
    ],
    [
        SearchRange::new("position.vertical-position.kp", 0.3, 5.0),
        SearchRange::new("position.vertical-position.ki", 1e-3, 0.3),
    ],
    [
        SearchRange::new("position.horizontal-position.kp", 0.3, 5.0),
        SearchRange::new("position.horizontal-position.ki", 1e-3, 0.3),
    ],
];

/// All gains tuned with a law in a stack: first the law's own gains, beginning with the one raised for `max_q`, then those of the
/// stack.
pub fn parameters(law: ControllerName, stack: LawStack) -> Vec<SearchRange> {
    let is_predictive = law.is_predictive() || stack == LawStack::Predictive;
    let around: &[SearchRange] = if is_predictive { &PREDICTOR } else { &LOOPS };
    own(law).chain(around.iter().cloned()).collect()
}

fn own(law: ControllerName) -> impl Iterator<Item = SearchRange> {
    let section = format!("control.{}", law.name());
    law.tuned_gains().iter().map(move |gain| gain.within(&section))
}

/// Returns the search ranges of `target` on whose bound a gain of `settings` lies, within the rounding of written values. `target` is a
/// law, in either stack, or the position loops.
pub fn on_a_bound(target: &str, settings: &[Setting]) -> Vec<SearchRange> {
    let ranges: Vec<SearchRange> = match law::of_name(target) {
        Some(law) => own(law).chain(PREDICTOR.iter().chain(&LOOPS).cloned()).collect(),
        None => OUTER.concat(),
    };
    let lies = |range: &SearchRange| {
        let set = settings.iter().find(|setting| setting.key == range.key);
        let value = set.and_then(|setting| setting.value.as_float());
        value.is_some_and(|value| value <= range.low * 1.001 || value >= range.high * 0.999)
    };
    ranges.into_iter().filter(lies).collect()
}

/// Values of `parameters` at a point given by their logarithms.
pub fn values(parameters: &[SearchRange], point: &[f64]) -> Vec<(String, f64)> {
    parameters.iter().zip(point).map(|(p, log)| (p.key.to_string(), readable(log.exp()))).collect()
}

/// Values of `parameters` in `config`.
pub fn present(parameters: &[SearchRange], config: &Config) -> Vec<(String, f64)> {
    let config = table(config);
    let value = |p: &SearchRange| {
        let value = value_at(&config, &p.key).and_then(toml::Value::as_float);
        (p.key.to_string(), value.expect("a parameter is a number of the configuration"))
    };
    parameters.iter().map(value).collect()
}

/// Values of `parameters` in `config`, limited to their bounds.
pub fn configured(parameters: &[SearchRange], config: &Config) -> Vec<(String, f64)> {
    let within =
        |((key, value), p): ((String, f64), &SearchRange)| (key, value.clamp(p.low, p.high));
    present(parameters, config).into_iter().zip(parameters).map(within).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::gains::tuned;

    #[test]
    fn a_gain_on_either_bound_is_found_and_one_inside_is_not() {
        let [low, high, inside] =
            ["vertical-velocity.kp", "horizontal-position.ki", "vertical-position.kp"]
                .map(|key| format!("position.{key}"));
        let settings = [(&low, 1.0), (&high, 0.2999), (&inside, 2.0)]
            .map(|(key, v)| Setting::flag("", key, v));
        let found = |target| {
            let ranges = on_a_bound(target, &settings).into_iter();
            ranges.map(|range| range.key.into_owned()).collect::<Vec<_>>()
        };
        assert_eq!(found("pid"), [high.clone(), low]);
        assert_eq!(found("outer"), [high], "the ranges of the loops alone are wider");
    }

    #[test]
    fn every_law_has_a_gain_of_its_own_to_tune() {
        for law in law::registered() {
            assert!(!law.tuned_gains().is_empty(), "{}: no gain to tune", law.name());
        }
    }

    #[test]
    fn every_parameter_is_a_key_whose_shipped_value_is_within_its_bounds() {
        let shipped = table(&Config::default());
        let all = law::registered().flat_map(|law| parameters(law, LawStack::Default));
        for SearchRange { key, low, high } in all {
            let value = value_at(&shipped, &key).and_then(toml::Value::as_float);
            assert!(value.is_some_and(|value| (low..=high).contains(&value)), "{key} = {value:?}");
        }
    }

    #[test]
    fn every_law_has_tuned_gains_for_every_parameter() {
        for law in law::registered() {
            let settings = tuned(law.name());
            for SearchRange { key, low, high } in parameters(law, LawStack::Default) {
                let found = settings.iter().find(|setting| setting.key == key);
                let value = found.and_then(|setting| setting.value.as_float());
                let Some(value) = value else { panic!("{}: no {key}", law.name()) };
                // Values are written with four digits, so the bounds themselves may be rounded.
                let slack = 1e-3 * high;
                assert!(value >= low - slack && value <= high + slack);
            }
        }
    }
}
