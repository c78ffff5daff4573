//! Text files of bounded length.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Reads a text of at most `longest_mib` \[MiB\]; an endless file, such as a device, is an error.
///
/// # Errors
/// The file cannot be read, is longer, or is not UTF-8.
pub fn read_text(path: &Path, longest_mib: u64) -> io::Result<String> {
    let invalid = |reason: String| io::Error::new(io::ErrorKind::InvalidData, reason);
    let longest = longest_mib << 20;
    let mut bytes = Vec::new();
    File::open(path)?.take(longest + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > longest {
        return Err(invalid(format!("longer than {longest_mib} MiB")));
    }
    String::from_utf8(bytes).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = 1 + valid.iter().filter(|byte| **byte == b'\n').count();
        invalid(format!("line {line} is not UTF-8"))
    })
}

/// Length up to which a waypoint file is read \[MiB\].
const LONGEST_WAYPOINTS_MIB: u64 = 16;

/// Reads a waypoint file.
///
/// # Errors
/// Like [`read_text`].
pub fn read_waypoints(path: &Path) -> io::Result<String> {
    read_text(path, LONGEST_WAYPOINTS_MIB)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_without_end_and_one_that_is_not_text_are_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("text");
        std::fs::write(&path, "1234").unwrap();
        assert_eq!(read_text(&path, 1).unwrap(), "1234");
        std::fs::write(&path, b"1\n2\n\xff\n").unwrap();
        assert_eq!(read_text(&path, 1).unwrap_err().to_string(), "line 3 is not UTF-8");
        let endless = read_text(Path::new("/dev/zero"), 1).unwrap_err();
        assert_eq!(endless.to_string(), "longer than 1 MiB");
    }
}
