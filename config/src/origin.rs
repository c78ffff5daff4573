//! Origins of the values of the configuration.

use oqtal_control::options::OptionError;

use crate::error::{BrokenRule, ConfigError};
use crate::follow::followed_by;
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

    /// As [`Origins::locate_rule`]. If no setting touches an option of the rule, the error is blamed on the first setting with which
    /// `is_kept`, told the settings up to it, no longer holds.
    pub(crate) fn locate_change(
        &self,
        broken: &BrokenRule,
        is_kept: impl Fn(&[Setting]) -> bool,
    ) -> ConfigError {
        let located = self.locate_rule(broken);
        if located.origin != BUILT_IN {
            return located;
        }
        let changes = (1..=self.settings.len()).find(|count| !is_kept(&self.settings[..*count]));
        let Some(setting) = changes.and_then(|count| self.settings.get(count - 1)) else {
            return located;
        };
        let Setting { key, value, origin } = setting;
        let reason = format!("with `{key}` = {value}: {}", located.reason);
        ConfigError { origin: origin.clone(), reason }
    }

    /// Adds the origin of the option in `error`; for an option that follows another one, the origin of the followed option.
    pub(crate) fn locate(&self, error: &OptionError) -> ConfigError {
        self.locate_rule(&BrokenRule { error: error.clone(), others: &[] })
    }

    /// Adds the origin to a broken rule: that of the last-set option in the rule.
    pub(crate) fn locate_rule(&self, broken: &BrokenRule) -> ConfigError {
        let BrokenRule { error, others } = broken;
        let followed = followed_by(&error.key);
        let last = |concerned: &dyn Fn(&str) -> bool| {
            self.settings.iter().rev().find(|set| concerned(&set.key))
        };
        let found = last(&|set| are_nested(set, &error.key) || others.contains(&set))
            .or_else(|| last(&|set| followed.as_deref().is_some_and(|key| are_nested(set, key))));
        let (set, origin) =
            found.map_or(("", BUILT_IN), |setting| (setting.key.as_str(), setting.origin.as_str()));
        let reason = match (&followed, found) {
            (Some(key), _) if key == set => format!("{error} (it follows `{key}`)"),
            (_, Some(other)) if !are_nested(set, &error.key) => {
                format!("with `{set}` = {}: {error}", other.value)
            }
            _ => error.to_string(),
        };
        ConfigError { origin: origin.to_owned(), reason }
    }
}

/// Whether the keys are equal, or one is a section that contains the other.
fn are_nested(a: &str, b: &str) -> bool {
    let is_within = |key: &str, section: &str| {
        key.strip_prefix(section).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    is_within(a, b) || is_within(b, a)
}
