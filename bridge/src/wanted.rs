//! Parameters that a vehicle must have, with a rule for their value and the reason.

/// Rule for the value of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WantedValue {
    /// Exactly this value \[unit of the parameter\].
    Exactly(f64),
    /// Any value with these bits set.
    Bits(u32),
    /// At most this value, and more than zero \[unit of the parameter\].
    AtMost(f64),
}

/// Parameter with a rule for its value.
#[derive(Clone, Copy, Debug)]
pub struct WantedParameter {
    /// Name of the parameter.
    pub name: &'static str,
    /// Rule for its value.
    pub value: WantedValue,
    /// Reason for the rule.
    pub reason: &'static str,
}

impl WantedValue {
    /// Whether `value` \[-\] satisfies the rule.
    pub fn is_met_by(self, value: f64) -> bool {
        match self {
            Self::Exactly(wanted) => (value - wanted).abs() < 1e-6,
            Self::Bits(bits) => value >= 0.0 && value as u32 & bits == bits,
            // Single precision on the wire.
            Self::AtMost(most) => value > 0.0 && value <= most * (1.0 + 1e-6),
        }
    }

    /// The value to be set in place of `value` \[-\].
    pub fn in_place_of(self, value: f64) -> f64 {
        match self {
            Self::Exactly(wanted) => wanted,
            Self::Bits(bits) => f64::from(value.max(0.0) as u32 | bits),
            Self::AtMost(most) => most,
        }
    }
}
