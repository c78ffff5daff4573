//! Signatures of MAVLink 2: signing of packets, and the check of received ones.
//!
//! A signature is the beginning of SHA-256 over a secret key, the packet and a stamp that increases with every packet, so that replayed
//! packets are rejected.

use std::fmt;

use sha2::{Digest, Sha256};

use super::address::MavlinkAddress;
use super::payload::MavlinkWire;
use crate::hex::{from_hex, to_hex};

/// Length of a signature, with the number of its link and its stamp \[bytes\].
pub(super) const SIGNATURE: usize = 13;
/// Length of the part of the hash that is sent \[bytes\].
const SIGNATURE_HASH: usize = 6;
/// Number of the link in a signature \[-\].
const LINK: u8 = 0;
/// Seconds between the beginnings of Unix time and of MAVLink's signatures, 1 January 2015.
const SIGNATURE_EPOCH_S: u64 = 1_420_070_400;
/// Greatest age of a sender's first packet, relative to the newest known stamp \[10 us\]: a minute.
const MAX_FIRST_AGE: u64 = 6_000_000;
/// Greatest stamp of a packet \[10 us\].
const MAX_STAMP: u64 = (1 << 48) - 1;
/// Most accepted senders \[-\]; each has a key.
const MAX_SENDERS: usize = 16;

/// Secret key of signed packets.
#[derive(Clone, PartialEq, Eq)]
pub struct SigningKey([u8; 32]);

impl SigningKey {
    /// Key of 64 hexadecimal digits; `None` for anything else.
    pub fn from_hex(text: &str) -> Option<Self> {
        from_hex(text.as_bytes()).map(Self)
    }

    /// Text that differs for different keys and does not reveal the key.
    pub fn fingerprint(&self) -> String {
        to_hex(&self.signature_of(b"fingerprint"))
    }

    /// Signature of `bytes`: a packet up to the stamp of its signature.
    fn signature_of(&self, bytes: &[u8]) -> [u8; SIGNATURE_HASH] {
        let hash = Sha256::new().chain_update(self.0).chain_update(bytes).finalize();
        std::array::from_fn(|index| hash[index])
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

    /// Appends the signature to a packet.
    pub(super) fn sign(&mut self, wire: &mut MavlinkWire) {
        let [stamp @ .., _, _] = self.stamp.to_le_bytes();
        wire.put(&[LINK]).put(&stamp);
        let signature = self.key.signature_of(wire.as_bytes());
        wire.put(&signature);
        self.stamp += 1;
    }

    /// Stamp of the next packet.
    pub(super) fn stamp(&self) -> u64 {
        self.stamp
    }

    /// Raises the stamp of the next packet to at least `stamp`: stamps must not decrease.
    pub(super) fn raise_stamp(&mut self, stamp: u64) {
        self.stamp = self.stamp.max(stamp);
    }

    /// Makes the next stamp later than every stamp that `check` has accepted. Receivers reject a sender whose first stamp is more than
    /// a minute older, for instance because the clock of its machine was not set.
    pub(super) fn follow(&mut self, check: &SignatureCheck) {
        self.stamp = self.stamp.max(check.newest.saturating_add(1)).min(MAX_STAMP);
    }
}

/// Received packet with its signature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SignedBytes(MavlinkWire);

impl SignedBytes {
    /// Copy of a whole signed packet; `None` if it is longer than any.
    pub(super) fn of(frame: &[u8]) -> Option<Self> {
        MavlinkWire::of(frame).map(Self)
    }

    /// Signed bytes, link, stamp \[10 us since 1 January 2015\] and signature.
    fn parts(&self) -> Option<(&[u8], u8, u64, [u8; SIGNATURE_HASH])> {
        let (signed, signature) = self.0.as_bytes().split_last_chunk()?;
        let [.., link, a, b, c, d, e, f] = *signed else { return None };
        Some((signed, link, u64::from_le_bytes([a, b, c, d, e, f, 0, 0]), *signature))
    }
}

/// Stream of signed packets of one sender.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SignedStream {
    from: MavlinkAddress,
    link: u8,
    /// Stamp of the last packet of the sender \[10 us since 1 January 2015\].
    stamp: u64,
}

/// Check of the signatures of received packets, by the rules of MAVLink: a packet must be signed with the key, and its stamp must be
/// greater than that of the previous packet of the same sender. The stamp of a sender's first packet may be at most a minute older
/// than the newest known stamp.
#[derive(Clone, Debug)]
pub struct SignatureCheck {
    key: SigningKey,
    /// Newest known stamp \[10 us since 1 January 2015\].
    newest: u64,
    streams: [Option<SignedStream>; MAX_SENDERS],
}

impl SignatureCheck {
    /// Check by `key`, where Unix time is `unix_us` \[us\].
    pub fn new(key: SigningKey, unix_us: u64) -> Self {
        Self { key, newest: stamp_of(unix_us), streams: [None; MAX_SENDERS] }
    }

    /// Checks a packet of `from`, `signed` if it has a signature, and stores its stamp if it is accepted.
    pub fn accepts(&mut self, from: MavlinkAddress, signed: Option<&SignedBytes>) -> bool {
        let Some((bytes, link, stamp, signature)) = signed.and_then(SignedBytes::parts) else {
            return false;
        };
        if self.key.signature_of(bytes) != signature {
            return false;
        }
        let is_same = |stream: &SignedStream| (stream.from, stream.link) == (from, link);
        let known = self.streams.iter_mut().flatten().find(|stream| is_same(stream));
        match known {
            Some(stream) if stamp > stream.stamp => stream.stamp = stamp,
            Some(_) => return false,
            None if stamp.saturating_add(MAX_FIRST_AGE) < self.newest => return false,
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
