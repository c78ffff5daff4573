//! Links of MAVLink: `serial:PATH[,baud=921600]`, `udpin:HOST:PORT`, `udpout:HOST:PORT` or `tcp:HOST:PORT`, and behind each
//! `[,autopilot=px4|ardupilot][,system=N]`.

use std::fmt;

use super::options::LinkOptions;
use super::port::PortSpec;

/// Default speed of a serial port, that of an autopilot's second telemetry port \[baud\].
const DEFAULT_BAUD: u32 = 921_600;

/// Firmware of an autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AutopilotKind {
    /// PX4.
    Px4,
    /// ArduPilot.
    ArduPilot,
}

/// Port of a MAVLink vehicle, and which vehicle it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MavlinkLink {
    /// The port.
    pub port: PortSpec,
    /// The firmware; `None` to be found out from heartbeats.
    pub autopilot: Option<AutopilotKind>,
    /// System id of the vehicle, 1..255 \[-\]; `None` for the first autopilot that is heard.
    pub system: Option<u8>,
}

impl AutopilotKind {
    const ALL: [Self; 2] = [Self::Px4, Self::ArduPilot];

    /// Name in a link.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Px4 => "px4",
            Self::ArduPilot => "ardupilot",
        }
    }
}

impl MavlinkLink {
    /// Text form, for messages.
    pub const FORM: &str = "mavlink:serial:PATH[,baud=921600] | mavlink:udpin:HOST:PORT | mavlink:udpout:HOST:PORT | \
                            mavlink:tcp:HOST:PORT, each with [,autopilot=px4|ardupilot][,system=N]";

    /// Parses what stands behind `mavlink:`.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let (port, mut options) = LinkOptions::split(text)?;
        let port = PortSpec::parse(port, &mut options, DEFAULT_BAUD)?;
        let autopilot = options.take("autopilot").map(parse_autopilot).transpose()?;
        let system = options.take("system").map(parse_system).transpose()?;
        options.finish()?;
        Ok(Self { port, autopilot, system })
    }
}

fn parse_autopilot(name: &str) -> Result<AutopilotKind, String> {
    let kind = AutopilotKind::ALL.into_iter().find(|kind| kind.name() == name);
    kind.ok_or_else(|| format!("autopilot `{name}` is neither px4 nor ardupilot"))
}

fn parse_system(text: &str) -> Result<u8, String> {
    let system = text.parse().ok().filter(|system: &u8| *system != 0);
    system.ok_or_else(|| format!("system `{text}` is not between 1 and 255"))
}

impl fmt::Display for MavlinkLink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.port)?;
        if let Some(baud) = self.port.baud().filter(|baud| *baud != DEFAULT_BAUD) {
            write!(f, ",baud={baud}")?;
        }
        if let Some(autopilot) = self.autopilot {
            write!(f, ",autopilot={}", autopilot.name())?;
        }
        self.system.map_or(Ok(()), |system| write!(f, ",system={system}"))
    }
}
