//! A running instance: an operator's commands, and references of a planner.
//!
//! Ports on the bus belong to threads, which leave the instance when their owner is dropped. A child after a fork has no such thread,
//! and closes nothing that belongs to its parent.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Mutex, OnceLock};

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{OperatorCommand, ReferenceKind};
use oqtal_bus::message::{ControlRequestV1, ReferenceV1, Stamps};
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{REFERENCE, Role};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_bus::watch::InstanceWatch;
use oqtal_operator::request::{running_bus, send, unanswered};
use oqtal_operator::{
    AddressedInstance, ControlReport, CtlRequest, accepted, arm, execute, require_daemon, status,
};
use oqtal_runtime::health::SILENCE;
use oqtal_runtime::process::{Exit, Failure, paths_of};
use pyo3::prelude::*;

use crate::error;
use crate::observation::Observation;
use crate::settings::Sources;
use crate::task;

/// Author of requests in the event log.
const AUTHOR: &str = "Python";
/// Period at which the files of the instance are checked.
const WATCH_PERIOD: Span = Span::from_millis(500);

/// The process that loaded the module: its children after a fork may not connect.
static PROCESS: OnceLock<u32> = OnceLock::new();

/// Refuses a process that is a fork of the one that loaded the module.
pub fn check_process() -> PyResult<()> {
    if PROCESS.get() == Some(&std::process::id()) {
        return Ok(());
    }
    let text = "a forked process may not connect to an instance; start it with multiprocessing.get_context(\"spawn\")";
    Err(error::usage(text))
}

/// An instance whose daemon answered.
#[pyclass(frozen, module = "oqtal._native")]
struct Connection {
    address: AddressedInstance,
    references: Mutex<Option<ReferenceThread>>,
}

#[pymethods]
impl Connection {
    /// Connects to the instance of `sources`.
    #[new]
    fn new(py: Python<'_>, sources: Sources) -> PyResult<Self> {
        check_process()?;
        let address = task::interruptible(py, move |_| {
            let instance = sources.config()?.instance;
            let address = AddressedInstance {
                paths: paths_of(&instance)?,
                has_root: !instance.root.is_empty(),
            };
            address.paths.become_owner()?;
            require_daemon(&running_bus(&address.paths)?, "wait until it has started")?;
            Ok(address)
        })?;
        Ok(Self { address, references: Mutex::default() })
    }

    /// Name of the instance.
    #[getter]
    fn name(&self) -> &str {
        &self.address.paths.instance
    }

    /// Executes a command like `oqtal ctl`, and returns the answer as text.
    fn request(&self, py: Python<'_>, command: &str, arguments: Vec<String>) -> PyResult<String> {
        check_process()?;
        let command = CtlRequest::named(command).map_err(error::usage)?;
        let address = self.address.clone();
        task::interruptible(py, move |cancelled| {
            if !command.ends_flight() {
                // A landing and a stop reach an instance whose directory cannot be used.
                address.paths.become_owner()?;
            }
            match command {
                CtlRequest::Arm => arm(&address.paths, cancelled),
                _ => execute(&address, (command, &arguments), None, |request| request.by(AUTHOR)),
            }
        })
    }

    /// Changes settings: all of them, or none.
    fn set(&self, py: Python<'_>, settings: Sources) -> PyResult<String> {
        self.request(py, "set", settings.texts())
    }

    /// Mode, state, obstacles, processes and vehicle as JSON.
    fn status(&self, py: Python<'_>) -> PyResult<String> {
        check_process()?;
        let paths = self.address.paths.clone();
        task::interruptible(py, move |_| {
            paths.become_owner()?;
            let bus = running_bus(&paths)?;
            let response = send(&bus, ControlRequestV1::of(OperatorCommand::Status), None)?;
            let response = response.ok_or_else(|| unanswered(&bus))?;
            let status = status::observe(&bus)?;
            let report = ControlReport::new(OperatorCommand::Status, &response, status, &paths);
            Ok(report.to_json())
        })
    }

    /// Publishes a reference: position, velocity, acceleration, jerk, yaw and its rate, then, with `is_attitude`, attitude and rate;
    /// valid for `validity_s`.
    fn reference(
        &self,
        py: Python<'_>,
        numbers: [f64; 21],
        is_attitude: bool,
        validity_s: f64,
    ) -> PyResult<()> {
        check_process()?;
        let three = |at: usize| std::array::from_fn(|index| numbers[at + index]);
        let kind = if is_attitude { ReferenceKind::Attitude } else { ReferenceKind::Position };
        let time = Time::now();
        let reference = ReferenceV1 {
            time,
            valid_until: time + Span::from_seconds(validity_s),
            kind: kind.code(),
            position: three(0),
            velocity: three(3),
            acceleration: three(6),
            jerk: three(9),
            yaw: numbers[12],
            yaw_rate: numbers[13],
            attitude: std::array::from_fn(|index| numbers[14 + index]),
            rate: three(18),
        };
        py.detach(|| self.publish(reference)).map_err(error::raised)
    }

    /// Opens the observation of a topic, or of `events`, for `seconds`.
    fn observe(&self, py: Python<'_>, topic: &str, seconds: f64) -> PyResult<Observation> {
        check_process()?;
        let duration = Span::from_seconds(seconds.clamp(0.0, 1e9));
        Observation::open(py, &self.address.paths, topic, duration)
    }
}

/// Arms like `oqtal ctl arm`.
fn arm(paths: &InstancePaths, cancelled: &AtomicBool) -> Result<String, Failure> {
    let arming = ControlRequestV1::of(OperatorCommand::Arm).by(AUTHOR);
    let bus = running_bus(paths)?;
    let is_cancelled = || cancelled.load(Ordering::Relaxed);
    let response = arm::ask(&bus, arming, None, &mut |_| {}, &is_cancelled)?;
    let response = response.ok_or_else(|| unanswered(&bus))?;
    accepted(OperatorCommand::Arm, &response, None, paths)
}

/// Failure of a thread that has ended.
pub fn ended() -> Failure {
    Failure::new(Exit::Internal, "the thread of the instance has ended; connect again")
}

/// Thread that writes the topic `reference`.
struct ReferenceThread {
    references: Sender<ReferenceV1>,
    results: Receiver<Result<(), Failure>>,
}

impl Connection {
    /// Publishes a reference; the first one opens the topic, which has one writer.
    fn publish(&self, reference: ReferenceV1) -> Result<(), Failure> {
        let mut thread = self.references.lock().map_err(|_| ended())?;
        let open = thread.get_or_insert_with(|| {
            let (references, incoming) = channel();
            let (outgoing, results) = channel();
            let paths = self.address.paths.clone();
            std::thread::spawn(move || {
                error::catch_panics_of_thread(true);
                if let Err(failure) = write(&paths, &incoming, &outgoing) {
                    // The owner waits for a result.
                    let _ = outgoing.send(Err(failure));
                }
            });
            ReferenceThread { references, results }
        });
        let sent = open.references.send(reference).map_err(|_| ended());
        let result = sent.and_then(|()| open.results.recv().unwrap_or_else(|_| Err(ended())));
        if result.is_err() {
            // The next reference opens the topic again.
            *thread = None;
        }
        result
    }
}

/// Writes references until their owner is dropped.
fn write(
    paths: &InstancePaths,
    incoming: &Receiver<ReferenceV1>,
    results: &Sender<Result<(), Failure>>,
) -> Result<(), Failure> {
    paths.become_owner()?;
    let bus = running_bus(paths)?;
    let mut watch = Watch::of(&bus)?;
    let mut writer = bus.writer(&REFERENCE)?;
    let mut health = bus.observer(&Role::Daemon.health())?;
    let mut heard_at = Time::now();
    while let Ok(reference) = incoming.recv() {
        let now = Time::now();
        watch.check(now)?;
        while health.receive()?.is_some() {
            heard_at = now;
        }
        if now.since(heard_at) > SILENCE {
            let text = "the daemon is silent, so that nobody follows this reference; connect again once it runs";
            return Err(Failure::new(Exit::Peer, text));
        }
        writer.send(0, Stamps::default(), reference)?;
        if results.send(Ok(())).is_err() {
            break;
        }
    }
    Ok(())
}

/// Watch over the files of the instance.
pub struct Watch(InstanceWatch, Time);

impl Watch {
    /// Watch over the instance of `bus`.
    pub fn of(bus: &Bus) -> Result<Self, Failure> {
        Ok(Self(bus.watch()?, Time::UNSET))
    }

    /// Fails if files of the instance were removed, so that its processes no longer reach this one.
    pub fn check(&mut self, now: Time) -> Result<(), Failure> {
        let Self(files, due) = self;
        if now < *due {
            return Ok(());
        }
        *due = now + WATCH_PERIOD;
        match files.check().into_iter().find(|file| !file.is_restored) {
            None => Ok(()),
            Some(file) => {
                let text = format!(
                    "{} was removed, the instance has ended; connect again",
                    file.path.display()
                );
                Err(Failure::new(Exit::Peer, text))
            }
        }
    }
}

/// Registers the class.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    PROCESS.get_or_init(std::process::id);
    module.add_class::<Connection>()
}
