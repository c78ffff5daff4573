//! Arbitrary bytes into both ends of VRPN.
#![no_main]

#[allow(dead_code)]
#[path = "../../tests/common/any_camera_bytes.rs"]
mod any_camera_bytes;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| any_camera_bytes::any_vrpn_bytes(bytes));
