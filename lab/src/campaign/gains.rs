//! The gains with which a campaign flies each law.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use oqtal_config::{Config, Setting};
use oqtal_runtime::process::{Exit, Failure};

use crate::tune::gains::tuned;

/// Where a campaign takes the gains of its laws from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum GainSource {
    /// The configuration, as `oqtal fly` does.
    #[default]
    Configured,
    /// `deploy/tuned`: gains tuned alike for the shipped vehicle.
    Tuned,
    /// `DIR/LAW.toml`, as written by `oqtal tune --out DIR`.
    Directory(PathBuf),
}

impl FromStr for GainSource {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "configured" => Self::Configured,
            "tuned" => Self::Tuned,
            directory => Self::Directory(directory.into()),
        })
    }
}

impl fmt::Display for GainSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Configured => f.write_str("configured"),
            Self::Tuned => f.write_str("tuned"),
            Self::Directory(directory) => directory.display().fmt(f),
        }
    }
}

impl GainSource {
    /// Whether the source has gains of the law `controller`: a directory may lack them.
    #[must_use]
    pub fn has(&self, controller: &str) -> bool {
        match self {
            Self::Configured | Self::Tuned => true,
            Self::Directory(directory) => directory.join(format!("{controller}.toml")).is_file(),
        }
    }

    /// The settings of the law `controller` under those of a study, `common`, and a remark on its gains.
    ///
    /// # Errors
    /// The directory has no file for the law, or one with an error (exit code 78).
    pub fn of(
        &self,
        controller: &str,
        common: &[Setting],
    ) -> Result<(Vec<Setting>, String), Failure> {
        let (own, remark) = match self {
            Self::Configured => (Vec::new(), "configured gains".to_owned()),
            Self::Tuned => match tuned(controller) {
                none if none.is_empty() => (none, "configured gains, not tuned".to_owned()),
                tuned => (tuned, "tuned alike, deploy/tuned".to_owned()),
            },
            Self::Directory(directory) => {
                let file = directory.join(format!("{controller}.toml"));
                let settings = Config::file_settings(&file).map_err(|error| {
                    let reason = format!(
                        "{error}; make it with `oqtal tune {controller} --out {}`",
                        directory.display()
                    );
                    Failure::new(Exit::Config, reason)
                })?;
                (settings, format!("gains of {}", directory.display()))
            }
        };
        Ok((common.iter().cloned().chain(own).collect(), remark))
    }
}
