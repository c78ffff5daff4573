//! Output of a study: the output directory and its files, or one file.

use std::path::Path;
use std::{fs, io};

use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};

/// Makes the directory; to be called before a study, so that a failure is detected early.
///
/// # Errors
/// The directory cannot be made (exit code 71).
pub fn make(directory: &Path) -> Result<(), Failure> {
    fs::create_dir_all(directory).map_err(|error| unwritable(directory, &error))
}

/// Writes a file into the directory, which is made if it does not exist.
///
/// # Errors
/// The file cannot be written (exit code 71).
pub fn write(directory: &Path, name: &str, text: impl AsRef<[u8]>) -> Result<(), Failure> {
    write_file(&directory.join(name), text)
}

/// Writes a file; its directory is made if it does not exist.
///
/// # Errors
/// The file cannot be written (exit code 71).
pub fn write_file(file: &Path, text: impl AsRef<[u8]>) -> Result<(), Failure> {
    make_parent(file)
        .and_then(|()| files::write(file, text))
        .map_err(|error| unwritable(file, &error))
}

/// Checks that `file` can be written, and keeps its content; to be called before a study, so that a failure is detected early.
///
/// # Errors
/// The file cannot be written (exit code 71).
pub fn check_file(file: &Path) -> Result<(), Failure> {
    make_parent(file)
        .and_then(|()| files::check_writable(file))
        .map_err(|error| unwritable(file, &error))
}

fn make_parent(file: &Path) -> io::Result<()> {
    fs::create_dir_all(file.parent().unwrap_or(Path::new("")))
}

fn unwritable(path: &Path, error: &io::Error) -> Failure {
    Failure::new(Exit::System, format!("{}: {error}; give another --out", path.display()))
}
