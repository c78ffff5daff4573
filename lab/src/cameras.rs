//! `oqtal cameras`: comparison of the emulated camera system with recordings of real ones, its noise by position in the room, and
//! estimation errors with its poses.

pub mod estimation;
pub mod noise;
pub mod statistics;

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use oqtal_config::{Config, Setting};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;
use serde_json::{Value, json};

/// Commands of `oqtal cameras`.
#[derive(Subcommand, Debug)]
pub enum CamerasCommand {
    /// Arrivals, captures, gaps and noise at rest of the emulated cameras beside those of recordings
    Statistics(StatisticsArgs),
    /// Noise of a pose from the markers up, at places from the centre of the room to its edge
    Noise(NoiseArgs),
    /// Errors and innovations of the estimators in a flight, for exact, arrival and estimated stamps
    Estimation(SettingsArgs),
}

/// Arguments of `oqtal cameras statistics`.
#[derive(Args, Debug)]
pub struct StatisticsArgs {
    /// Recordings: CSV with named columns, TUM or EuRoC
    files: Vec<PathBuf>,
    /// Duration of the emulated recordings, one of a body at rest and one of a body in motion
    #[arg(long, value_name = "S", default_value_t = 1000.0, value_parser = seconds)]
    seconds: f64,
    #[command(flatten)]
    settings: SettingsArgs,
}

/// Arguments of `oqtal cameras noise`.
#[derive(Args, Debug)]
pub struct NoiseArgs {
    /// Frames at each place
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u64).range(10..=1_000_000))]
    frames: u64,
    #[command(flatten)]
    settings: SettingsArgs,
}

/// Arguments of every command of `oqtal cameras`.
#[derive(Args, Debug)]
pub struct SettingsArgs {
    /// Preset of the cameras
    #[arg(long, value_name = "NAME", default_value = "room")]
    preset: String,
    /// Set a value of the configuration, as in mocap.room.stalls-per-1000-s=0
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seed of every random source
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
}

impl SettingsArgs {
    /// Configuration without environment variables, so that tables are reproducible.
    fn config(&self) -> Result<Config, Failure> {
        let mut settings = vec![
            Setting::flag("--preset", "mocap.preset", self.preset.as_str()),
            Setting::flag("--seed", "clock.seed", self.seed.cast_signed()),
        ];
        for text in &self.set {
            settings.push(Setting::parse("--set", text)?);
        }
        Ok(Config::from_settings(&settings)?)
    }

    fn show(&self, json: &Value, text: &str) -> Result<Exit, Failure> {
        let json = self.json.then(|| format!("{json:#}"));
        print(json.as_deref().unwrap_or(text))?;
        Ok(Exit::Ok)
    }
}

impl CamerasCommand {
    /// Executes the command.
    ///
    /// # Errors
    /// A setting is invalid (exit code 78), a recording is invalid (65), or a flight could not be flown.
    pub fn execute(&self) -> Result<Exit, Failure> {
        match self {
            Self::Statistics(args) => {
                let files: Vec<&Path> = args.files.iter().map(PathBuf::as_path).collect();
                let study =
                    statistics::CameraStudy::of(&args.settings.config()?, args.seconds, &files)?;
                args.settings.show(&study.to_json(), &study.to_text())
            }
            Self::Noise(args) => {
                let map = noise::map(&args.settings.config()?, args.frames);
                args.settings.show(&json!({ "places": map }), &noise::to_text(&map))
            }
            Self::Estimation(settings) => {
                let rows = estimation::study(settings.config()?)?;
                settings.show(&json!({ "stamps": rows }), &estimation::to_text(&rows))
            }
        }
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    let allowed = 30.0..=100_000.0;
    if allowed.contains(&seconds) { Ok(seconds) } else { Err("between 30 and 100000".to_owned()) }
}
