//! Poses of trackers.

use crate::bytes::{ByteOrder, ByteReader, ByteWriter};
use crate::motion::RigidPose;

/// Payload of a message of the type `vrpn_Tracker Pos_Quat`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerPose {
    /// Number of the sensor of its tracker \[-\].
    pub sensor: i32,
    /// Position \[m, volume\].
    pub position_m: [f64; 3],
    /// Quaternion x, y, z, w \[body to volume\].
    pub attitude: [f64; 4],
}

impl TrackerPose {
    /// The payload of a pose of the first sensor.
    pub fn new(pose: &RigidPose) -> Self {
        Self { sensor: 0, position_m: pose.position_m, attitude: pose.attitude }
    }

    /// Parses a payload; `None` if it is too short.
    pub fn parse(payload: &[u8]) -> Option<Self> {
        let mut reader = ByteReader::new(payload, ByteOrder::Big);
        let (sensor, _padding) = (reader.i32()?, reader.i32()?);
        let position_m = [reader.f64()?, reader.f64()?, reader.f64()?];
        let attitude = [reader.f64()?, reader.f64()?, reader.f64()?, reader.f64()?];
        Some(Self { sensor, position_m, attitude })
    }

    /// The payload.
    pub fn to_payload(self) -> [u8; 64] {
        let mut payload = Vec::with_capacity(64);
        let mut writer = ByteWriter::new(&mut payload, ByteOrder::Big);
        writer.i32(self.sensor).i32(self.sensor);
        for number in self.position_m.into_iter().chain(self.attitude) {
            writer.f64(number);
        }
        let mut bytes = [0; 64];
        bytes.copy_from_slice(&payload);
        bytes
    }

    /// Pose in the volume; `None` if the numbers are not a pose.
    pub fn pose(&self) -> Option<RigidPose> {
        RigidPose::new(self.position_m, self.attitude)
    }
}
