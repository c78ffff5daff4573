//! Payload to and from a radio, for every framing.

use std::slice::Chunks;
use std::str::FromStr;

use super::Framing;
use super::decoder::{Api1Decoder, Api1Grammar, Api2Decoder, Api2Grammar};
use super::frame::{ApiFrame, Payload, TooLong, UNKNOWN_NETWORK};
use super::packet::{MAX_PAYLOAD, WireBytes};
use crate::stream::{DecodedEvents, DecoderCounters};

/// Address of the remote radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Address {
    /// Address of 16 bits: frames 0x01, 0x81 and 0x89.
    Short(u16),
    /// Address of 64 bits: frames 0x10, 0x90 and 0x8B.
    Long(u64),
}

impl Address {
    /// Address of every radio in reach.
    pub const BROADCAST: Self = Self::Long(0xFFFF);
    /// Whether the address, of 16 or 64 bits, is the broadcast address.
    pub fn is_broadcast(self) -> bool {
        matches!(self, Self::Long(0xFFFF) | Self::Short(0xFFFF))
    }
}

/// Error in the text of an address.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("must be 4 or 16 hexadecimal digits, is `{0}`")]
pub struct InvalidAddress(String);

impl FromStr for Address {
    type Err = InvalidAddress;

    fn from_str(text: &str) -> Result<Self, InvalidAddress> {
        let address = match text.len() {
            4 => u16::from_str_radix(text, 16).ok().map(Self::Short),
            16 => u64::from_str_radix(text, 16).ok().map(Self::Long),
            _ => None,
        };
        address.ok_or_else(|| InvalidAddress(text.to_owned()))
    }
}

/// End of the serial port between a computer and its radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The computer, which sends requests and receives packets.
    Host,
    /// The radio, which receives requests and delivers packets.
    Radio,
}

/// Event on the serial port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RadioEvent {
    /// Payload for this end. The radio reports its delivery under `id`, unless that is 0.
    Payload {
        /// Number of the request \[-\].
        id: u8,
        /// The payload.
        payload: Payload,
    },
    /// Delivery report of a request, for the host.
    Delivery {
        /// Number of the request \[-\].
        id: u8,
        /// Whether the other radio acknowledged the packet.
        delivered: bool,
    },
    /// Status of the host's radio, as in Digi's manuals; 0 and 1 are resets.
    Modem(u8),
}

/// Carrier of payload at one end of the serial port. A host accepts packets from its peer alone, or from every radio if the peer
/// is the broadcast address.
#[derive(Clone, Debug)]
pub struct Carrier {
    side: Side,
    peer: Address,
    decoder: Inbound,
}

#[derive(Clone, Debug)]
enum Inbound {
    Transparent,
    Api1(Api1Decoder),
    Api2(Api2Decoder),
}

impl Carrier {
    /// Carrier to the radio `peer`.
    pub fn new(framing: Framing, side: Side, peer: Address) -> Self {
        let decoder = match framing {
            Framing::Transparent => Inbound::Transparent,
            Framing::Api1 => Inbound::Api1(Api1Decoder::new()),
            Framing::Api2 => Inbound::Api2(Api2Decoder::new()),
        };
        Self { side, peer, decoder }
    }

    /// Wraps `payload` for the serial port. With an `id` other than 0, a host requests a delivery report.
    ///
    /// # Errors
    /// More than [`MAX_PAYLOAD`] bytes; split them, as the radios do.
    pub fn wrap(&self, id: u8, payload: &[u8]) -> Result<WireBytes, TooLong> {
        let payload = Payload::try_from(payload)?;
        Ok(match self.escapes() {
            None => WireBytes::of(&payload).unwrap_or(WireBytes::EMPTY),
            Some(escaped) => self.frame_of(id, payload).to_wire(escaped),
        })
    }

    /// Encodes the delivery report of request `id`, from a radio to its host; empty without framing, or if `id` is 0.
    pub fn report(&self, id: u8, delivered: bool) -> WireBytes {
        // 0x01 and 0x21: no acknowledgement from the other radio.
        let frame = match self.peer {
            Address::Short(_) => {
                ApiFrame::TxStatus { id, status: if delivered { 0 } else { 0x01 } }
            }
            Address::Long(_) => ApiFrame::TxStatusExtended {
                id,
                network: UNKNOWN_NETWORK,
                retries: 0,
                delivery: if delivered { 0 } else { 0x21 },
                discovery: 0,
            },
        };
        match self.escapes() {
            Some(escaped) if id != 0 => frame.to_wire(escaped),
            _ => WireBytes::EMPTY,
        }
    }

    /// Bytes that the framing adds to a payload, escapes not counted \[bytes\].
    pub fn overhead(&self) -> usize {
        match (&self.decoder, self.side, self.peer) {
            (Inbound::Transparent, ..) => 0,
            (_, _, Address::Short(_)) => 9,
            (_, Side::Host, Address::Long(_)) => 18,
            (_, Side::Radio, Address::Long(_)) => 16,
        }
    }

    /// Takes bytes received on the serial port and returns the events that they complete. Bytes are taken as the iterator advances:
    /// run it to its end.
    pub fn push<'a>(&'a mut self, bytes: &'a [u8]) -> RadioEvents<'a> {
        let inbound = match &mut self.decoder {
            Inbound::Transparent => Pieces::Transparent(bytes.chunks(MAX_PAYLOAD)),
            Inbound::Api1(decoder) => Pieces::Api1(decoder.push(bytes)),
            Inbound::Api2(decoder) => Pieces::Api2(decoder.push(bytes)),
        };
        RadioEvents { side: self.side, peer: self.peer, inbound }
    }

    /// Counters of API frames since the start; zero without framing.
    pub fn counters(&self) -> DecoderCounters {
        match &self.decoder {
            Inbound::Transparent => DecoderCounters::default(),
            Inbound::Api1(decoder) => decoder.counters(),
            Inbound::Api2(decoder) => decoder.counters(),
        }
    }

    /// Discards the beginning of a frame, as after a reopened port.
    pub fn reset(&mut self) {
        match &mut self.decoder {
            Inbound::Transparent => {}
            Inbound::Api1(decoder) => decoder.reset(),
            Inbound::Api2(decoder) => decoder.reset(),
        }
    }

    fn escapes(&self) -> Option<bool> {
        match &self.decoder {
            Inbound::Transparent => None,
            Inbound::Api1(_) => Some(false),
            Inbound::Api2(_) => Some(true),
        }
    }

    fn frame_of(&self, id: u8, payload: Payload) -> ApiFrame {
        let (network, options, rssi) = (UNKNOWN_NETWORK, 0, 0);
        match (self.side, self.peer) {
            (Side::Host, Address::Short(to)) => ApiFrame::TxRequest16 { id, to, options, payload },
            (Side::Host, Address::Long(to)) => {
                ApiFrame::TxRequest { id, to, network, radius: 0, options, payload }
            }
            (Side::Radio, Address::Short(from)) => {
                ApiFrame::RxPacket16 { from, rssi, options, payload }
            }
            (Side::Radio, Address::Long(from)) => {
                ApiFrame::RxPacket { from, network, options, payload }
            }
        }
    }
}

/// Events that received bytes complete.
#[must_use = "bytes are only taken as the iterator advances"]
#[derive(Debug)]
pub struct RadioEvents<'a> {
    side: Side,
    peer: Address,
    inbound: Pieces<'a>,
}

#[derive(Debug)]
enum Pieces<'a> {
    Transparent(Chunks<'a, u8>),
    Api1(DecodedEvents<'a, Api1Grammar>),
    Api2(DecodedEvents<'a, Api2Grammar>),
}

impl Iterator for RadioEvents<'_> {
    type Item = RadioEvent;

    fn next(&mut self) -> Option<RadioEvent> {
        loop {
            let frame = match &mut self.inbound {
                Pieces::Transparent(chunks) => {
                    let payload = Payload::try_from(chunks.next()?).ok()?;
                    return Some(RadioEvent::Payload { id: 0, payload });
                }
                Pieces::Api1(frames) => frames.next()?,
                Pieces::Api2(frames) => frames.next()?,
            };
            if let Some(arrival) = arrival(self.side, self.peer, frame) {
                return Some(arrival);
            }
        }
    }
}

/// Converts a frame to an event of this side. Frames of the other direction are echoes and, like those of other radios, ignored.
fn arrival(side: Side, peer: Address, frame: ApiFrame) -> Option<RadioEvent> {
    match (side, frame) {
        (
            Side::Radio,
            ApiFrame::TxRequest { id, payload, .. } | ApiFrame::TxRequest16 { id, payload, .. },
        ) => Some(RadioEvent::Payload { id, payload }),
        (
            Side::Host,
            ApiFrame::RxPacket { from, payload, .. } | ApiFrame::RxPacket64 { from, payload, .. },
        ) => received_from(peer, Address::Long(from), payload),
        (Side::Host, ApiFrame::RxPacket16 { from, payload, .. }) => {
            received_from(peer, Address::Short(from), payload)
        }
        (
            Side::Host,
            ApiFrame::TxStatus { id, status: delivery }
            | ApiFrame::TxStatusExtended { id, delivery, .. },
        ) => Some(RadioEvent::Delivery { id, delivered: delivery == 0 }),
        (Side::Host, ApiFrame::ModemStatus(status)) => Some(RadioEvent::Modem(status)),
        (Side::Radio, _) | (Side::Host, _) => None,
    }
}

fn received_from(peer: Address, from: Address, payload: Payload) -> Option<RadioEvent> {
    (peer.is_broadcast() || peer == from).then_some(RadioEvent::Payload { id: 0, payload })
}
