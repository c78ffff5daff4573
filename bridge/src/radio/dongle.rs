//! Interface to a radio.

use std::fmt::Debug;
use std::io;

use oqtal_wire::crtp::CrtpPacket;
use oqtal_wire::link::RadioSpec;

/// Outcome of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RadioAck {
    /// Whether the vehicle acknowledged it.
    pub is_acknowledged: bool,
    /// Number of times that the radio repeated the packet \[-\].
    pub repeated: u32,
    /// Payload of the vehicle's acknowledgement.
    pub reply: Option<CrtpPacket>,
}

/// Radio that reaches several vehicles, one packet at a time.
pub trait RadioDongle: Debug {
    /// Sends `packet` to the vehicle at `target`, and waits for the acknowledgement.
    ///
    /// # Errors
    /// The radio is lost.
    fn exchange(&mut self, target: &RadioSpec, packet: &CrtpPacket) -> io::Result<RadioAck>;

    /// Sends `packet` to every vehicle on the channel and with the rate of `target`; none acknowledges it.
    ///
    /// # Errors
    /// The radio is lost.
    fn broadcast(&mut self, target: &RadioSpec, packet: &CrtpPacket) -> io::Result<()>;
}
