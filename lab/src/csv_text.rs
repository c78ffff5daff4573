//! Tables of studies as CSV.

use oqtal_runtime::process::{Exit, Failure};

/// A table that is being written.
#[derive(Debug)]
pub struct CsvText(csv::Writer<Vec<u8>>);

impl CsvText {
    /// A table with these names of columns.
    ///
    /// # Errors
    /// None that an empty memory can have; those of [`CsvText::row`].
    pub fn new<'a>(columns: impl Iterator<Item = &'a str>) -> Result<Self, Failure> {
        let mut table = Self(csv::Writer::from_writer(Vec::new()));
        table.row(columns.map(str::to_owned))?;
        Ok(table)
    }

    /// Adds a row.
    ///
    /// # Errors
    /// The row has not as many fields as there are columns (exit code 70).
    pub fn row(&mut self, fields: impl Iterator<Item = String>) -> Result<(), Failure> {
        self.0.write_record(fields).map_err(|error| internal(&error))
    }

    /// The text of the table.
    ///
    /// # Errors
    /// As [`CsvText::row`].
    pub fn finish(self) -> Result<String, Failure> {
        let bytes = self.0.into_inner().map_err(|error| internal(&error))?;
        String::from_utf8(bytes).map_err(|error| internal(&error))
    }
}

/// A number as a field; empty if it is not finite, as that of a flight that did not land.
#[must_use]
pub fn number(value: f64) -> String {
    if value.is_finite() { value.to_string() } else { String::new() }
}

fn internal(error: &dyn std::fmt::Display) -> Failure {
    Failure::new(Exit::Internal, error.to_string())
}
