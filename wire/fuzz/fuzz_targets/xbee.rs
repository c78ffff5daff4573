//! Arbitrary bytes into the decoders of a radio and of its host.
#![no_main]

#[path = "../../tests/common/any_bytes.rs"]
mod any_bytes;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| any_bytes::any_radio_bytes(bytes));
