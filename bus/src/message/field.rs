//! Fields of messages: their description, and the encoding of their values.

use crate::text::Text;
use crate::time::Time;

/// Type of the elements of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldType {
    /// Unsigned integer of 8 bits.
    U8,
    /// Unsigned integer of 32 bits.
    U32,
    /// Unsigned integer of 64 bits.
    U64,
    /// Signed integer of 64 bits.
    I64,
    /// Floating-point number of 64 bits.
    F64,
    /// Instant as nanoseconds since the clock's origin, unsigned, 64 bits.
    Time,
}

impl FieldType {
    /// Length of one encoded element \[bytes\].
    pub const fn size(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U32 => 4,
            Self::U64 | Self::I64 | Self::F64 | Self::Time => 8,
        }
    }
}

/// Description of one field of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name, as in the Rust definition.
    pub name: &'static str,
    /// Type, as in the Rust definition.
    pub type_name: &'static str,
    /// Type of its elements.
    pub element: FieldType,
    /// Number of elements; 1 for a scalar.
    pub length: usize,
    /// Unit and frame of its elements; `-` for numbers without unit, `code` for an enumeration of [`crate::code`], `flag` for
    /// 0 or 1, `text` for the bytes of a text.
    pub unit: &'static str,
    /// Description.
    pub doc: &'static str,
}

impl Field {
    /// Length of the encoded field \[bytes\].
    pub const fn size(&self) -> usize {
        self.element.size() * self.length
    }
}

/// Length of encoded `fields` \[bytes\].
pub(super) const fn total_size(fields: &[Field]) -> usize {
    let mut size = 0;
    let mut i = 0;
    while i < fields.len() {
        size += fields[i].size();
        i += 1;
    }
    size
}

/// A value that a field can hold.
pub(super) trait Value: Copy {
    const ELEMENT: FieldType;
    const LENGTH: usize;

    /// Writes the value to the front of `bytes` and returns the remaining bytes.
    fn put(self, bytes: &mut [u8]) -> &mut [u8];

    /// Reads a value from the front of `bytes`, and advances `bytes` past it.
    fn take(bytes: &mut &[u8]) -> Self;
}

macro_rules! number {
    ($($type:ty => $element:ident),*) => {
        $(impl Value for $type {
            const ELEMENT: FieldType = FieldType::$element;
            const LENGTH: usize = 1;

            fn put(self, bytes: &mut [u8]) -> &mut [u8] {
                let (own, rest) = bytes.split_at_mut(size_of::<Self>());
                own.copy_from_slice(&self.to_le_bytes());
                rest
            }

            fn take(bytes: &mut &[u8]) -> Self {
                let (own, rest) = bytes.split_first_chunk().expect("a message of its full size");
                *bytes = rest;
                Self::from_le_bytes(*own)
            }
        })*
    };
}

number!(u8 => U8, u32 => U32, u64 => U64, i64 => I64, f64 => F64);

impl Value for Time {
    const ELEMENT: FieldType = FieldType::Time;
    const LENGTH: usize = 1;

    fn put(self, bytes: &mut [u8]) -> &mut [u8] {
        self.nanos().put(bytes)
    }

    fn take(bytes: &mut &[u8]) -> Self {
        Self::from_nanos(u64::take(bytes))
    }
}

impl<const N: usize> Value for Text<N> {
    const ELEMENT: FieldType = FieldType::U8;
    const LENGTH: usize = N;

    fn put(self, bytes: &mut [u8]) -> &mut [u8] {
        let (own, rest) = bytes.split_at_mut(N);
        own.copy_from_slice(&self.bytes());
        rest
    }

    fn take(bytes: &mut &[u8]) -> Self {
        let (own, rest) = bytes.split_first_chunk().expect("a message of its full size");
        *bytes = rest;
        Self::from_bytes(*own)
    }
}

impl<const N: usize> Value for [f64; N] {
    const ELEMENT: FieldType = FieldType::F64;
    const LENGTH: usize = N;

    fn put(self, bytes: &mut [u8]) -> &mut [u8] {
        self.into_iter().fold(bytes, |rest, element| element.put(rest))
    }

    fn take(bytes: &mut &[u8]) -> Self {
        std::array::from_fn(|_| f64::take(bytes))
    }
}
