//! Packets of MAVLink 2: the encoder of one sender, and the grammar of a stream or of datagrams.
//!
//! Messages of the common dialect are decoded by the crate; of ArduPilot's own dialect one is read here, EKF_STATUS_REPORT, so that
//! the dialect need not be built. A packet with a message that is unknown here is skipped as a whole.

use mavlink::dialects::common::MavMessage;
use mavlink::{MAV_STX_V2, MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message, calculate_crc};

use super::address::MavlinkAddress;
use super::content::MavlinkContent;
use super::signature::{SIGNATURE, SignatureCheck, SignedBytes, Signer, SigningKey};
use super::{read, write};
use crate::stream::{Decoder, Grammar, Verdict};

/// Longest packet, signed \[bytes\].
pub const MAX_PACKET: usize = 280;
/// Length of the header with its start byte \[bytes\].
const HEADER: usize = 10;
const CHECKSUM: usize = 2;
/// Flag of a signed packet.
const SIGNED: u8 = 1;
/// Number of EKF_STATUS_REPORT, the byte that its checksum includes, and where its flags are.
const EKF_STATUS_REPORT: u32 = 193;
const EKF_STATUS_CRC: u8 = 71;
const EKF_STATUS_FLAGS: usize = 20;
/// Numbers of messages above which a packet of an unknown message is taken for noise \[-\].
const GREATEST_MESSAGE: u32 = 0xffff;

/// Bytes of a packet.
#[derive(Clone, Copy)]
pub struct MavlinkWire(MAVLinkV2MessageRaw);

impl MavlinkWire {
    /// The bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        self.0.raw_bytes()
    }
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
    #[must_use]
    pub fn new(own: MavlinkAddress) -> Self {
        Self { own, sequence: 0, signer: None }
    }

    /// The sender.
    #[must_use]
    pub fn own(&self) -> MavlinkAddress {
        self.own
    }

    /// Whether packets are signed.
    #[must_use]
    pub fn signs(&self) -> bool {
        self.signer.is_some()
    }

    /// Signs packets from now on with `key`, where Unix time is `unix_us` \[us\].
    pub fn sign(&mut self, key: SigningKey, unix_us: u64) {
        self.signer = Some(Signer::new(key, unix_us));
    }

    /// Stamps the packets from now on later than those that `check` has accepted; nothing if packets are not signed.
    pub fn follow(&mut self, check: &SignatureCheck) {
        if let Some(signer) = &mut self.signer {
            signer.follow(check);
        }
    }

    /// The packet of a message; `None` for one that cannot be sent.
    pub fn encode(&mut self, content: &MavlinkContent) -> Option<MavlinkWire> {
        let message = write::message(content)?;
        let MavlinkAddress { system, component } = self.own;
        let header = MavHeader {
            sequence: self.sequence,
            system_id: system.into(),
            component_id: component,
        };
        self.sequence = self.sequence.wrapping_add(1);
        let mut raw = MAVLinkV2MessageRaw::new();
        match &mut self.signer {
            None => raw.serialize_message(header, &message),
            Some(signer) => {
                raw.serialize_message_for_signing(header, &message);
                signer.sign(&mut raw);
            }
        }
        Some(MavlinkWire(raw))
    }
}

/// Message, and who sent it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MavlinkPacket {
    /// The sender.
    pub from: MavlinkAddress,
    /// Number of the packet among those of its sender, modulo 256 \[-\].
    pub sequence: u8,
    /// What it says.
    pub content: MavlinkContent,
    /// The packet with its signature, if it has one: [`SignatureCheck`] says whether it is believed.
    pub signed: Option<SignedBytes>,
}

/// Grammar of MAVLink 2. Signatures of received packets are kept, and not checked.
#[derive(Clone, Copy, Debug)]
pub struct MavlinkGrammar;

/// Decoder of a stream, or of datagrams.
pub type MavlinkDecoder = Decoder<MavlinkGrammar>;

impl Grammar for MavlinkGrammar {
    type Event = MavlinkPacket;

    const START: u8 = MAV_STX_V2;

    fn inspect(bytes: &[u8]) -> Verdict<MavlinkPacket> {
        let Some(&[_, length, flags, _, sequence, system, component, id @ ..]) =
            bytes.first_chunk::<HEADER>()
        else {
            return Verdict::Wait(HEADER);
        };
        let [low, middle, high] = id;
        let id = u32::from_le_bytes([low, middle, high, 0]);
        if flags & !SIGNED != 0 || id > GREATEST_MESSAGE {
            return Verdict::Noise;
        }
        let behind = HEADER + usize::from(length);
        let whole = behind + CHECKSUM + SIGNATURE * usize::from(flags & SIGNED);
        let Some(frame) = bytes.get(..whole) else { return Verdict::Wait(whole) };
        let Some(extra) = extra_of(id) else { return unknown(bytes, whole) };
        let checksum = u16::from_le_bytes([frame[behind], frame[behind + 1]]);
        if calculate_crc(&frame[1..behind], extra) != checksum {
            return Verdict::Damaged;
        }
        let from = MavlinkAddress { system, component };
        let content = content_of(id, &frame[HEADER..behind]);
        let signed = if flags & SIGNED != 0 { SignedBytes::of(frame) } else { None };
        Verdict::Accept(whole, Some(MavlinkPacket { from, sequence, content, signed }))
    }
}

/// Verdict on a packet of `whole` bytes whose message is unknown, so that its checksum cannot be computed: it is one if another
/// packet follows it. Noise that looks like its beginning would cost the packets behind it otherwise.
fn unknown(bytes: &[u8], whole: usize) -> Verdict<MavlinkPacket> {
    match bytes.get(whole) {
        Some(&MAV_STX_V2) => Verdict::Accept(whole, None),
        Some(_) => Verdict::Noise,
        None if whole < MAX_PACKET => Verdict::Wait(whole + 1),
        None => Verdict::Accept(whole, None),
    }
}

/// The byte that the checksum of the message `id` includes; `None` for an unknown message.
fn extra_of(id: u32) -> Option<u8> {
    if id == EKF_STATUS_REPORT {
        return Some(EKF_STATUS_CRC);
    }
    MavMessage::default_message_from_id(id).map(|_| MavMessage::extra_crc(id))
}

fn content_of(id: u32, payload: &[u8]) -> MavlinkContent {
    if id == EKF_STATUS_REPORT {
        // Zeros at the end are not sent.
        let byte = |at: usize| payload.get(at).copied().unwrap_or_default();
        let flags = [byte(EKF_STATUS_FLAGS), byte(EKF_STATUS_FLAGS + 1)];
        return MavlinkContent::Estimator(u16::from_le_bytes(flags));
    }
    let message = MavMessage::parse(MavlinkVersion::V2, id, payload);
    message.map_or(MavlinkContent::Other, |message| read::content(&message))
}
