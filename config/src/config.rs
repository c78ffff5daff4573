//! Effective configuration of all processes, composed of layers.

use std::hash::Hasher;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use oqtal_control::ControlOptions;
use oqtal_control::options::OptionError;
use oqtal_control::position::PositionOptions;
use oqtal_control::trajectory::TrajectoryOptions;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::bridge::BridgeOptions;
use crate::error::ConfigError;
use crate::external::{EnvelopeOptions, ExternalOptions};
use crate::fault::FaultOptions;
use crate::fence::FenceOptions;
use crate::instance::{ClockOptions, InstanceOptions, LogOptions};
use crate::layer::FILE_KEYS;
use crate::mocap::MocapOptions;
use crate::nearest_key::with_nearest_key;
use crate::origin::{Origins, of_different_keys};
use crate::plant::PlantOptions;
use crate::realtime::RealtimeOptions;
use crate::reason::{self, plain};
use crate::receiver::ReceiverOptions;
use crate::record::RecordOptions;
use crate::reference::ReferenceOptions;
use crate::safety::SafetyOptions;
use crate::setting::Setting;
use crate::vehicle::VehicleOptions;
use crate::{follow, layer, preset, renamed};

/// The shipped file, with the default of every key.
pub const DEFAULTS: &str = include_str!("../../deploy/oqtal.toml");

/// Origin of the values of the shipped file.
const SHIPPED: &str = "deploy/oqtal.toml, as built in";

/// The shipped file as a table and as a configuration: parsed once, since a study makes a configuration for each flight.
static SHIPPED_CONFIG: LazyLock<Result<(Table, Config), String>> = LazyLock::new(|| {
    let table: Table =
        DEFAULTS.parse().expect("the shipped configuration is TOML: a test holds it");
    deserialize(&table).map(|config| (table, config))
});

/// Sections and keys that may differ between the processes of one flight: the ends of wires are set only for the process at that
/// end.
const NOT_FLOWN: [&str; 9] = [
    "instance",
    "clock.kind",
    "log",
    "record",
    "mocap.serve",
    "bridge.link",
    "bridge.mavlink.signing-key-file",
    "plant.wire.link",
    "receiver.link",
];

/// Deviation of the loop's rate from the requested one that does not cause a warning \[-\].
pub(crate) const RATE_TOLERANCE: f64 = 0.01;

/// The effective configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Config {
    /// `[instance]`: the testbed.
    pub instance: InstanceOptions,
    /// `[clock]`: the time base.
    pub clock: ClockOptions,
    /// `[vehicle]`: the controller's model of the vehicle.
    pub vehicle: VehicleOptions,
    /// `[plant]`: the simulated vehicle and its environment.
    pub plant: PlantOptions,
    /// `[mocap]`: the emulated cameras.
    pub mocap: MocapOptions,
    /// `[control]`: the loop and the attitude laws.
    pub control: ControlOptions,
    /// `[position]`: the outer loops.
    pub position: PositionOptions,
    /// `[trajectory]`: the flight.
    pub trajectory: TrajectoryOptions,
    /// `[reference]`: references from outside, and legs to a point.
    pub reference: ReferenceOptions,
    /// `[safety]`: acceptance of poses, and limits.
    pub safety: SafetyOptions,
    /// `[fence]`: the space in which the vehicle may fly.
    pub fence: FenceOptions,
    /// `[envelope]`: where a command must not lead.
    pub envelope: EnvelopeOptions,
    /// `[external]`: a law outside the daemon.
    pub external: ExternalOptions,
    /// `[bridge]`: connection to a real vehicle.
    pub bridge: BridgeOptions,
    /// `[receiver]`: connection to a real camera system.
    pub receiver: ReceiverOptions,
    /// `[record]`: recordings.
    pub record: RecordOptions,
    /// `[realtime]`: scheduling of the loops.
    pub realtime: RealtimeOptions,
    /// `[log]`: log lines.
    pub log: LogOptions,
    /// `[fault]`: injected faults.
    pub fault: FaultOptions,
    /// Origins of the values.
    #[serde(skip)]
    pub(crate) origins: Origins,
}

impl Default for Config {
    fn default() -> Self {
        Self::from_settings(&[]).expect("the shipped configuration is valid: a test holds it")
    }
}

impl Config {
    /// Effective configuration from `files`, of which later ones override earlier ones, the environment and `flags`.
    ///
    /// # Errors
    /// A file cannot be read or parsed, a key is unknown, a value has the wrong type or breaks a rule; with its origin.
    pub fn load(files: &[PathBuf], flags: &[Setting]) -> Result<Self, ConfigError> {
        let mut settings = Self::layers(files)?;
        settings.extend_from_slice(flags);
        Self::from_settings(&settings)
    }

    /// The settings of `files`, each with its line; later files override earlier ones.
    ///
    /// # Errors
    /// A file cannot be read, or is not TOML.
    pub fn file_settings<P: AsRef<Path>>(files: &[P]) -> Result<Vec<Setting>, ConfigError> {
        let settings: Result<Vec<_>, _> =
            files.iter().map(|file| layer::from_file(file.as_ref())).collect();
        Ok(settings?.concat())
    }

    /// Settings of `files`, overridden by those of the environment.
    ///
    /// # Errors
    /// A file cannot be read, or is not TOML, or gives a thrust without the mass that it lifts; with its line.
    pub fn layers(files: &[PathBuf]) -> Result<Vec<Setting>, ConfigError> {
        let mut settings = Self::file_settings(files)?;
        // An unknown key, which may be meant as the mass, is reported first, with the flags.
        if Self::unchecked(&settings).is_some() {
            refuse_thrust_alone(&settings)?;
        }
        settings.extend(layer::from_environment(std::env::vars_os()));
        Ok(settings)
    }

    /// Configuration from a file named `file` with this `text`, overridden by `flags`, without the environment; for example that
    /// of a recording.
    ///
    /// # Errors
    /// Like [`Config::load`].
    pub fn parse(file: &str, text: &str, flags: &[Setting]) -> Result<Self, ConfigError> {
        let mut settings = layer::from_toml(file, text)?;
        settings.extend_from_slice(flags);
        Self::from_settings(&settings)
    }

    /// The built-in values overridden by `settings`; later settings take precedence.
    ///
    /// # Errors
    /// Like [`Config::load`], without files.
    pub fn from_settings(settings: &[Setting]) -> Result<Self, ConfigError> {
        // An error of its own: otherwise it would name the first setting if the shipped file lacks a section.
        let (mut table, mut config) = SHIPPED_CONFIG
            .clone()
            .map_err(|reason| ConfigError { origin: SHIPPED.to_owned(), reason })?;
        let mut origins = Origins::default();
        origins.rename_warnings = renamed::warnings(settings);
        let settings = renamed::with_present_keys(settings);
        let settings = [preset::named_by(&settings)?, settings].concat();
        for group in of_different_keys(&settings) {
            let mut before = table.clone();
            config = match apply_all(group, &mut table) {
                Some(config) => config,
                // One at a time, so that the error names the offending setting.
                None => group.iter().try_fold(config, |_, setting| apply(setting, &mut before))?,
            };
        }
        settings.iter().for_each(|setting| origins.record(setting));
        let mut config = Self { origins, ..config };
        config.make_paths_absolute();
        config.check()?;
        Ok(config)
    }

    /// Adds the origin of the option in `error`, which is named by its full key.
    pub fn locate(&self, error: &OptionError) -> ConfigError {
        self.origins.locate(error)
    }

    /// Adds to `error` the origin of the setting from which on `is_kept` fails. For a trajectory that leaves the room, that is
    /// the setting that made it too long, not the border of the room.
    pub fn locate_change(
        &self,
        error: &OptionError,
        is_kept: impl Fn(&Self) -> bool,
    ) -> ConfigError {
        let is_kept =
            |settings: &[Setting]| Self::unchecked(settings).is_none_or(|it| is_kept(&it));
        self.origins.locate_change(error, is_kept)
    }

    /// Configuration from `settings` without a check of the rules; `None` if they cannot be parsed.
    pub(crate) fn unchecked(settings: &[Setting]) -> Option<Self> {
        let (mut table, _) = SHIPPED_CONFIG.clone().ok()?;
        apply_all(settings, &mut table)
    }

    /// Whether a file, preset, variable or flag set `key`, or a key in it.
    pub fn is_set(&self, key: &str) -> bool {
        self.origins.has(key)
    }

    /// Whether a setting is from `file`.
    pub fn is_from(&self, file: &Path) -> bool {
        let is_same =
            |other: &str| file.canonicalize().ok() == Path::new(other).canonicalize().ok();
        file.is_file() && self.origins.files().any(is_same)
    }

    /// Whether a recording is played instead of the cameras.
    pub fn is_replay(&self) -> bool {
        !self.mocap.replay.is_empty()
    }

    /// Number of poses per tick of the loop \[-\]: poses of cameras much faster than the loop are decimated.
    pub fn poses_per_tick(&self) -> f64 {
        (self.safety.pose_rate_hz / self.control.rate_hz).round().max(1.0)
    }

    /// Rate of the loop \[Hz\]: `control.rate-hz`, or the nearest one at which the cameras allow it to run.
    pub fn loop_rate_hz(&self) -> f64 {
        self.safety.pose_rate_hz / self.poses_per_tick()
    }

    /// Expected rate of the poses and rate of the loop, as text.
    pub fn pace(&self) -> String {
        let (poses, wanted) = (self.safety.pose_rate_hz, self.control.rate_hz);
        let (every, rate) = (self.poses_per_tick(), self.loop_rate_hz());
        format!(
            "poses expected at {poses} Hz, control.rate-hz = {wanted}: the loop acts on one pose in {every}, at {rate:.4} Hz"
        )
    }

    /// Warning that the loop cannot run at the requested rate, because it is not a whole number of poses; `None` if it can.
    pub fn rate_warning(&self) -> Option<String> {
        let (rate, wanted) = (self.loop_rate_hz(), self.control.rate_hz);
        ((rate / wanted - 1.0).abs() > RATE_TOLERANCE).then(|| {
            let (pace, rate) = (self.pace(), (rate * 1e3).round() * 1e-3);
            format!(
                "{pace}, while the laws are designed for {wanted} Hz; set control.rate-hz = {rate}"
            )
        })
    }

    /// Warning that emulated cameras, which send every frame, send poses at another rate than the loop expects; `None` otherwise.
    pub fn pose_rate_warning(&self) -> Option<String> {
        let (sent, expected) = (self.mocap.rate_hz, self.safety.pose_rate_hz);
        let is_emulated = self.receiver.link.is_empty()
            && !self.is_replay()
            && self.mocap.room.send_period_ms == 0.0;
        (is_emulated && (sent / expected - 1.0).abs() > RATE_TOLERANCE).then(|| {
            format!(
                "mocap.rate-hz is {sent} and safety.pose-rate-hz {expected}: the emulated cameras send poses at another rate than the loop expects, so its ticks are uneven; set mocap.rate-hz = {expected}"
            )
        })
    }

    /// Warnings for settings with keys of earlier versions, with their origins.
    pub fn rename_warnings(&self) -> &[String] {
        &self.origins.rename_warnings
    }

    /// The configuration as a file with every key, one key per line.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a configuration holds only what TOML can say")
    }

    /// Hash of the effective configuration, without the settings that determine where and how it is flown and recorded: instance, kind of
    /// clock, log, recordings, ends of wires, and directories of input files.
    pub fn hash(&self) -> u64 {
        let mut hasher = fnv::FnvHasher::default();
        hasher.write(self.hashed().to_string().as_bytes());
        hasher.finish()
    }

    /// The settings that the hash covers.
    pub(crate) fn hashed(&self) -> Table {
        let mut hashed =
            Table::try_from(self).expect("a configuration holds only what TOML can say");
        NOT_FLOWN.iter().for_each(|key| remove(&mut hashed, key));
        FILE_KEYS.iter().for_each(|key| keep_file_name(&mut hashed, key));
        hashed
    }
}

/// Configuration with `settings`, which are inserted into `table`; `None` if it cannot be parsed.
fn apply_all(settings: &[Setting], table: &mut Table) -> Option<Config> {
    settings.iter().try_for_each(|setting| setting.insert_into(table)).ok()?;
    deserialize(table).ok()
}

/// Configuration with `setting`, which is inserted into `table`.
fn apply(setting: &Setting, table: &mut Table) -> Result<Config, ConfigError> {
    setting.insert_into(table)?;
    deserialize(table).map_err(|reason| {
        let again = |value| {
            let (other, mut table) = (Setting { value, ..setting.clone() }, table.clone());
            other.insert_into(&mut table).ok()?;
            deserialize(&table).err()
        };
        let reason = reason::completed(reason, &setting.value, again);
        setting.refused(&with_nearest_key(setting, reason, DEFAULTS))
    })
}

/// Refuses settings with a thrust and without a mass: the mass of the preset would be flown with another vehicle's thrust.
///
/// # Errors
/// The thrust, and the remedy.
pub fn refuse_thrust_alone(settings: &[Setting]) -> Result<(), ConfigError> {
    let has = |key: &str| settings.iter().any(|setting| setting.key == key);
    let thrust = settings.iter().find(|setting| setting.key == "vehicle.max-thrust-n");
    match thrust.filter(|_| !has("vehicle.mass-kg")) {
        Some(thrust) => Err(thrust
            .refused("given without `vehicle.mass-kg`; add the mass that this vehicle has [kg]")),
        None => Ok(()),
    }
}

/// Removes a dotted key if it exists.
fn remove(table: &mut Table, key: &str) {
    match key.split_once('.') {
        None => drop(table.remove(key)),
        Some((section, rest)) => {
            if let Some(Value::Table(inner)) = table.get_mut(section) {
                remove(inner, rest);
            }
        }
    }
}

/// Replaces the path at a dotted key, if there is one, by its file name.
pub(crate) fn keep_file_name(table: &mut Table, key: &str) {
    let Some((section, key)) = key.split_once('.') else { return };
    let section = table.get_mut(section).and_then(Value::as_table_mut);
    if let Some(Value::String(path)) = section.and_then(|section| section.get_mut(key)) {
        let name = Path::new(path.as_str()).file_name().unwrap_or_default();
        *path = name.to_string_lossy().into_owned();
    }
}

/// Configuration from a complete table; the reason on one line if it is invalid.
pub(crate) fn deserialize(table: &Table) -> Result<Config, String> {
    let mut table = table.clone();
    follow::resolve(&mut table);
    observe_replay(&mut table);
    table.try_into().map_err(|error: toml::de::Error| plain(error.message()))
}

/// During playback of a recording the daemon only observes, since no vehicle receives its commands.
fn observe_replay(table: &mut Table) {
    let replay = table.get("mocap").and_then(|mocap| mocap.get("replay")).and_then(Value::as_str);
    if replay.is_some_and(|file| !file.is_empty())
        && let Some(Value::Table(safety)) = table.get_mut("safety")
    {
        safety.insert("observe-only".to_owned(), true.into());
    }
}
