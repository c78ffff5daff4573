//! The laws of a study, with their gains.

use oqtal_config::{Config, Setting};
use oqtal_control::controller::ControllerName;
use oqtal_runtime::process::Failure;

use super::args;
use crate::sheet::Variant;

/// Registered laws in table order, `oqtal-dt` last.
pub fn registered() -> impl Iterator<Item = ControllerName> {
    let others = ControllerName::ALL.into_iter().filter(|law| *law != ControllerName::OqtalDt);
    others.chain([ControllerName::OqtalDt])
}

/// Configuration names of the laws, in table order.
pub fn names() -> impl Iterator<Item = &'static str> {
    registered().map(ControllerName::name)
}

/// Law with this name in the configuration.
pub fn of_name(name: &str) -> Option<ControllerName> {
    registered().find(|law| law.name() == name)
}

/// Origin of the defaults of a study, which gains of a law replace.
pub const STUDY_DEFAULT: &str = "robustness";

/// A law with its gains.
#[derive(Clone, Debug)]
pub struct StudyLaw {
    /// Name in tables.
    pub name: String,
    /// Name of the law in the configuration.
    pub controller: &'static str,
    /// Settings that differ from the shipped configuration: the study's first, then the gains of the law.
    pub settings: Vec<Setting>,
    /// Remark on the gains.
    pub remark: String,
    /// Origin of the gains.
    pub variant: Variant,
}

impl StudyLaw {
    /// The law `controller` under these settings.
    pub fn new(
        controller: &'static str,
        settings: Vec<Setting>,
        remark: impl Into<String>,
    ) -> Self {
        let (name, remark) = (controller.to_owned(), remark.into());
        Self { name, controller, settings, remark, variant: Variant::Ours }
    }

    /// The law with further settings.
    pub fn with(&self, settings: &[Setting]) -> Self {
        Self { settings: [&self.settings[..], settings].concat(), ..self.clone() }
    }

    /// Settings of the law under `others`, in order of precedence. A default of the study gives way to the gains of the law.
    pub fn settings_under(&self, others: &[Setting]) -> Vec<Setting> {
        let is_default = |it: &Setting| it.origin == STUDY_DEFAULT;
        let has_own = |key: &str| self.settings.iter().any(|it| it.key == key && !is_default(it));
        let others = others.iter().filter(|it| !is_default(it) || !has_own(&it.key));
        self.settings.iter().chain(others).cloned().collect()
    }

    /// Setting that selects the law.
    pub fn setting(&self) -> Setting {
        Setting::flag("--controllers", "control.controller", self.controller)
    }

    /// Configuration with which the law flies.
    ///
    /// # Errors
    /// A setting is invalid.
    pub fn config(&self) -> Result<Config, Failure> {
        Ok(Config::from_settings(&[&self.settings[..], &[self.setting()]].concat())?)
    }

    /// Whether the law flies with the estimation and prediction of `oqtal-dt`; `false` if a setting is invalid.
    pub fn is_predictive(&self) -> bool {
        self.config().is_ok_and(|config| config.control.is_predictive())
    }
}

/// Laws among `asked`, in table order.
pub fn named(asked: &[String]) -> impl Iterator<Item = &'static str> {
    names().filter(|law| asked.iter().any(|name| name == law))
}

/// Warnings before flights of `laws`, each once; one that does not apply to all laws begins with the names of those to which it
/// applies. A law with invalid settings has none: its flights report the error.
pub fn warnings(laws: &[StudyLaw]) -> Vec<String> {
    let mut all: Vec<(String, Vec<&str>)> = Vec::new();
    for law in laws {
        for warning in law.config().map_or_else(|_| Vec::new(), |config| args::warnings(&config)) {
            match all.iter_mut().find(|(text, _)| *text == warning) {
                Some((_, concerned)) => concerned.push(&law.name),
                None => all.push((warning, vec![&law.name])),
            }
        }
    }
    let text = |(warning, concerned): (String, Vec<&str>)| match concerned.len() == laws.len() {
        true => warning,
        false => format!("{}: {warning}", concerned.join(", ")),
    };
    all.into_iter().map(text).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_warning_names_the_laws_that_it_concerns() {
        let settings = [("vehicle.mass-kg", 0.5), ("trajectory.take-off-s", 1.0)]
            .map(|(key, value)| Setting::flag("test", key, value));
        let law = |name| StudyLaw::new(name, settings.to_vec(), "");
        let two = warnings(&[law("pid"), law("oqtal-dt")]);
        assert!(
            two.iter().all(|it| it.starts_with("pid: the take-off")) && two.len() == 1,
            "{two:?}"
        );
        assert!(warnings(&[law("pid")])[0].starts_with("the take-off"));
        assert!(warnings(&[law("oqtal-dt")]).is_empty());
    }
}
