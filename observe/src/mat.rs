//! Tables as MAT-files of MATLAB, level 5: each column is a variable, a vector of doubles, of integers or of texts.
//!
//! Format: MathWorks, *MAT-File Format*, chapter "Level 5 MAT-File Format". Octave and `scipy.io.loadmat` read it, too.

use crate::csv::ColumnValues;

/// Data types of elements.
const INT8: u32 = 1;
const UINT16: u32 = 4;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const INT64: u32 = 12;
const UINT64: u32 = 13;
const MATRIX: u32 = 14;
/// Classes of arrays.
const CHAR_CLASS: u32 = 4;
const DOUBLE_CLASS: u32 = 6;
const INT64_CLASS: u32 = 14;
const UINT64_CLASS: u32 = 15;
/// Length of the text before the version in the header \[bytes\].
const HEADER_TEXT: usize = 124;

/// The file of a table. A count whose name ends with `_ns` is an instant: a signed integer \[ns\], like other times.
pub fn file<N: AsRef<str>>(columns: impl IntoIterator<Item = (N, ColumnValues)>) -> Vec<u8> {
    let text = "MATLAB 5.0 MAT-file, written by oqtal";
    let mut file = format!("{text:HEADER_TEXT$}").into_bytes();
    // Version, and the mark of little-endian bytes.
    file.extend([0x00, 0x01, b'I', b'M']);
    for (name, values) in columns {
        append(&mut file, MATRIX, &variable(name.as_ref(), values));
    }
    file
}

/// The content of a variable: flags, dimensions, name, values.
fn variable(name: &str, values: ColumnValues) -> Vec<u8> {
    let (class, kind, size, data) = match values {
        ColumnValues::Numbers(numbers) => {
            (DOUBLE_CLASS, DOUBLE, [numbers.len(), 1], bytes(&numbers, |n| n.to_le_bytes()))
        }
        ColumnValues::Counts(counts) => {
            let is_instant = name.ends_with("_ns");
            let (class, kind) =
                if is_instant { (INT64_CLASS, INT64) } else { (UINT64_CLASS, UINT64) };
            (class, kind, [counts.len(), 1], bytes(&counts, |n| n.to_le_bytes()))
        }
        ColumnValues::Signed(numbers) => {
            (INT64_CLASS, INT64, [numbers.len(), 1], bytes(&numbers, |n| n.to_le_bytes()))
        }
        ColumnValues::Words(words) => {
            let (width, data) = characters(&words);
            (CHAR_CLASS, UINT16, [words.len(), width], data)
        }
    };
    let mut content = Vec::with_capacity(data.len() + 128);
    append(&mut content, UINT32, &bytes(&[class, 0], |n| n.to_le_bytes()));
    let size = size.map(|count| u32::try_from(count).unwrap_or(u32::MAX));
    append(&mut content, INT32, &bytes(&size, |n| n.to_le_bytes()));
    append(&mut content, INT8, name.as_bytes());
    append(&mut content, kind, &data);
    content
}

/// Texts as a matrix of characters, one row each, padded with spaces and stored column by column; with its width.
fn characters(words: &[String]) -> (usize, Vec<u8>) {
    let rows: Vec<Vec<u16>> = words.iter().map(|word| word.encode_utf16().collect()).collect();
    let width = rows.iter().map(Vec::len).max().unwrap_or(0).max(1);
    let column = |index| rows.iter().map(move |row| row.get(index).copied().unwrap_or(b' '.into()));
    let units: Vec<u16> = (0..width).flat_map(column).collect();
    (width, bytes(&units, |unit| unit.to_le_bytes()))
}

fn bytes<T: Copy, const N: usize>(values: &[T], encode: impl Fn(T) -> [u8; N]) -> Vec<u8> {
    values.iter().flat_map(|value| encode(*value)).collect()
}

/// Appends an element: type, length, and the data padded to 8 bytes.
fn append(file: &mut Vec<u8>, kind: u32, data: &[u8]) {
    let length = u32::try_from(data.len()).unwrap_or(u32::MAX);
    file.extend(bytes(&[kind, length], |n| n.to_le_bytes()));
    file.extend_from_slice(data);
    file.resize(file.len().next_multiple_of(8), 0);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_variable_has_flags_dimensions_name_and_values() {
        let file = file([("t_ns", ColumnValues::Counts(vec![1, 2, 3]))]);
        assert_eq!((file.len(), &file[124..128]), (128 + 8 + 80, b"\x00\x01IM".as_slice()));
        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
        assert_eq!([word(128), word(132)], [MATRIX, 80]);
        assert_eq!([word(136), word(140), word(144)], [UINT32, 8, INT64_CLASS]);
        assert_eq!([word(152), word(156), word(160), word(164)], [INT32, 8, 3, 1]);
        assert_eq!((word(168), &file[176..180]), (INT8, b"t_ns".as_slice()));
        assert_eq!([word(184), word(188), word(192), word(200)], [INT64, 24, 1, 2]);
    }

    #[test]
    fn texts_are_rows_of_equal_length() {
        let (width, data) = characters(&["ab".to_owned(), String::new()]);
        let spaced = [b'a', 0, b' ', 0, b'b', 0, b' ', 0];
        assert_eq!((width, data.as_slice()), (2, spaced.as_slice()));
    }
}
