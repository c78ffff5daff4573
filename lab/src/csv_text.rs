//! Tables of studies as CSV.

use oqtal_runtime::process::{Exit, Failure};

/// A table with these names of columns and these rows.
///
/// # Errors
/// The number of fields of a row differs from the number of columns (exit code 70).
pub fn table(
    columns: impl Iterator<Item = impl AsRef<[u8]>>,
    rows: impl Iterator<Item = Vec<String>>,
) -> Result<String, Failure> {
    let internal = |error: &dyn std::fmt::Display| Failure::new(Exit::Internal, error.to_string());
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(columns).map_err(|error| internal(&error))?;
    for row in rows {
        table.write_record(row).map_err(|error| internal(&error))?;
    }
    let bytes = table.into_inner().map_err(|error| internal(&error))?;
    String::from_utf8(bytes).map_err(|error| internal(&error))
}

/// A number as a field; empty if it is not finite, as for a flight that did not land.
pub fn number(value: f64) -> String {
    if value.is_finite() { value.to_string() } else { String::new() }
}
