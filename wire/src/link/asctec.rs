//! Links of AscTec's serial interface: `PATH[,baud=57600][,xbee=transparent|api1|api2]`.

use std::fmt;

use super::options::LinkOptions;
use super::port::SerialSpec;
use crate::xbee::Framing;

/// Default speed, AscTec's \[baud\].
const DEFAULT_BAUD: u32 = 57_600;

/// Serial port of an AscTec vehicle, and the framing of the radio on it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AsctecLink {
    /// The serial port.
    pub serial: SerialSpec,
    /// Framing of the radio.
    pub xbee: Framing,
}

impl AsctecLink {
    /// Text form, for messages.
    pub const FORM: &str = "asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]";

    /// Parses what stands behind `asctec:`.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let (path, mut options) = LinkOptions::split(text)?;
        let serial = SerialSpec::parse(path, &mut options, DEFAULT_BAUD)?;
        let xbee = options.take("xbee").map(str::parse::<Framing>).transpose();
        let xbee = xbee.map_err(|error| error.to_string())?.unwrap_or_default();
        options.finish()?;
        Ok(Self { serial, xbee })
    }
}

impl fmt::Display for AsctecLink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.serial.path)?;
        if self.serial.baud != DEFAULT_BAUD {
            write!(f, ",baud={}", self.serial.baud)?;
        }
        if self.xbee != Framing::default() {
            write!(f, ",xbee={}", self.xbee)?;
        }
        Ok(())
    }
}
