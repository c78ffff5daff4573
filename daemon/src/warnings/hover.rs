//! Warning of a law that does not hold its hover: on the model of `[vehicle]` it does not return to it after a small displacement.

use nalgebra::Vector3;
use oqtal_config::Config;
use oqtal_control::controller::{ControlOptions, ControllerName};
use oqtal_control::trajectory::{Phase, Reference};

use super::law::lacks_feed_forward;
use super::model_flight::ModelFlight;

/// Initial displacement, and a final distance that a stable loop never reaches \[m\].
const DISPLACEMENT_M: f64 = 0.1;
const ASTRAY_M: f64 = 0.2;
/// Tilt below which the last part of a hover without noise is at rest \[rad\].
const TILT_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// Duration of the hover, and of its last part, in which distance and tilt count \[s\].
const HOVER_S: f64 = 15.0;
const LAST_S: f64 = 3.0;

/// Warning that the vehicle oscillates in a hover under the configured law.
pub(crate) fn oscillates(config: &Config) -> Option<String> {
    if config.safety.observe_only {
        return None;
    }
    let hover = Reference::rest(Vector3::z(), Phase::Trajectory);
    let beside = hover.position + Vector3::x() * DISPLACEMENT_M;
    let start = Reference { position: beside, ..hover };
    let mut flight = ModelFlight::at(&start, 0.0, config)?;
    let period_s = 1.0 / config.loop_rate_hz();
    let ticks = (HOVER_S / period_s) as u64;
    let (mut distance_m, mut tilt_rad) = (0.0_f64, 0.0_f64);
    for tick in 1..=ticks {
        let now_s = tick as f64 * period_s;
        match flight.tick(tick, (now_s, period_s), &hover) {
            Some(motion) if now_s > HOVER_S - LAST_S => {
                distance_m = distance_m.max((motion.position - hover.position).norm());
                tilt_rad =
                    tilt_rad.max(motion.attitude.to_world(&Vector3::z()).angle(&Vector3::z()));
            }
            Some(_) => {}
            // The law does not fly the model.
            None if tick == 1 => return None,
            None => distance_m = f64::INFINITY,
        }
    }
    let law = config.control.built_in().name();
    (distance_m > ASTRAY_M || tilt_rad > TILT_RAD).then(|| {
        let distance = match distance_m < 10.0 {
            true => format!("{distance_m:.2} m away and tilts by {:.0} deg", tilt_rad.to_degrees()),
            false => "more than 10 m away".to_owned(),
        };
        format!(
            "{law} oscillates with this vehicle: in a hover of its model that begins {DISPLACEMENT_M} m aside, it is {distance} after {HOVER_S} s; {}",
            remedy(&config.control)
        )
    })
}

/// Remedy for a law that oscillates, as it flies with `control`.
fn remedy(control: &ControlOptions) -> String {
    if let Some(law) = lacks_feed_forward(control) {
        return format!("set control.{}.feed-forward to true", law.name());
    }
    let law = control.built_in();
    let stack = match control.is_predictive() && !law.is_predictive() {
        true => " --set control.stack=predictive",
        false => "",
    };
    let other = match law {
        _ if control.is_external() => ", or set another control.fallback",
        ControllerName::OqtalDt => "",
        _ => ", or fly oqtal-dt",
    };
    format!("find other gains with `oqtal tune {}{stack}`{other}", law.name())
}
