//! Requests for a stream of frames.

use std::fmt;
use std::net::IpAddr;

use super::component::{ComponentKind, ComponentSet};

/// Names of components that a server may have and this one has not.
const ABSENT: [&str; 14] = [
    "2D",
    "2DLin",
    "Analog",
    "AnalogSingle",
    "Force",
    "ForceSingle",
    "Image",
    "GazeVector",
    "EyeTracker",
    "Timecode",
    "Skeleton",
    "MarkerTypes",
    "Footprint",
    "None",
];

/// Lowest port to which frames are sent \[-\].
const MIN_PORT: u16 = 1023;

/// Frames of a stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StreamRate {
    /// Every frame.
    #[default]
    AllFrames,
    /// Frames per second, at most every frame \[Hz\].
    Frequency(u32),
    /// Every n-th frame \[-\].
    Divisor(u32),
}

impl StreamRate {
    /// Whether frame `number` of a server with this rate \[Hz\] belongs to the stream.
    pub fn includes(self, number: u32, server_hz: u32) -> bool {
        match self {
            Self::AllFrames => true,
            Self::Divisor(divisor) => number.is_multiple_of(divisor.max(1)),
            Self::Frequency(wanted) if wanted >= server_hz => true,
            Self::Frequency(wanted) => {
                let passed =
                    |number: u32| u64::from(number) * u64::from(wanted) / u64::from(server_hz);
                number == 0 || passed(number) != passed(number - 1)
            }
        }
    }

    fn parse(word: &str) -> Option<Self> {
        let (name, number) = word.split_once(':').unwrap_or((word, ""));
        let number = number.parse().ok().filter(|number| *number > 0);
        match name.to_ascii_lowercase().as_str() {
            "allframes" => Some(Self::AllFrames),
            "frequency" => number.map(Self::Frequency),
            "frequencydivisor" => number.map(Self::Divisor),
            _ => None,
        }
    }
}

impl fmt::Display for StreamRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AllFrames => f.write_str("AllFrames"),
            Self::Frequency(hz) => write!(f, "Frequency:{hz}"),
            Self::Divisor(divisor) => write!(f, "FrequencyDivisor:{divisor}"),
        }
    }
}

/// Destination of the frames of a stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StreamTarget {
    /// The TCP connection.
    #[default]
    Tcp,
    /// UDP datagrams.
    Udp {
        /// Address; the client's if not given.
        address: Option<IpAddr>,
        /// Port \[-\].
        port: u16,
    },
}

impl StreamTarget {
    fn parse(word: &str) -> Option<Self> {
        let (name, target) = word.split_once(':')?;
        if !name.eq_ignore_ascii_case("udp") {
            return None;
        }
        let (address, port) = match target.rsplit_once(':') {
            Some((address, port)) => (Some(address.parse().ok()?), port),
            None => (None, target),
        };
        let port = port.parse().ok().filter(|port| *port >= MIN_PORT)?;
        Some(Self::Udp { address, port })
    }
}

/// A request for frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamRequest {
    /// Selection of the frames.
    pub rate: StreamRate,
    /// Destination of the frames.
    pub target: StreamTarget,
    /// Components of the frames.
    pub components: ComponentSet,
}

impl StreamRequest {
    pub(super) fn parse<'a>(mut words: impl Iterator<Item = &'a str>) -> Option<Self> {
        let rate = StreamRate::parse(words.next()?)?;
        let mut words = words.peekable();
        let is_udp = |word: &&str| word.to_ascii_lowercase().starts_with("udp:");
        let target = match words.next_if(is_udp) {
            Some(word) => StreamTarget::parse(word)?,
            None => StreamTarget::Tcp,
        };
        Some(Self { rate, target, components: parse_components(words)? })
    }
}

/// The components named by words; `None` if a word is not the name of a component of the protocol.
pub(super) fn parse_components<'a>(words: impl Iterator<Item = &'a str>) -> Option<ComponentSet> {
    let mut components = ComponentSet::new();
    for word in words {
        // Options of components that are not supported here follow a colon.
        let name = word.split(':').next().unwrap_or(word);
        match ComponentKind::from_name(name) {
            Some(kind) => components = components.with(kind),
            None if ABSENT.iter().any(|absent| absent.eq_ignore_ascii_case(name)) => {}
            None => return None,
        }
    }
    Some(components)
}

impl fmt::Display for StreamRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.rate)?;
        match self.target {
            StreamTarget::Tcp => {}
            StreamTarget::Udp { address: None, port } => write!(f, " UDP:{port}")?,
            StreamTarget::Udp { address: Some(address), port } => {
                write!(f, " UDP:{address}:{port}")?
            }
        }
        write!(f, " {}", self.components)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_has_as_many_frames_as_asked_for() {
        let count = |rate: StreamRate| (1..=1000).filter(|n| rate.includes(*n, 100)).count();
        assert_eq!(count(StreamRate::AllFrames), 1000);
        assert_eq!(count(StreamRate::Frequency(30)), 300);
        assert_eq!(count(StreamRate::Frequency(250)), 1000);
        assert_eq!(count(StreamRate::Divisor(8)), 125);
    }
}
