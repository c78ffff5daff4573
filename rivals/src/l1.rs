//! Geometric control with L1 adaptation.
//!
//! ```text
//! f = a_r - k_v e_v - k_p e_p + D v + g z - C(s) s_v,   T = m f . z_body
//! u = C omega_r - k_R e_R + (tau + h/2) C alpha_r - tau C(s) s_w
//! predictor    z' = model + s + A_s (z^ - z),   z = [v; omega]
//! adaptation   s = -Phi^-1 exp(A_s h) (z^ - z),   Phi = A_s^-1 (exp(A_s h) - I), held for a tick
//! ```
//!
//! Source: T. Lee, M. Leok and N. H. McClamroch, *IEEE CDC* 2010, and Z. Wu et al., *L1Quad: L1 Adaptive Augmentation of Geometric
//! Control for Agile Quadrotors With Performance Guarantees*, IEEE TCST 33(2), 2025 (arXiv 2302.07208). Differences: the vehicle takes
//! body rates, as with the law `geometric`, so that the adapted torque becomes a rate; the adapted force across the thrust, which the
//! source only estimates, turns the desired force if `cancels_lateral` is set.

use nalgebra::Vector3;
use oqtal_control::predictive::{ModelInput, Motion};
use oqtal_control::tracking_error::AttitudeError;

use crate::dfbc::{axes, force_for, thrust_along};
use crate::law::{RateVehicle, Rival, RivalTick};

/// Gains of [`L1Geometric`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct L1Options {
    /// `k_p`, horizontal and vertical \[1/s^2\].
    pub position: [f64; 2],
    /// `k_v`, horizontal and vertical \[1/s\].
    pub velocity: [f64; 2],
    /// `k_R`, of tilt and heading \[1/s\].
    pub attitude: [f64; 2],
    /// `-A_s` of the velocity and of the rate \[1/s\].
    pub predictor_per_s: [f64; 2],
    /// Bandwidth of `C(s)` for force and rate \[rad/s\]; 0 for no adaptation.
    pub bandwidth_rad_s: [f64; 2],
    /// Whether the adapted force across the thrust is cancelled, too.
    pub cancels_lateral: bool,
}

impl Default for L1Options {
    fn default() -> Self {
        Self {
            position: [6.0, 6.0],
            velocity: [4.0, 4.0],
            attitude: [8.0, 4.0],
            predictor_per_s: [1.0, 1.0],
            bandwidth_rad_s: [2.0, 4.0],
            cancels_lateral: true,
        }
    }
}

impl L1Options {
    /// Ranges of the gains of [`Self::of`] in a search.
    pub const RANGES: [[f64; 2]; 8] = [
        [1.0, 60.0],
        [1.0, 60.0],
        [1.0, 20.0],
        [1.0, 20.0],
        [1.0, 40.0],
        [0.5, 20.0],
        [0.1, 20.0],
        [0.1, 40.0],
    ];

    /// Options with these gains \[units of the fields\], in the order of the fields without that of the predictor.
    pub fn of(gains: &[f64; 8]) -> Self {
        let [p_h, p_v, v_h, v_v, tilt, heading, force, rate] = *gains;
        Self {
            position: [p_h, p_v],
            velocity: [v_h, v_v],
            attitude: [tilt, heading],
            bandwidth_rad_s: [force, rate],
            ..Self::default()
        }
    }
}

/// Velocity \[m/s, world\] and body rate \[rad/s, body\], or their derivatives.
type Pair = [Vector3<f64>; 2];

/// The law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct L1Geometric {
    options: L1Options,
    /// Predicted velocity and rate; `None` before the first tick.
    predicted: Option<Pair>,
    /// Adapted acceleration \[m/s^2, world\] and angular acceleration \[rad/s^2, body\], behind the filter.
    adapted: Pair,
}

impl L1Geometric {
    /// The law with these gains.
    pub fn new(options: L1Options) -> Self {
        Self { options, predicted: None, adapted: [Vector3::zeros(); 2] }
    }

    /// Takes the motion and the input of `tick`: adaptation, filter and predictor.
    fn adapt(&mut self, tick: &RivalTick) {
        let RivalTick { vehicle, measured, dt_s, .. } = *tick;
        let measured_pair = [measured.velocity, measured.rate];
        let predicted = self.predicted.unwrap_or(measured_pair);
        let model = model_of(vehicle, measured, &tick.acting);
        self.predicted = Some(std::array::from_fn(|part| {
            let (pole, bandwidth) =
                (self.options.predictor_per_s[part], self.options.bandwidth_rad_s[part]);
            let error = predicted[part] - measured_pair[part];
            // Wu et al., piecewise-constant adaptation: the error fades within a tick
            let kept = (-pole * dt_s).exp();
            let sigma = -error * (pole * kept / (1.0 - kept));
            let share = 1.0 - (-bandwidth * dt_s).exp();
            self.adapted[part] += (sigma - self.adapted[part]) * share;
            predicted[part] + (model[part] + sigma - error * pole) * dt_s
        }));
    }
}

/// Derivatives of velocity and rate by the model.
fn model_of(vehicle: &RateVehicle, motion: &Motion, acting: &ModelInput) -> Pair {
    let up = motion.attitude.to_world(&Vector3::z());
    [
        up * (motion.thrust_n / vehicle.mass_kg)
            - Vector3::z() * vehicle.gravity_m_s2
            - motion.velocity * vehicle.drag_per_s,
        (acting.demand - motion.rate) / vehicle.rate_lag_s,
    ]
}

impl Rival for L1Geometric {
    fn reset(&mut self) {
        *self = Self::new(self.options);
    }

    fn command(&mut self, tick: &RivalTick) -> ModelInput {
        let RivalTick { vehicle, motion, dt_s, .. } = *tick;
        let L1Options { position, velocity, attitude, cancels_lateral, .. } = self.options;
        self.adapt(tick);
        let [acceleration, angular] = self.adapted;
        let reference = (tick.reference)(0.0);
        let up = motion.attitude.to_world(&Vector3::z());
        let cancelled = match cancels_lateral {
            true => acceleration,
            false => up * acceleration.dot(&up),
        };
        // Lee et al., the force of the position-controlled mode, per mass
        let correction = (reference.position - motion.position).component_mul(&axes(position))
            + (reference.velocity - motion.velocity).component_mul(&axes(velocity));
        let force = force_for(&reference, vehicle, motion, &(correction - cancelled));
        let wanted = force.attitude(reference.yaw_after(0.0));
        let error = AttitudeError::between(&wanted.attitude, &motion.attitude);
        // Lee et al., e_R, as in the law `geometric`
        let e_r = 2.0 * error.lambda() * error.eps();
        let to_body = error.rotation();
        let lag_s = vehicle.rate_lag_s;
        vehicle.limited(&ModelInput {
            demand: to_body * (wanted.rate.0 + wanted.acceleration.0 * (lag_s + dt_s / 2.0))
                - e_r.component_mul(&axes(attitude))
                - angular * lag_s,
            thrust_n: thrust_along(&force, (vehicle, motion), dt_s),
            ..ModelInput::default()
        })
    }
}
