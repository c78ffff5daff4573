//! Refusal of a change of a flight, with its reason.

use oqtal_bus::code::Cause;
use oqtal_config::{Config, ConfigError};
use oqtal_runtime::process::Failure;

/// Refusal of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Cause.
    pub cause: Cause,
    /// Reason, with the key at fault; empty if the cause is sufficient.
    pub reason: String,
}

impl Refusal {
    pub(crate) fn of_setting(reason: impl ToString) -> Self {
        Self { cause: Cause::Setting, reason: reason.to_string() }
    }
}

impl From<ConfigError> for Refusal {
    fn from(error: ConfigError) -> Self {
        Self::of_setting(error)
    }
}

impl From<Failure> for Refusal {
    fn from(failure: Failure) -> Self {
        Self::of_setting(failure.message)
    }
}

/// Way within which a vehicle must be able to stop from the greatest speed of a planner's reference after a change in flight \[m\].
const LONGEST_STOP_M: f64 = 2.5;

/// Requires that a fast vehicle can still stop if the settings `present` become `next` in flight.
///
/// # Errors
/// The limit of the tilt becomes too low.
pub(crate) fn require_braking(present: &Config, next: &Config) -> Result<(), Refusal> {
    let [before_deg, deg] = [present, next].map(|config| config.position.tilt_limit_deg);
    let speed_m_s = present.reference.speed_limit_m_s;
    let deceleration_m_s2 = speed_m_s * speed_m_s / (2.0 * LONGEST_STOP_M);
    let least_deg = (deceleration_m_s2 / present.vehicle.gravity_m_s2).atan().to_degrees();
    if deg >= before_deg.min(least_deg) {
        return Ok(());
    }
    Err(Refusal::of_setting(format!(
        "`position.tilt-limit-deg` is {deg}, it must be at least {least_deg:.1} in flight: at {speed_m_s} m/s, `reference.speed-limit-m-s`, a vehicle could not stop within {LONGEST_STOP_M} m; set it before the flight"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_config::Setting;

    #[test]
    fn the_tilt_is_not_limited_in_flight_so_far_that_a_fast_vehicle_cannot_stop() {
        let limited = |deg: f64| {
            let setting = Setting::flag("test", "position.tilt-limit-deg", deg);
            Config::from_settings(&[setting]).unwrap()
        };
        let refused = |from, to| require_braking(&limited(from), &limited(to)).is_err();
        assert!(refused(15.0, 7.2) && refused(2.0, 1.0));
        assert!(!refused(15.0, 7.3) && !refused(2.0, 2.5) && !refused(2.0, 2.0));
    }
}
