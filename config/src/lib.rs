//! One configuration for all processes: built-in values, a preset, a file, `OQTAL_*` variables, flags, in this order.
//!
//! Every value that is set carries its origin (`FILE:LINE`, the variable, the flag), and values are applied one at a time,
//! so that any error names the line to mend.

mod bridge;
mod layer;
mod mocap;
mod realtime;
mod rule;
mod vehicle;
mod wire;

use std::hash::Hasher;
use std::path::Path;

use oqtal_control::ControlOptions;
use oqtal_control::position::PositionOptions;
use oqtal_control::trajectory::TrajectoryOptions;
use serde::{Deserialize, Serialize};
use toml::Table;

pub use bridge::Bridge;
pub use layer::Setting;
pub use mocap::Mocap;
pub use realtime::{Realtime, Scheduling};
pub use rule::Violation;
pub use vehicle::{Battery, Fidelity, Rotors, Vehicle, VehicleKind};
pub use wire::Wire;

use rule::{link_at, not_negative, outside, positive, probability};

/// The shipped file: every key with its default.
pub const DEFAULTS: &str = include_str!("../../deploy/oqtal.toml");

/// The presets: (key that names one, its value, its file).
const PRESETS: [(&str, &str, &str); 3] = [
    ("vehicle.kind", "spacecraft", include_str!("../../deploy/presets/spacecraft.toml")),
    ("mocap.preset", "ideal", include_str!("../../deploy/presets/mocap-ideal.toml")),
    ("mocap.preset", "measured", include_str!("../../deploy/presets/mocap-measured.toml")),
];

/// A value that cannot be used, and where it was set.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{origin}: {reason}")]
pub struct ConfigError {
    /// `FILE:LINE`, the variable or the flag; the file alone if it cannot be read.
    pub origin: String,
    /// What is wrong with it.
    pub reason: String,
}

/// `[instance]`: which testbed on this machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Instance {
    /// Name, `[a-z0-9-]{1,32}`.
    pub name: String,
    /// Directory of the instance's files; empty for the default rule of `oqtal_bus::paths::InstancePaths`.
    pub root: String,
}

/// Which clock drives a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum ClockKind {
    /// The machine's monotonic clock.
    Real,
    /// Virtual time, the same processes.
    Lockstep,
    /// Virtual time, one process.
    InProcess,
}

impl ClockKind {
    /// Its name in a configuration.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Real => "real",
            Self::Lockstep => "lockstep",
            Self::InProcess => "in-process",
        }
    }
}

/// `[clock]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Clock {
    /// Which clock.
    pub kind: ClockKind,
    /// Seed of every random source.
    pub seed: u64,
}

/// `[safety]`: what the daemon believes, and when it flies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Safety {
    /// An older pose is not believed \[ms since its capture\].
    pub max_pose_age_ms: f64,
    /// Faster than this between two poses is a jump \[m/s\].
    pub max_speed_m_s: f64,
    /// Faster than this between two poses is a jump \[rad/s\].
    pub max_rate_rad_s: f64,
    /// Good poses in a row before poses are believed again.
    pub recovery_poses: u32,
    /// Without believable poses for so long the motors stop \[ms\].
    pub coast_ms: f64,
    /// A vehicle that did not answer for so long is silent: no take-off, and in flight the motors stop \[ms\].
    pub vehicle_silence_ms: f64,
    /// Whether the daemon flies once, by itself, as soon as it can. Only a simulated vehicle is flown so.
    pub arm_at_start: bool,
}

/// `[log]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Log {
    /// Least severe level that is written.
    pub level: LogLevel,
}

/// Severity of a log line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs)]
pub enum LogLevel {
    Error,
    Warn,
    Info,
    Debug,
    Trace,
}

/// The effective configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Config {
    /// `[instance]`.
    pub instance: Instance,
    /// `[clock]`.
    pub clock: Clock,
    /// `[vehicle]`.
    pub vehicle: Vehicle,
    /// `[mocap]`.
    pub mocap: Mocap,
    /// `[control]`: the loop, its law and its estimator.
    pub control: ControlOptions,
    /// `[position]`: the outer loops.
    pub position: PositionOptions,
    /// `[trajectory]`: what is flown.
    pub trajectory: TrajectoryOptions,
    /// `[safety]`.
    pub safety: Safety,
    /// `[bridge]`: the way to a real vehicle.
    pub bridge: Bridge,
    /// `[realtime]`: how the loops are run by the operating system.
    pub realtime: Realtime,
    /// `[log]`.
    pub log: Log,
}

impl Default for Config {
    fn default() -> Self {
        Self::from_settings(&[]).expect("the shipped configuration is valid: a test holds it")
    }
}

impl Config {
    /// The effective configuration of `file` (if any), the environment and `flags`.
    ///
    /// # Errors
    /// A file that cannot be read or parsed, an unknown key, a value of the wrong type, or one that breaks a rule; with its
    /// origin.
    pub fn load(file: Option<&Path>, flags: &[Setting]) -> Result<Self, ConfigError> {
        let mut settings = Vec::new();
        if let Some(path) = file {
            let origin = path.display().to_string();
            let text = std::fs::read_to_string(path).map_err(|error| ConfigError {
                origin: origin.clone(),
                reason: error.to_string(),
            })?;
            settings.extend(layer::from_toml(&origin, &text)?);
        }
        settings.extend(layer::from_environment(std::env::vars_os())?);
        settings.extend_from_slice(flags);
        Self::from_settings(&settings)
    }

    /// The built-in values under `settings`; later ones win.
    ///
    /// # Errors
    /// As [`Config::load`], without files.
    pub fn from_settings(settings: &[Setting]) -> Result<Self, ConfigError> {
        let mut table: Table =
            DEFAULTS.parse().expect("the shipped configuration is TOML: a test holds it");
        for (key, name, text) in PRESETS {
            let chosen = settings.iter().rev().find(|setting| setting.key == key);
            if chosen.is_some_and(|setting| setting.value.as_str() == Some(name)) {
                for setting in layer::from_toml(name, text)? {
                    setting.apply(&mut table)?;
                }
            }
        }
        for setting in settings {
            setting.apply(&mut table)?;
        }
        let config = layer::deserialize(&table)
            .map_err(|reason| ConfigError { origin: "built-in".to_owned(), reason })?;
        config.check().map_err(|violation| {
            let part = format!("{}.", violation.key);
            let concerns = |key: &str| key == violation.key || key.starts_with(&part);
            let set = settings.iter().rev().find(|setting| concerns(&setting.key));
            let origin = set.map_or("built-in", |setting| &setting.origin).to_owned();
            ConfigError { origin, reason: violation.to_string() }
        })?;
        Ok(config)
    }

    /// The rules that one value, or several together, must keep.
    ///
    /// # Errors
    /// The first rule broken.
    pub fn check(&self) -> Result<(), Violation> {
        self.vehicle.check()?;
        if !self.vehicle.wire.link.is_empty() && self.clock.kind != ClockKind::Real {
            return Err(Violation::new("vehicle.wire.link", "needs clock.kind = \"real\""));
        }
        self.mocap.check()?;
        self.control.check().map_err(|error| outside("control", error))?;
        let rate = self.control.rate_hz;
        if self.mocap.rate_hz * 1.5 < rate {
            let rule = format!("is {}, too slow for a loop at {rate} Hz", self.mocap.rate_hz);
            return Err(Violation::new("mocap.rate-hz", rule));
        }
        if self.safety.recovery_poses == 0 {
            return Err(Violation::new("safety.recovery-poses", "must be at least 1"));
        }
        self.bridge.check()?;
        self.realtime.check()?;
        self.check_flight()?;
        positive("safety.max-pose-age-ms", self.safety.max_pose_age_ms)?;
        positive("safety.max-speed-m-s", self.safety.max_speed_m_s)?;
        positive("safety.max-rate-rad-s", self.safety.max_rate_rad_s)?;
        positive("safety.coast-ms", self.safety.coast_ms)?;
        positive("safety.vehicle-silence-ms", self.safety.vehicle_silence_ms)
    }

    fn check_flight(&self) -> Result<(), Violation> {
        self.position.check().map_err(|error| outside("position", error))?;
        self.trajectory.check().map_err(|error| outside("trajectory", error))?;
        let (lift, gravity) =
            (self.position.vertical_acceleration_limit_m_s2, self.vehicle.gravity_m_s2);
        if lift < gravity {
            Ok(())
        } else {
            let rule =
                format!("is {lift}, it must be below gravity, {gravity}: thrust only pushes");
            Err(Violation::new("position.vertical-acceleration-limit-m-s2", rule))
        }
    }

    /// Whether a recording is played instead of the cameras.
    #[must_use]
    pub fn is_replay(&self) -> bool {
        !self.mocap.replay.is_empty()
    }

    /// Of so many poses the loop acts on one: cameras much faster than it are decimated.
    #[must_use]
    pub fn poses_per_tick(&self) -> f64 {
        (self.mocap.rate_hz / self.control.rate_hz).round().max(1.0)
    }

    /// How cameras and loop go together, in words.
    #[must_use]
    pub fn pace(&self) -> String {
        let (cameras, wanted) = (self.mocap.rate_hz, self.control.rate_hz);
        let every = self.poses_per_tick();
        let rate = cameras / every;
        format!(
            "cameras at {cameras} Hz, control.rate-hz = {wanted}: the loop acts on one pose in {every}, at {rate:.4} Hz"
        )
    }

    /// The configuration as a file with every key.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).expect("a configuration holds only what TOML can say")
    }

    /// Identifies the effective configuration.
    #[must_use]
    pub fn hash(&self) -> u64 {
        let mut hasher = fnv::FnvHasher::default();
        hasher.write(self.to_toml().as_bytes());
        hasher.finish()
    }
}
