//! The tuned gains that come with the program: output of `oqtal tune`, one file for each law, found by its name.

use oqtal_config::Setting;
use toml::{Table, Value};

/// Name and text of every file in `deploy/tuned`.
const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/tuned.rs"));

/// The settings in `deploy/tuned/WHAT.toml`, for a law or for the outer loops; none if there is no such file.
///
/// # Panics
/// If the file is not TOML: a test holds that every file is.
#[must_use]
pub fn tuned(what: &str) -> Vec<Setting> {
    let Some((name, text)) = FILES.iter().find(|(name, _)| *name == what) else {
        return Vec::new();
    };
    let table: Table = text.parse().expect("the files of deploy/tuned are TOML");
    let mut settings = Vec::new();
    collect(name, "", &table, &mut settings);
    settings
}

fn collect(file: &str, prefix: &str, table: &Table, settings: &mut Vec<Setting>) {
    for (name, value) in table {
        let key = format!("{prefix}{name}");
        match value {
            Value::Table(inner) => collect(file, &format!("{key}."), inner, settings),
            value => {
                let origin = format!("deploy/tuned/{file}.toml");
                settings.push(Setting { key, value: value.clone(), origin });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tune::space::{LAWS, NAMES};

    #[test]
    fn every_file_is_that_of_a_law_or_of_the_outer_loops() {
        for (name, _) in FILES {
            assert!(NAMES.contains(name), "deploy/tuned/{name}.toml");
            assert!(!tuned(name).is_empty(), "deploy/tuned/{name}.toml");
        }
        for name in LAWS.iter().map(|law| law.controller).chain(["outer"]) {
            assert!(FILES.iter().any(|(file, _)| *file == name), "no deploy/tuned/{name}.toml");
        }
    }

    #[test]
    fn every_law_has_gains_for_all_that_is_tuned() {
        for law in LAWS {
            let settings = tuned(law.controller);
            for parameter in law.parameters() {
                let found = settings.iter().find(|setting| setting.key == parameter.key);
                let value = found.and_then(|setting| setting.value.as_float());
                let Some(value) = value else { panic!("{}: no {}", law.controller, parameter.key) };
                // Written with four digits: the bounds themselves may be rounded.
                let slack = 1e-3 * parameter.high;
                assert!(value >= parameter.low - slack && value <= parameter.high + slack);
            }
        }
    }
}
