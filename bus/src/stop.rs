//! The operator's stop: words in shared memory that the process of the vehicle and the daemon read in every turn.
//!
//! An operator raises a stop by incrementing a number. The process of the vehicle (simulator or bridge) keeps the motors off while the
//! newest stop is in force, whatever the daemon commands. It lifts the stop once the daemon has commanded "disarmed" afterwards and the
//! motors are known to be off: the daemon has then detected the end of the flight, and a new flight needs an operator. The process of the
//! vehicle and the daemon each confirm the number that they obey. Reading requires no lock and no other process; a stop outlives the
//! processes that raised or obeyed it.
//!
//! A signal is a second path to both processes, which does not depend on any file: a process that receives it raises the stop itself.

use std::fs::File;
use std::ops::Deref;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use crate::code::Actuation;
use crate::error::BusError;
use crate::message::{CommandV1, Header};
use crate::paths::InstancePaths;
use crate::shared::SharedWords;
use crate::time::{Span, Time};

mod words;

pub use words::StopReport;
pub(crate) use words::WORDS;
use words::{DaemonView, VehicleView};

/// Name of the file among the words of the instance.
pub(crate) const FILE: &str = "stop";

/// Requests to the loop of this process: flags set by its signal handlers and by the watch over its files, and taken by its next turn.
#[derive(Clone, Debug, Default)]
pub struct SignalFlags {
    /// An operator requested a stop.
    pub stop: Arc<AtomicBool>,
    /// An operator requested a landing.
    pub land: Arc<AtomicBool>,
    /// A file of the instance was removed and cannot be restored.
    pub files_lost: Arc<AtomicBool>,
}

/// Takes a request: whether `flag` was set since the last call.
fn take(flag: &AtomicBool) -> bool {
    // The plain load keeps the cache line shared in turns without a request.
    flag.load(Ordering::Acquire) && flag.swap(false, Ordering::AcqRel)
}

/// Shared words, between processes or in one process.
#[derive(Clone, Debug)]
enum StopWords {
    Shared(Rc<SharedWords>),
    Local(Rc<[AtomicU32; WORDS]>),
}

impl Deref for StopWords {
    type Target = [AtomicU32];

    fn deref(&self) -> &[AtomicU32] {
        match self {
            Self::Shared(words) => words,
            Self::Local(words) => &words[..],
        }
    }
}

/// Operator's stop of an instance: words shared by the process of the vehicle, the daemon, and the operators who raise it.
#[derive(Clone, Debug)]
pub struct StopSwitch {
    words: StopWords,
    signals: SignalFlags,
}

impl StopSwitch {
    pub(crate) fn local(words: Rc<[AtomicU32; WORDS]>) -> Self {
        Self { words: StopWords::Local(words), signals: SignalFlags::default() }
    }

    /// The stop in the file at `path`, which is created if it does not exist; the caller holds the lock of the instance.
    pub(crate) fn open(path: PathBuf) -> Result<Self, BusError> {
        let words = SharedWords::open(&path, WORDS)
            .map_err(|error| BusError::of_shared_file(FILE, path, &error))?;
        Ok(Self::shared(words))
    }

    fn shared(words: SharedWords) -> Self {
        Self { words: StopWords::Shared(Rc::new(words)), signals: SignalFlags::default() }
    }

    /// This switch for a process whose signal handlers set `signals`.
    pub(crate) fn with_signals(self, signals: SignalFlags) -> Self {
        Self { signals, ..self }
    }

    /// The stop in a file of words that a running process holds and that may have been removed.
    ///
    /// # Errors
    /// The file was shortened, or cannot be mapped.
    pub(crate) fn of_held_file(file: File) -> std::io::Result<Self> {
        SharedWords::of_mapped_file(file, WORDS).map(Self::shared)
    }

    /// Whether both switches are the same words in shared memory.
    pub fn is_same(&self, other: &Self) -> bool {
        match (&self.words, &other.words) {
            (StopWords::Shared(ours), StopWords::Shared(theirs)) => ours.id() == theirs.id(),
            _ => false,
        }
    }

    /// The stop of the instance at `paths`, without the lock, which another process may hold; `None` if no process that could
    /// obey has ever joined.
    ///
    /// # Errors
    /// The stop belongs to another user or another version.
    pub fn existing(paths: &InstancePaths) -> Result<Option<Self>, BusError> {
        let path = paths.words_file(FILE);
        match SharedWords::open_existing(&path, WORDS) {
            Ok(words) => Ok(Some(Self::shared(words))),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(BusError::of_shared_file(FILE, path, &error)),
        }
    }

    /// Raises a stop and returns its number. Takes effect in the next turn of the processes that obey it.
    pub fn raise(&self) -> u32 {
        words::raise(&self.words)
    }

    /// Processes that obey the stop `number`, or a later one.
    pub fn report(&self, number: u32) -> StopReport {
        words::report(&self.words, number)
    }

    /// Whether a stop is in force that the vehicle's process does not obey yet: it hangs, or is not started.
    pub fn awaits_vehicle(&self) -> bool {
        words::awaits_vehicle(&self.words)
    }

    /// Withdraws the stop `number`, which no process has seen.
    pub fn withdraw(&self, number: u32) {
        words::lift(&self.words, number);
    }

    /// Raises a stop for each request by signal.
    fn raise_signalled(&self) {
        if take(&self.signals.stop) {
            self.raise();
        }
    }
}

/// Time from its confirmation after which a stop is lifted although the vehicle has reported nothing about its motors.
const UNREPORTED: Span = Span::from_millis(3000);

/// Stop that the vehicle's process has seen and not yet lifted.
#[derive(Clone, Copy, Debug)]
struct StopInForce {
    number: u32,
    /// Instant at which it was first seen.
    since: Time,
    /// Instant at which it was first confirmed.
    confirmed_at: Option<Time>,
    motors: StoppedMotors,
}

/// Motors of a vehicle while a stop is in force, ordered: a later report never lowers the state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum StoppedMotors {
    /// No report has arrived since the stop.
    Unknown,
    /// The motors run according to the last report, or a sequence that was sent may still start them.
    Running,
    /// The vehicle has reported that they are off.
    Off,
}

/// The vehicle's side: obeys and lifts stops.
#[derive(Debug)]
pub struct VehicleStop {
    switch: StopSwitch,
    view: VehicleView,
    in_force: Option<StopInForce>,
}

impl VehicleStop {
    /// Vehicle's side, for the only process that controls the motors.
    pub fn new(switch: StopSwitch) -> Self {
        let view = VehicleView::new(&switch.words);
        Self { switch, view, in_force: None }
    }

    /// Whether the motors must be off at `now`. To be called in every turn.
    pub fn is_in_force(&mut self, now: Time) -> bool {
        self.switch.raise_signalled();
        let raised = self.view.in_force(&self.switch.words);
        if self.in_force.map(|stop| stop.number) != raised {
            let motors = StoppedMotors::Unknown;
            self.in_force =
                raised.map(|number| StopInForce { number, since: now, confirmed_at: None, motors });
        }
        self.in_force.is_some()
    }

    /// Instant at which the stop in force was first seen; `None` without one.
    pub fn since(&self) -> Option<Time> {
        self.in_force.map(|stop| stop.since)
    }

    /// Confirms at `now` that the stop in force is obeyed, with the state of the motors. Once reported running, they count as running
    /// until they are reported off; once off, they stay off.
    pub fn confirm(&mut self, now: Time, motors: StoppedMotors) {
        let Some(stop) = &mut self.in_force else { return };
        stop.confirmed_at = stop.confirmed_at.or(Some(now));
        stop.motors = stop.motors.max(motors);
        words::confirm(&self.switch.words, stop.number, motors == StoppedMotors::Off);
    }

    /// Records that the stop in force does not reach the motors, since another has control of the vehicle. It is not lifted before it is
    /// confirmed again.
    pub fn withhold(&mut self) {
        let Some(stop) = &mut self.in_force else { return };
        (stop.confirmed_at, stop.motors) = (None, StoppedMotors::Unknown);
        words::withhold(&self.switch.words, stop.number);
    }

    /// Takes a command of the daemon. A "disarmed" published after the stop in force was seen lifts the stop once the motors are
    /// known to be off; or 3 s after its confirmation, if nothing is known of them. The last command of a daemon that ends has no
    /// stamps and counts as published afterwards.
    pub fn receive_command(&mut self, header: &Header, command: &CommandV1) {
        let Some(stop) = self.in_force else { return };
        let Some(confirmed_at) = stop.confirmed_at else { return };
        let published_at = header.stamps.command_published_at;
        let is_disarmed = command.actuation == Actuation::Disarmed.code();
        let is_after = !published_at.is_set() || published_at >= stop.since;
        let is_overdue = published_at.is_set() && published_at.since(confirmed_at) >= UNREPORTED;
        let may_lift = match stop.motors {
            StoppedMotors::Off => true,
            StoppedMotors::Running => false,
            StoppedMotors::Unknown => is_overdue,
        };
        if is_disarmed && is_after && may_lift {
            words::lift(&self.switch.words, stop.number);
            self.in_force = None;
        }
    }
}

/// The daemon's side: reports each stop once.
#[derive(Debug)]
pub struct ControllerStop {
    switch: StopSwitch,
    view: DaemonView,
}

impl ControllerStop {
    /// Side of a daemon that starts: a stop not lifted by the vehicle counts as new.
    pub fn new(switch: StopSwitch) -> Self {
        let view = DaemonView::new(&switch.words);
        Self { switch, view }
    }

    /// Whether a stop was raised since the last call.
    pub fn is_newly_raised(&mut self) -> bool {
        self.switch.raise_signalled();
        self.view.is_newly_raised(&self.switch.words)
    }

    /// Whether a landing was requested by signal since the last call.
    pub fn is_landing_requested(&self) -> bool {
        take(&self.switch.signals.land)
    }

    /// Whether a file of the instance was lost since the last call.
    pub fn are_files_lost(&self) -> bool {
        take(&self.switch.signals.files_lost)
    }

    /// Confirms that "disarmed" was commanded after the newest seen stop.
    pub fn confirm(&self) {
        self.view.confirm(&self.switch.words);
    }
}

#[cfg(test)]
mod tests;
