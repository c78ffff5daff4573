//! r
use crate::flight::Flight;
/// x
pub fn write(_f: &Flight, _o: impl std::io::Write) -> Result<(), String> {
    Ok(())
}
