//! Values that default to those of another section: the simulated vehicle equals the controller's model except for the keys set
//! in `[plant]`.
//!
//! In the configuration such a key has the name of the other section as its value: `mass-kg = "vehicle"` in `[plant]`. When a
//! configuration is loaded, the word is replaced by the other section's value.

use toml::{Table, Value};

/// The keys of `[plant]` that follow the key of the same name in `[vehicle]`.
const AIRFRAME: [&str; 12] = [
    "interface",
    "mass-kg",
    "gravity-m-s2",
    "inertia-kg-m2",
    "max-thrust-n",
    "rate-authority-rad-s",
    "max-torque-nm",
    "rate-lag-ms",
    "attitude-gain-per-s",
    "thrust-lag-ms",
    "command-delay-ms",
    "drag-per-s",
];

/// Further keys that may follow another: (key, key followed).
const OTHERS: [(&str, &str); 9] = [
    ("control.predictive.filter.attitude-noise-deg", "mocap.attitude-noise-deg"),
    ("control.predictive.filter.position-noise-mm", "mocap.position-noise-mm"),
    ("plant.frame-rate-hz", "mocap.rate-hz"),
    ("plant.wire.xbee-address", "bridge.xbee-address"),
    ("plant.wire.asctec", "bridge.asctec"),
    ("plant.wire.crtp.thrust-curve-n", "bridge.crtp.thrust-curve-n"),
    ("plant.wire.mavlink.thrust-table", "bridge.mavlink.thrust-table"),
    ("plant.wire.msp.thrust-table", "bridge.msp.thrust-table"),
    ("safety.pose-rate-hz", "mocap.rate-hz"),
];

/// Values of the filter's noise for cameras without noise, with which a filter cannot work: (key, value).
const WITHOUT_NOISE: [(&str, f64); 2] = [
    ("control.predictive.filter.attitude-noise-deg", 0.2),
    ("control.predictive.filter.position-noise-mm", 0.5),
];

/// The key that `key` may follow; `None` if it cannot follow one. A key in a table that follows another table follows the key
/// with the same name there.
pub(crate) fn followed_by(key: &str) -> Option<String> {
    if let Some(name) = key.strip_prefix("plant.").filter(|name| AIRFRAME.contains(name)) {
        return Some(format!("vehicle.{name}"));
    }
    OTHERS.iter().find_map(|(follower, source)| {
        let rest = key.strip_prefix(follower)?;
        (rest.is_empty() || rest.starts_with('.')).then(|| format!("{source}{rest}"))
    })
}

/// Word with which `key` follows another: the first part of the followed key.
pub(crate) fn follow_word(key: &str) -> Option<String> {
    followed_by(key).and_then(|source| source.split('.').next().map(str::to_owned))
}

/// Keys of `[plant]` that follow the vehicle's.
pub(crate) fn airframe() -> impl Iterator<Item = String> {
    AIRFRAME.iter().map(|name| format!("plant.{name}"))
}

/// Replaces every word in `table` that names a section to follow by the followed value, and completes partly given tables.
pub(crate) fn resolve(table: &mut Table) {
    let others = OTHERS.map(|(key, _)| key.to_owned());
    for key in &Vec::from_iter(airframe().chain(others)) {
        let Some(value) = followed_by(key).and_then(|source| value_at(table, &source)).cloned()
        else {
            continue;
        };
        let word = follow_word(key);
        match (value_at_mut(table, key), value) {
            (Some(Value::Table(own)), Value::Table(followed)) => complete(own, &followed),
            (Some(own), value) if own.as_str() == word.as_deref() => {
                let is_zero = value.as_float() == Some(0.0) || value.as_integer() == Some(0);
                let least = WITHOUT_NOISE.iter().find(|(filter, _)| is_zero && filter == key);
                *own = least.map_or(value, |(_, noise)| (*noise).into());
            }
            _ => {}
        }
    }
}

/// Adds the entries of `followed` that `own` lacks.
fn complete(own: &mut Table, followed: &Table) {
    for (name, value) in followed {
        match (own.get_mut(name), value) {
            (None, value) => drop(own.insert(name.clone(), value.clone())),
            (Some(Value::Table(own)), Value::Table(followed)) => complete(own, followed),
            (Some(_), _) => {}
        }
    }
}

/// The value, or the section, of the dotted key `key`.
pub(crate) fn value_at<'a>(table: &'a Table, key: &str) -> Option<&'a Value> {
    let mut names = key.split('.');
    let first = table.get(names.next()?)?;
    names.try_fold(first, |value, name| value.get(name))
}

fn value_at_mut<'a>(table: &'a mut Table, key: &str) -> Option<&'a mut Value> {
    let (section, name) = key.rsplit_once('.')?;
    let section = section.split('.').try_fold(table, |t, name| t.get_mut(name)?.as_table_mut())?;
    section.get_mut(name)
}
