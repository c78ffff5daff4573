//! What can be wrong with a recording, and where.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::MAX_BYTES;

/// A recording that cannot be used. Displays as `FILE:LINE: what is wrong`, without `:LINE` if no line is at fault.
#[derive(Debug)]
pub struct RecordingError {
    /// The file as it was named.
    pub path: PathBuf,
    /// The line at fault, counted from 1 over all lines of the file.
    pub line: Option<usize>,
    /// What is wrong.
    pub kind: ErrorKind,
}

/// What is wrong with a recording.
#[derive(Debug, thiserror::Error)]
pub enum ErrorKind {
    /// The operating system does not give the content.
    #[error("cannot be read: {0}")]
    Unreadable(io::Error),
    /// More than [`MAX_BYTES`].
    #[error("larger than {} MiB", MAX_BYTES >> 20)]
    TooLarge,
    /// Nothing but blank lines and comments.
    #[error("empty")]
    Empty,
    /// The first line belongs to none of the formats.
    #[error("neither a header naming t,x,y,z,qx,qy,qz,qw, nor TUM text, nor a EuRoC header")]
    UnknownFormat,
    /// The header lacks these columns.
    #[error("the header lacks {}", .0.join(", "))]
    MissingColumns(Vec<&'static str>),
    /// Fewer or more fields than the header has, or than the eight of TUM text.
    #[error("expected {expected} fields, found {found}")]
    FieldCount {
        /// Fields on the line.
        found: usize,
        /// Fields a line must have.
        expected: usize,
    },
    /// Text where a number belongs.
    #[error("{column} is not a number: {text:?}")]
    NotANumber {
        /// Name of the column.
        column: &'static str,
        /// The field, shortened.
        text: String,
    },
    /// NaN or infinite, in the column of this name.
    #[error("{0} is not finite")]
    NotFinite(&'static str),
    /// Beyond 64 bits of nanoseconds, 292 years either way, in the column of this name.
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
    /// Four numbers that are no rotation: their norm.
    #[error("norm of the quaternion is {0:.4}, not 1")]
    NotUnit(f64),
    /// So many poses, and no time passes between them.
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

/// Enough of a field to find it: one field of a damaged file may be as long as the file.
fn shortened(text: &str) -> String {
    text.chars().take(40).collect()
}
