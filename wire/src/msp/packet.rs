//! Packets of MSP, and their grammar in a stream.

use crate::stream::{Decoder, Grammar, Verdict};

/// Longest payload \[bytes\]; a length of 255 announces a longer one, which none of these messages has.
pub const MAX_MSP_PAYLOAD: usize = 254;
/// Length of a packet without payload: head, kind, length, command and checksum \[bytes\].
pub const MSP_ENVELOPE: usize = 6;
/// Length of what precedes the payload \[bytes\].
const PREFIX: usize = 5;

/// Kind of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MspKind {
    /// Request from the host.
    Request,
    /// Reply of the vehicle: the request was executed.
    Reply,
    /// Refusal by the vehicle: the request is unknown, or was refused.
    Refusal,
}

impl MspKind {
    const ALL: [(Self, u8); 3] =
        [(Self::Request, b'<'), (Self::Reply, b'>'), (Self::Refusal, b'!')];

    fn mark(self) -> u8 {
        Self::ALL
            .into_iter()
            .find_map(|(kind, mark)| (kind == self).then_some(mark))
            .unwrap_or(b'!')
    }

    fn of(mark: u8) -> Option<Self> {
        Self::ALL.into_iter().find_map(|(kind, known)| (known == mark).then_some(kind))
    }
}

/// One packet.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct MspPacket {
    /// Kind of the packet.
    pub kind: MspKind,
    /// Command number, one of [`super::command`] \[-\].
    pub command: u8,
    bytes: [u8; MAX_MSP_PAYLOAD + MSP_ENVELOPE],
    length: usize,
}

/// Grammar of packets of all kinds.
#[derive(Clone, Copy, Debug)]
pub struct MspGrammar;

/// Decoder of a stream of packets.
pub type MspDecoder = Decoder<MspGrammar>;

impl MspPacket {
    /// Packet with `payload`, of which at most [`MAX_MSP_PAYLOAD`] bytes are taken.
    pub fn new(kind: MspKind, command: u8, payload: &[u8]) -> Self {
        let payload = &payload[..payload.len().min(MAX_MSP_PAYLOAD)];
        let length = payload.len() as u8;
        let mut bytes = [0; MAX_MSP_PAYLOAD + MSP_ENVELOPE];
        bytes[..PREFIX].copy_from_slice(&[b'$', b'M', kind.mark(), length, command]);
        bytes[PREFIX..PREFIX + payload.len()].copy_from_slice(payload);
        bytes[PREFIX + payload.len()] = checksum(&bytes[3..PREFIX + payload.len()]);
        Self { kind, command, bytes, length: payload.len() + MSP_ENVELOPE }
    }

    /// Request with `payload`.
    pub fn request(command: u8, payload: &[u8]) -> Self {
        Self::new(MspKind::Request, command, payload)
    }

    /// The payload.
    pub fn payload(&self) -> &[u8] {
        &self.bytes[PREFIX..self.length - 1]
    }

    /// The bytes on the wire.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

impl std::fmt::Debug for MspPacket {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?} {} {:?}", self.kind, self.command, self.payload())
    }
}

impl Grammar for MspGrammar {
    type Event = MspPacket;

    const START: u8 = b'$';

    fn inspect(bytes: &[u8]) -> Verdict<MspPacket> {
        if bytes.get(1).is_some_and(|byte| *byte != b'M') {
            return Verdict::Noise;
        }
        let &[_, _, mark, length, command, ..] = bytes else { return Verdict::Wait(PREFIX) };
        let Some(kind) = MspKind::of(mark) else { return Verdict::Noise };
        let length = usize::from(length);
        if length > MAX_MSP_PAYLOAD {
            return Verdict::Damaged;
        }
        let Some(frame) = bytes.get(..length + MSP_ENVELOPE) else {
            return Verdict::Wait(length + MSP_ENVELOPE);
        };
        // The exclusive or with its own checksum is zero.
        if checksum(&frame[3..]) != 0 {
            return Verdict::Damaged;
        }
        let packet = MspPacket::new(kind, command, &frame[PREFIX..length + PREFIX]);
        Verdict::Accept(frame.len(), Some(packet))
    }
}

fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}
