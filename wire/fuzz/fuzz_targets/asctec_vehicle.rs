//! Arbitrary bytes into the vehicle's AscTec decoder.
#![no_main]

#[allow(dead_code)]
#[path = "../../tests/common/any_bytes.rs"]
mod any_bytes;

use libfuzzer_sys::fuzz_target;
use oqtal_wire::asctec::VehicleGrammar;

fuzz_target!(|bytes: &[u8]| any_bytes::any_bytes::<VehicleGrammar>(bytes));
