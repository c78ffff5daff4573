//! Adjacent columns of `telemetry.csv`, and what their cells are made of.

use oqtal_bus::time::Time;

use crate::flight::{AppliedCommand, FlightSample};

/// What a row is made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row<'a> {
    pub(super) sample: &'a FlightSample,
    /// The command of the tick as it reached the vehicle; `None` if it did not.
    pub(super) applied: Option<&'a AppliedCommand>,
    /// Zero of the time axis.
    pub(super) origin: Time,
}

/// The cells of adjacent columns.
#[derive(Clone, Copy, Debug)]
pub(super) enum CellValues {
    /// Numbers, of which as many are used as there are columns; NaN is an empty cell.
    Numbers(fn(&Row<'_>) -> [f64; 6]),
    /// A word.
    Word(fn(&Row<'_>) -> Option<String>),
}

/// Instant that a value is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Instant {
    /// That of the row, `t_s`.
    Tick,
    /// The capture of the newest accepted pose, `pose_captured_s`.
    Capture,
    /// The whole way of the command that was published in the tick.
    Command,
}

/// Adjacent columns that mean the same for several axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct ColumnGroup {
    pub(super) names: &'static [&'static str],
    pub(super) unit: &'static str,
    pub(super) instant: Instant,
    pub(super) about: &'static str,
    pub(super) cells: CellValues,
}

impl ColumnGroup {
    /// The cells of these columns in `row`.
    pub(super) fn cells(&self, row: &Row<'_>) -> Vec<String> {
        match self.cells {
            CellValues::Word(word) => vec![word(row).unwrap_or_default()],
            CellValues::Numbers(numbers) => {
                numbers(row).into_iter().take(self.names.len()).map(number).collect()
            }
        }
    }
}

/// The shortest decimal text that is read back as the same number; empty for NaN.
fn number(value: f64) -> String {
    if value.is_nan() { String::new() } else { value.to_string() }
}
