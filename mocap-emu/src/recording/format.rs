//! File formats of recordings: names and positions of columns, and the parser of a line.

use nalgebra::{Vector3, Vector4};
use oqtal_control::quaternion::Attitude;

use super::error::ErrorKind;

#[derive(Debug)]
struct Format {
    /// Names of the columns: time, position x, y, z, quaternion with the scalar last.
    columns: [&'static str; 8],
    /// Whether fields are separated by commas under a header; otherwise by white space, without a header.
    has_header: bool,
    /// The unit of time is 10^`time_exponent` ns.
    time_exponent: i64,
}

static NAMED: Format = Format {
    columns: ["t", "x", "y", "z", "qx", "qy", "qz", "qw"],
    has_header: true,
    time_exponent: 9,
};

static TUM: Format = Format {
    columns: ["timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw"],
    has_header: false,
    time_exponent: 9,
};

static EUROC: Format = Format {
    #[rustfmt::skip]
    columns: [
        "timestamp", "p_RS_R_x", "p_RS_R_y", "p_RS_R_z", "q_RS_x", "q_RS_y", "q_RS_z", "q_RS_w",
    ],
    has_header: true,
    time_exponent: 0,
};

/// Layout of the lines of one file.
#[derive(Debug)]
pub(super) struct Layout {
    format: &'static Format,
    /// Index of the field of each column of the format \[-\].
    index: [usize; 8],
    /// Number of fields on each line \[-\].
    fields: usize,
}

/// The pose on one line of a recording.
#[derive(Debug)]
pub(super) struct PoseRow<'a> {
    /// Arrival, by the clock of the recording \[ns\].
    pub time_ns: i64,
    /// The text of the time field.
    pub time_text: &'a str,
    /// Position \[m, world\].
    pub position: Vector3<f64>,
    /// Attitude \[body to world\].
    pub attitude: Attitude,
}

impl Layout {
    /// Detects the layout from a line before the first pose; `None` if the line is a comment.
    pub fn detect(line: &str) -> Result<Option<Self>, ErrorKind> {
        if let Some(comment) = line.strip_prefix('#') {
            let names: Vec<_> = comma_separated(comment).map(without_unit).collect();
            // The column `timestamp` is left out, since it also occurs in comments of TUM text.
            if !mentions(&names, &EUROC.columns[1..]) {
                return Ok(None);
            }
            return Self::under_header(&EUROC, &names).map(Some);
        }
        let names: Vec<_> = comma_separated(line).collect();
        if mentions(&names, &NAMED.columns) {
            return Self::under_header(&NAMED, &names).map(Some);
        }
        let first = line.split_whitespace().next().unwrap_or_default();
        if first.parse::<f64>().is_err() {
            return Err(ErrorKind::UnknownFormat);
        }
        Ok(Some(Self { format: &TUM, index: std::array::from_fn(|column| column), fields: 8 }))
    }

    fn under_header(format: &'static Format, names: &[&str]) -> Result<Self, ErrorKind> {
        let mut missing = Vec::new();
        let index = format.columns.map(|column| {
            names.iter().position(|name| name.eq_ignore_ascii_case(column)).unwrap_or_else(|| {
                missing.push(column);
                usize::MAX
            })
        });
        if !missing.is_empty() {
            return Err(ErrorKind::MissingColumns(missing));
        }
        Ok(Self { format, index, fields: names.len() })
    }

    /// Whether the line from which the layout was detected is a header, not a pose.
    pub fn has_header(&self) -> bool {
        self.format.has_header
    }

    /// Parses the pose on a line.
    pub fn row<'a>(&self, line: &'a str) -> Result<PoseRow<'a>, ErrorKind> {
        let fields: Vec<_> = if self.format.has_header {
            comma_separated(line).collect()
        } else {
            line.split_whitespace().collect()
        };
        if fields.len() != self.fields {
            return Err(ErrorKind::FieldCount { found: fields.len(), expected: self.fields });
        }
        let texts = self.index.map(|field| fields[field]);
        let mut numbers = [0.0; 8];
        for ((number, text), column) in numbers.iter_mut().zip(texts).zip(self.format.columns) {
            *number = finite(text, column)?;
        }
        let [_, x, y, z, q1, q2, q3, eta] = numbers;
        let quaternion = [q1, q2, q3, eta];
        Ok(PoseRow {
            time_ns: shifted(texts[0], self.format.time_exponent)
                .ok_or(ErrorKind::TimeOutOfRange(self.format.columns[0]))?,
            time_text: texts[0],
            position: Vector3::new(x, y, z),
            attitude: Attitude::from_xyzw(quaternion)
                .ok_or_else(|| ErrorKind::NotUnit(Vector4::from(quaternion).norm()))?,
        })
    }
}

fn comma_separated(line: &str) -> impl Iterator<Item = &str> {
    line.split(',').map(|field| field.trim().trim_matches('"'))
}

/// The name of a column without its unit: `p_RS_R_x` for `p_RS_R_x [m]`.
fn without_unit(name: &str) -> &str {
    name.split_once('[').map_or(name, |(name, _)| name.trim())
}

fn mentions(names: &[&str], columns: &[&str]) -> bool {
    names.iter().any(|name| columns.iter().any(|column| name.eq_ignore_ascii_case(column)))
}

fn finite(text: &str, column: &'static str) -> Result<f64, ErrorKind> {
    let number: f64 = text.parse().map_err(|_| ErrorKind::not_a_number(column, text))?;
    if number.is_finite() { Ok(number) } else { Err(ErrorKind::NotFinite(column)) }
}

/// A finite decimal number times 10^`exponent`, rounded to the nearest integer; `None` if beyond 64 bits.
///
/// Computed digit by digit: f64 has 16 significant digits, a Unix time in nanoseconds has 19.
fn shifted(number: &str, exponent: i64) -> Option<i64> {
    let (mantissa, power) = number.split_once(['e', 'E']).unwrap_or((number, "0"));
    let magnitude = mantissa.trim_start_matches(['+', '-']);
    let (whole, fraction) = magnitude.split_once('.').unwrap_or((magnitude, ""));
    let mut digits = whole.bytes().chain(fraction.bytes()).map(|digit| i64::from(digit - b'0'));
    if digits.clone().all(|digit| digit == 0) {
        return Some(0);
    }
    let digits_before_point = whole.len() as i64 + i64::from(power.parse::<i32>().ok()?) + exponent;
    let mut value: i64 = 0;
    for _ in 0..digits_before_point {
        value = value.checked_mul(10)?.checked_add(digits.next().unwrap_or(0))?;
    }
    if digits_before_point >= 0 && digits.next().is_some_and(|digit| digit >= 5) {
        value = value.checked_add(1)?;
    }
    Some(if mantissa.starts_with('-') { -value } else { value })
}
