//! Changes of a flight under way: those of its course, and settings that take effect between two ticks.
//!
//! Everything that may fail or allocate happens on the background thread: a request is parsed, its settings are merged into the
//! configuration and checked as a whole, and what the loop needs is built. The loop exchanges it with its own between two ticks;
//! the background thread drops the rest.

use std::collections::HashSet;
use std::path::PathBuf;

use nalgebra::{Vector3, Vector4};
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::text::LongText;
use oqtal_config::{Config, ConfigError, Setting, reread_comments};
use oqtal_control::predictive::MotionTracker;
use oqtal_control::trajectory::{Trajectory, TrajectoryOptions, Waypoints};
use oqtal_runtime::process::Failure;

use crate::arming::ArmingPath;
use crate::command_model::{CommandModel, motion_tracker};
use crate::flight_room::{
    fitting_starts, require_flyable, require_flyable_in_flight, require_target,
};
use crate::law_guard::{LiveGuard, of_stack};
use crate::limits::LoopLimits;
use crate::refusal::Refusal;
use crate::room::StoppingRoom;
use crate::stack::ControlStack;
use crate::stream::ReferenceStream;
use crate::warnings::{added_warnings, note_below_envelope};
use crate::waypoint_file::{ReadSettings, WAYPOINTS_KEY, read_in_time};

/// Number of changes of settings that can be taken back \[-\].
const MOST_UNDONE: usize = 32;
/// Name of the request in errors.
const ORIGIN: &str = "set";

/// The parts of the control that settings change, as the loop takes them.
#[derive(Debug)]
pub struct LiveControl {
    pub(crate) stack: ControlStack,
    /// Limits of the motion, which depend on those of the position loops.
    pub(crate) limits: LoopLimits,
    /// Needs of a guarded law; `None` without a fallback.
    pub(crate) guarded: Option<LiveGuard>,
    /// Whether the attitude law has the same options as before: it then keeps its state.
    pub(crate) keeps_law: bool,
    /// The tracker of the motion, if the law needs another one.
    pub(crate) tracker: Option<MotionTracker>,
    pub(crate) trajectory: Trajectory,
    pub(crate) path: ArmingPath,
    pub(crate) options: TrajectoryOptions,
    pub(crate) room: StoppingRoom,
    pub(crate) stream: ReferenceStream,
}

impl LiveControl {
    /// The control of `next`, which follows `present` in a daemon that was started with `started`, and its trajectory.
    ///
    /// # Errors
    /// An option of the law is not allowed, or the trajectory does not fit inside the fence.
    fn new(
        started: &Config,
        present: &Config,
        next: &Config,
        trajectory: Trajectory,
    ) -> Result<Self, Failure> {
        let located = |error| Failure::from(next.locate(&error));
        require_flyable(next, &trajectory, None)?;
        let of_tracker = |config: &Config| {
            let model = CommandModel::new(config).map_err(located)?.model;
            Ok::<_, Failure>(motion_tracker(config, model))
        };
        let tracker = of_tracker(next)?;
        let tracker = (tracker != of_tracker(present)?).then_some(tracker);
        Ok(Self {
            stack: ControlStack::new(&of_stack(started, next)).map_err(located)?,
            limits: LoopLimits::of(next),
            guarded: LiveGuard::new(started, next).map_err(located)?,
            keeps_law: next.control.is_external() || present.control == next.control,
            tracker,
            path: ArmingPath::new(next, &trajectory),
            trajectory,
            options: next.trajectory.clone(),
            room: StoppingRoom::new(next),
            stream: ReferenceStream::new(next),
        })
    }
}

/// A change that the loop makes.
#[derive(Debug)]
pub enum FlightChange {
    /// Fly to a point and stay there: x, y, z \[m, world\] and yaw \[rad\], NaN for the present one.
    Goto(Vector4<f64>),
    /// Fly this trajectory next, then stay.
    Trajectory(Box<Trajectory>),
    /// Come to rest and stay.
    Hover,
    /// Control with other settings.
    Settings(Box<LiveControl>),
}

/// A request that was checked.
#[derive(Debug)]
pub struct PreparedChange {
    /// The change for the loop.
    pub change: FlightChange,
    /// Text of the request, for the recording: what a replay prepares the same change from.
    pub text: LongText,
    /// The settings after the change, and whether they are those before the last one.
    settings: Option<(ReadSettings, bool)>,
}

impl PreparedChange {
    /// Whether the change is one of settings.
    pub fn changes_settings(&self) -> bool {
        self.settings.is_some()
    }

    /// The configuration after the change, if it is one of settings.
    pub(crate) fn next_config(&self) -> Option<&Config> {
        self.settings.as_ref().map(|(next, _)| &next.config)
    }
}

/// The settings with which a daemon flies, and those before.
#[derive(Clone, Debug)]
pub struct LiveSettings {
    started: ReadSettings,
    present: ReadSettings,
    /// Earlier settings, the last ones at the end.
    earlier: Vec<ReadSettings>,
    files: Vec<PathBuf>,
    /// Recorded points of the next waypoint file that is read, for a replay.
    recorded: Option<Waypoints>,
}

impl LiveSettings {
    /// The settings of `config`, which was read from `files`, without copies; its waypoint file is read.
    pub fn new(config: &Config, files: &[PathBuf]) -> Self {
        Self::of(ReadSettings::at_start(config), files.to_vec())
    }

    /// Like [`LiveSettings::new`] without files, with these points of the waypoint file.
    pub fn along(config: &Config, waypoints: Option<Waypoints>) -> Self {
        Self::of(ReadSettings::along(config.clone(), waypoints), Vec::new())
    }

    fn of(started: ReadSettings, files: Vec<PathBuf>) -> Self {
        Self { present: started.clone(), started, earlier: Vec::new(), files, recorded: None }
    }

    /// The next waypoint file that a request names has these `points`, whatever the file holds now: those recorded in flight.
    pub fn expect_waypoints(&mut self, points: Option<Waypoints>) {
        self.recorded = points;
    }

    /// The present settings.
    pub fn present(&self) -> &Config {
        &self.present.config
    }

    /// Settings that differ from those with which the daemon was started, one per line below a title; empty if none does.
    pub fn changed(&self) -> Vec<String> {
        let Self { started, present, .. } = self;
        let mut changed = started.config.differences(&present.config).unwrap_or_default();
        // The same name, with other points.
        changed.extend(started.has_other_points(present).then(|| present.named_file()).flatten());
        let title =
            (!changed.is_empty()).then(|| "settings changed since the daemon's start:".into());
        title.into_iter().chain(changed).collect()
    }

    /// Comment lines of the files that were read again in flight, and of the waypoint file.
    pub(crate) fn file_comments(&self) -> String {
        format!("{}{}", self.present.reread, self.present.waypoints_read)
    }

    /// Number of changes that can be taken back \[-\].
    pub fn changes(&self) -> usize {
        self.earlier.len()
    }

    /// The value of a key.
    ///
    /// # Errors
    /// The key does not exist.
    pub fn get(&self, key: &str) -> Result<String, Refusal> {
        let value = self.present().value(key);
        value.ok_or_else(|| {
            Refusal::of_setting(format!("`{key}` is not a key of the configuration, or is not set"))
        })
    }

    /// Checks `request` and builds what the loop needs for it. The settings change with [`LiveSettings::commit`].
    ///
    /// # Errors
    /// The request is invalid; the reason names the key at fault.
    pub fn prepare(
        &self,
        command: OperatorCommand,
        request: &ControlRequestV1,
    ) -> Result<PreparedChange, Refusal> {
        let text = request.text;
        let course = |change| PreparedChange { change, text, settings: None };
        match command {
            OperatorCommand::Goto => {
                let target = Vector3::from(request.point).push(request.yaw);
                require_target(self.present(), &target)?;
                Ok(course(FlightChange::Goto(target)))
            }
            OperatorCommand::Hover => Ok(course(FlightChange::Hover)),
            OperatorCommand::Trajectory => {
                let trajectory = self.trajectory(text.as_str())?;
                Ok(course(FlightChange::Trajectory(Box::new(trajectory))))
            }
            OperatorCommand::Undo => {
                let none = || Refusal::of_setting("no change of settings to take back");
                let earlier = self.earlier.last().cloned().ok_or_else(none)?;
                // Recorded; a replay takes the settings back itself.
                let changed = self.present().described_differences(&earlier.config);
                let text = LongText::of_lines(changed.iter().map(String::as_str)).unwrap_or(text);
                self.settings(earlier, text, true)
            }
            // A recorded reload states the settings that it changed.
            OperatorCommand::Reload if !(text.is_empty() || text.as_str().starts_with('/')) => {
                self.set(text)
            }
            OperatorCommand::Reload => self.reload(text.as_str()),
            _ => self.set(text),
        }
    }

    /// Whether `prepared` sets the present values again.
    pub fn are_unchanged_by(&self, prepared: &PreparedChange) -> bool {
        prepared
            .settings
            .as_ref()
            .is_some_and(|(settings, _)| settings.has_same_values(&self.present))
    }

    /// The job that finds the warnings that `prepared` adds to those of the present settings, by its settings or its point; the floor is
    /// at height 0. It flies the law on a model, which takes time.
    pub fn new_warnings(&self, prepared: &PreparedChange) -> impl FnOnce() -> Vec<String> + use<> {
        let present = self.present.clone();
        let next = prepared.settings.as_ref().map(|(next, _)| next.clone());
        let height_m = match &prepared.change {
            FlightChange::Goto(target) => Some(target.z),
            _ => None,
        };
        move || match next {
            Some(next) => added_warnings(&present, &next),
            None => {
                height_m.and_then(|z| note_below_envelope(&present.config, z)).into_iter().collect()
            }
        }
    }

    /// Takes the settings of a change that was handed to the loop.
    pub fn commit(&mut self, prepared: &mut PreparedChange) {
        match prepared.settings.take() {
            Some((settings, true)) => {
                self.present = settings;
                self.earlier.pop();
            }
            // A change to the present values is nothing to take back.
            Some((settings, false)) if settings.has_same_values(&self.present) => {
                self.present = settings;
            }
            Some((settings, false)) => {
                self.earlier.push(std::mem::replace(&mut self.present, settings));
                let surplus = self.earlier.len().saturating_sub(MOST_UNDONE);
                self.earlier.drain(..surplus);
            }
            None => {}
        }
    }

    fn settings(
        &self,
        next: ReadSettings,
        text: LongText,
        is_undo: bool,
    ) -> Result<PreparedChange, Refusal> {
        let live = LiveControl::new(
            &self.started.config,
            self.present(),
            &next.config,
            next.trajectory()?,
        )?;
        let change = FlightChange::Settings(Box::new(live));
        let settings = Some((next, is_undo));
        Ok(PreparedChange { change, text, settings })
    }

    /// Changes the settings `KEY=VALUE` in the lines of `text`.
    fn set(&self, text: LongText) -> Result<PreparedChange, Refusal> {
        let lines = text.as_str().lines();
        let settings: Vec<_> =
            lines.map(|line| Setting::parse(ORIGIN, line)).collect::<Result<_, _>>()?;
        if settings.is_empty() {
            return Err(Refusal::of_setting("no KEY=VALUE given"));
        }
        let mut keys = HashSet::new();
        if let Some(twice) = settings.iter().find(|setting| !keys.insert(setting.key.as_str())) {
            return Err(Refusal::of_setting(format!(
                "`{}`: given more than once; give each key once",
                twice.key
            )));
        }
        let is_named = keys.contains(WAYPOINTS_KEY);
        self.settings(self.read(self.present().with_live(&settings)?, is_named)?, text, false)
    }

    /// Changes the settings that differ in the file `path`. Without a path, undoes the changes in flight and reads the daemon's files
    /// again; flags keep precedence over the files.
    fn reload(&self, path: &str) -> Result<PreparedChange, Refusal> {
        let files = if path.is_empty() { &self.files[..] } else { &[PathBuf::from(path)] };
        if files.is_empty() {
            let reason = "no file to reload: the daemon was started without a file, or with a copy, config.toml of a flight or an instance, which does not have later edits; name the file";
            return Err(Refusal::of_setting(reason));
        }
        let (read, before) = (files.to_owned(), self.present.reread.clone());
        let (reread, mut settings) = read_in_time(files, move || {
            // First: an edit from now on is told once too often, and never lost.
            let reread = reread_comments(&before, &read);
            Ok::<_, ConfigError>((reread, Config::file_settings(&read)?))
        })?;
        // Processes of several instances may read one file.
        settings.retain(|setting| !setting.is_of_instance());
        let next = match path.is_empty() {
            true => {
                let next = self.started.config.with_files(files, settings.clone())?;
                self.present().require_live(&next, &settings)?;
                next
            }
            false => self.present().with_live(&settings)?,
        };
        let is_named = path.is_empty() || settings.iter().any(|it| it.key == WAYPOINTS_KEY);
        // If the file was removed, its points are kept.
        let is_read =
            is_named && next.trajectory.waypoints_file.as_ref().is_some_and(|it| it.exists());
        let mut changed = self.present().differences(&next).map_err(Refusal::of_setting)?;
        let next = ReadSettings { reread, ..self.read(next, is_read)? };
        // A replay reads the recorded points of a request that names the file.
        changed.extend(self.present.has_other_points(&next).then(|| next.named_file()).flatten());
        let Some(text) = LongText::of_lines(changed.iter().map(String::as_str)) else {
            let reason = format!("{} settings differ, too many for one request", changed.len());
            return Err(Refusal::of_setting(reason));
        };
        self.settings(next, text, false)
    }

    /// `config` with the points of its waypoint file, which is read if `config` names another one than the present settings, or if the
    /// request names it again.
    fn read(&self, config: Config, is_named: bool) -> Result<ReadSettings, Refusal> {
        let present = self.present.clone();
        let file = &config.trajectory.waypoints_file;
        match (file, &self.recorded) {
            _ if !is_named && *file == present.config.trajectory.waypoints_file => {
                Ok(ReadSettings { config, ..present })
            }
            (Some(_), Some(points)) => {
                Ok(ReadSettings { config, waypoints: Some(points.clone()), ..present })
            }
            _ => {
                let named = config.clone();
                let read = read_in_time(file.as_slice(), move || ReadSettings::reading(named))?;
                Ok(ReadSettings { reread: present.reread, ..read })
            }
        }
    }

    /// The present settings with the trajectory of the name `kind`.
    fn with_trajectory(&self, kind: &str) -> Result<ReadSettings, Refusal> {
        let kind = Setting::flag("fly", "trajectory.kind", kind);
        self.read(self.present().with_live(&[kind])?, false)
    }

    /// The trajectory with the name `kind` and the present options.
    fn trajectory(&self, kind: &str) -> Result<Trajectory, Refusal> {
        let settings = self.with_trajectory(kind)?;
        let trajectory = settings.trajectory()?;
        require_flyable_in_flight(&settings.config, &trajectory)?;
        Ok(trajectory)
    }

    /// Place that the trajectory with the name `kind` needs, for its refusal by the fence; `None` if it cannot be read any more.
    pub(crate) fn place_for(&self, kind: &str) -> Option<String> {
        let settings = self.with_trajectory(kind).ok()?;
        Some(fitting_starts(&settings.config, &settings.trajectory().ok()?))
    }
}
