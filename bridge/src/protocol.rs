//! What a bridge needs of a vehicle's protocol: orders into bytes, bytes into answers. The seam behind which wire formats live;
//! a new vehicle is one more implementation.

use std::fmt::Debug;

use crate::safety::VehicleSetpoint;

/// The longest frame that any protocol sends \[bytes\].
pub const MAX_FRAME: usize = 128;

/// A frame on its way out.
#[derive(Clone, Copy, Debug)]
pub struct VehicleFrame {
    bytes: [u8; MAX_FRAME],
    length: usize,
}

impl Default for VehicleFrame {
    fn default() -> Self {
        Self { bytes: [0; MAX_FRAME], length: 0 }
    }
}

impl VehicleFrame {
    /// The frame of these bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        let mut frame = Self::default();
        frame.push(bytes);
        frame
    }

    /// Adds `bytes`; what does not fit is left off, and such a frame is none.
    pub fn push(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if let Some(place) = self.bytes.get_mut(self.length) {
                *place = *byte;
                self.length += 1;
            }
        }
    }

    /// Its bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

/// What a vehicle says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VehicleReply {
    /// It took an setpoint.
    Acknowledged,
    /// How it is: the answer to a poll.
    Status {
        /// Battery voltage \[V\].
        battery_v: f64,
        /// Whether its motors run.
        motors_run: bool,
    },
    /// Something else that is valid.
    Other,
}

/// Bytes on the wire, whatever frames a radio puts around them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameSizes {
    /// Of an setpoint.
    pub setpoint: usize,
    /// Of the answer to an setpoint.
    pub acknowledgement: usize,
    /// Of a poll.
    pub poll: usize,
    /// Of the answer to a poll.
    pub status: usize,
}

/// A vehicle's protocol. No call allocates, and no bytes can make one panic.
pub trait VehicleProtocol: Debug + Send {
    /// How long its frames are.
    fn sizes(&self) -> FrameSizes;

    /// The frame for an setpoint.
    fn setpoint(&mut self, setpoint: &VehicleSetpoint) -> VehicleFrame;

    /// The frame that asks how the vehicle is.
    fn poll(&mut self) -> VehicleFrame;

    /// The frame that stops the motors at once.
    fn emergency_stop(&mut self) -> VehicleFrame;

    /// Takes bytes as they came, and tells what they complete.
    fn hear(&mut self, bytes: &[u8], reply: &mut dyn FnMut(VehicleReply));

    /// Frames that were damaged, in total.
    fn damaged(&self) -> u64;

    /// A port was opened: the beginning of a frame that came through another one is forgotten.
    fn forget(&mut self);
}
