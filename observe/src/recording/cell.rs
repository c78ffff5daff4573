//! Messages as rows of typed cells, with the names of their columns.

use oqtal_bus::message::{Field, FieldType, Header, Stamps};
use oqtal_bus::topic::Sample;

use super::schema::member_name;
use crate::csv::FieldCell;
use crate::sink::Reception;

/// Names of vector components in columns.
const COMPONENTS: [&str; 4] = ["x", "y", "z", "w"];
/// Unit of a field that contains the bytes of a text.
const TEXT: &str = "text";

/// Names of the columns of messages with these fields, with their units: reception by the recorder, header, stamps, body. A header field or
/// stamp with the same name as a body field begins with `header_`.
pub fn names(fields: &[Field]) -> Vec<String> {
    let body: Vec<String> = fields.iter().flat_map(columns).collect();
    let header = [Header::FIELDS, Stamps::FIELDS].concat();
    let mut names = vec!["recorded_at_ns".to_owned()];
    names.extend(header.iter().flat_map(columns).map(|name| match body.contains(&name) {
        true => format!("header_{name}"),
        false => name,
    }));
    names.extend(body);
    names
}

/// Columns of a field: one for each element.
fn columns(field: &Field) -> Vec<String> {
    let name = member_name(field);
    match field.length {
        1 => vec![name],
        _ if field.unit == TEXT => vec![name],
        length => {
            COMPONENTS[..length].iter().map(|component| format!("{name}_{component}")).collect()
        }
    }
}

/// The row of a message, with a cell for each of its [`names`].
pub fn cells(
    reception: &Reception,
    sample: &Sample<'_>,
) -> impl Iterator<Item = FieldCell> + use<> {
    let Header { sequence, pose_sequence, schema, source, stamps } = reception.header;
    let words = [reception.received_at.nanos(), sequence, pose_sequence, schema, source];
    let words = words.into_iter().chain(stamps.to_words()).map(FieldCell::Count);
    let message = sample.body();
    let packed = message.packed();
    let mut rest = packed.as_slice();
    let mut body = Vec::new();
    for field in message.fields() {
        let (bytes, behind) = rest.split_at(field.size());
        rest = behind;
        match field.unit {
            TEXT => body.push(FieldCell::Text(text_of(bytes))),
            _ => body.extend(bytes.chunks(field.element.size()).map(|b| cell_of(field.element, b))),
        }
    }
    words.chain(body)
}

/// The bytes of a text without the trailing zeros.
fn text_of(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).trim_end_matches('\0').to_owned()
}

fn cell_of(element: FieldType, bytes: &[u8]) -> FieldCell {
    let mut word = [0; 8];
    word[..bytes.len()].copy_from_slice(bytes);
    let number = u64::from_le_bytes(word);
    match element {
        FieldType::U8 | FieldType::U32 | FieldType::U64 | FieldType::Time => {
            FieldCell::Count(number)
        }
        FieldType::I64 => FieldCell::Signed(number.cast_signed()),
        FieldType::F64 => FieldCell::Number(f64::from_bits(number)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::topic::ObservedTopic;

    #[test]
    fn names_of_columns_are_distinct_and_legal_in_matlab() {
        for topic in ObservedTopic::all() {
            let names = names(topic.fields());
            let distinct: std::collections::BTreeSet<_> = names.iter().collect();
            assert_eq!(distinct.len(), names.len(), "{topic}");
            let is_legal = |name: &str| name.len() < 64 && name.starts_with(char::is_alphabetic);
            assert!(names.iter().all(|name| is_legal(name)), "{topic}: {names:?}");
        }
    }
}
