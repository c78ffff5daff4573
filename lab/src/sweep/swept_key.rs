//! The axes of a sweep: keys of the configuration with their values.

use std::collections::BTreeSet;

use oqtal_config::Setting;
use oqtal_runtime::process::{Exit, Failure};

/// Greatest number of combinations of values \[-\].
const MOST_COMBINATIONS: usize = 100_000;

/// Key of the configuration, and its values.
#[derive(Clone, Debug, PartialEq)]
pub struct SweptKey {
    /// The key.
    pub key: String,
    /// Values of the key, in the order given.
    pub values: Vec<toml::Value>,
}

impl SweptKey {
    /// The key with its values, from `KEY=FIRST:LAST:NUMBER` or `KEY=A,B,C`.
    ///
    /// # Errors
    /// The text has another form.
    pub fn parse(text: &str) -> Result<Self, String> {
        let form = "write KEY=FIRST:LAST:NUMBER, as in plant.rate-lag-ms=30:90:7, or KEY=A,B,C";
        let (key, values) = text.split_once('=').ok_or_else(|| form.to_owned())?;
        let key = key.trim().to_owned();
        let range: Vec<&str> = values.split(':').collect();
        if let [first, last, number] = range[..] {
            let end = |text: &str| text.trim().parse::<f64>().ok().filter(|end| end.is_finite());
            let number = number.trim().parse().ok().filter(|number| (2..=10_000).contains(number));
            let (Some(first), Some(last), Some(number)) = (end(first), end(last), number) else {
                return Err(format!("{form}; NUMBER is from 2 to 10000"));
            };
            if first == last {
                return Err(format!("FIRST and LAST are both {first}: write {key}={first}"));
            }
            return Ok(Self { key, values: spaced(first, last, number) });
        }
        if let [first, last] = range[..] {
            return Err(format!(
                "`{values}` has no number of values: write {key}={first}:{last}:7 for seven values from {first} to {last}"
            ));
        }
        if range.len() > 1 {
            return Err(form.to_owned());
        }
        let one = |text: &str| Setting::parse("", &format!("{key}={text}")).map(|s| s.value);
        let values: Result<_, _> = listed(values).into_iter().map(one).collect();
        values.map(|values| Self { key: key.clone(), values }).map_err(|_| form.to_owned())
    }
}

/// The parts of `text` between commas outside brackets.
fn listed(text: &str) -> Vec<&str> {
    let mut depth = 0_i32;
    let is_border = |letter: char| {
        depth += i32::from(letter == '[') - i32::from(letter == ']');
        letter == ',' && depth <= 0
    };
    text.split(is_border).collect()
}

/// `number` values from `first` to `last`; both ends are exact.
fn spaced(first: f64, last: f64, number: usize) -> Vec<toml::Value> {
    let steps = (number - 1) as f64;
    let value = |k: usize| match k + 1 == number {
        true => last,
        false => first + (last - first) * k as f64 / steps,
    };
    (0..number).map(value).map(toml::Value::from).collect()
}

/// All combinations of the axes' values; the last axis varies fastest.
///
/// # Errors
/// A key is given twice, or there are too many combinations (exit code 64).
pub fn combinations(axes: &[SweptKey]) -> Result<Vec<Vec<toml::Value>>, Failure> {
    let mut keys = BTreeSet::new();
    if let Some(SweptKey { key, .. }) = axes.iter().find(|axis| !keys.insert(&axis.key)) {
        let reason = format!("{key} is given twice; give all its values once, as {key}=A,B,C");
        return Err(Failure::new(Exit::Usage, reason));
    }
    let count = axes.iter().try_fold(1_usize, |count, axis| count.checked_mul(axis.values.len()));
    if count.is_none_or(|count| count > MOST_COMBINATIONS) {
        let reason = format!("more than {MOST_COMBINATIONS} combinations; sweep fewer values");
        return Err(Failure::new(Exit::Usage, reason));
    }
    let mut all = vec![Vec::new()];
    for axis in axes {
        let longer = |values: &Vec<toml::Value>| {
            let with =
                |value: &toml::Value| [values.as_slice(), std::slice::from_ref(value)].concat();
            axis.values.iter().map(with).collect::<Vec<_>>()
        };
        all = all.iter().flat_map(longer).collect();
    }
    Ok(all)
}

/// A value as text in a table; numbers are rounded to nine decimals.
pub fn shown(value: &toml::Value) -> String {
    match value {
        toml::Value::String(text) => text.clone(),
        toml::Value::Float(number) => format!("{}", (number * 1e9).round() / 1e9),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_is_evenly_spaced_or_listed() {
        let lag = SweptKey::parse("plant.rate-lag-ms=30:90:3").unwrap();
        assert_eq!(lag.values, [30.0, 60.0, 90.0].map(toml::Value::from));
        let cells = SweptKey::parse("control.oqtal.cells=floor,centred").unwrap();
        assert_eq!(cells.values, ["floor", "centred"].map(toml::Value::from));
        let walls = SweptKey::parse("fence.x-m=[-3,3],[-4.0,4.0]").unwrap();
        let texts: Vec<String> = walls.values.iter().map(toml::Value::to_string).collect();
        assert_eq!(texts, ["[-3, 3]", "[-4.0, 4.0]"]);
        assert!(SweptKey::parse("lag=30:90").unwrap_err().contains("write lag=30:90:7"));
        for text in
            ["lag", "lag=1:2", "lag=1:2:1", "lag=1:2:x", "lag=a:2:3", "lag=0:inf:3", "lag=4:4:3"]
        {
            assert!(SweptKey::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn combinations_are_all_of_them_and_bounded() {
        let axis = |text| SweptKey::parse(text).unwrap();
        let all = combinations(&[axis("a=1:2:2"), axis("b=x,y,z")]).unwrap();
        assert_eq!(all.len(), 6);
        assert_eq!(all[1], [toml::Value::from(1.0), toml::Value::from("y")]);
        assert!(combinations(&[axis("a=0:1:1000"), axis("b=0:1:1000")]).is_err());
        let twice = combinations(&[axis("a=1,2"), axis("b=1"), axis("a=3")]).unwrap_err();
        assert_eq!(twice.exit, Exit::Usage);
    }
}
