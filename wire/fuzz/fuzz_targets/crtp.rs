//! Arbitrary bytes into both ends of CRTP.
#![no_main]

#[allow(dead_code)]
#[path = "../../tests/common/any_crtp_bytes.rs"]
mod any_crtp_bytes;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| any_crtp_bytes::any_crtp_bytes(bytes));
