//! Watch over a flight: ends it when a process ends, and passes operator interrupts to the daemon.

use std::sync::Mutex;
use std::thread::sleep;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{Role, TELEMETRY};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_config::{ClockKind, Config};
use oqtal_operator::end_flight;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::say;
use oqtal_runtime::stop::{SetOnDrop, StopFlag};

use super::fault::{FaultAction, ProcessFaults};
use super::landing::{self, Landing};
use super::process_group::ProcessGroup;
use super::progress::{Interrupts, before_take_off, tell_interrupt};

/// Period of the checks of processes and interrupts.
const WATCH_PERIOD: Span = Span::from_millis(20);

/// Time beyond the longest descent without poses: the daemon ends the flight before.
const DESCENT_MARGIN: Span = Span::from_millis(2000);

/// Note on a vehicle in flight whose bridge has ended.
const FLIES_ON: &str = "\nno command reaches the vehicle any more, not even a stop: it may fly on until its own set-point time-out; land it by remote control";

/// Watches the processes and the operator while the flight is recorded.
#[derive(Debug)]
pub struct ProcessWatch<'a> {
    paths: &'a InstancePaths,
    /// The configuration, with the faults of processes.
    config: &'a Config,
    /// Stops the recording.
    stop: &'a StopFlag,
    /// Stops the watch.
    over: StopFlag,
    failure: Mutex<Option<Failure>>,
}

/// Failure of the camera process in flight, and the time at which the watch ends the flight. Printed when dropped, if not returned before.
struct CameraLoss(Option<(Failure, Time)>);

impl Drop for CameraLoss {
    fn drop(&mut self) {
        self.0.iter().for_each(|(failure, _)| say(&failure.message));
    }
}

impl CameraLoss {
    /// Checks the cameras. In flight the daemon has the time `descent`: it may descend without poses.
    ///
    /// # Errors
    /// The cameras have ended, on the ground or for too long.
    fn check(&mut self, group: &mut ProcessGroup, descent: Option<Span>) -> Result<(), Failure> {
        let now = Time::now();
        if let Some(failure) = group.camera_failure() {
            self.0.get_or_insert((failure, now + descent.unwrap_or(Span::ZERO)));
        }
        self.0.take_if(|(_, until)| now >= *until).map_or(Ok(()), |(failure, _)| Err(failure))
    }
}

impl<'a> ProcessWatch<'a> {
    /// Watch over the flight under `config` at `paths`; sets `stop` when the flight cannot continue.
    pub fn new(paths: &'a InstancePaths, config: &'a Config, stop: &'a StopFlag) -> Self {
        Self { paths, config, stop, over: StopFlag::default(), failure: Mutex::new(None) }
    }

    /// Watches until a process ends, an interrupt cannot be passed on, or the flight has ended.
    pub fn run(&self, processes: &mut ProcessGroup, interrupts: &Interrupts) {
        if let Err(failure) = self.watch(processes, interrupts) {
            self.fail(failure);
        }
    }

    fn watch(&self, processes: &mut ProcessGroup, interrupts: &Interrupts) -> Result<(), Failure> {
        // The flight ends with the watch in any case.
        let _stop = self.stop.set_on_drop();
        let bus = Bus::open(self.paths)?;
        let mut telemetry = bus.reader(&TELEMETRY)?;
        let mut faults = ProcessFaults::open(&bus, self.config)?;
        let (mut landing, mut cameras) = (None, CameraLoss(None));
        let (mut is_in_flight, mut has_flown) = (false, false);
        while !self.over.is_set() {
            cameras.check(processes, is_in_flight.then(|| self.descent()))?;
            self.check_processes(processes, is_in_flight)?;
            self.inject(&mut faults, processes)?;
            if let Some((_, tick)) = telemetry.latest()? {
                is_in_flight = tick.is_armed();
                has_flown |= is_in_flight;
            }
            match interrupts.next() {
                Some(_) if self.config.safety.observe_only => {
                    return Err(Failure::new(Exit::Flight, "interrupted"));
                }
                // No process is asked: a request to land could be read before the one to fly. The processes end, the daemon
                // first, which disarms the vehicle.
                Some(OperatorCommand::Land) if !has_flown => return Err(before_take_off()),
                Some(OperatorCommand::Land) if !is_in_flight => {
                    say("the flight has ended; waiting until the motors are known to be off");
                }
                Some(OperatorCommand::Land) => {
                    tell_interrupt(OperatorCommand::Land);
                    landing = Some(Landing::begin(|| landing::request(self.paths), Time::now()));
                }
                Some(command) => {
                    tell_interrupt(command);
                    landing = None;
                    if !end_flight(self.paths, command) {
                        return Err(Failure::new(Exit::Flight, "interrupted"));
                    }
                }
                None => {}
            }
            landing.as_mut().map_or(Ok(()), |landing| landing.check(Time::now()))?;
            let until_next = faults.next().map_or(WATCH_PERIOD, |next| next.since(Time::now()));
            sleep(until_next.min(WATCH_PERIOD).to_duration());
        }
        Ok(())
    }

    /// Checks the processes that command the vehicle.
    ///
    /// # Errors
    /// One has ended. Without its bridge, a vehicle that is not emulated may fly on.
    fn check_processes(
        &self,
        processes: &mut ProcessGroup,
        is_in_flight: bool,
    ) -> Result<(), Failure> {
        let Some(Failure { exit, message }) = processes.other_failure() else { return Ok(()) };
        let is_emulated = self.config.plant.is_simulated_behind_bridge();
        let flies_on = is_in_flight && !is_emulated && processes.has_lost(Role::Bridge);
        Err(Failure::new(exit, message + if flies_on { FLIES_ON } else { "" }))
    }

    /// Time after the loss of the cameras within which the daemon ends a flight. In virtual time the other processes wait for them.
    fn descent(&self) -> Span {
        let safety = &self.config.safety;
        match self.config.clock.kind {
            ClockKind::Real => {
                Span::from_seconds((safety.coast_ms + safety.descend_ms) * 1e-3) + DESCENT_MARGIN
            }
            _ => Span::ZERO,
        }
    }

    /// Injects the faults that are due.
    fn inject(
        &self,
        faults: &mut ProcessFaults,
        processes: &mut ProcessGroup,
    ) -> Result<(), Failure> {
        while let Some(action) = faults.due(Time::now())? {
            match action {
                FaultAction::Process(role, action) => processes.apply(role, action)?,
                FaultAction::RemoveFiles => self.remove_files()?,
            }
        }
        Ok(())
    }

    fn remove_files(&self) -> Result<(), Failure> {
        let directory = self.paths.directory();
        std::fs::remove_dir_all(&directory).map_err(|error| {
            Failure::new(Exit::System, format!("removing {}: {error}", directory.display()))
        })
    }

    /// Ends the watch when the returned guard is dropped.
    pub fn end_on_drop(&self) -> SetOnDrop {
        self.over.set_on_drop()
    }

    /// The reason why the watch ended the flight; `None` if it did not.
    pub fn into_failure(self) -> Option<Failure> {
        self.failure.into_inner().unwrap_or_else(|poison| poison.into_inner())
    }

    fn fail(&self, failure: Failure) {
        if let Ok(mut slot) = self.failure.lock() {
            *slot = Some(failure);
        }
    }
}
