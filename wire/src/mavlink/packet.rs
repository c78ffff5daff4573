//! Packets of MAVLink 2: the encoder of one sender, and the grammar of a stream or of datagrams.
//!
//! Checksums are checked for every message of the common dialect and for ArduPilot's EKF_STATUS_REPORT; a packet with any other
//! message is skipped as a whole.

use crc::{CRC_16_MCRF4XX, Crc};

use super::address::MavlinkAddress;
use super::content::MavlinkContent;
use super::crc_extra::crc_extra;
use super::payload::{MAX_PACKET, MavlinkPayload, MavlinkWire};
use super::signature::{SIGNATURE, SignatureCheck, SignedBytes, Signer, SigningKey};
use super::{read, write};
use crate::stream::{Decoder, Grammar, Verdict};

/// First byte of a packet.
const START: u8 = 0xFD;
/// Length of the header with its start byte \[bytes\].
const HEADER: usize = 10;
const CHECKSUM: usize = 2;
/// Flag of a signed packet.
const SIGNED: u8 = 1;
/// Greatest plausible message id \[-\]: above it, a packet of an unknown message is treated as noise.
const MAX_MESSAGE_ID: u32 = 0xffff;

/// Checksum of a packet: of the bytes behind the start byte, and of the message's seed.
fn checksum(bytes: &[u8], extra: u8) -> u16 {
    const CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_MCRF4XX);
    let mut digest = CRC.digest();
    digest.update(bytes);
    digest.update(&[extra]);
    digest.finalize()
}

/// Encoder of the packets of one sender.
#[derive(Clone, Debug)]
pub struct MavlinkEncoder {
    own: MavlinkAddress,
    sequence: u8,
    signer: Option<Signer>,
}

impl MavlinkEncoder {
    /// Encoder of the sender `own`.
    pub fn new(own: MavlinkAddress) -> Self {
        Self { own, sequence: 0, signer: None }
    }

    /// The sender.
    pub fn own(&self) -> MavlinkAddress {
        self.own
    }

    /// Whether packets are signed.
    pub fn signs(&self) -> bool {
        self.signer.is_some()
    }

    /// Signs packets from now on with `key`, where Unix time is `unix_us` \[us\].
    pub fn sign(&mut self, key: SigningKey, unix_us: u64) {
        self.signer = Some(Signer::new(key, unix_us));
    }

    /// Makes the stamps of further packets later than those that `check` has accepted; no effect if packets are not signed.
    pub fn follow(&mut self, check: &SignatureCheck) {
        if let Some(signer) = &mut self.signer {
            signer.follow(check);
        }
    }

    /// Number of the next packet, modulo 256, and its stamp, zero if packets are not signed \[-\].
    pub fn position(&self) -> (u8, u64) {
        (self.sequence, self.signer.as_ref().map_or(0, Signer::stamp))
    }

    /// Continues behind the packets of another encoder of this sender, which has reached this [`Self::position`]. The stamp never
    /// decreases: this encoder may already have adopted later stamps of received packets.
    pub fn continue_at(&mut self, (sequence, stamp): (u8, u64)) {
        self.sequence = sequence;
        if let Some(signer) = &mut self.signer {
            signer.raise_stamp(stamp);
        }
    }

    /// The packet of a message; `None` for a message that cannot be sent.
    pub fn encode(&mut self, content: &MavlinkContent) -> Option<MavlinkWire> {
        let (id, payload) = write::message(content)?;
        let wire = self.packet(id, &payload);
        self.sequence = self.sequence.wrapping_add(1);
        wire
    }

    fn packet(&mut self, id: u32, payload: &MavlinkPayload) -> Option<MavlinkWire> {
        let payload = payload.sent();
        let [low, middle, high, _] = id.to_le_bytes();
        let flags = if self.signs() { SIGNED } else { 0 };
        let length = payload.len() as u8;
        let MavlinkAddress { system, component } = self.own;
        let mut wire = MavlinkWire::EMPTY;
        wire.put(&[START, length, flags, 0, self.sequence, system, component, low, middle, high]);
        wire.put(payload);
        let checksum = checksum(&wire.as_bytes()[1..], crc_extra(id)?);
        wire.put(&checksum.to_le_bytes());
        if let Some(signer) = &mut self.signer {
            signer.sign(&mut wire);
        }
        Some(wire)
    }
}

/// Received message and its sender.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MavlinkPacket {
    /// The sender.
    pub from: MavlinkAddress,
    /// Number of the packet within the sequence of its sender, modulo 256 \[-\].
    pub sequence: u8,
    /// Meaning of the message.
    pub content: MavlinkContent,
    /// The packet with its signature, if it has one: checked by [`SignatureCheck`].
    pub signed: Option<SignedBytes>,
}

/// Grammar of MAVLink 2. Signatures of received packets are kept, and not checked.
#[derive(Clone, Copy, Debug)]
pub struct MavlinkGrammar;

/// Decoder of a stream, or of datagrams.
pub type MavlinkDecoder = Decoder<MavlinkGrammar>;

impl Grammar for MavlinkGrammar {
    type Event = MavlinkPacket;

    const START: u8 = START;

    fn inspect(bytes: &[u8]) -> Verdict<MavlinkPacket> {
        let Some(&[_, length, flags, _, sequence, system, component, id @ ..]) =
            bytes.first_chunk::<HEADER>()
        else {
            return Verdict::Wait(HEADER);
        };
        let [low, middle, high] = id;
        let id = u32::from_le_bytes([low, middle, high, 0]);
        if flags & !SIGNED != 0 || id > MAX_MESSAGE_ID {
            return Verdict::Noise;
        }
        let behind = HEADER + usize::from(length);
        let whole = behind + CHECKSUM + SIGNATURE * usize::from(flags & SIGNED);
        let Some(frame) = bytes.get(..whole) else { return Verdict::Wait(whole) };
        let Some(extra) = crc_extra(id) else { return unknown(bytes, whole) };
        let received = u16::from_le_bytes([frame[behind], frame[behind + 1]]);
        if checksum(&frame[1..behind], extra) != received {
            return Verdict::Damaged;
        }
        let from = MavlinkAddress { system, component };
        let content = read::content(id, &frame[HEADER..behind]);
        let signed = if flags & SIGNED != 0 { SignedBytes::of(frame) } else { None };
        Verdict::Accept(whole, Some(MavlinkPacket { from, sequence, content, signed }))
    }
}

/// Verdict on a packet of `whole` bytes with an unknown message, whose checksum cannot be computed: accepted if another packet follows it.
/// Otherwise, noise that looks like the beginning of a packet would cause the loss of the packets behind it.
fn unknown(bytes: &[u8], whole: usize) -> Verdict<MavlinkPacket> {
    match bytes.get(whole) {
        Some(&START) => Verdict::Accept(whole, None),
        Some(_) => Verdict::Noise,
        None if whole < MAX_PACKET => Verdict::Wait(whole + 1),
        None => Verdict::Accept(whole, None),
    }
}
