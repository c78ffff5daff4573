//! Command line common to all processes.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use oqtal_config::{ConfigError, Setting};

/// Arguments common to all processes.
#[derive(Args, Clone, Debug, Default)]
pub struct CommonArgs {
    /// Configuration file (TOML), see `oqtal check`; may be repeated, later files override earlier ones
    #[arg(long, value_name = "FILE")]
    pub config: Vec<PathBuf>,
    /// Name of the instance, 1 to 32 of a-z, 0-9 and -: only processes of one instance exchange messages
    #[arg(long, value_name = "NAME")]
    pub instance: Option<String>,
    /// Directory of the instance's files
    #[arg(long, value_name = "DIR")]
    pub root: Option<PathBuf>,
    /// Any key of the configuration, as in --set vehicle.mass-kg=0.6; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub settings: Vec<String>,
    /// End when the process that started this one dies
    #[arg(long, hide = true, value_name = "PID")]
    pub child: Option<i32>,
}

impl CommonArgs {
    /// These flags as settings.
    ///
    /// # Errors
    /// A `--set` without `=`.
    pub fn settings(&self) -> Result<Vec<Setting>, ConfigError> {
        let parsed: Result<Vec<_>, _> = set_flags(&self.settings).collect();
        parsed.map(|settings| self.with_place(settings))
    }

    /// These flags as settings, without any `--set` that has no `=`.
    pub fn usable_settings(&self) -> Vec<Setting> {
        self.with_place(set_flags(&self.settings).filter_map(Result::ok).collect())
    }

    /// `settings`, followed by the flags that name the instance.
    fn with_place(&self, mut settings: Vec<Setting>) -> Vec<Setting> {
        settings.extend(place_settings(self.instance.as_deref(), self.root.as_deref()));
        settings
    }
}

/// The flags that name an instance and the directory of its files, as settings.
pub fn place_settings(
    instance: Option<&str>,
    root: Option<&Path>,
) -> impl Iterator<Item = Setting> {
    let name = instance.map(|name| Setting::flag("--instance", "instance.name", name));
    let root = root.map(|root| root.display().to_string());
    let root = root.map(|root| Setting::flag("--root", "instance.root", root));
    name.into_iter().chain(root)
}

/// Settings of a command that flies a simulated vehicle, or checks the configuration for one.
#[derive(Args, Clone, Debug, Default)]
pub struct SettingArgs {
    /// Any key of the configuration, as in --set vehicle.mass-kg=0.6; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// The simulated vehicle, where it differs.
    #[command(flatten)]
    pub plant: PlantKeyArgs,
}

impl SettingArgs {
    /// These flags as settings.
    ///
    /// # Errors
    /// A flag without `=`.
    pub fn settings(&self) -> Result<Vec<Setting>, ConfigError> {
        let set: Result<Vec<_>, _> = set_flags(&self.set).collect();
        Ok([set?, self.plant.settings()?].concat())
    }

    /// These flags as words of a command line: flag and value.
    pub fn words(&self) -> impl Iterator<Item = (&'static str, String)> {
        let set = self.set.iter().map(|text| ("--set", text.clone()));
        set.chain(self.plant.plant.iter().map(|text| ("--plant", text.clone())))
    }
}

/// Differences of the simulated vehicle.
#[derive(Args, Clone, Debug, Default)]
pub struct PlantKeyArgs {
    /// A key of `[plant]`, where the simulated vehicle differs from the one that the laws are designed for, as in
    /// --plant rate-lag-ms=80; may be repeated
    #[arg(long = "plant", value_name = "KEY=VALUE")]
    pub plant: Vec<String>,
}

impl PlantKeyArgs {
    /// These flags as settings.
    ///
    /// # Errors
    /// A flag without `=`.
    pub fn settings(&self) -> Result<Vec<Setting>, ConfigError> {
        self.plant.iter().map(|text| Setting::parse_in("plant", "--plant", text)).collect()
    }
}

/// The texts of `--set` as settings.
fn set_flags(texts: &[String]) -> impl Iterator<Item = Result<Setting, ConfigError>> {
    texts.iter().map(|text| Setting::parse("--set", text))
}

/// The commands of a process.
#[derive(Subcommand, Clone, Debug)]
pub enum ProcessCommand {
    /// Run the process until SIGINT or SIGTERM
    Run(CommonArgs),
    /// Check the configuration the process would run with, and print it
    Check(CommonArgs),
}
