//! `[fault]`: injected faults, in the grammar of `oqtal fly --fault`.

mod kinds;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::period::Period;

pub use kinds::{FaultKind, FaultTarget, FaultUnit, Magnitude};

/// `[fault]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct FaultOptions {
    /// The faults, each as `TARGET:KIND[=VALUE]@TIME[+DURATION]`.
    pub inject: Vec<Fault>,
    /// Whether faults also act on a vehicle that is not simulated.
    pub with_real_vehicle: bool,
}

/// Fault with its duration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Fault {
    /// Affected topic or process.
    pub target: FaultTarget,
    /// Kind of failure.
    pub kind: FaultKind,
    /// Magnitude; `None` for kinds without one.
    pub magnitude: Option<Magnitude>,
    /// Beginning, from the first command that arms \[s\].
    pub at_s: f64,
    /// Duration; `None` for the rest of the flight \[s\].
    pub duration_s: Option<f64>,
}

impl Fault {
    /// Time at which the fault ends, from the first command that arms; infinite if it lasts to the end of the flight \[s\].
    pub fn end_s(&self) -> f64 {
        self.duration_s.map_or(f64::INFINITY, |duration| self.at_s + duration)
    }

    /// The magnitude as a number, 0 for kinds without one \[unit of the magnitude\].
    pub fn value(&self) -> f64 {
        self.magnitude.map_or(0.0, |magnitude| magnitude.value)
    }

    /// The forms of a fault, for messages: one line for each target.
    pub fn grammar() -> String {
        let mut text =
            "expected TARGET:KIND[=VALUE]@TIME[+DURATION], in seconds, TIME from arming, \
                        as in pose:off@5+0.1"
                .to_owned();
        for target in FaultTarget::ALL {
            let kinds: Vec<String> = kinds::kinds_of(target).map(kinds::KindRule::form).collect();
            text += &format!("\n  {:<10} {}", target.name(), kinds.join(" | "));
        }
        text
    }

    /// Parses `text`.
    ///
    /// # Errors
    /// The values that are allowed in place of a wrong one; empty for another form.
    fn parse(text: &str) -> Result<Self, String> {
        let named = || {
            let (what, when) = text.split_once('@')?;
            let (target, how) = what.split_once(':')?;
            let target = FaultTarget::ALL.into_iter().find(|known| known.name() == target)?;
            let (kind, value) =
                how.split_once('=').map_or((how, None), |(kind, value)| (kind, Some(value)));
            let rule = kinds::kinds_of(target).find(|rule| rule.kind.name() == kind)?;
            Some((target, rule, value, when))
        };
        let (target, rule, value, when) = named().ok_or_else(String::new)?;
        let magnitude = rule.magnitude(value).ok_or_else(|| {
            format!("{}:{} takes {}; ", target.name(), rule.kind.name(), rule.allowed())
        })?;
        let Period { at_s, duration_s } =
            Period::parse(when).ok_or_else(|| format!("{}; ", Period::allowed()))?;
        Ok(Self { target, kind: rule.kind, magnitude, at_s, duration_s })
    }
}

impl FromStr for Fault {
    type Err = String;

    /// Parses `TARGET:KIND[=VALUE]@TIME[+DURATION]`; the error has the values allowed in place of a wrong one, and the grammar.
    fn from_str(text: &str) -> Result<Self, String> {
        Self::parse(text)
            .map_err(|allowed| format!("`{text}` is not a fault: {allowed}{}", Self::grammar()))
    }
}

impl TryFrom<String> for Fault {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Fault> for String {
    fn from(fault: Fault) -> Self {
        fault.to_string()
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.target.name(), self.kind.name())?;
        if let Some(Magnitude { value, unit }) = self.magnitude {
            write!(f, "={value}{}", unit.name())?;
        }
        let Self { at_s, duration_s, .. } = *self;
        write!(f, "@{}", Period { at_s, duration_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_read_and_written_back_with_its_magnitude() {
        for (given, canonical) in [
            ("pose:off@5+0.1", "pose:off@5+0.1"),
            ("pose:wrong@0", "pose:wrong=0.3m@0"),
            ("pose:wrong=180deg@2.5", "pose:wrong=180deg@2.5"),
            ("command:delayed=80ms@1+2", "command:delayed=80ms@1+2"),
            ("radio:intermittent@1e1+2", "radio:intermittent=50%@10+2"),
            ("pose:frozen-noise@4", "pose:frozen-noise=0.5mm@4"),
            ("pose:drift=0.5deg/s@4", "pose:drift=0.5deg/s@4"),
            ("daemon:kill@3", "daemon:kill@3"),
            ("mocap-emu:stop@3+0.5", "mocap-emu:stop@3+0.5"),
        ] {
            let fault: Fault = given.parse().unwrap();
            assert_eq!(fault.to_string(), canonical);
            assert_eq!(canonical.parse::<Fault>().unwrap(), fault);
        }
        assert_eq!("pose:off@5+0.5".parse::<Fault>().unwrap().end_s(), 5.5);
        assert_eq!("pose:off@5".parse::<Fault>().unwrap().end_s(), f64::INFINITY);
    }

    #[test]
    fn a_value_out_of_range_is_refused_with_the_values_allowed() {
        for (wrong, allowed) in [
            ("pose:wrong=2000m@1", "pose:wrong takes 0 to 1000 m or -180 to 180 deg"),
            ("command:intermittent=101%@1", "command:intermittent takes 0 to 100 %"),
            ("pose:off=3m@1", "pose:off takes no value"),
            ("pose:off@-1", "TIME is 0 to 1000000 s, and DURATION above 0 and up to 1000000 s"),
            ("pose:off@1+0", "TIME is 0 to 1000000 s, and DURATION above 0 and up to 1000000 s"),
        ] {
            let message = wrong.parse::<Fault>().unwrap_err();
            assert!(
                message.starts_with(&format!("`{wrong}` is not a fault: {allowed}; ")),
                "{message}"
            );
        }
    }

    #[test]
    fn any_other_text_is_refused_with_the_grammar() {
        for wrong in [
            "",
            "pose",
            "pose:off",
            "pose:off@",
            "pose:off@-1",
            "pose:off@nan",
            "pose:off@1+0",
            "pose:off@1+inf",
            "pose:off=3m@1",
            "pose:kill@1",
            "daemon:off@1",
            "radio:garbage@1",
            "pose:wrong=0.3@1",
            "pose:wrong=0.3ms@1",
            "pose:intermittent=101%@1",
            "pose:slow=0Hz@1",
            "cameras:off@1",
        ] {
            let message = wrong.parse::<Fault>().unwrap_err();
            assert!(message.contains("TARGET:KIND[=VALUE]@TIME[+DURATION]"), "{wrong}: {message}");
            for word in ["delayed[=60ms]", "wrong[=0.3m|=180deg]", "mocap-emu", "kill"] {
                assert!(message.contains(word), "{word} in {message}");
            }
        }
    }
}
