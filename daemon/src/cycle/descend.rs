//! Level and descend: what a vehicle that holds an attitude by itself does where the daemon has been blind for too long.

use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::euler::EulerAngles;

use super::Cycle;
use crate::command::VehicleCommand;
use crate::guard::seconds;

/// Height above the floor at the last accepted pose from which on a vehicle is in the air \[m\].
const AIRBORNE_M: f64 = 0.1;
/// Greatest share of the weight by which the thrust is corrected for the external force that was estimated \[-\].
const LARGEST_CORRECTION: f64 = 0.3;
/// Age of the predicted motion from which on it is carried forward \[s\]: less than the commands that are remembered.
const OLD_TRACK_S: f64 = 0.5;
/// Age of the motion that is carried forward \[s\]: more than that of any pose that is accepted.
const CARRIED_TRACK_S: f64 = 0.25;

/// The descent without poses.
#[derive(Clone, Debug)]
pub(super) struct BlindDescent {
    /// Whether the vehicle stays level without the daemon.
    is_possible: bool,
    /// Greatest age of the last accepted pose.
    longest: Span,
    /// Thrust over that of a hover \[-\].
    thrust: f64,
    mass_kg: f64,
    gravity_m_s2: f64,
}

impl BlindDescent {
    pub(super) fn of(config: &Config) -> Self {
        let (safety, vehicle) = (&config.safety, &config.vehicle);
        Self {
            is_possible: vehicle.interface.holds_attitude(),
            longest: Span::from_seconds((safety.coast_ms + safety.descend_ms) * 1e-3),
            thrust: safety.descend_thrust,
            mass_kg: vehicle.mass_kg,
            gravity_m_s2: vehicle.gravity_m_s2,
        }
    }

    /// The thrust of the descent \[N\] under the estimated external acceleration upward `lift` \[m/s^2\]: wind, or a thrust or
    /// mass other than configured.
    fn thrust_n(&self, lift: f64) -> f64 {
        let greatest = LARGEST_CORRECTION * self.gravity_m_s2;
        let known = if lift.is_finite() { lift.clamp(-greatest, greatest) } else { 0.0 };
        self.thrust * self.mass_kg * (self.gravity_m_s2 - known)
    }
}

impl Cycle {
    /// Whether the vehicle may descend without poses: it stays level by itself, was in the air when it was seen last, and has
    /// not descended for too long.
    pub(super) fn may_descend(&self, now: Time) -> bool {
        let Some(last) = self.guard.last().filter(|_| self.is_flying() && !self.is_held()) else {
            return false;
        };
        self.descent.is_possible
            && now.since(last.captured_at) <= self.descent.longest
            && last.position.z > self.guard.motion.floor_m() + AIRBORNE_M
    }

    /// Whether the predicted motion has reached the floor.
    pub(super) fn is_down(&self, now: Time) -> bool {
        let floor_m = self.guard.motion.floor_m();
        self.guard.motion.predict(seconds(now)).is_some_and(|track| track.is_at_floor(floor_m))
    }

    /// The command of the descent: level at the last heading, with a thrust below that of a hover.
    pub(super) fn descend(&self, now: Time) -> VehicleCommand {
        let heading = EulerAngles::from_attitude(&self.estimator.latest().attitude).yaw;
        let track = self.guard.motion.predict(seconds(now));
        let lift = track.map_or(0.0, |track| track.external_acceleration().z);
        VehicleCommand::level(self.interface, heading, self.descent.thrust_n(lift))
    }

    /// Carries the predicted motion forward where poses have been missing for longer than commands are remembered.
    pub(super) fn carry_motion(&mut self, now: Time) {
        let now_s = seconds(now);
        self.guard.motion.carry(now_s - OLD_TRACK_S, now_s - CARRIED_TRACK_S);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_thrust_of_a_descent_is_below_the_hovers_whatever_was_estimated() {
        let descent = BlindDescent::of(&Config::default());
        let weight_n = descent.mass_kg * descent.gravity_m_s2;
        let share = |lift| descent.thrust_n(lift) / weight_n;
        assert!((share(0.0) - 0.9).abs() < 1e-12);
        assert!((share(0.1 * descent.gravity_m_s2) - 0.81).abs() < 1e-12);
        assert!((share(f64::NAN) - 0.9).abs() < 1e-12);
        assert!((share(-1e9) - 1.17).abs() < 1e-12 && (share(1e9) - 0.63).abs() < 1e-12);
    }
}
