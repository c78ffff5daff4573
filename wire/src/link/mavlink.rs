//! Links of MAVLink: `mavlink:PORT[,autopilot=px4|ardupilot][,system=N]`, where PORT is `serial:PATH[,baud=921600]`,
//! `udpin:HOST:PORT`, `udpout:HOST:PORT` or `tcp:HOST:PORT`.

use super::port::PortSpec;
use super::text::{LinkText, option};

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

/// Port of a MAVLink vehicle, its firmware and its system id.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MavlinkLink {
    /// The port.
    pub port: PortSpec,
    /// The firmware; `None` if it is determined from heartbeats.
    pub autopilot: Option<AutopilotKind>,
    /// System id of the vehicle, 1..255 \[-\]; `None` for the first autopilot that sends a heartbeat.
    pub system: Option<u8>,
}

impl AutopilotKind {
    const ALL: [Self; 2] = [Self::Px4, Self::ArduPilot];

    /// Name in a link.
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

    /// Parses the port, and takes the options.
    pub(super) fn parse(port: &str, link: &mut LinkText<'_>) -> Result<Self, String> {
        let port = PortSpec::parse(port, link, DEFAULT_BAUD)?;
        let autopilot = link.take("autopilot")?.map(parse_autopilot).transpose()?;
        let system = link.take("system")?.map(parse_system).transpose()?;
        Ok(Self { port, autopilot, system })
    }

    /// Text of the options.
    pub(super) fn options(&self) -> String {
        let autopilot = option("autopilot", self.autopilot.map(AutopilotKind::name));
        self.port.option(DEFAULT_BAUD) + &autopilot + &option("system", self.system)
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
