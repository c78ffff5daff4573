//! Signatures of MAVLink 2: how packets are signed, and which of those that are received are believed.
//!
//! A signature is the beginning of SHA-256 over a secret key, the packet and a stamp that rises with every packet, so that a packet that
//! was recorded and is sent again is told from a new one.

use std::fmt;

use mavlink::MAVLinkV2MessageRaw;

use super::address::MavlinkAddress;

/// Length of a signature, with the number of its link and its stamp \[bytes\].
pub(super) const SIGNATURE: usize = 13;
/// Seconds between the beginnings of Unix time and of MAVLink's signatures, 1 January 2015.
const SIGNATURE_EPOCH_S: u64 = 1_420_070_400;
/// Age, by the newest stamp that is known, above which the first packet of a sender is not believed \[10 us\]: a minute.
const FIRST_WITHIN: u64 = 6_000_000;
/// Greatest stamp that a packet can carry \[10 us\].
const GREATEST_STAMP: u64 = (1 << 48) - 1;
/// Most senders that are believed \[-\]; each has a key.
const MAX_SENDERS: usize = 16;

/// Secret key of signed packets.
#[derive(Clone, PartialEq, Eq)]
pub struct SigningKey([u8; 32]);

impl SigningKey {
    /// Key of 64 hexadecimal digits; `None` for anything else.
    #[must_use]
    pub fn from_hex(text: &str) -> Option<Self> {
        let mut key = [0; 32];
        if text.len() != 64 || !text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
            return None;
        }
        for (place, index) in key.iter_mut().zip((0..64).step_by(2)) {
            *place = u8::from_str_radix(&text[index..index + 2], 16).ok()?;
        }
        Some(Self(key))
    }

    fn signature_of(&self, raw: &MAVLinkV2MessageRaw) -> [u8; 6] {
        let mut signature = [0; 6];
        raw.calculate_signature(&self.0, &mut signature);
        signature
    }
}

impl fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SigningKey(…)")
    }
}

/// Stamp of the instant `unix_us` of Unix time \[10 us since 1 January 2015\].
fn stamp_of(unix_us: u64) -> u64 {
    unix_us.saturating_sub(SIGNATURE_EPOCH_S * 1_000_000) / 10
}

/// Signature of the packets of one sender: their stamps rise.
#[derive(Clone, Debug)]
pub(super) struct Signer {
    key: SigningKey,
    /// Stamp of the next packet \[10 us since 1 January 2015\].
    stamp: u64,
}

impl Signer {
    /// Signer with `key`, where Unix time is `unix_us` \[us\].
    pub(super) fn new(key: SigningKey, unix_us: u64) -> Self {
        Self { key, stamp: stamp_of(unix_us) }
    }

    /// Signs the packet `raw`, which has room for it.
    pub(super) fn sign(&mut self, raw: &mut MAVLinkV2MessageRaw) {
        let stamp = self.stamp.to_le_bytes();
        let place = raw.signature_timestamp_bytes_mut();
        let length = place.len();
        place.copy_from_slice(&stamp[..length]);
        *raw.signature_link_id_mut() = 0;
        let signature = self.key.signature_of(raw);
        raw.signature_value_mut().copy_from_slice(&signature);
        self.stamp += 1;
    }

    /// Makes the next stamp later than every one that `check` has accepted: a receiver that knows those believes no sender whose
    /// first stamp is a minute behind them, as of a machine whose clock was not set.
    pub(super) fn follow(&mut self, check: &SignatureCheck) {
        self.stamp = self.stamp.max(check.newest.saturating_add(1)).min(GREATEST_STAMP);
    }
}

/// Packet with its signature, as it was received.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct SignedBytes(MAVLinkV2MessageRaw);

impl SignedBytes {
    /// Copy of a whole signed packet; `None` if it is longer than any.
    pub(super) fn of(frame: &[u8]) -> Option<Self> {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.as_mut_slice().get_mut(..frame.len())?.copy_from_slice(frame);
        Some(Self(raw))
    }
}

impl fmt::Debug for SignedBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SignedBytes(…)")
    }
}

/// Stream of signed packets of one sender.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SignedStream {
    from: MavlinkAddress,
    link: u8,
    /// Stamp of its last packet \[10 us since 1 January 2015\].
    stamp: u64,
}

/// Check of the signatures of received packets, by the rules of MAVLink: a packet must be signed with the key, and its stamp must be
/// greater than that of the packet before it from the same sender; that of a sender's first packet at most a minute behind the newest
/// stamp that is known.
#[derive(Clone, Debug)]
pub struct SignatureCheck {
    key: SigningKey,
    /// Newest stamp that is known \[10 us since 1 January 2015\].
    newest: u64,
    streams: [Option<SignedStream>; MAX_SENDERS],
}

impl SignatureCheck {
    /// Check by `key`, where Unix time is `unix_us` \[us\].
    #[must_use]
    pub fn new(key: SigningKey, unix_us: u64) -> Self {
        Self { key, newest: stamp_of(unix_us), streams: [None; MAX_SENDERS] }
    }

    /// Whether a packet of `from` is believed; `signed` is the packet if it has a signature. Remembers its stamp if so.
    pub fn accepts(&mut self, from: MavlinkAddress, signed: Option<&SignedBytes>) -> bool {
        let Some(SignedBytes(raw)) = signed else { return false };
        if self.key.signature_of(raw) != raw.signature_value() {
            return false;
        }
        let (link, stamp) = (raw.signature_link_id(), raw.signature_timestamp());
        let is_same = |stream: &SignedStream| (stream.from, stream.link) == (from, link);
        let known = self.streams.iter_mut().flatten().find(|stream| is_same(stream));
        match known {
            Some(stream) if stamp > stream.stamp => stream.stamp = stamp,
            Some(_) => return false,
            None if stamp.saturating_add(FIRST_WITHIN) < self.newest => return false,
            None => {
                let Some(place) = self.streams.iter_mut().find(|stream| stream.is_none()) else {
                    return false;
                };
                *place = Some(SignedStream { from, link, stamp });
            }
        }
        self.newest = self.newest.max(stamp);
        true
    }
}
