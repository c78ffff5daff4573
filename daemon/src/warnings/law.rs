//! Notes on the law and its stack.

use oqtal_config::Config;
use oqtal_control::controller::ControllerName;

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
