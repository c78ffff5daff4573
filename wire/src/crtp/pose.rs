//! Poses from a camera system: of one vehicle in full, or of up to two vehicles in one packet that every vehicle may receive.

use super::packet::{CrtpPacket, CrtpPort};
use super::quaternion::{compress, decompress};
use crate::bytes::{ByteOrder, ByteReader};

/// Channel of poses.
const CHANNEL: u8 = 1;
/// Type of a pose in full.
pub(super) const FULL_POSE: u8 = 8;
/// Type of packed poses.
pub(super) const PACKED_POSES: u8 = 9;

/// Pose as the vehicle's estimator takes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CrtpPose {
    /// Position \[m, world\].
    pub position: [f64; 3],
    /// Unit quaternion `[x, y, z, w]`, body to world \[-\].
    pub attitude: [f64; 4],
}

impl CrtpPose {
    pub(super) fn packet(&self) -> CrtpPacket {
        let packet = CrtpPacket::new(CrtpPort::Localization, CHANNEL, &[FULL_POSE]);
        let numbers = self.position.into_iter().chain(self.attitude);
        numbers.fold(packet, |packet, number| packet.with(&(number as f32).to_le_bytes()))
    }

    pub(super) fn read(fields: &[u8]) -> Option<Self> {
        let mut fields = ByteReader::new(fields, ByteOrder::Little);
        let position = fields.f32s::<3>()?.map(f64::from);
        Some(Self { position, attitude: fields.f32s::<4>()?.map(f64::from) })
    }
}

/// Pose of one of several vehicles: to a millimetre and 0.28 degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PackedPose {
    /// Last byte of the vehicle's radio address \[-\].
    pub vehicle: u8,
    position_mm: [i16; 3],
    attitude: u32,
}

impl PackedPose {
    const BYTES: usize = 11;

    /// Packs `pose` of the vehicle whose radio address ends with `vehicle`; `None` if it lies further than 32.767 m from the
    /// origin, or is not finite.
    pub fn of(vehicle: u8, pose: &CrtpPose) -> Option<Self> {
        let is_finite = pose.attitude.iter().all(|component| component.is_finite());
        let mut position_mm = [0; 3];
        for (counts, metres) in position_mm.iter_mut().zip(pose.position) {
            let rounded = (metres * 1e3).round();
            let fits = rounded.abs() <= f64::from(i16::MAX);
            *counts = fits.then_some(rounded as i16)?;
        }
        is_finite.then(|| Self { vehicle, position_mm, attitude: compress(pose.attitude) })
    }

    /// The pose.
    pub fn pose(&self) -> CrtpPose {
        let position = self.position_mm.map(|counts| f64::from(counts) * 1e-3);
        CrtpPose { position, attitude: decompress(self.attitude) }
    }

    fn put_into(&self, packet: &mut CrtpPacket) {
        packet.put(&[self.vehicle]);
        self.position_mm.iter().for_each(|counts| packet.put(&counts.to_le_bytes()));
        packet.put(&self.attitude.to_le_bytes());
    }

    fn read(fields: &[u8]) -> Option<Self> {
        let mut fields = ByteReader::new(fields, ByteOrder::Little);
        let vehicle = fields.u8()?;
        let position_mm = [fields.i16()?, fields.i16()?, fields.i16()?];
        Some(Self { vehicle, position_mm, attitude: fields.u32()? })
    }
}

/// Poses of one or two vehicles in one packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PackedPoses {
    poses: [PackedPose; Self::MAX],
    count: usize,
}

impl PackedPoses {
    /// Most poses of one packet \[-\].
    pub const MAX: usize = 2;

    /// Packet of the first [`Self::MAX`] of `poses`.
    pub fn of(poses: &[PackedPose]) -> Self {
        let count = poses.len().min(Self::MAX);
        let mut packed = Self { poses: [PackedPose::default(); Self::MAX], count };
        packed.poses[..count].copy_from_slice(&poses[..count]);
        packed
    }

    /// The poses.
    pub fn poses(&self) -> &[PackedPose] {
        &self.poses[..self.count]
    }

    pub(super) fn packet(&self) -> CrtpPacket {
        let mut packet = CrtpPacket::new(CrtpPort::Localization, CHANNEL, &[PACKED_POSES]);
        self.poses().iter().for_each(|pose| pose.put_into(&mut packet));
        packet
    }

    pub(super) fn read(fields: &[u8]) -> Self {
        let mut packed = Self::of(&[]);
        let pieces = fields.chunks_exact(PackedPose::BYTES).take(Self::MAX);
        for pose in pieces.filter_map(PackedPose::read) {
            packed.poses[packed.count] = pose;
            packed.count += 1;
        }
        packed
    }
}
