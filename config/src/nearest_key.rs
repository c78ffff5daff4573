//! The key that an unknown key was probably meant to be.

use toml::{Table, Value};

use crate::follow::value_at;
use crate::setting::Setting;

/// Least similarity of a suggested key \[-\], from 0 to 1.
const SIMILAR: f64 = 0.7;

/// `reason` for which `setting` was refused; for an unknown key, with the key of the file `shipped` that was probably meant.
pub(crate) fn with_nearest_key(setting: &Setting, reason: String, shipped: &str) -> String {
    let is_variable = setting.origin.starts_with("OQTAL_");
    if let Some(inner) = first_of_section(&setting.key, shipped) {
        let key = format!("{}.{inner}", setting.key);
        let key = if is_variable { variable(&key) } else { key };
        return format!("a section; set its keys one by one, as `{key}`");
    }
    if !reason.starts_with("unknown key") {
        return reason;
    }
    match nearest(&setting.key, shipped) {
        Some(known) if is_variable => {
            format!("unknown key; did you mean the variable {}?", variable(&known))
        }
        Some(known) => format!("unknown key; did you mean `{known}`?"),
        None => reason,
    }
}

/// The first key of the section `path` of the file `shipped`; `None` if that is not a section.
fn first_of_section(path: &str, shipped: &str) -> Option<String> {
    let table: Table = shipped.parse().ok()?;
    let section = value_at(&table, path)?.as_table()?;
    section.iter().find(|(_, value)| !value.is_table()).map(|(name, _)| name.clone())
}

/// The variable of the environment that sets the key `key`.
fn variable(key: &str) -> String {
    format!("OQTAL_{}", key.to_ascii_uppercase().replace('.', "__").replace('-', "_"))
}

/// The key of the file `shipped` that is most like `key`.
fn nearest(key: &str, shipped: &str) -> Option<String> {
    let plain = |key: &str| key.replace(['.', '_'], "-").to_ascii_lowercase();
    let wanted = plain(key);
    let likeness = |known: &String| {
        // Some of the parts between dots are missing, as in `trajectory.radius-m`.
        if has_words(known, key) {
            return 1.0;
        }
        let known = plain(known);
        // The unit or the section is missing.
        let is_part = known.strip_prefix(&wanted).is_some_and(|rest| rest.starts_with('-'))
            || known.strip_suffix(&wanted).is_some_and(|rest| rest.ends_with('-'));
        if is_part { 1.0 } else { strsim::normalized_damerau_levenshtein(&known, &wanted) }
    };
    let table: Table = shipped.parse().ok()?;
    let mut keys = Vec::new();
    collect(&table, "", &mut keys);
    let rated = keys.into_iter().map(|key| (likeness(&key), key));
    // Among equally similar keys, [vehicle] before [plant], then the shortest.
    let order = |key: &str| (!key.starts_with("vehicle."), key.starts_with("plant."), key.len());
    let best = rated.max_by(|a, b| a.0.total_cmp(&b.0).then(order(&b.1).cmp(&order(&a.1))))?;
    (best.0 >= SIMILAR).then_some(best.1)
}

/// Whether the parts of the dotted key `wanted` are among those of `known`, in this order.
fn has_words(known: &str, wanted: &str) -> bool {
    let mut parts = known.split('.');
    wanted.split('.').all(|word| parts.any(|part| part == word))
}

/// Collects the dotted keys of `table`, which is the section `path`.
fn collect(table: &Table, path: &str, keys: &mut Vec<String>) {
    for (name, value) in table {
        let key = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        match value {
            Value::Table(inner) => collect(inner, &key, keys),
            _ => keys.push(key),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHIPPED: &str = "[mocap]\npreset = ''\n[vehicle]\npreset = ''\nmass-kg = 0.5\nmax-thrust-n = 9.8\n[control]\ncontroller = 'pid'\n\
                           [trajectory]\nheight-m = 1.0\n[trajectory.circle]\nradius-m = 1.0\n\
                           [control.oqtal]\nattitude-weight = 1\n[control.oqtal-dt]\nattitude-weight = 1\n";

    #[test]
    fn a_key_that_is_almost_right_is_suggested() {
        for (written, meant) in [
            ("vehicle.mass", "vehicle.mass-kg"),
            ("vehicle-mass-kg", "vehicle.mass-kg"),
            ("vehicle.mas-kg", "vehicle.mass-kg"),
            ("mass-kg", "vehicle.mass-kg"),
            ("preset", "vehicle.preset"),
            ("control.oqtal-dt.atitude-weight", "control.oqtal-dt.attitude-weight"),
            ("vehicle.max_thrust_n", "vehicle.max-thrust-n"),
            ("control.controler", "control.controller"),
            ("trajectory.radius-m", "trajectory.circle.radius-m"),
        ] {
            assert_eq!(nearest(written, SHIPPED).as_deref(), Some(meant), "{written}");
        }
        assert_eq!(nearest("zebra.stripes", SHIPPED), None);
    }

    #[test]
    fn a_variable_is_suggested_for_a_variable() {
        let told = |key: &str, origin: &str, reason: &str| {
            with_nearest_key(&Setting::flag(origin, key, 1.0), reason.to_owned(), SHIPPED)
        };
        let text = told("vehicle-mass-kg", "OQTAL_VEHICLE_MASS_KG", "unknown key `x`");
        assert!(text.ends_with("the variable OQTAL_VEHICLE__MASS_KG?"), "{text}");
        let text = told("mocap", "OQTAL_MOCAP", "not a table");
        assert!(text.contains("as `OQTAL_MOCAP__"), "{text}");
        assert_eq!(told("vehicle.mass-kg", "--set", "not a number"), "not a number");
    }
}
