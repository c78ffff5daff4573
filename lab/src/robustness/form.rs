//! Form of drawing the value of a key of the configuration.

use toml::Value;

use crate::random::SplitMix64;
use crate::study::flights::{self, readable};

/// Form of drawing a key's value; numbers are drawn uniformly within their bounds.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// A number \[unit of the key\].
    Between(f64, f64),
    /// The configured value as a whole, times a random factor \[-\].
    Factor(f64, f64),
    /// Each element of the configured value, times a separate random factor \[-\].
    EachFactor(f64, f64),
    /// One randomly selected element of the configured value, times a random factor \[-\].
    OneFactor(f64, f64),
    /// One of these values.
    Choose(Vec<Value>),
}

impl Form {
    /// Value drawn about `nominal`; `None` if `nominal` has another type.
    pub fn value(&self, nominal: &Value, random: &mut SplitMix64) -> Option<Value> {
        match self {
            Self::Between(low, high) => Some(Value::from(readable(random.between(*low, *high)))),
            Self::Factor(low, high) => scaled(nominal, random.between(*low, *high)),
            Self::EachFactor(low, high) => {
                let each = |value: &Value| scaled(value, random.between(*low, *high));
                nominal.as_array()?.iter().map(each).collect::<Option<Vec<_>>>().map(Value::from)
            }
            Self::OneFactor(low, high) => {
                let mut values = nominal.as_array()?.clone();
                let (index, factor) = (random.below(values.len()), random.between(*low, *high));
                let one = values.get_mut(index)?;
                *one = scaled(one, factor)?;
                Some(Value::from(values))
            }
            Self::Choose(values) => values.get(random.below(values.len())).cloned(),
        }
    }

    /// The form in words.
    pub fn words(&self) -> String {
        let range = |low: &f64, high: &f64| format!("{} to {}", readable(*low), readable(*high));
        match self {
            Self::Between(low, high) => range(low, high),
            Self::Factor(low, high) => format!("times {}", range(low, high)),
            Self::EachFactor(low, high) => format!("each times {}", range(low, high)),
            Self::OneFactor(low, high) => format!("one of them times {}", range(low, high)),
            Self::Choose(values) => {
                let values: Vec<String> = values.iter().map(ToString::to_string).collect();
                format!("one of {}", values.join(", "))
            }
        }
    }
}

/// `value` with every number multiplied by `factor`; `None` if it contains anything but numbers.
fn scaled(value: &Value, factor: f64) -> Option<Value> {
    flights::scaled(value, &|number| readable(number * factor))
}
