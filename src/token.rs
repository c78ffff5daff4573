//! Random names that nobody can guess.

use std::fs::File;
use std::io::Read;

use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::hex::to_hex;

/// Number of random bytes.
const BYTES: usize = 16;

/// 128 random bits as hexadecimal digits.
///
/// # Errors
/// The operating system gives no random numbers (exit code 71).
pub fn random_token() -> Result<String, Failure> {
    let mut bytes = [0; BYTES];
    File::open("/dev/urandom")
        .and_then(|mut file| file.read_exact(&mut bytes))
        .map_err(|error| Failure::new(Exit::System, format!("/dev/urandom: {error}")))?;
    Ok(to_hex(&bytes))
}
