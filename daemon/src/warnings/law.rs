//! Notes on the law and its stack.

use oqtal_config::Config;
use oqtal_control::controller::{ControlOptions, ControllerName};
use oqtal_control::trajectory::{Phase, Reference};

use super::guarded::{note_below_envelope, note_near_border};
use crate::law_guard::note_on_fallback;

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

/// Note on a law, or fallback law, in the predictive stack that does not use the rate of the reference: its loop oscillates.
pub(super) fn feed_forward_off(config: &Config) -> Option<String> {
    let (flown, fallback) = (&config.control, config.control.of_fallback());
    let of = |control: &ControlOptions, what| {
        let law = lacks_feed_forward(control)?.name();
        Some(format!(
            "on the predictive stack the {what} {law} needs its feed-forward, or the vehicle oscillates: set control.{law}.feed-forward to true"
        ))
    };
    let what = if flown.is_external() { "fallback law" } else { "law" };
    of(flown, what).or_else(|| of(fallback.as_ref()?, "fallback law"))
}

/// Note on a feed-forward that is set and has no effect: only the predictive stack gives the law the rates of the reference.
pub(super) fn feed_forward_unused(config: &Config) -> Option<String> {
    let (control, law) = (&config.control, config.control.controller);
    let is_unused = feed_forward(control, law) == Some(true) && !control.is_predictive();
    is_unused.then(|| {
        format!(
            "control.{law}.feed-forward has no effect with control.stack = \"default\", in which laws get no rate of the reference; set control.stack to \"predictive\""
        )
    })
}

/// The built-in law of `control` if it is in the predictive stack and does not use the rate of the reference.
pub(super) fn lacks_feed_forward(control: &ControlOptions) -> Option<ControllerName> {
    let law = control.built_in();
    (control.is_predictive() && feed_forward(control, law) == Some(false)).then_some(law)
}

/// Whether the paper's law `law` uses the rate of the reference; `None` for another law.
fn feed_forward(control: &ControlOptions, law: ControllerName) -> Option<bool> {
    match law {
        ControllerName::Pid => Some(control.pid.feed_forward),
        ControllerName::Lqr => Some(control.lqr.feed_forward),
        ControllerName::Oqtal => Some(control.oqtal.feed_forward),
        _ => None,
    }
}

/// Note that a part of the path is so low, or so close to the fence, that a guarded law cannot fly it.
pub(super) fn outside_envelope(samples: &[(f64, Reference)], config: &Config) -> Option<String> {
    let is_flight = |(_, reference): &&(f64, Reference)| {
        matches!(reference.phase, Phase::Settle | Phase::Trajectory)
    };
    let flown = samples.iter().filter(is_flight);
    let lowest_m = flown.clone().map(|(_, it)| it.position.z).fold(f64::INFINITY, f64::min);
    note_below_envelope(config, lowest_m).or_else(|| note_near_border(config, flown))
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
    note_on_fallback(present, next).into_iter().chain(of_laws(present, next))
}

/// Notes on changed settings of laws that do not fly, which a fallback law does, and of laws whose place the vehicle's own attitude loop
/// takes.
fn of_laws(present: &Config, next: &Config) -> impl Iterator<Item = String> {
    let control = &next.control;
    let flown = [control.controller, control.built_in()].into_iter().chain(control.fallback);
    let flown: Vec<_> = flown.map(|law| format!("control.{}.", law.name())).collect();
    let laws = ControllerName::NAMES.map(|name| format!("control.{name}."));
    let changed = present.differences(next).unwrap_or_default();
    let keys = changed.iter().filter_map(|line| line.split('=').next());
    let of_law = keys.filter(|key| laws.iter().any(|law| key.starts_with(law)));
    let (own, others): (Vec<_>, Vec<_>) =
        of_law.partition(|key| flown.iter().any(|law| key.starts_with(law)));
    let unused = (!others.is_empty()).then(|| {
        format!(
            "{}: no effect, since control.controller is {}",
            others.join(", "),
            control.controller
        )
    });
    let is_replaced = next.vehicle.interface.holds_attitude() && !own.is_empty();
    // The default stack sends the yaw of the law to a vehicle that holds roll and pitch alone.
    let extent = if control.is_predictive() { "" } else { " on roll and pitch" };
    let replaced = is_replaced.then(|| {
        format!(
            "{}: no effect{extent}, since the vehicle holds its attitude by itself",
            own.join(", ")
        )
    });
    unused.into_iter().chain(replaced)
}
