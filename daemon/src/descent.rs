//! The descent without poses of a vehicle with its own attitude loop: its duration and thrust.

use oqtal_bus::time::Span;
use oqtal_config::Config;

/// Greatest share of the weight by which the thrust is corrected for the external force that was estimated \[-\].
const LARGEST_CORRECTION: f64 = 0.3;

/// Largest share of the weight: an estimate from wrong poses must not let the vehicle climb \[-\].
const LARGEST_SHARE: f64 = 1.0;

/// The descent without poses.
#[derive(Clone, Debug)]
pub struct BlindDescent {
    /// Greatest age of the last accepted pose; `None` for a vehicle that does not stay level without the daemon.
    longest: Option<Span>,
    /// Thrust over that of a hover \[-\].
    thrust: f64,
    gravity_m_s2: f64,
}

impl BlindDescent {
    /// The descent of `config`.
    pub fn of(config: &Config) -> Self {
        let (safety, vehicle) = (&config.safety, &config.vehicle);
        let longest = Span::from_seconds((safety.coast_ms + safety.descend_ms) * 1e-3);
        Self {
            longest: vehicle.interface.holds_attitude().then_some(longest),
            thrust: safety.descend_thrust,
            gravity_m_s2: vehicle.gravity_m_s2,
        }
    }

    /// Whether the vehicle may descend, or descend further, on a last accepted pose of this age.
    pub fn is_possible(&self, age: Span) -> bool {
        self.longest.is_some_and(|longest| age <= longest)
    }

    /// Thrust of the descent \[N\] by the model of the vehicle's thrust and the mass adapted by the tracker. `lift` is the estimated upward
    /// external acceleration \[m/s^2\]: wind, or an error of thrust or mass to which the tracker has not adapted yet.
    pub fn thrust_n(&self, mass_kg: f64, lift: f64) -> f64 {
        let greatest = LARGEST_CORRECTION * self.gravity_m_s2;
        let known = if lift.is_finite() { lift.clamp(-greatest, greatest) } else { 0.0 };
        let share = self.thrust * (1.0 - known / self.gravity_m_s2);
        share.min(LARGEST_SHARE) * mass_kg * self.gravity_m_s2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_thrust_of_a_descent_is_at_most_the_weight_for_any_estimate() {
        let descent = BlindDescent::of(&Config::default());
        let share = |lift| descent.thrust_n(0.5, lift) / (0.5 * descent.gravity_m_s2);
        assert!((share(0.0) - 0.9).abs() < 1e-12);
        assert!((share(0.1 * descent.gravity_m_s2) - 0.81).abs() < 1e-12);
        assert!((share(f64::NAN) - 0.9).abs() < 1e-12);
        assert!((share(-1e9) - 1.0).abs() < 1e-12 && (share(1e9) - 0.63).abs() < 1e-12);
    }
}
