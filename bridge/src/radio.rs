//! XBee radios around a vehicle's language.

use oqtal_wire::xbee::Framing;

use crate::language::Language;

/// `language` as it goes through a radio that frames like this.
#[must_use]
pub fn through(framing: Framing, language: Box<dyn Language>) -> Box<dyn Language> {
    let _ = framing;
    language
}
