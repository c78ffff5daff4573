//! Bytes of packets, and payloads of MAVLink 2: little endian, the widest fields first, fields of an extension last; zeros at the end
//! are not sent.
//!
//! Field orders are those of the message definitions, `common.xml` and `ardupilotmega.xml` of <https://github.com/mavlink/mavlink>.

use crate::bytes::{ByteArray, ByteOrder, ByteReader};

/// Longest packet, signed \[bytes\].
pub const MAX_PACKET: usize = 280;

/// Bytes of a packet.
pub type MavlinkWire = ByteArray<MAX_PACKET>;

/// Greatest length of a payload \[bytes\].
pub(super) const MAX_PAYLOAD: usize = 255;

/// Ids of the messages \[-\].
pub(super) struct MavlinkId;

impl MavlinkId {
    pub(super) const HEARTBEAT: u32 = 0;
    pub(super) const SYS_STATUS: u32 = 1;
    pub(super) const PARAM_REQUEST_READ: u32 = 20;
    pub(super) const PARAM_VALUE: u32 = 22;
    pub(super) const PARAM_SET: u32 = 23;
    pub(super) const ATTITUDE_QUATERNION: u32 = 31;
    pub(super) const LOCAL_POSITION_NED: u32 = 32;
    pub(super) const SET_GPS_GLOBAL_ORIGIN: u32 = 48;
    pub(super) const COMMAND_LONG: u32 = 76;
    pub(super) const COMMAND_ACK: u32 = 77;
    pub(super) const SET_ATTITUDE_TARGET: u32 = 82;
    pub(super) const VISION_POSITION_ESTIMATE: u32 = 102;
    pub(super) const SIM_STATE: u32 = 108;
    pub(super) const TIMESYNC: u32 = 111;
    pub(super) const HIL_STATE_QUATERNION: u32 = 115;
    pub(super) const EKF_STATUS_REPORT: u32 = 193;
    pub(super) const ESTIMATOR_STATUS: u32 = 230;
    pub(super) const STATUSTEXT: u32 = 253;
    pub(super) const ODOMETRY: u32 = 331;
}

/// Payload with the zeros at its end.
#[derive(Clone, Copy, Debug)]
pub(super) struct MavlinkPayload {
    bytes: [u8; MAX_PAYLOAD],
    /// Number of bytes written \[bytes\].
    length: usize,
}

impl MavlinkPayload {
    /// Payload without fields.
    pub(super) fn new() -> Self {
        Self { bytes: [0; MAX_PAYLOAD], length: 0 }
    }

    /// Payload of received bytes; those that were not sent are zeros.
    pub(super) fn received(sent: &[u8]) -> Self {
        let mut payload = Self::new();
        payload.put(sent);
        payload
    }

    /// Appends a field. Bytes beyond the greatest length are cut off.
    pub(super) fn put(&mut self, field: &[u8]) -> &mut Self {
        for (place, byte) in self.bytes[self.length..].iter_mut().zip(field) {
            *place = *byte;
        }
        self.length = (self.length + field.len()).min(MAX_PAYLOAD);
        self
    }

    /// Appends a number of 8 bits.
    pub(super) fn u8(&mut self, number: u8) -> &mut Self {
        self.put(&[number])
    }

    /// Appends a number of 16 bits.
    pub(super) fn u16(&mut self, number: u16) -> &mut Self {
        self.put(&number.to_le_bytes())
    }

    /// Appends a number of 32 bits.
    pub(super) fn u32(&mut self, number: u32) -> &mut Self {
        self.put(&number.to_le_bytes())
    }

    /// Appends a number of 64 bits.
    pub(super) fn u64(&mut self, number: u64) -> &mut Self {
        self.put(&number.to_le_bytes())
    }

    /// Appends real numbers.
    pub(super) fn f32s(&mut self, numbers: &[f32]) -> &mut Self {
        for number in numbers {
            self.put(&number.to_le_bytes());
        }
        self
    }

    /// Bytes to be sent: at least one, without the zeros behind it.
    pub(super) fn sent(&self) -> &[u8] {
        let last = self.bytes[..self.length].iter().rposition(|byte| *byte != 0);
        &self.bytes[..last.unwrap_or(0) + 1]
    }

    /// Reader of the fields; no message is longer than the payload.
    pub(super) fn reader(&self) -> ByteReader<'_> {
        ByteReader::new(&self.bytes, ByteOrder::Little)
    }
}
