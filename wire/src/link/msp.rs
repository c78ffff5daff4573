//! Links of MSP: `msp:PORT`, where PORT is `serial:PATH[,baud=115200]`, `tcp:HOST:PORT`, `udpin:HOST:PORT` or `udpout:HOST:PORT`.

use super::port::PortSpec;
use super::text::LinkText;

/// Default speed of a serial port, that of Betaflight's ports for MSP \[baud\].
const DEFAULT_BAUD: u32 = 115_200;

/// Port of a Betaflight vehicle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MspLink {
    /// The port.
    pub port: PortSpec,
}

impl MspLink {
    /// Text form, for messages.
    pub const FORM: &str = "msp:serial:PATH[,baud=115200] | msp:tcp:HOST:PORT | msp:udpout:HOST:PORT | msp:udpin:HOST:PORT";

    /// Parses the port.
    pub(super) fn parse(port: &str, link: &mut LinkText<'_>) -> Result<Self, String> {
        PortSpec::parse(port, link, DEFAULT_BAUD).map(|port| Self { port })
    }

    /// Text of the options.
    pub(super) fn options(&self) -> String {
        self.port.option(DEFAULT_BAUD)
    }
}
