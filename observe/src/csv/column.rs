//! The ticks of a flight as columns.

use super::row::CellSink;

/// A column.
#[derive(Clone, Debug, PartialEq)]
pub struct TelemetryColumn {
    /// Name, with the unit.
    pub name: &'static str,
    /// Values, one for each tick.
    pub values: ColumnValues,
}

/// The values of a column.
#[derive(Clone, Debug, PartialEq)]
pub enum ColumnValues {
    /// Numbers \[unit in the column's name\]; NaN for an unknown one.
    Numbers(Vec<f64>),
    /// Counts \[-\], or instants \[ns\].
    Counts(Vec<u64>),
    /// Spans of time \[ns\]; in exported topics only.
    Signed(Vec<i64>),
    /// Words; an empty one for a code unknown to this version.
    Words(Vec<String>),
}

/// Collects the cells of rows by column.
pub(super) struct ColumnSink {
    columns: Vec<TelemetryColumn>,
    /// Index of the column of the next cell.
    next: usize,
}

impl ColumnSink {
    /// Columns without rows; the first row decides the kinds of their values.
    pub(super) fn new(names: impl Iterator<Item = &'static str>) -> Self {
        let column = |name| TelemetryColumn { name, values: ColumnValues::Numbers(Vec::new()) };
        Self { columns: names.map(column).collect(), next: 0 }
    }

    pub(super) fn begin_row(&mut self) {
        self.next = 0;
    }

    pub(super) fn into_columns(self) -> Vec<TelemetryColumn> {
        self.columns
    }

    /// The values of the column of the next cell.
    fn values(&mut self) -> &mut ColumnValues {
        self.next += 1;
        &mut self.columns[self.next - 1].values
    }
}

impl CellSink for ColumnSink {
    fn number(&mut self, value: f64) {
        if let ColumnValues::Numbers(numbers) = self.values() {
            numbers.push(value);
        }
    }

    fn count(&mut self, value: u64) {
        match self.values() {
            ColumnValues::Counts(counts) => counts.push(value),
            values => *values = ColumnValues::Counts(vec![value]),
        }
    }

    fn word(&mut self, word: String) {
        match self.values() {
            ColumnValues::Words(words) => words.push(word),
            values => *values = ColumnValues::Words(vec![word]),
        }
    }
}
