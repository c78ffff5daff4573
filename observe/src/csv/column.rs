//! Cells of a table, and its columns.

use std::fmt;

/// Cell of a row.
#[derive(Clone, Debug, PartialEq)]
pub enum FieldCell {
    /// A count, a code, a flag, or an instant \[ns\].
    Count(u64),
    /// A span of time \[ns\].
    Signed(i64),
    /// A number \[unit in the column's name\]; NaN if unknown.
    Number(f64),
    /// A text; empty for a code unknown to this version.
    Text(String),
}

impl fmt::Display for FieldCell {
    /// Writes a number as the shortest decimal that reproduces it exactly, an unknown one as nothing.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(count) => write!(f, "{count}"),
            Self::Signed(number) => write!(f, "{number}"),
            Self::Number(number) if number.is_nan() => Ok(()),
            Self::Number(number) => write!(f, "{number}"),
            Self::Text(text) => f.write_str(text),
        }
    }
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

impl ColumnValues {
    /// A column without values; the first cell decides their kind.
    pub(crate) const EMPTY: Self = Self::Numbers(Vec::new());

    /// Appends the value of `cell`.
    pub(crate) fn push(&mut self, cell: FieldCell) {
        match (self, cell) {
            (Self::Numbers(numbers), FieldCell::Number(number)) => numbers.push(number),
            (Self::Counts(counts), FieldCell::Count(count)) => counts.push(count),
            (Self::Signed(numbers), FieldCell::Signed(number)) => numbers.push(number),
            (Self::Words(words), FieldCell::Text(text)) => words.push(text),
            (empty, FieldCell::Number(number)) => *empty = Self::Numbers(vec![number]),
            (empty, FieldCell::Count(count)) => *empty = Self::Counts(vec![count]),
            (empty, FieldCell::Signed(number)) => *empty = Self::Signed(vec![number]),
            (empty, FieldCell::Text(text)) => *empty = Self::Words(vec![text]),
        }
    }
}
