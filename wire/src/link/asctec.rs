//! Links of AscTec's serial interface: `asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]`.

use super::port::SerialSpec;
use super::text::{LinkText, option};
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

    /// Parses the path, and takes the options.
    pub(super) fn parse(path: &str, link: &mut LinkText<'_>) -> Result<Self, String> {
        let serial = SerialSpec::parse(path, link, DEFAULT_BAUD)?;
        let xbee = link.take("xbee")?.map(str::parse::<Framing>).transpose();
        let xbee = xbee.map_err(|error| error.to_string())?.unwrap_or_default();
        Ok(Self { serial, xbee })
    }

    /// Text of the options.
    pub(super) fn options(&self) -> String {
        let framing = Some(self.xbee).filter(|framing| *framing != Framing::default());
        self.serial.option(DEFAULT_BAUD) + &option("xbee", framing)
    }
}
