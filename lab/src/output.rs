//! What a study writes: the directory of `--out`, and the files in it.

use std::fs;
use std::path::Path;

use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};

/// Makes the directory, before what it is for has taken its time.
///
/// # Errors
/// It cannot be made (exit code 71).
pub fn make(directory: &Path) -> Result<(), Failure> {
    fs::create_dir_all(directory).map_err(|error| unwritable(directory, &error))
}

/// Writes a file into the directory, which is made where it is missing.
///
/// # Errors
/// It cannot be written (exit code 71).
pub fn write(directory: &Path, name: &str, text: impl AsRef<[u8]>) -> Result<(), Failure> {
    make(directory)?;
    let file = directory.join(name);
    files::write(&file, text).map_err(|error| unwritable(&file, &error))
}

fn unwritable(path: &Path, error: &std::io::Error) -> Failure {
    Failure::new(Exit::System, format!("{}: {error}; give another --out", path.display()))
}
