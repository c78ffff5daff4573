//! `[mocap]`: what six cameras make of the truth.

use serde::{Deserialize, Serialize};

use crate::{Violation, not_negative, positive, probability};

/// `[mocap]`. Noise is Gaussian, per axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Mocap {
    /// The preset that these values started from.
    pub preset: String,
    /// Rate of the cameras \[Hz\].
    pub rate_hz: f64,
    /// Standard deviation of the position \[mm, per axis\].
    pub position_noise_mm: f64,
    /// Standard deviation of the attitude \[deg, per body axis\].
    pub attitude_noise_deg: f64,
    /// Capture to pose \[ms\].
    pub latency_ms: f64,
    /// Greatest addition to the latency \[ms\], uniform from zero.
    pub jitter_ms: f64,
    /// Poses are handed on at multiples of this \[ms\], as by a receiver that polls; 0 hands them on at once.
    pub poll_ms: f64,
    /// Probability that a frame starts a gap.
    pub dropout_probability: f64,
    /// Mean length of a gap \[frames\], geometric.
    pub dropout_frames: f64,
    /// Probability that a frame is wrong.
    pub outlier_probability: f64,
    /// Distance of a wrong frame from the truth \[m\].
    pub outlier_m: f64,
    /// Resolution of a position \[mm\]; 0 is exact.
    pub position_quantum_mm: f64,
    /// Resolution of a rotation vector \[deg\]; 0 is exact.
    pub attitude_quantum_deg: f64,
    /// A recording to play instead of the cameras; empty for none.
    pub replay: String,
}

impl Mocap {
    pub(crate) fn check(&self) -> Result<(), Violation> {
        if !["ideal", "qualisys", "measured"].contains(&self.preset.as_str()) {
            let rule = format!("must be ideal, qualisys or measured, is `{}`", self.preset);
            return Err(Violation::new("mocap.preset", rule));
        }
        positive("mocap.rate-hz", self.rate_hz)?;
        if self.rate_hz > 1000.0 {
            return Err(Violation::new("mocap.rate-hz", "must be at most 1000"));
        }
        not_negative("mocap.position-noise-mm", self.position_noise_mm)?;
        not_negative("mocap.attitude-noise-deg", self.attitude_noise_deg)?;
        not_negative("mocap.latency-ms", self.latency_ms)?;
        not_negative("mocap.jitter-ms", self.jitter_ms)?;
        not_negative("mocap.poll-ms", self.poll_ms)?;
        probability("mocap.dropout-probability", self.dropout_probability)?;
        if !(self.dropout_frames >= 1.0 && self.dropout_frames.is_finite()) {
            return Err(Violation::new("mocap.dropout-frames", "must be at least 1"));
        }
        probability("mocap.outlier-probability", self.outlier_probability)?;
        not_negative("mocap.outlier-m", self.outlier_m)?;
        not_negative("mocap.position-quantum-mm", self.position_quantum_mm)?;
        not_negative("mocap.attitude-quantum-deg", self.attitude_quantum_deg)
    }
}
