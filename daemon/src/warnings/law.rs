//! Notes on the law and its stack.

use oqtal_config::Config;
use oqtal_control::controller::ControllerName;
use oqtal_control::trajectory::{Phase, Reference};

use crate::law_guard::{note_below_envelope, note_on_fallback};

/// Note that the configured law has no effect, because the vehicle has its own attitude loop.
pub(super) fn replaced(config: &Config) -> Option<String> {
    let replaced = config.vehicle.interface.holds_attitude() && !config.control.is_predictive();
    replaced.then(|| {
        format!(
            "vehicle.interface is \"attitude\": the vehicle's own loop takes the place of the attitude law; {} flies like every law but oqtal-dt and mpc, which also predict the motion",
            config.control.controller
        )
    })
}

/// Note on a law in the predictive stack that does not use the rate of the reference: its loop oscillates.
pub(super) fn feed_forward_off(config: &Config) -> Option<String> {
    let (control, law) = (&config.control, config.control.controller.name());
    let is_off = match control.controller {
        ControllerName::Pid => !control.pid.feed_forward,
        ControllerName::Lqr => !control.lqr.feed_forward,
        ControllerName::Oqtal => !control.oqtal.feed_forward,
        _ => false,
    };
    (control.is_predictive() && is_off).then(|| {
        format!(
            "with control.stack = \"predictive\" the law {law} needs its feed-forward, or the vehicle oscillates: set control.{law}.feed-forward to true"
        )
    })
}

/// Note that a part of the path is so low that a guarded law cannot fly it.
pub(super) fn too_low(samples: &[(f64, Reference)], config: &Config) -> Option<String> {
    let is_flight =
        |reference: &&Reference| matches!(reference.phase, Phase::Settle | Phase::Trajectory);
    let flown = samples.iter().map(|(_, reference)| reference).filter(is_flight);
    note_below_envelope(config, flown.map(|it| it.position.z).fold(f64::INFINITY, f64::min))
}

/// Note that gains of position loops are changed that do not fly.
pub(super) fn position_gains_unused(config: &Config) -> Option<String> {
    let gains = |config: &Config| {
        let own = &config.position;
        [
            ("horizontal-position", own.horizontal_position),
            ("vertical-position", own.vertical_position),
            ("horizontal-velocity", own.horizontal_velocity),
            ("vertical-velocity", own.vertical_velocity),
        ]
    };
    let shipped = gains(&Config::default());
    let changed = gains(config).into_iter().filter(|own| !shipped.contains(own));
    let changed: Vec<_> = changed.map(|(name, _)| format!("position.{name}")).collect();
    (config.control.is_predictive() && !changed.is_empty()).then(|| {
        format!(
            "{}: these loops do not fly under {}, whose position law has the gains in [control.predictive]",
            changed.join(", "),
            config.control.controller
        )
    })
}

/// Notes on settings that change from those of `present` to those of `next` without effect on the law that flies.
pub(crate) fn without_effect(present: &Config, next: &Config) -> impl Iterator<Item = String> {
    note_on_fallback(present, next).into_iter().chain(of_other_laws(present, next))
}

/// Note on changed settings of laws that do not fly; those of a fallback law are not counted.
fn of_other_laws(present: &Config, next: &Config) -> Option<String> {
    let flown = [next.control.controller, next.control.built_in()];
    let flown = flown.into_iter().chain(next.control.fallback).map(ControllerName::name);
    let flown: Vec<_> = flown.collect();
    let others = ControllerName::NAMES.into_iter().filter(|name| !flown.contains(name));
    let others: Vec<_> = others.map(|name| format!("control.{name}.")).collect();
    let changed = present.differences(next).unwrap_or_default();
    let keys = changed.iter().filter_map(|line| line.split('=').next());
    let unused = keys.filter(|key| others.iter().any(|other| key.starts_with(other)));
    let unused: Vec<_> = unused.collect();
    (!unused.is_empty()).then(|| {
        format!("{}: no effect, since control.controller is {}", unused.join(", "), flown[0])
    })
}
