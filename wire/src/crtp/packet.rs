//! Packets as bytes: port and channel in the header, payload.

/// Greatest payload \[bytes\].
pub const MAX_CRTP_PAYLOAD: usize = 30;
/// Greatest packet \[bytes\]: header and payload.
pub const MAX_CRTP_PACKET: usize = 1 + MAX_CRTP_PAYLOAD;

/// Bits of the header that are neither port nor channel: set by hosts, counters of a radio's safe link elsewhere.
const LINK_BITS: u8 = 0x0C;

/// Ports that are used here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum CrtpPort {
    /// Text.
    Console = 0,
    /// Parameters.
    Parameters = 2,
    /// Set-points of roll, pitch, yaw and thrust.
    Commander = 3,
    /// Memories.
    Memory = 4,
    /// Log variables.
    Logging = 5,
    /// Poses from outside; before protocol 12, the emergency stop.
    Localization = 6,
    /// Set-points of other kinds.
    GenericCommander = 7,
    /// Arming and state, from protocol 12 on.
    Supervisor = 9,
    /// Protocol version; before protocol 12, arming.
    Platform = 13,
    /// Echo and source.
    LinkService = 15,
}

impl CrtpPort {
    const ALL: [Self; 10] = [
        Self::Console,
        Self::Parameters,
        Self::Commander,
        Self::Memory,
        Self::Logging,
        Self::Localization,
        Self::GenericCommander,
        Self::Supervisor,
        Self::Platform,
        Self::LinkService,
    ];

    /// The port of this number; `None` if it is not used here.
    pub fn from_wire(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|port| *port as u8 == number)
    }
}

/// Error in bytes that should be a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CrtpError {
    /// Number of bytes that no packet has.
    #[error("{0} bytes; a packet has 1 to {MAX_CRTP_PACKET}")]
    Length(usize),
}

/// Packet: header and payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CrtpPacket {
    bytes: [u8; MAX_CRTP_PACKET],
    length: usize,
}

impl CrtpPacket {
    /// Packet without data; a radio sends it to fetch data of a vehicle.
    pub const NULL: Self = {
        let mut bytes = [0; MAX_CRTP_PACKET];
        bytes[0] = 0xFF;
        Self { bytes, length: 1 }
    };

    /// Packet of `payload`, cut off beyond [`MAX_CRTP_PAYLOAD`].
    pub fn new(port: CrtpPort, channel: u8, payload: &[u8]) -> Self {
        let mut packet = Self { bytes: [0; MAX_CRTP_PACKET], length: 1 };
        packet.bytes[0] = (port as u8) << 4 | LINK_BITS | (channel & 3);
        packet.put(payload);
        packet
    }

    /// Takes one packet from `bytes`, a datagram or a radio's acknowledgement.
    ///
    /// # Errors
    /// The bytes are empty or too many.
    pub fn parse(bytes: &[u8]) -> Result<Self, CrtpError> {
        let ([header, payload @ ..], true) = (bytes, bytes.len() <= MAX_CRTP_PACKET) else {
            return Err(CrtpError::Length(bytes.len()));
        };
        let mut packet = Self { bytes: [0; MAX_CRTP_PACKET], length: 1 };
        packet.bytes[0] = header | LINK_BITS;
        packet.put(payload);
        Ok(packet)
    }

    /// The packet as on the wire.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// Number of the port \[-\].
    pub fn port(&self) -> u8 {
        self.bytes[0] >> 4
    }

    /// Number of the channel \[-, 0..3\].
    pub fn channel(&self) -> u8 {
        self.bytes[0] & 3
    }

    /// Bytes after the header.
    pub fn payload(&self) -> &[u8] {
        &self.bytes[1..self.length]
    }

    /// Whether the packet has no data.
    pub fn is_null(&self) -> bool {
        self.port() == CrtpPort::LinkService as u8 && self.channel() == 3
    }

    /// Appends `bytes`, as far as there is room.
    pub(super) fn put(&mut self, bytes: &[u8]) {
        let count = bytes.len().min(MAX_CRTP_PACKET - self.length);
        self.bytes[self.length..self.length + count].copy_from_slice(&bytes[..count]);
        self.length += count;
    }

    /// The packet with `bytes` appended.
    pub(super) fn with(mut self, bytes: &[u8]) -> Self {
        self.put(bytes);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_holds_port_and_channel_for_any_counter_of_the_radio() {
        let packet = CrtpPacket::new(CrtpPort::Commander, 0, &[]);
        assert_eq!(packet.as_bytes(), [0x3C]);
        for header in [0x30, 0x34, 0x38, 0x3C] {
            assert_eq!(CrtpPacket::parse(&[header]), Ok(packet));
        }
        assert!(CrtpPacket::NULL.is_null() && CrtpPacket::parse(&[0xF3]).unwrap().is_null());
    }

    #[test]
    fn no_more_than_31_bytes_are_a_packet() {
        assert_eq!(CrtpPacket::parse(&[]), Err(CrtpError::Length(0)));
        assert_eq!(CrtpPacket::parse(&[0x3C; 31]).unwrap().payload().len(), 30);
        assert_eq!(CrtpPacket::parse(&[0x3C; 32]), Err(CrtpError::Length(32)));
        assert_eq!(CrtpPacket::new(CrtpPort::Platform, 1, &[0; 40]).payload().len(), 30);
    }
}
