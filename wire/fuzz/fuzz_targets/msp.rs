//! Arbitrary bytes into the MSP decoder, and its replies into their readers.
#![no_main]

#[allow(dead_code)]
#[path = "../../tests/common/any_bytes.rs"]
mod any_bytes;

use libfuzzer_sys::fuzz_target;
use oqtal_wire::msp::{MspChannelMap, MspGrammar, MspModeRange, MspSticks, MspStatus, battery_v};

fuzz_target!(|bytes: &[u8]| {
    any_bytes::any_bytes::<MspGrammar>(bytes);
    MspModeRange::all(bytes).for_each(|range| {
        let _ = range.contains(range.middle_us());
    });
    let _ = (MspStatus::read(bytes), battery_v(bytes), MspChannelMap::read(bytes));
    let _ = MspSticks::read(bytes, MspChannelMap::FACTORY);
});
