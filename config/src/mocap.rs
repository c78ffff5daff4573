//! `[mocap]`: the emulated camera system.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

use crate::mocap_cameras::{CameraOptions, MarkerOptions};
use crate::mocap_room::{DELAY, RoomOptions};
use crate::mocap_serve::ServeOptions;
use crate::preset;

/// Model of the measurement of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MocapModel {
    /// True pose with configured noise.
    Pose,
    /// Markers seen by cameras, triangulated, and a rigid body fitted to them.
    Markers,
}

/// Instant stamped on a pose as its capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CaptureStamp {
    /// The capture itself.
    Exact,
    /// Arrival of the pose, as for a receiver without a clock model.
    Arrival,
    /// Capture on a clock with offset and drift, as for a receiver that uses a foreign clock unconverted.
    Clock,
}

/// `[mocap]`. Noise is Gaussian, per axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct MocapOptions {
    /// Name of the preset on which these values are based.
    pub preset: String,
    /// Model of the measurement.
    pub model: MocapModel,
    /// Capture time of a pose.
    pub stamp: CaptureStamp,
    /// Rate of the cameras \[Hz\].
    pub rate_hz: f64,
    /// Standard deviation of the position \[mm, per axis\].
    pub position_noise_mm: f64,
    /// Standard deviation of the attitude \[deg, per body axis\].
    pub attitude_noise_deg: f64,
    /// Time from capture to pose \[ms\].
    pub latency_ms: f64,
    /// Greatest random addition to the latency \[ms\], uniform from 0.
    pub jitter_ms: f64,
    /// Polling period of an emulated receiver \[ms\]: poses are published at its multiples; 0 publishes them at once.
    pub poll_ms: f64,
    /// Probability that a frame starts a gap \[0..1\].
    pub dropout_probability: f64,
    /// Mean length of a gap \[frames\], geometric.
    pub dropout_frames: f64,
    /// Probability that a frame is an outlier \[0..1\].
    pub outlier_probability: f64,
    /// Distance of an outlier from the truth \[m\], in a random direction.
    pub outlier_m: f64,
    /// Resolution of a position \[mm\]; 0 is exact.
    pub position_quantum_mm: f64,
    /// Resolution of a rotation vector \[deg\]; 0 is exact.
    pub attitude_quantum_deg: f64,
    /// A recording to play instead of the cameras; empty for none.
    pub replay: String,
    /// `[mocap.room]`.
    pub room: RoomOptions,
    /// `[mocap.cameras]`.
    pub cameras: CameraOptions,
    /// `[mocap.markers]`.
    pub markers: MarkerOptions,
    /// `[mocap.serve]`: poses over the network.
    pub serve: ServeOptions,
}

impl MocapOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        preset::check("mocap.preset", &self.preset)?;
        let probability = Rule::Between(0.0, 1.0);
        check_options([
            ("rate-hz", self.rate_hz, Rule::Between(f64::MIN_POSITIVE, 1000.0)),
            ("position-noise-mm", self.position_noise_mm, Rule::NotNegative),
            ("attitude-noise-deg", self.attitude_noise_deg, Rule::NotNegative),
            ("latency-ms", self.latency_ms, DELAY),
            ("jitter-ms", self.jitter_ms, DELAY),
            ("poll-ms", self.poll_ms, DELAY),
            ("dropout-probability", self.dropout_probability, probability),
            ("dropout-frames", self.dropout_frames, Rule::Between(1.0, f64::MAX)),
            ("outlier-probability", self.outlier_probability, probability),
            ("outlier-m", self.outlier_m, Rule::NotNegative),
            ("position-quantum-mm", self.position_quantum_mm, Rule::NotNegative),
            ("attitude-quantum-deg", self.attitude_quantum_deg, Rule::NotNegative),
        ])
        .map_err(|error| error.within("mocap"))?;
        self.room.check().map_err(|error| error.within("mocap.room"))?;
        self.serve.check().map_err(|error| error.within("mocap.serve"))?;
        self.cameras.check().map_err(|error| error.within("mocap.cameras"))?;
        self.markers.check().map_err(|error| error.within("mocap.markers"))
    }
}
