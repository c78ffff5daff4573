//! Origins of the values of the configuration.

use std::path::PathBuf;

use oqtal_control::options::OptionError;

use crate::error::ConfigError;
use crate::follow::followed_by;
use crate::preset::PRESET;
use crate::setting::Setting;

/// Origin of a value that no setting changed.
const BUILT_IN: &str = "built-in";

/// Settings of a configuration, later ones last.
#[derive(Clone, Debug, Default)]
pub(crate) struct Origins {
    settings: Vec<Setting>,
    /// A warning for each setting whose key is one of an earlier version.
    pub(crate) rename_warnings: Vec<String>,
}

/// Configurations are compared by values only, so all origins are equal.
impl PartialEq for Origins {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Origins {
    /// Records `setting`.
    pub(crate) fn record(&mut self, setting: &Setting) {
        self.settings.push(setting.clone());
    }

    /// Whether a setting touches `key`.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.settings.iter().any(|setting| are_nested(&setting.key, key))
    }

    /// The file of each setting that is from a file; files may repeat.
    pub(crate) fn files(&self) -> impl Iterator<Item = &str> {
        self.settings.iter().filter_map(Setting::file)
    }

    /// The settings that are from none of `files` nor from a preset, and those of the instance.
    pub(crate) fn apart_from(&self, files: &[PathBuf]) -> Vec<Setting> {
        let is_read = |file: &str| {
            file.starts_with(PRESET) || files.iter().any(|path| path.display().to_string() == file)
        };
        let is_apart =
            |setting: &&Setting| setting.is_of_instance() || !setting.file().is_some_and(is_read);
        self.settings.iter().filter(is_apart).cloned().collect()
    }

    /// Adds to `error` the origin of the setting that broke the rule: the first one after the longest prefix of the settings for
    /// which `is_kept` holds or, if its key is set again later, the last setting of that key. Without one, as
    /// [`Origins::locate`].
    pub(crate) fn locate_change(
        &self,
        error: &OptionError,
        is_kept: impl Fn(&[Setting]) -> bool,
    ) -> ConfigError {
        let settings = &self.settings;
        let last_kept = (0..settings.len()).rev().find(|count| is_kept(&settings[..*count]));
        let located = self.locate(error);
        let Some(first) = last_kept.map(|count| &settings[count]) else { return located };
        let blamed = blame(error, settings.iter().rfind(|setting| setting.key == first.key));
        // Of two settings that contradict each other both are named: a preset counts as set before the files.
        match are_nested(&first.key, &error.key) || located.origin == BUILT_IN {
            true => blamed,
            false => {
                let both = format!("{}; `{}` is of {}", blamed.reason, error.key, located.origin);
                ConfigError { reason: both, ..blamed }
            }
        }
    }

    /// Adds the origin of the option in `error`; for an option that follows another one, the origin of the followed option.
    pub(crate) fn locate(&self, error: &OptionError) -> ConfigError {
        let last = |key: &str| self.settings.iter().rev().find(|set| are_nested(&set.key, key));
        let followed = followed_by(&error.key);
        blame(error, last(&error.key).or_else(|| followed.as_deref().and_then(last)))
    }
}

/// The error with its origin, the setting that caused it; `None` for a built-in value.
fn blame(error: &OptionError, setting: Option<&Setting>) -> ConfigError {
    let Some(Setting { key, value, origin }) = setting else {
        return ConfigError { origin: BUILT_IN.to_owned(), reason: error.to_string() };
    };
    let reason = match followed_by(&error.key) {
        Some(followed) if followed == *key => format!("{error} (it follows `{key}`)"),
        _ if are_nested(key, &error.key) => error.to_string(),
        _ => format!("with `{key}` = {value}: {error}"),
    };
    ConfigError { origin: origin.clone(), reason }
}

/// `settings` in groups, in order, in none of which one setting changes the value of another.
pub(crate) fn of_different_keys(settings: &[Setting]) -> impl Iterator<Item = &[Setting]> {
    let mut rest = settings;
    std::iter::from_fn(move || {
        let is_repeated = |count: &usize| {
            rest[..*count].iter().any(|other| are_nested(&other.key, &rest[*count].key))
        };
        let count = (1..rest.len()).find(is_repeated).unwrap_or(rest.len());
        let (group, later) = rest.split_at(count);
        rest = later;
        (!group.is_empty()).then_some(group)
    })
}

/// Whether the keys are equal, or one is a section that contains the other.
pub(crate) fn are_nested(a: &str, b: &str) -> bool {
    let is_within = |key: &str, section: &str| {
        key.strip_prefix(section).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    is_within(a, b) || is_within(b, a)
}
