//! Control by differential flatness, with incremental inversion of the rate loop.
//!
//! ```text
//! f = a_r + K_v (v_r - v) + K_p (p_r - p) + D v - b + g z
//! T = m f . z_body,   alpha_d = k_t q_tilt + k_y q_yaw + K_w (omega_r - omega) + alpha_r
//! ```
//!
//! Source: S. Sun, A. Romero, P. Foehn, E. Kaufmann and D. Scaramuzza, *A Comparative Study of Nonlinear MPC and
//! Differential-Flatness-Based Control for Quadrotor Agile Flight*, IEEE T-RO 38(6), 2022 (arXiv 2109.01365); the attitude error in
//! which tilt comes before heading is that of D. Brescianini and R. D'Andrea, *IEEE TCST* 28(2), 2020. Differences: the vehicle takes
//! body rates, so that the inversion is of its rate loop and there is no allocation to rotors; the thrust is ahead of its lag, and rate
//! and thrust of half of the time for which a command is held; `b`, a disturbance estimated elsewhere, is an option.

use nalgebra::Vector3;
use oqtal_control::predictive::{Force, ModelInput, Motion};
use oqtal_control::tracking_error::{AttitudeError, AttitudeReference};
use oqtal_control::trajectory::Reference;

use crate::flat::thrust_growth;
use crate::increment::RateIncrement;
use crate::law::{RateVehicle, Rival, RivalTick};

/// Gains of [`Dfbc`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DfbcOptions {
    /// `K_p`, horizontal and vertical \[1/s^2\].
    pub position: [f64; 2],
    /// `K_v`, horizontal and vertical \[1/s\].
    pub velocity: [f64; 2],
    /// `k_t` \[1/s^2\].
    pub tilt: f64,
    /// `k_y` \[1/s^2\].
    pub yaw: f64,
    /// `K_w`, of tilt and heading \[1/s\].
    pub rate: [f64; 2],
    /// Cut-off frequency of the inversion \[Hz\]; 0 for none.
    pub indi_cutoff_hz: f64,
}

impl Default for DfbcOptions {
    fn default() -> Self {
        Self {
            position: [6.0, 6.0],
            velocity: [4.0, 4.0],
            tilt: 150.0,
            yaw: 20.0,
            rate: [20.0, 8.0],
            indi_cutoff_hz: 12.0,
        }
    }
}

impl DfbcOptions {
    /// Ranges of the gains of [`Self::of`] in a search.
    pub const RANGES: [[f64; 2]; 9] = [
        [1.0, 60.0],
        [1.0, 60.0],
        [1.0, 20.0],
        [1.0, 20.0],
        [10.0, 600.0],
        [4.0, 200.0],
        [4.0, 60.0],
        [2.0, 40.0],
        [0.1, 12.0],
    ];

    /// Options with these gains \[units of the fields\], in the order of the fields.
    pub fn of(gains: &[f64; 9]) -> Self {
        let [p_h, p_v, v_h, v_v, tilt, yaw, rate_tilt, rate_yaw, indi_cutoff_hz] = *gains;
        let (position, velocity, rate) = ([p_h, p_v], [v_h, v_v], [rate_tilt, rate_yaw]);
        Self { position, velocity, tilt, yaw, rate, indi_cutoff_hz }
    }
}

/// The law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dfbc {
    options: DfbcOptions,
    increment: RateIncrement,
}

impl Dfbc {
    /// The law with these gains.
    pub fn new(options: DfbcOptions) -> Self {
        Self { options, increment: RateIncrement::new(options.indi_cutoff_hz) }
    }

    /// The angular acceleration that takes `motion` to `wanted` \[rad/s^2, body\].
    fn angular_acceleration(&self, motion: &Motion, wanted: &AttitudeReference) -> Vector3<f64> {
        let DfbcOptions { tilt, yaw, rate, .. } = self.options;
        let error = AttitudeError::between(&wanted.attitude, &motion.attitude);
        // From the body to its reference: the inverse of the error.
        let (x, y, z) = (-error.eps().x, -error.eps().y, -error.eps().z);
        let w = error.lambda();
        let norm = w.hypot(z).max(f64::EPSILON);
        // Sun et al., Eq. (28): the turn of the thrust axis, then that about it
        let to_tilt = Vector3::new(w * x - y * z, w * y + x * z, 0.0) / norm;
        let to_heading = Vector3::new(0.0, 0.0, z / norm);
        let to_reference = error.rotation();
        let rate_error = to_reference * wanted.rate.0 - motion.rate;
        to_tilt * tilt
            + to_heading * yaw
            + rate_error.component_mul(&axes(rate))
            + to_reference * wanted.acceleration.0
    }
}

impl Rival for Dfbc {
    fn reset(&mut self) {
        self.increment.reset();
    }

    fn command(&mut self, tick: &RivalTick) -> ModelInput {
        let RivalTick { vehicle, motion, bias, dt_s, .. } = *tick;
        let DfbcOptions { position, velocity, .. } = self.options;
        let reference = (tick.reference)(0.0);
        let correction = (reference.position - motion.position).component_mul(&axes(position))
            + (reference.velocity - motion.velocity).component_mul(&axes(velocity));
        let force = force_for(&reference, vehicle, motion, &(correction - bias.acceleration));
        // Sun et al., Eqs. (14) to (24): attitude, rate and acceleration of the force
        let wanted = force.attitude(reference.yaw_after(0.0));
        let alpha = self.angular_acceleration(motion, &wanted);
        let error = self.increment.demand_error(tick).unwrap_or(bias.demand);
        let lag_s = vehicle.rate_lag_s;
        // Of a command that is held the mean effect is that of the middle: the reference's own change is ahead by half a tick.
        let held = wanted.acceleration.0 * (dt_s / 2.0);
        vehicle.limited(&ModelInput {
            demand: motion.rate + alpha * lag_s + held - error,
            thrust_n: thrust_along(&force, (vehicle, motion), dt_s),
            ..ModelInput::default()
        })
    }
}

/// Force per mass on `reference` with the drag of `motion` and the additional acceleration `correction` \[m/s^2, world\].
pub(crate) fn force_for(
    reference: &Reference,
    vehicle: &RateVehicle,
    motion: &Motion,
    correction: &Vector3<f64>,
) -> Force {
    let drag = vehicle.drag_per_s;
    let up = Vector3::z() * vehicle.gravity_m_s2;
    Force {
        value: reference.acceleration + correction + motion.velocity * drag + up,
        slope: reference.jerk + reference.acceleration * drag,
        curvature: reference.snap + reference.jerk * drag,
    }
}

/// Thrust command for `force` in the attitude of `motion` \[N\], ahead of its lag and of half of the time for which it is held.
pub(crate) fn thrust_along(
    force: &Force,
    (vehicle, motion): (&RateVehicle, &Motion),
    dt_s: f64,
) -> f64 {
    let along = force.value.dot(&motion.attitude.to_world(&Vector3::z()));
    vehicle.mass_kg * (along + thrust_growth(force) * (vehicle.thrust_lag_s + dt_s / 2.0))
}

/// Gains of horizontal or tilt, and of vertical or heading, for each axis.
pub(crate) fn axes([horizontal, vertical]: [f64; 2]) -> Vector3<f64> {
    Vector3::new(horizontal, horizontal, vertical)
}
