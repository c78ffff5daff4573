//! Body rate and angular acceleration behind one first-order filter, for laws that use a measured angular acceleration.

use std::f64::consts::TAU;

use nalgebra::Vector3;

/// Greatest rate that is filtered \[rad/s\]; greater values are not vehicle motion.
const MOST_RAD_S: f64 = 1e3;
/// Shortest step over which a rate is differentiated \[s\].
const SHORTEST_S: f64 = 1e-5;

/// Body rate and its derivative behind a first-order filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FilteredRate {
    cutoff_rad_s: f64,
    /// Filtered rate \[rad/s, body axes\]; `None` before the first one.
    rate: Option<Vector3<f64>>,
    acceleration: Vector3<f64>,
}

impl FilteredRate {
    /// A filter with this cut-off frequency \[Hz\].
    pub(super) fn new(cutoff_hz: f64) -> Self {
        Self { cutoff_rad_s: TAU * cutoff_hz, rate: None, acceleration: Vector3::zeros() }
    }

    /// Takes the rate `omega` \[rad/s, body axes\], `dt_s` after the last one \[s\]. Returns the weight of the new value in the
    /// filter \[-\].
    pub(super) fn step(&mut self, omega: &Vector3<f64>, dt_s: f64) -> f64 {
        let omega = omega.map(|rate| rate.clamp(-MOST_RAD_S, MOST_RAD_S));
        let dt_s = dt_s.max(SHORTEST_S);
        let share = -(-self.cutoff_rad_s * dt_s).exp_m1();
        let last = self.rate.unwrap_or(omega);
        let change = share * (omega - last);
        self.rate = Some(last + change);
        self.acceleration = change / dt_s;
        share
    }

    /// The filtered rate \[rad/s, body axes\].
    pub(super) fn rate(&self) -> Vector3<f64> {
        self.rate.unwrap_or_default()
    }

    /// The filtered angular acceleration \[rad/s^2, body axes\].
    pub(super) fn acceleration(&self) -> Vector3<f64> {
        self.acceleration
    }

    /// Resets the filter.
    pub(super) fn reset(&mut self) {
        (self.rate, self.acceleration) = (None, Vector3::zeros());
    }
}
