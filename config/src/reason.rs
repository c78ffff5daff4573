//! Reasons of the TOML reader in the words of a configuration file, in place of those of the programming language.

use toml::Value;

/// Types that the reader expects, and their plain names.
const TYPES: [(&str, &str); 14] = [
    ("f64", "a number"),
    ("f32", "a number"),
    ("u8", "a whole number from 0 to 255"),
    ("u16", "a whole number from 0 to 65535"),
    ("u32", "a whole number, not negative"),
    ("u64", "a whole number, not negative"),
    ("usize", "a whole number, not negative"),
    ("i32", "a whole number"),
    ("i64", "a whole number"),
    ("a boolean", "true or false"),
    ("a string", "a text in quotes"),
    ("string only", "a text in quotes"),
    ("a sequence", "a list"),
    ("a map", "a section"),
];

/// Names of found values that the reader writes before or in place of them.
const FOUND: [(&str, &str); 7] = [
    ("string ", ""),
    ("integer ", ""),
    ("floating point ", ""),
    ("boolean ", ""),
    ("sequence", "a list"),
    ("map", "a section"),
    ("unit variant", "another kind of value"),
];

/// Beginning of a reason that does not say what was found.
const OTHER_KIND: &str = "found another kind of value";
/// End of a reason that does not say how many elements a list must have.
const TOO_MANY: &str = "expected fewer elements in array";

/// `message` in plain words.
pub(crate) fn plain(message: &str) -> String {
    for start in ["invalid type: ", "invalid value: "] {
        let parts = message.strip_prefix(start).and_then(|rest| rest.rsplit_once(", expected "));
        if let Some((found, expected)) = parts {
            return format!("found {}, expected {}", named(found, &FOUND), type_named(expected));
        }
    }
    let length =
        message.strip_prefix("invalid length ").and_then(|rest| rest.split_once(", expected "));
    if let Some((count, expected)) = length {
        return format!("found a list of {count}, expected {}", type_named(expected));
    }
    let renamed = [
        ("unknown field ", "unknown key "),
        ("unknown variant ", "unknown value "),
        ("missing field ", "missing key "),
    ];
    let of =
        |(start, plain): (&str, &str)| Some(format!("{plain}{}", message.strip_prefix(start)?));
    renamed.into_iter().find_map(of).unwrap_or_else(|| message.to_owned())
}

/// `reason` for which `value` was refused, completed from the reason `again` for another value in its place, where the reader does
/// not say what it found, or how many elements it expected.
pub(crate) fn completed(
    reason: String,
    value: &Value,
    again: impl Fn(Value) -> Option<String>,
) -> String {
    let is_choice = reason.starts_with(OTHER_KIND) || reason.starts_with("wanted exactly 1 ");
    let other = match value {
        Value::Array(all) if reason.ends_with(TOO_MANY) => {
            Some((format!("a list of {}", all.len()), Value::Array(Vec::new())))
        }
        Value::Array(_) if is_choice => Some(("a list".to_owned(), String::new().into())),
        Value::Table(_) if is_choice => Some(("a section".to_owned(), String::new().into())),
        value if is_choice => Some((format!("`{value}`"), String::new().into())),
        _ => None,
    };
    let completed = other.and_then(|(found, other)| {
        let reason = again(other)?;
        let (_, expected) = reason.split_once(", expected ")?;
        Some(format!("found {found}, expected {expected}"))
    });
    completed.unwrap_or(reason)
}

fn type_named(expected: &str) -> String {
    if let Some(count) = expected.strip_prefix("an array of length ") {
        return format!("a list of {count}");
    }
    if expected.starts_with("struct ") {
        return "a section".to_owned();
    }
    let known = TYPES.iter().find(|(name, _)| *name == expected);
    known.map_or_else(|| expected.to_owned(), |(_, plain)| (*plain).to_owned())
}

/// `text` with the first of `names` that it begins with replaced.
fn named(text: &str, names: &[(&str, &str)]) -> String {
    let rest = |(name, plain): &(&str, &str)| Some(format!("{plain}{}", text.strip_prefix(name)?));
    names.iter().find_map(rest).unwrap_or_else(|| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::de::DeserializeOwned;
    use toml::Table;

    fn said<T: DeserializeOwned>(value: impl Into<Value>) -> String {
        let read: Result<T, toml::de::Error> = value.into().try_into();
        plain(read.map(|_| ()).unwrap_err().message())
    }

    #[test]
    fn a_value_of_another_kind_is_refused_in_plain_words() {
        assert_eq!(said::<f64>("heavy"), "found \"heavy\", expected a number");
        assert_eq!(said::<f64>(true), "found `true`, expected a number");
        assert_eq!(said::<f64>(vec![1.0]), "found a list, expected a number");
        assert_eq!(said::<[f64; 3]>(vec![1.0, 2.0]), "found a list of 2, expected a list of 3");
        assert_eq!(said::<u32>(-1), "found `-1`, expected a whole number, not negative");
        assert_eq!(said::<u64>(1.5), "found `1.5`, expected a whole number, not negative");
        assert_eq!(said::<bool>("maybe"), "found \"maybe\", expected true or false");
        assert_eq!(said::<String>(5), "found `5`, expected a text in quotes");
        assert_eq!(said::<Table>(5), "found `5`, expected a section");
    }
}
