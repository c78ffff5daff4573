//! `[receiver]`: connection to a real camera system.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

/// Greatest size of a room or a body offset \[m\].
const LENGTH: Rule = Rule::Between(-1000.0, 1000.0);
/// A full turn either way \[deg\].
const ANGLE: Rule = Rule::Between(-360.0, 360.0);

/// Axis of the camera system's room that points upward.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UpAxis {
    /// Third axis, as in the world of oqtal.
    Z,
    /// Second axis.
    Y,
}

/// Source of the instants of capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StampSource {
    /// Stamps of the server, converted by an estimate of its clock.
    Server,
    /// Arrivals of the frames.
    Arrival,
}

/// `[receiver]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ReceiverOptions {
    /// Link to the camera system; empty for none. Parsed by the receiver.
    pub link: String,
    /// Source of the instants of capture.
    pub stamps: StampSource,
    /// Time from the exposure of a frame to the arrival of the fastest frames \[ms\].
    pub camera_latency_ms: f64,
    /// Axis of the room that points upward; applied before the rotation of the room.
    pub up_axis: UpAxis,
    /// Origin of the room \[m, world\].
    pub room_position_m: [f64; 3],
    /// Roll, pitch and yaw from the room to the world \[deg\].
    pub room_rotation_deg: [f64; 3],
    /// Centre of mass of the vehicle \[m, frame of the markers\].
    pub body_position_m: [f64; 3],
    /// Roll, pitch and yaw from the body to the frame of the markers \[deg\].
    pub body_rotation_deg: [f64; 3],
    /// Greatest delay relative to the fastest frames with which a frame is passed on \[ms\].
    pub max_delay_ms: f64,
    /// Time without a frame after which the receiver reconnects \[ms\].
    pub silence_ms: f64,
}

impl ReceiverOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("camera-latency-ms", self.camera_latency_ms, Rule::Between(0.0, 200.0)),
            ("max-delay-ms", self.max_delay_ms, Rule::Positive),
            ("silence-ms", self.silence_ms, Rule::Between(100.0, 60_000.0)),
        ])
        .and_then(|()| check_vector("room-position-m", self.room_position_m, LENGTH))
        .and_then(|()| check_vector("room-rotation-deg", self.room_rotation_deg, ANGLE))
        .and_then(|()| check_vector("body-position-m", self.body_position_m, LENGTH))
        .and_then(|()| check_vector("body-rotation-deg", self.body_rotation_deg, ANGLE))
        .map_err(|error| error.within("receiver"))
    }
}

fn check_vector(key: &str, vector: [f64; 3], rule: Rule) -> Result<(), OptionError> {
    check_options(vector.map(|number| (key, number, rule)))
}
