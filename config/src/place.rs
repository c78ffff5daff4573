//! The instance in a configuration that may have errors: a command that ends a flight must reach the instance even with a missing
//! or half-edited file.

use std::ffi::OsString;
use std::path::PathBuf;

use toml::Table;

use crate::config::{DEFAULTS, plain};
use crate::error::ConfigError;
use crate::instance::InstanceOptions;
use crate::layer;
use crate::setting::Setting;

/// Section of the instance.
const SECTION: &str = "instance";

impl InstanceOptions {
    /// The instance according to `files`, the environment and `flags`, as far as they are readable. Settings of other
    /// sections are ignored. Unusable settings are left out and returned as errors.
    pub fn salvage(files: &[PathBuf], flags: &[Setting]) -> (Self, Vec<ConfigError>) {
        Self::salvage_under(files, std::env::vars_os(), flags)
    }

    fn salvage_under(
        files: &[PathBuf],
        variables: impl Iterator<Item = (OsString, OsString)>,
        flags: &[Setting],
    ) -> (Self, Vec<ConfigError>) {
        let (mut settings, mut errors) = (Vec::new(), Vec::new());
        for file in files {
            let (readable, wrong) = layer::salvage(file, SECTION);
            settings.extend(readable);
            errors.extend(wrong);
        }
        settings.extend(layer::from_environment(variables));
        settings.extend_from_slice(flags);
        let mut table: Table =
            DEFAULTS.parse().expect("the shipped configuration is TOML: a test holds it");
        let mut salvaged = instance(&table).expect("the shipped configuration is valid");
        for setting in settings.iter().filter(|setting| is_of_instance(&setting.key)) {
            let mut changed = table.clone();
            let inserted = setting.insert_into(&mut changed);
            match inserted.and_then(|()| instance(&changed).map_err(|e| setting.refused(&e))) {
                Ok(instance) => (salvaged, table) = (instance, changed),
                Err(error) => errors.push(error),
            }
        }
        (salvaged, errors)
    }
}

fn is_of_instance(key: &str) -> bool {
    key.strip_prefix(SECTION).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// The section of the instance; the reason if it is invalid.
fn instance(table: &Table) -> Result<InstanceOptions, String> {
    let section = table.get(SECTION).cloned().ok_or("missing")?;
    section.try_into().map_err(|error: toml::de::Error| plain(error.message()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn salvage(text: Option<&str>, flags: &[&str]) -> (String, String, usize) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("lab.toml");
        text.iter().for_each(|text| std::fs::write(&path, text).unwrap());
        let flags: Vec<_> =
            flags.iter().map(|text| Setting::parse("--set", text).unwrap()).collect();
        let foreign = [("OQTAL_FOO", "1"), ("OQTAL_VEHICLE__MASS_KG", "banana")];
        let variables = foreign.map(|(name, value)| (name.into(), value.into())).into_iter();
        let (instance, errors) = InstanceOptions::salvage_under(&[path], variables, &flags);
        (instance.name, instance.root, errors.len())
    }

    #[test]
    fn the_instance_of_a_half_edited_file_is_found() {
        let text = "[instance]\nname = \"lab\"\n[vehicle]\nmass-kg = \n[safety\nroot = 7";
        let (name, root, errors) = salvage(Some(text), &["instance.root=/run/lab"]);
        assert_eq!((name.as_str(), root.as_str()), ("lab", "/run/lab"));
        assert!(errors > 0);
    }

    #[test]
    fn a_file_that_is_missing_leaves_the_flags_and_bad_values_are_left_out() {
        let flags = ["vehicle.mass-kg=9", "instance.name=lab", "instance.root=3", "instance.x=1"];
        assert_eq!(salvage(None, &flags), ("lab".to_owned(), String::new(), 3));
        assert_eq!(salvage(Some("instance = \"lab\""), &[]).0, "default");
    }
}
