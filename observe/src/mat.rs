//! The ticks of a flight as a MAT-file of version 5, which MATLAB, Octave and scipy read: a variable for each column of
//! `telemetry.csv`, and `t_ns`, the time of the ticks as 64-bit integers.
//!
//! The format: *MAT-File Format*, The MathWorks; uncompressed, little-endian.

use std::io::{self, Write};

use crate::csv::{Column, ColumnValues, columns};
use crate::flight::Flight;

/// Types of data elements.
const INT8: u32 = 1;
const UINT16: u32 = 4;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const INT64: u32 = 12;
const MATRIX: u32 = 14;

/// Classes of arrays.
const CELL_CLASS: u32 = 1;
const CHAR_CLASS: u32 = 4;
const DOUBLE_CLASS: u32 = 6;
const INT64_CLASS: u32 = 14;

/// Length of the text of the header \[bytes\]; the rest up to 128 bytes is subsystem, version and byte order.
const HEADER_TEXT: usize = 116;

/// Writes the ticks of `flight`.
///
/// # Errors
/// `out` cannot be written.
pub fn write(flight: &Flight, mut out: impl Write) -> io::Result<()> {
    let mut header = [b' '; HEADER_TEXT];
    let text = b"MATLAB 5.0 MAT-file, flight of oqtal";
    header[..text.len()].copy_from_slice(text);
    out.write_all(&header)?;
    out.write_all(&[0; 8])?;
    out.write_all(&0x0100_u16.to_le_bytes())?;
    out.write_all(b"IM")?;
    let origin = flight.origin();
    let times = flight.samples.iter().map(|sample| sample.telemetry.time.since(origin).nanos());
    out.write_all(&integers("t_ns", &times.collect::<Vec<i64>>()))?;
    for Column { name, values } in columns(flight) {
        out.write_all(&match values {
            ColumnValues::Numbers(numbers) => numbers_of(name, &numbers),
            ColumnValues::Counts(counts) => {
                integers(name, &counts.into_iter().map(u64::cast_signed).collect::<Vec<_>>())
            }
            ColumnValues::Words(words) => words_of(name, &words),
        })?;
    }
    out.flush()
}

/// A column of numbers.
fn numbers_of(name: &str, numbers: &[f64]) -> Vec<u8> {
    let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    matrix(name, DOUBLE_CLASS, [numbers.len(), 1], &element(DOUBLE, &bytes))
}

/// A column of integers.
fn integers(name: &str, integers: &[i64]) -> Vec<u8> {
    let bytes: Vec<u8> = integers.iter().flat_map(|integer| integer.to_le_bytes()).collect();
    matrix(name, INT64_CLASS, [integers.len(), 1], &element(INT64, &bytes))
}

/// A column of words: a cell array of texts.
fn words_of(name: &str, words: &[String]) -> Vec<u8> {
    let cell = |word: &String| {
        let codes: Vec<u16> = word.encode_utf16().collect();
        let bytes: Vec<u8> = codes.iter().flat_map(|code| code.to_le_bytes()).collect();
        let rows = usize::from(!codes.is_empty());
        matrix("", CHAR_CLASS, [rows, codes.len()], &element(UINT16, &bytes))
    };
    matrix(name, CELL_CLASS, [words.len(), 1], &words.iter().flat_map(cell).collect::<Vec<u8>>())
}

/// An array with its name, class, dimensions and data elements.
fn matrix(name: &str, class: u32, dimensions: [usize; 2], data: &[u8]) -> Vec<u8> {
    let flags: Vec<u8> = [class, 0].iter().flat_map(|word| word.to_le_bytes()).collect();
    let sizes = dimensions.map(|size| i32::try_from(size).unwrap_or(i32::MAX));
    let sizes: Vec<u8> = sizes.iter().flat_map(|size| size.to_le_bytes()).collect();
    let parts = [
        element(UINT32, &flags),
        element(INT32, &sizes),
        element(INT8, name.as_bytes()),
        data.to_vec(),
    ];
    element(MATRIX, &parts.concat())
}

/// A data element: type, length, data, filled to a multiple of 8 bytes.
fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(data.len() + 16);
    bytes.extend(kind.to_le_bytes());
    bytes.extend(u32::try_from(data.len()).unwrap_or(u32::MAX).to_le_bytes());
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::fixture;

    /// Names, classes and numbers of rows of the arrays in a file; panics if an element is not within its bounds.
    fn arrays(file: &[u8]) -> Vec<(String, u8, i32)> {
        let word =
            |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let mut found = Vec::new();
        let mut rest = &file[128..];
        while !rest.is_empty() {
            assert_eq!(word(rest, 0), MATRIX);
            let (array, after) = rest[8..].split_at(word(rest, 4) as usize);
            let length = word(array, 36) as usize;
            let name = String::from_utf8(array[40..40 + length].to_vec()).unwrap();
            found.push((name, array[8], word(array, 24).cast_signed()));
            rest = after;
        }
        found
    }

    #[test]
    fn every_column_is_an_array_with_a_row_for_each_tick() {
        let flight = fixture::square();
        let mut file = Vec::new();
        write(&flight, &mut file).unwrap();
        assert_eq!(&file[124..128], [0, 1, b'I', b'M']);
        let arrays = arrays(&file);
        let names: Vec<&str> = arrays.iter().map(|(name, ..)| name.as_str()).collect();
        let expected: Vec<&str> = columns(&flight).iter().map(|column| column.name).collect();
        assert_eq!(names[0], "t_ns");
        assert_eq!(names[1..], expected);
        for (name, class, rows) in &arrays {
            assert_eq!(*rows as usize, flight.samples.len(), "{name}");
            let is_word = ["mode", "state", "cause", "phase"].contains(&name.as_str());
            assert_eq!(u32::from(*class) == CELL_CLASS, is_word, "{name}");
        }
    }
}
