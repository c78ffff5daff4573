//! Arbitrary bytes as a recording, read and exported.
#![no_main]

#[allow(dead_code)]
#[path = "../../../tests/parsers/any_file.rs"]
mod any_file;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| any_file::any_recording(bytes));
