//! The interface of a message body, and the hash that identifies its layout.

use super::field::Field;

/// Body of a message: the data of a topic, behind the [`super::Header`].
pub trait Message: Copy + std::fmt::Debug + Default + 'static {
    /// Hash of the wire name and of name, type and unit of every field, including the header's.
    const SCHEMA: u64;
    /// Table of the fields, in the order of their bytes.
    const FIELDS: &'static [Field];
    /// Length of the encoded body \[bytes\].
    const SIZE: usize;

    /// Writes the fields one after another, little-endian and without padding, into `bytes`.
    ///
    /// # Panics
    /// `bytes` is shorter than [`Message::SIZE`].
    fn encode(&self, bytes: &mut [u8]);

    /// Reads the fields as [`Message::encode`] wrote them.
    ///
    /// # Panics
    /// `bytes` is shorter than [`Message::SIZE`].
    fn decode(bytes: &[u8]) -> Self;
}

/// Message body of a type that is not known at compile time.
pub trait AnyMessage {
    /// [`Message::FIELDS`].
    fn fields(&self) -> &'static [Field];

    /// The fields as [`Message::encode`] writes them.
    fn packed(&self) -> Vec<u8>;
}

impl<M: Message> AnyMessage for M {
    fn fields(&self) -> &'static [Field] {
        M::FIELDS
    }

    fn packed(&self) -> Vec<u8> {
        let mut bytes = vec![0; M::SIZE];
        self.encode(&mut bytes);
        bytes
    }
}

/// FNV-1a, 64 bits: the hash of schemas and trajectories.
pub const fn fnv1a(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        i += 1;
    }
    hash
}

/// The start value of [`fnv1a`].
pub const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;

/// Continues `hash` with a wire name and with `;name:type:unit` of every field.
pub(super) const fn schema(hash: u64, wire_name: &str, fields: &[Field]) -> u64 {
    let mut hash = fnv1a(hash, wire_name.as_bytes());
    let mut i = 0;
    while i < fields.len() {
        let parts = [";", fields[i].name, ":", fields[i].type_name, ":", fields[i].unit];
        let mut k = 0;
        while k < parts.len() {
            hash = fnv1a(hash, parts[k].as_bytes());
            k += 1;
        }
        i += 1;
    }
    hash
}

/// Number of digits of a hash in the names of files. iceoryx2 allows 255 characters for a path, which has the name of a run twice and
/// up to 130 others.
pub(crate) const SHORT_DIGITS: usize = 10;

/// The first digits of a hash, for the name of a file.
pub(crate) fn short_digits(hash: u64) -> String {
    format!("{hash:016x}")[..SHORT_DIGITS].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fnv1a_agrees_with_its_published_test_value() {
        // Fowler, Noll, Vo: FNV-1a 64 of "foobar".
        assert_eq!(fnv1a(FNV_OFFSET, b"foobar"), 0x8594_4171_f739_67e8);
    }
}
