//! Parameters of autopilots.

use std::fmt;

/// Greatest length of a name \[bytes\].
const LENGTH: usize = 16;

/// Name of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ParameterName(pub(super) [u8; LENGTH]);

impl ParameterName {
    /// Name of `text`; `None` if it is empty, longer than 16 bytes, or not of printable ASCII.
    pub fn new(text: &str) -> Option<Self> {
        let is_name =
            (1..=LENGTH).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_graphic());
        let mut name = [0; LENGTH];
        if is_name {
            name[..text.len()].copy_from_slice(text.as_bytes());
        }
        is_name.then_some(Self(name))
    }

    /// The text; empty if the bytes are not UTF-8.
    pub fn as_str(&self) -> &str {
        let length = self.0.iter().position(|byte| *byte == 0).unwrap_or(LENGTH);
        str::from_utf8(&self.0[..length]).unwrap_or_default()
    }
}

impl fmt::Display for ParameterName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

/// Value of a parameter on the wire: a number of 32 bits and its type. The encoding of integers depends on the autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterValue {
    /// The number as sent \[-\].
    pub raw: f32,
    /// Whether it is of a type of floating-point numbers.
    pub is_real: bool,
    /// MAV_PARAM_TYPE \[-\].
    pub code: u8,
}

impl ParameterValue {
    /// MAV_PARAM_TYPE_INT32.
    pub const INT32: u8 = 6;
    /// MAV_PARAM_TYPE_REAL32.
    pub const REAL32: u8 = 9;

    /// Value received as `raw` with the type `code`.
    pub(super) fn new(raw: f32, code: u8) -> Self {
        Self { raw, is_real: code >= Self::REAL32, code }
    }

    /// The value, where integers are sent `as_bits`, or else as numbers \[-\].
    pub fn number(&self, as_bits: bool) -> f64 {
        if as_bits && !self.is_real {
            f64::from(self.raw.to_bits().cast_signed())
        } else {
            f64::from(self.raw)
        }
    }

    /// The same parameter with the value `number`, where integers are sent `as_bits`, or else as numbers.
    pub fn with(self, number: f64, as_bits: bool) -> Self {
        let raw = if as_bits && !self.is_real {
            f32::from_bits((number.round() as i32).cast_unsigned())
        } else {
            number as f32
        };
        Self { raw, ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_sent_as_bits_or_as_numbers() {
        let value = ParameterValue { raw: 0.0, is_real: false, code: ParameterValue::INT32 };
        for number in [-1.0, 0.0, 15.0, 2_147_483_647.0] {
            let sent = value.with(number, true);
            assert_eq!(sent.number(true), number);
        }
        assert_eq!(value.with(15.0, true).raw.to_bits(), 15);
        assert_eq!(value.with(15.0, false).raw, 15.0);
    }

    #[test]
    fn names_have_one_to_sixteen_letters() {
        assert_eq!(ParameterName::new("EK3_SRC1_POSXY").unwrap().as_str(), "EK3_SRC1_POSXY");
        assert_eq!(ParameterName::new("SIXTEEN_LETTERS_").unwrap().as_str(), "SIXTEEN_LETTERS_");
        for wrong in ["", "SEVENTEEN_LETTERS", "A B", "\u{e9}"] {
            assert!(ParameterName::new(wrong).is_none(), "{wrong}");
        }
    }
}
