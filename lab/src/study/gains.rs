//! Gains of the laws of a study: as configured, as shipped in tuned files, or from a directory.

use std::fmt;
use std::path::{Path, PathBuf};
use std::slice;
use std::str::FromStr;

use oqtal_bus::paths::quoted;
use oqtal_config::{Config, Setting};
use oqtal_runtime::process::{Exit, Failure};
use toml::{Table, Value};

use super::args::say_notes;
use super::flights::{table, value_at};
use super::law::{self, StudyLaw, named};

/// Name and text of every file in `deploy/tuned` and its folders, output of `oqtal tune`; the names of the latter begin with that
/// of the folder.
const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/tuned.rs"));

/// Settings in `deploy/tuned/NAME.toml`, for a law or for the outer loops; empty without such a file.
///
/// # Panics
/// The file is not valid TOML; a test parses every file.
pub fn tuned(name: &str) -> Vec<Setting> {
    let Some((name, text)) = FILES.iter().find(|(file, _)| *file == name) else {
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
                // Not the name of a file: the text is in the program, and a command that repeats a flight names the keys.
                let origin = format!("gains of deploy/tuned/{file}");
                settings.push(Setting { key, value: value.clone(), origin });
            }
        }
    }
}

/// Source of the gains of laws.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum GainSource {
    /// The configuration, as for `oqtal fly`.
    #[default]
    Configured,
    /// `deploy/tuned`: gains of all laws, tuned alike for the shipped vehicle.
    Tuned,
    /// A folder of `deploy/tuned`: gains of some laws.
    Set(&'static str),
    /// `DIR/LAW.toml`, as written by `oqtal tune --out DIR`.
    Directory(PathBuf),
}

/// Names of the folders of `deploy/tuned`, one for each file.
fn sets() -> impl Iterator<Item = &'static str> {
    FILES.iter().filter_map(|(name, _)| Some(name.split_once('/')?.0))
}

impl FromStr for GainSource {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "configured" => Self::Configured,
            "tuned" => Self::Tuned,
            name => match sets().find(|set| *set == name) {
                Some(set) => Self::Set(set),
                None => Self::Directory(name.into()),
            },
        })
    }
}

impl fmt::Display for GainSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Configured => f.write_str("configured"),
            Self::Tuned => f.write_str("tuned"),
            Self::Set(set) => f.write_str(set),
            Self::Directory(directory) => directory.display().fmt(f),
        }
    }
}

impl GainSource {
    /// Whether the source has gains for the law `controller`; a set or a directory may lack them.
    pub fn has(&self, controller: &str) -> bool {
        match self {
            Self::Configured | Self::Tuned => true,
            Self::Set(set) => !tuned(&format!("{set}/{controller}")).is_empty(),
            Self::Directory(directory) => directory.join(format!("{controller}.toml")).is_file(),
        }
    }

    /// Sentence on laws of which the source has no gains, with the command that finds them. A set of the program cannot get
    /// more of them: a directory of its name is another source.
    pub fn lacks(&self, laws: &[&str]) -> String {
        let (of, directory, give) = match self {
            Self::Directory(directory) => ("", quoted(&directory.display().to_string()), ""),
            _ => ("deploy/tuned/", "gains".to_owned(), ", and give --gains gains"),
        };
        format!(
            "{of}{self} has no gains of {}; find them with `oqtal tune {} --out {directory}`, with the configuration of this command{give}",
            laws.join(", "),
            laws.join(" ")
        )
    }

    /// Note that the gains were found for the shipped vehicle, if `config` has another one.
    pub fn note(&self, config: &Config) -> Option<String> {
        let is_shipped_set = matches!(self, Self::Tuned | Self::Set(_));
        (is_shipped_set && config.vehicle != Config::default().vehicle).then(|| {
            format!(
                "the gains {self} were found for the shipped vehicle, not for this one; find its own with `oqtal tune all --out gains`, with the configuration of this command, and give --gains gains"
            )
        })
    }

    /// The law `controller` with its gains, under the settings `common` of a study.
    ///
    /// # Errors
    /// The directory has no file for the law, or one that is invalid or of another study (exit code 78).
    pub fn law(&self, controller: &'static str, common: &[Setting]) -> Result<StudyLaw, Failure> {
        let (own, remark) = match self {
            Self::Configured => (Vec::new(), "configured gains".to_owned()),
            Self::Tuned => match tuned(controller) {
                none if none.is_empty() => (none, "configured gains, not tuned".to_owned()),
                tuned => (tuned, "tuned alike, deploy/tuned".to_owned()),
            },
            Self::Set(set) => {
                let own = tuned(&format!("{set}/{controller}"));
                if own.is_empty() {
                    return Err(Failure::new(Exit::Usage, self.lacks(&[controller])));
                }
                (own, format!("gains of deploy/tuned/{set}"))
            }
            Self::Directory(directory) => {
                let own = of_directory(directory, controller)?;
                check_study(&own, &Config::from_settings(common)?, (directory, controller))?;
                (own, format!("gains of {}", directory.display()))
            }
        };
        Ok(StudyLaw::new(controller, [common, &own].concat(), remark))
    }
}

/// The gains of the law `controller` in `directory`.
fn of_directory(directory: &Path, controller: &str) -> Result<Vec<Setting>, Failure> {
    if directory.is_file() {
        let reason = format!(
            "{0} is a file, and --gains takes a directory with a file for each law; give the file by --config {0}",
            directory.display()
        );
        return Err(Failure::new(Exit::Usage, reason));
    }
    let file = directory.join(format!("{controller}.toml"));
    let remedy = |reason: &str, force: &str| {
        let command = format!("oqtal tune {controller} --out {}{force}", directory.display());
        let text = format!(
            "{reason}; make it with `{command}` and the --config and --set of this command"
        );
        Failure::new(Exit::Config, text)
    };
    let settings = Config::file_settings(slice::from_ref(&file))
        .map_err(|error| remedy(&error.to_string(), ""))?;
    if settings.is_empty() {
        let reason = format!("{}: no gains, the file has no keys", file.display());
        return Err(remedy(&reason, " --force"));
    }
    let is_other =
        |it: &&Setting| it.key == "control.controller" && it.value.as_str() != Some(controller);
    match settings.iter().find(is_other) {
        Some(other) => {
            let reason =
                format!("{}: gains of {}, not of {controller}", file.display(), other.value);
            Err(remedy(&reason, " --force"))
        }
        None => Ok(settings),
    }
}

/// Refuses `gains` from a file of `directory` with a setting that is not one of the law, such as the rate of the controller, and
/// differs from that of the study: the flights would not be those of the configuration that is written beside their results.
fn check_study(
    gains: &[Setting],
    study: &Config,
    (directory, controller): (&Path, &str),
) -> Result<(), Failure> {
    let study = table(study);
    let is_of_law = |key: &str| {
        key != "control.rate-hz" && ["control.", "position."].iter().any(|it| key.starts_with(it))
    };
    let others = gains.iter().filter(|gain| !is_of_law(&gain.key));
    let mut others = others.filter_map(|gain| Some((gain, value_at(&study, &gain.key)?)));
    let Some((gain, of_study)) = others.find(|(gain, of_study)| !is_same(&gain.value, of_study))
    else {
        return Ok(());
    };
    let Setting { key, value, .. } = gain;
    let out = quoted(&directory.display().to_string());
    Err(Failure::new(
        Exit::Config,
        format!(
            "{}: these gains were found with {key} = {value}, and this command has {of_study}: tune again with the --config and --set of this command (`oqtal tune {controller} --out {out} --force`), fly with those for which they were found (--set {key}={value}), or remove the line from the file",
            directory.join(format!("{controller}.toml")).display()
        ),
    ))
}

/// Whether two values of a key are equal, also as an integer and as a floating-point number.
fn is_same(a: &Value, b: &Value) -> bool {
    let number = |value: &Value| value.as_float().or(value.as_integer().map(|it| it as f64));
    a == b || number(a).is_some() && number(a) == number(b)
}

/// The laws with these names, each with its gains from `source` under the settings `common`.
///
/// # Errors
/// A directory of gains has no file for a law, or an invalid one (exit code 78).
pub fn chosen(
    names: &[String],
    source: &GainSource,
    common: &[Setting],
) -> Result<Vec<StudyLaw>, Failure> {
    say_notes(source.note(&Config::from_settings(common)?));
    let laws = named(names).map(|controller| source.law(controller, common));
    let laws = laws.collect::<Result<Vec<_>, _>>()?;
    say_notes(replaced(&laws, common));
    say_notes(law::warnings(&laws));
    Ok(laws)
}

/// Note on the settings of a study that the gains of `laws` replace.
pub fn replaced(laws: &[StudyLaw], common: &[Setting]) -> Option<String> {
    // A study sets the law itself.
    let gains = laws.iter().flat_map(|law| &law.settings[common.len()..]);
    let gains = gains.filter(|gain| gain.key != "control.controller");
    let mut keys: Vec<&str> = Vec::new();
    for gain in gains {
        let mut given = common
            .iter()
            .filter(|setting| setting.key == gain.key && setting.origin != law::STUDY_DEFAULT);
        if given.any(|setting| !is_same(&setting.value, &gain.value)) && !keys.contains(&&*gain.key)
        {
            keys.push(&gain.key);
        }
    }
    (!keys.is_empty()).then(|| {
        format!(
            "--gains overrides your settings of {} (the configuration written beside the results still lists yours); to fly your value, remove the key from the files of gains, or use --gains configured",
            keys.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::args::words_of;

    #[test]
    fn a_file_without_gains_is_refused_with_the_remedy() {
        let directory = tempfile::tempdir().unwrap();
        std::fs::write(directory.path().join("pid.toml"), "# no keys\n").unwrap();
        let failure = GainSource::Directory(directory.path().into()).law("pid", &[]).unwrap_err();
        assert_eq!(failure.exit, Exit::Config);
        for part in ["pid.toml: no gains", "`oqtal tune pid --out", "--force`"] {
            assert!(failure.message.contains(part), "{part}: {failure}");
        }
    }

    #[test]
    fn gains_of_another_rate_are_refused_and_gains_of_the_law_are_flown() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("pid.toml");
        std::fs::write(&file, "control.rate-hz = 100\ncontrol.pid.gain = 3.0\n").unwrap();
        let law = |rate_hz: f64| {
            let common = ["control", "mocap"].map(|of| format!("{of}.rate-hz"));
            let common = common.map(|key| Setting::flag("--set", &key, rate_hz));
            GainSource::Directory(directory.path().into()).law("pid", &common)
        };
        let refused = law(50.0).unwrap_err();
        for part in ["found with control.rate-hz = 100, and this command has 50.0", "--force"] {
            assert!(refused.message.contains(part), "{part}: {refused}");
        }
        assert_eq!(refused.exit, Exit::Config);
        assert_eq!(law(100.0).unwrap().config().unwrap().control.pid.gain, 3.0);
    }

    #[test]
    fn the_remedy_for_gains_that_a_set_of_the_program_lacks_names_another_source() {
        let failure = GainSource::Set("shipped").law("pid", &[]).unwrap_err().to_string();
        let told =
            "deploy/tuned/shipped has no gains of pid; find them with `oqtal tune pid --out gains`";
        assert!(failure.contains(told) && failure.ends_with("give --gains gains"), "{failure}");
    }

    #[test]
    fn the_gains_of_the_program_are_written_as_keys_without_a_file() {
        let words = words_of(&tuned("pid"));
        assert!(words.contains(" --set control.pid.gain="), "{words}");
        assert!(!words.contains("--config") && !words.contains("controller"), "{words}");
    }

    #[test]
    fn every_law_and_the_outer_loops_have_a_file_and_every_file_is_one_of_them() {
        let names = || law::names().chain(["outer"]);
        for (name, _) in FILES {
            let law = name.split_once('/').map_or(*name, |(_, law)| law);
            assert!(names().any(|known| known == law), "deploy/tuned/{name}.toml");
            assert!(!tuned(name).is_empty(), "deploy/tuned/{name}.toml");
        }
        for name in names() {
            assert!(FILES.iter().any(|(file, _)| *file == name), "no deploy/tuned/{name}.toml");
        }
    }

    #[test]
    fn gains_replace_the_default_of_a_study_without_a_note() {
        let key = "position.velocity-integral-limit-m-s2";
        let common = [Setting::flag(law::STUDY_DEFAULT, key, 4.0)];
        let gains = [&common[..], &[Setting::flag("own.toml:1", key, 2.0)]].concat();
        let flown = [gains, common.to_vec()].map(|settings| {
            let law = StudyLaw::new("pid", settings, "");
            assert_eq!(replaced(std::slice::from_ref(&law), &common), None);
            let config = Config::from_settings(&law.settings_under(&common)).unwrap();
            config.position.velocity_integral_limit_m_s2
        });
        assert_eq!(flown, [2.0, 4.0]);
    }
}
