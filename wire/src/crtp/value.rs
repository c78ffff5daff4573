//! Types of parameters and of log variables, and values on the wire.

/// Type of a parameter, as its table states it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ParameterType {
    /// 8 bits, signed.
    I8 = 0x00,
    /// 16 bits, signed.
    I16 = 0x01,
    /// 32 bits, signed.
    I32 = 0x02,
    /// 32 bits, floating point.
    F32 = 0x06,
    /// 8 bits, unsigned.
    U8 = 0x08,
    /// 16 bits, unsigned.
    U16 = 0x09,
    /// 32 bits, unsigned.
    U32 = 0x0A,
}

impl ParameterType {
    const ALL: [Self; 7] =
        [Self::I8, Self::I16, Self::I32, Self::F32, Self::U8, Self::U16, Self::U32];
    /// Bits of the table's byte that state the type; the others mark it as read only, or stored.
    const MASK: u8 = 0x0F;

    /// The type that the byte of a table states; `None` if it has no name here.
    pub fn from_wire(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| *kind as u8 == byte & Self::MASK)
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
        }
    }
}

/// Value of a parameter, in its type's bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CrtpValue {
    bytes: [u8; 4],
    length: usize,
}

impl CrtpValue {
    /// The value `number` \[-\] as `kind`; rounded, and limited to what the type holds.
    pub fn of(kind: ParameterType, number: f64) -> Self {
        let mut bytes = [0; 4];
        let length = kind.bytes();
        let whole = number.round();
        let encoded = match kind {
            ParameterType::F32 => (number as f32).to_le_bytes(),
            ParameterType::I8 => i32::from(whole as i8).to_le_bytes(),
            ParameterType::I16 => i32::from(whole as i16).to_le_bytes(),
            ParameterType::I32 => (whole as i32).to_le_bytes(),
            ParameterType::U8 => u32::from(whole as u8).to_le_bytes(),
            ParameterType::U16 => u32::from(whole as u16).to_le_bytes(),
            ParameterType::U32 => (whole as u32).to_le_bytes(),
        };
        bytes[..length].copy_from_slice(&encoded[..length]);
        Self { bytes, length }
    }

    /// The value of `bytes`; `None` for no bytes or more than four.
    pub fn from_wire(bytes: &[u8]) -> Option<Self> {
        let mut value = Self { bytes: [0; 4], length: bytes.len() };
        value.bytes.get_mut(..bytes.len()).filter(|_| !bytes.is_empty())?.copy_from_slice(bytes);
        Some(value)
    }

    /// The bytes as on the wire.
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// The number \[-\]; `None` if the value has not the length of `kind`.
    pub fn number(&self, kind: ParameterType) -> Option<f64> {
        let bytes = self.bytes;
        let short = [bytes[0], bytes[1]];
        (self.length == kind.bytes()).then(|| match kind {
            ParameterType::I8 => f64::from(bytes[0].cast_signed()),
            ParameterType::U8 => f64::from(bytes[0]),
            ParameterType::I16 => f64::from(i16::from_le_bytes(short)),
            ParameterType::U16 => f64::from(u16::from_le_bytes(short)),
            ParameterType::I32 => f64::from(i32::from_le_bytes(bytes)),
            ParameterType::U32 => f64::from(u32::from_le_bytes(bytes)),
            ParameterType::F32 => f64::from(f32::from_le_bytes(bytes)),
        })
    }
}

/// Type of a log variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum LogType {
    /// 8 bits, unsigned.
    U8 = 1,
    /// 16 bits, unsigned.
    U16 = 2,
    /// 32 bits, unsigned.
    U32 = 3,
    /// 8 bits, signed.
    I8 = 4,
    /// 16 bits, signed.
    I16 = 5,
    /// 32 bits, signed.
    I32 = 6,
    /// 32 bits, floating point.
    F32 = 7,
}

impl LogType {
    const ALL: [Self; 7] =
        [Self::U8, Self::U16, Self::U32, Self::I8, Self::I16, Self::I32, Self::F32];
    const MASK: u8 = 0x0F;

    /// The type that the byte of a table states; `None` if it has no name here.
    pub fn from_wire(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| *kind as u8 == byte & Self::MASK)
    }

    /// Length \[bytes\].
    pub fn length(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
        }
    }
}
