//! Reading and writing of numbers in either byte order; bytes without allocation.

use std::fmt;
use std::ops::Deref;

/// Byte order of numbers on a wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ByteOrder {
    /// Least significant byte first.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

/// Up to `N` bytes, held in place.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct ByteArray<const N: usize> {
    /// Zeros behind the first `length` bytes.
    bytes: [u8; N],
    length: usize,
}

impl<const N: usize> ByteArray<N> {
    /// No bytes.
    pub(crate) const EMPTY: Self = Self { bytes: [0; N], length: 0 };

    /// Copy of `bytes`; `None` if there are more than `N`.
    pub(crate) fn of(bytes: &[u8]) -> Option<Self> {
        let mut array = Self::EMPTY;
        array.put(bytes);
        (bytes.len() <= N).then_some(array)
    }

    /// Appends `bytes`, cut off where the array is full.
    pub(crate) fn put(&mut self, bytes: &[u8]) -> &mut Self {
        let count = bytes.len().min(N - self.length);
        self.bytes[self.length..][..count].copy_from_slice(&bytes[..count]);
        self.length += count;
        self
    }

    /// The bytes.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

impl<const N: usize> Deref for ByteArray<N> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.as_bytes()
    }
}

impl<const N: usize> fmt::Debug for ByteArray<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:02x?}", self.as_bytes())
    }
}

/// Reader of fields, one after another; `None` where the bytes end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ByteReader<'a> {
    rest: &'a [u8],
    order: ByteOrder,
}

macro_rules! read_number {
    ($($name:ident: $type:ty),*) => {$(
        #[doc = concat!("Reads one `", stringify!($type), "`.")]
        pub(crate) fn $name(&mut self) -> Option<$type> {
            let order = self.order;
            self.take().map(|bytes| match order {
                ByteOrder::Little => <$type>::from_le_bytes(bytes),
                ByteOrder::Big => <$type>::from_be_bytes(bytes),
            })
        }
    )*};
}

impl<'a> ByteReader<'a> {
    pub(crate) fn new(bytes: &'a [u8], order: ByteOrder) -> Self {
        Self { rest: bytes, order }
    }

    read_number!(u16: u16, i16: i16, u32: u32, i32: i32, u64: u64, f32: f32, f64: f64);

    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.take().map(|[byte]| byte)
    }

    pub(crate) fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (field, rest) = self.rest.split_first_chunk()?;
        self.rest = rest;
        Some(*field)
    }

    /// Reads `count` bytes.
    pub(crate) fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (field, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(field)
    }

    /// Reads `N` numbers of 32 bits.
    pub(crate) fn f32s<const N: usize>(&mut self) -> Option<[f32; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.f32()?;
        }
        Some(numbers)
    }

    /// Reads a text up to its NUL, which is consumed; `None` without a NUL or if the text is not UTF-8.
    pub(crate) fn text(&mut self) -> Option<&'a str> {
        let length = self.rest.iter().position(|byte| *byte == 0)?;
        let text = self.bytes(length)?;
        self.bytes(1)?;
        std::str::from_utf8(text).ok()
    }

    /// The bytes that are not read yet.
    pub(crate) fn rest(&self) -> &'a [u8] {
        self.rest
    }
}

/// Writer of fields to the end of a buffer.
#[derive(Debug)]
pub(crate) struct ByteWriter<'a> {
    out: &'a mut Vec<u8>,
    order: ByteOrder,
}

macro_rules! write_number {
    ($($name:ident: $type:ty),*) => {$(
        #[doc = concat!("Writes one `", stringify!($type), "`.")]
        pub(crate) fn $name(&mut self, number: $type) -> &mut Self {
            match self.order {
                ByteOrder::Little => self.out.extend_from_slice(&number.to_le_bytes()),
                ByteOrder::Big => self.out.extend_from_slice(&number.to_be_bytes()),
            }
            self
        }
    )*};
}

impl<'a> ByteWriter<'a> {
    pub(crate) fn new(out: &'a mut Vec<u8>, order: ByteOrder) -> Self {
        Self { out, order }
    }

    write_number!(u16: u16, i16: i16, u32: u32, i32: i32, u64: u64, f32: f32, f64: f64);

    pub(crate) fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.out.extend_from_slice(bytes);
        self
    }

    pub(crate) fn f32s(&mut self, numbers: &[f32]) -> &mut Self {
        for number in numbers {
            self.f32(*number);
        }
        self
    }

    /// Writes a text and a NUL; the text ends at its first NUL.
    pub(crate) fn text(&mut self, text: &str) -> &mut Self {
        self.bytes(text.split('\0').next().unwrap_or_default().as_bytes()).bytes(&[0])
    }

    /// Writes a displayed value and a NUL. Only the buffer allocates.
    pub(crate) fn display(&mut self, text: impl fmt::Display) -> &mut Self {
        // Writing to a buffer cannot fail.
        let _ = fmt::Write::write_fmt(self, format_args!("{text}"));
        self.bytes(&[0])
    }

    /// Number of bytes in the buffer.
    pub(crate) fn len(&self) -> usize {
        self.out.len()
    }

    /// Replaces 32 bits at `place` that were written before.
    pub(crate) fn set_u32(&mut self, place: usize, number: u32) {
        let bytes = match self.order {
            ByteOrder::Little => number.to_le_bytes(),
            ByteOrder::Big => number.to_be_bytes(),
        };
        if let Some(field) = self.out.get_mut(place..place + 4) {
            field.copy_from_slice(&bytes);
        }
    }
}

impl fmt::Write for ByteWriter<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.bytes(text.as_bytes());
        Ok(())
    }
}

/// Capacity of a client's output buffer \[bytes\]: more than it sends at once.
pub(crate) const OUTPUT_BYTES: usize = 4096;

/// Passes the bytes of a non-empty output to `send`, and empties it.
pub(crate) fn flush<E>(
    output: &mut Vec<u8>,
    send: impl FnOnce(&[u8]) -> Result<(), E>,
) -> Result<(), E> {
    let sent = if output.is_empty() { Ok(()) } else { send(output) };
    output.clear();
    sent
}

/// Length as the 32-bit field of a format; every message of this crate is far below the limit.
pub(crate) fn count_u32(length: usize) -> u32 {
    u32::try_from(length).unwrap_or(u32::MAX)
}
