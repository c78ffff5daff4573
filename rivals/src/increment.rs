//! The error of the rate command, measured by the angular acceleration: incremental nonlinear dynamic inversion (INDI) around the
//! vehicle's rate loop.
//!
//! ```text
//! d = omega_f + tau omega_dot_f - u_f,   u = omega + tau alpha_d - d
//! ```
//!
//! For `omega = omega_f` this is the increment `u = u_f + tau (alpha_d - omega_dot_f)` of Sun et al., Eqs. (32) to (35), where the
//! torque is replaced by the rate command and the inertia by the lag `tau`: the same filter for measured motion and input. Written with
//! `d`, the increment can be added to a motion that is predicted.

use std::f64::consts::{PI, SQRT_2};

use nalgebra::Vector3;

use crate::law::RivalTick;

/// Greatest cut-off frequency over the rate of the ticks \[-\].
const GREATEST_CUTOFF: f64 = 0.45;

/// Second-order Butterworth filter of three numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Butterworth {
    /// The last two inputs and outputs, newest first; `None` before the first input.
    past: Option<[[Vector3<f64>; 2]; 2]>,
}

impl Butterworth {
    /// Takes `value` and returns the output; `cutoff` is the cut-off frequency over that of the ticks \[-\].
    fn step(&mut self, value: Vector3<f64>, cutoff: f64) -> Vector3<f64> {
        let [[x_1, x_2], [y_1, y_2]] = self.past.unwrap_or([[value; 2]; 2]);
        // The bilinear transformation with the cut-off frequency kept.
        let k = (PI * cutoff.min(GREATEST_CUTOFF)).tan();
        let scale = 1.0 + SQRT_2 * k + k * k;
        let inputs = (value + x_1 * 2.0 + x_2) * (k * k);
        let outputs = y_1 * (2.0 * (k * k - 1.0)) + y_2 * (1.0 - SQRT_2 * k + k * k);
        let output = (inputs - outputs) / scale;
        self.past = Some([[value, x_1], [output, y_1]]);
        output
    }
}

/// The measured error of the rate command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateIncrement {
    cutoff_hz: f64,
    rate: Butterworth,
    input: Butterworth,
    /// Filtered rate of the last tick \[rad/s, body\] and the input in effect in it \[rad/s, body\].
    last: Option<[Vector3<f64>; 2]>,
}

impl RateIncrement {
    /// The measurement with this cut-off frequency \[Hz\]; 0 for none.
    pub fn new(cutoff_hz: f64) -> Self {
        Self { cutoff_hz, rate: Butterworth::default(), input: Butterworth::default(), last: None }
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        *self = Self::new(self.cutoff_hz);
    }

    /// Takes the motion and the input of `tick`, and returns the error of the rate command \[rad/s, body\]; `None` without a measurement.
    pub fn demand_error(&mut self, tick: &RivalTick) -> Option<Vector3<f64>> {
        if self.cutoff_hz <= 0.0 {
            return None;
        }
        let cutoff = self.cutoff_hz * tick.dt_s;
        let rate = self.rate.step(tick.measured.rate, cutoff);
        let acting = tick.acting.demand;
        let [last_rate, last_acting] = self.last.replace([rate, acting]).unwrap_or([rate, acting]);
        // The difference belongs to the middle of the tick, as does the mean of the inputs.
        let input = self.input.step((acting + last_acting) / 2.0, cutoff);
        let acceleration = (rate - last_rate) / tick.dt_s;
        Some((rate + last_rate) / 2.0 + acceleration * tick.vehicle.rate_lag_s - input)
    }
}
