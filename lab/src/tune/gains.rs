//! The gains that come with the program: output of `oqtal tune`, one file for each law.

use oqtal_config::Setting;
use toml::{Table, Value};

/// The files of `deploy/tuned`.
const FILES: [(&str, &str); 6] = [
    ("pid", include_str!("../../../deploy/tuned/pid.toml")),
    ("lqr", include_str!("../../../deploy/tuned/lqr.toml")),
    ("oqtal", include_str!("../../../deploy/tuned/oqtal.toml")),
    ("geometric", include_str!("../../../deploy/tuned/geometric.toml")),
    ("oqtal-dt", include_str!("../../../deploy/tuned/oqtal-dt.toml")),
    ("outer", include_str!("../../../deploy/tuned/outer.toml")),
];

/// The tuned settings of a law, or of the outer loops.
///
/// # Panics
/// If there are none: a test holds that every law has its file.
#[must_use]
pub fn tuned(what: &str) -> Vec<Setting> {
    let (name, text) =
        FILES.iter().find(|(name, _)| *name == what).expect("every law has its file");
    let table: Table = text.parse().expect("written by us");
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
    use crate::tune::space::LAWS;

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
