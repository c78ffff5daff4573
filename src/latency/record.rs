//! File with the measurement of a stand-in: instants and spans, one pair per line.

use std::fmt::Write;
use std::path::Path;

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure};

/// Number of rows allocated in advance: more than an hour at 60 Hz.
const ROOM: usize = 1 << 18;

/// Spans, each with its starting instant.
#[derive(Debug, Default)]
pub struct Record(Vec<(Time, Span)>);

impl Record {
    /// Empty record with resident memory, so that no page faults are measured.
    pub fn with_room() -> Self {
        let mut rows = vec![(Time::default(), Span::from_nanos(1)); ROOM];
        rows.clear();
        Self(rows)
    }

    /// Adds the span from `began` to `ended`.
    pub fn add(&mut self, began: Time, ended: Time) {
        self.0.push((began, ended.since(began)));
    }

    /// The spans that began between `from` and `to`.
    pub fn within(&self, from: Time, to: Time) -> impl Iterator<Item = Span> {
        self.0.iter().filter(move |(at, _)| (from..=to).contains(at)).map(|(_, span)| *span)
    }

    /// Writes the record to `path` atomically.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), Failure> {
        let mut text = String::with_capacity(32 * self.0.len());
        for (at, span) in &self.0 {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{} {}", at.nanos(), span.nanos());
        }
        let draft = path.with_extension("draft");
        let written = std::fs::write(&draft, text).and_then(|()| std::fs::rename(&draft, path));
        written.map_err(|error| failed(path, &error))
    }

    /// Reads a record written by [`Record::save`].
    ///
    /// # Errors
    /// The file does not exist, or is incomplete.
    pub fn load(path: &Path) -> Result<Self, Failure> {
        let text = std::fs::read_to_string(path).map_err(|error| failed(path, &error))?;
        let row = |line: &str| {
            let (at, span) = line.split_once(' ')?;
            Some((Time::from_nanos(at.parse().ok()?), Span::from_nanos(span.parse().ok()?)))
        };
        let rows: Option<Vec<_>> = text.lines().map(row).collect();
        rows.map(Self).ok_or_else(|| failed(path, &"not a record"))
    }
}

fn failed(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::new(Exit::System, format!("{}: {error}", path.display()))
}
