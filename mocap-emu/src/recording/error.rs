//! Errors of recordings: kind of fault, file and line.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Size of the largest file that is read \[byte\]: half an hour at 240 Hz, two hours at 60 Hz.
pub const MAX_BYTES: u64 = 64 << 20;

/// Error of a recording that cannot be used. Displays as `FILE:LINE: fault`, without `:LINE` if the fault has no line.
#[derive(Debug)]
pub struct RecordingError {
    /// Path of the file as given.
    pub path: PathBuf,
    /// Number of the line at fault, from 1; `None` if the file as a whole is at fault \[-\].
    pub line: Option<usize>,
    /// Kind of the fault.
    pub kind: ErrorKind,
}

/// Kind of fault of a recording.
#[derive(Debug, thiserror::Error)]
pub enum ErrorKind {
    /// The operating system could not read the file.
    #[error("cannot be read: {0}")]
    Unreadable(io::Error),
    /// The file is larger than [`MAX_BYTES`].
    #[error("larger than {} MiB", MAX_BYTES >> 20)]
    TooLarge,
    /// The file contains only blank lines and comments.
    #[error("empty")]
    Empty,
    /// The first line matches none of the formats.
    #[error("neither a header naming t,x,y,z,qx,qy,qz,qw, nor TUM text, nor a EuRoC header")]
    UnknownFormat,
    /// The header lacks these columns.
    #[error("the header lacks {}", .0.join(", "))]
    MissingColumns(Vec<&'static str>),
    /// Fewer or more fields than the header has, or than the eight of TUM text.
    #[error("expected {expected} fields, found {found}")]
    FieldCount {
        /// Number of fields on the line \[-\].
        found: usize,
        /// Number of fields that a line must have \[-\].
        expected: usize,
    },
    /// A field that is not a number.
    #[error("{column} is not a number: {text:?}")]
    NotANumber {
        /// Name of the column.
        column: &'static str,
        /// The text of the field, shortened.
        text: String,
    },
    /// A number that is NaN or infinite; the name of its column.
    #[error("{0} is not finite")]
    NotFinite(&'static str),
    /// A time beyond 64 bits of nanoseconds (292 years); the name of its column.
    #[error("{0} is out of range")]
    TimeOutOfRange(&'static str),
    /// A pose that arrived before its predecessor.
    #[error("time goes back from {from} to {to}")]
    TimeBackwards {
        /// The previous time as written, shortened.
        from: String,
        /// This line's time as written, shortened.
        to: String,
    },
    /// A quaternion that is not of unit norm; its norm \[-\].
    #[error("norm of the quaternion is {0:.4}, not 1")]
    NotUnit(f64),
    /// The poses do not span any time; their number \[-\].
    #[error("expected at least 2 poses at different times, found {0}")]
    TooShort(usize),
}

impl RecordingError {
    pub(super) fn new(path: &Path, line: Option<usize>, kind: ErrorKind) -> Self {
        Self { path: path.into(), line, kind }
    }
}

impl fmt::Display for RecordingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        write!(f, ": {}", self.kind)
    }
}

impl std::error::Error for RecordingError {}

impl ErrorKind {
    pub(super) fn not_a_number(column: &'static str, text: &str) -> Self {
        Self::NotANumber { column, text: shortened(text) }
    }

    pub(super) fn time_backwards(from: &str, to: &str) -> Self {
        Self::TimeBackwards { from: shortened(from), to: shortened(to) }
    }
}

/// The beginning of a field: a field of a damaged file may be as long as the file.
fn shortened(text: &str) -> String {
    text.chars().take(40).collect()
}
