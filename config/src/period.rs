//! The time for which a fault or a disturbance acts, `TIME[+DURATION]`.

use std::fmt;

/// Greatest time and duration \[s\].
const LONGEST_S: f64 = 1e6;

/// Period `TIME[+DURATION]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Period {
    /// Beginning, from the first command that arms \[s\].
    pub(crate) at_s: f64,
    /// Duration; `None` for the rest of the flight \[s\].
    pub(crate) duration_s: Option<f64>,
}

impl Period {
    /// The allowed times, as text.
    pub(crate) fn allowed() -> String {
        format!("TIME is 0 to {LONGEST_S} s, and DURATION above 0 and up to {LONGEST_S} s")
    }

    /// Parses `TIME[+DURATION]`.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let (at, duration) =
            text.split_once('+').map_or((text, None), |(at, duration)| (at, Some(duration)));
        let duration_s = match duration {
            Some(duration) => Some(seconds(duration).filter(|duration| *duration > 0.0)?),
            None => None,
        };
        Some(Self { at_s: seconds(at)?, duration_s })
    }
}

/// A time with or without the unit s \[s\].
fn seconds(text: &str) -> Option<f64> {
    let number = text.strip_suffix('s').unwrap_or(text);
    number.parse().ok().filter(|seconds| (0.0..=LONGEST_S).contains(seconds))
}

impl fmt::Display for Period {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.at_s)?;
        self.duration_s.map_or(Ok(()), |duration| write!(f, "+{duration}"))
    }
}
