//! A flight through separate processes over the bus, in real time or in lockstep.

use oqtal_bus::bus::Bus;
use oqtal_bus::paths::{InstancePaths, quoted};
use oqtal_bus::topic::Role;
use oqtal_config::{ClockKind, RecordedFlights};
use oqtal_control::controller::ControllerName;
use oqtal_daemon::LawPort;
use oqtal_lab::mission::Mission;
use oqtal_lab::simulation::{self, RecordedFlight};
use oqtal_observe::flight::Flight;
use oqtal_observe::kernel::OneProcessor;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::recorder::Recorder;
use oqtal_observe::recording::McapRecorder;
use oqtal_runtime::process::{Exit, Failure, instance_paths};
use oqtal_runtime::program::say;
use oqtal_runtime::stop::StopFlag;

use super::directory::FlightDirectory;
use super::flight_record;
use super::paths::FlightPaths;
use super::process_group::ProcessGroup;
use super::progress::{FlightProgress, Interrupts, tell_interrupt};
use super::recording::FlightRecording;
use super::watch::ProcessWatch;

/// Flight through processes: its mission, paths, directory, and operator interrupts.
#[derive(Debug)]
pub struct BusFlight<'a> {
    /// The mission.
    pub mission: &'a Mission,
    /// Paths of commands and poses.
    pub paths: &'a FlightPaths,
    /// Directory of configuration, logs and results.
    pub directory: &'a FlightDirectory,
    /// Interrupts of the operator.
    pub interrupts: &'a Interrupts,
}

impl BusFlight<'_> {
    /// Starts the processes, flies, ends the processes, and removes their files on the bus.
    ///
    /// # Errors
    /// A process could not be started, did not answer, or ended in flight.
    pub fn fly(&self) -> Result<RecordedFlight, Failure> {
        let paths = instance_paths(&self.mission.config)?;
        let result = self.fly_at(&paths);
        // Leaving the instance as the last process removes the shared memory of killed processes.
        drop(Bus::open(&paths));
        result
    }

    /// Flies in this process, with progress and interrupts in the terminal.
    ///
    /// # Errors
    /// An operator interrupted a flight that had not begun, or the recording cannot be written.
    pub fn fly_in_process(&self) -> Result<RecordedFlight, Failure> {
        let recording = self.recording(&[RecordedFlights::All])?;
        let progress = FlightProgress::new(self.mission);
        let flown =
            simulation::fly_recorded(self.mission, recording, LawPort::default(), |recorder| {
                progress.show(recorder);
                self.interrupts.next().inspect(|command| tell_interrupt(*command))
            });
        progress.finish();
        flown
    }

    /// Recording of this flight; `None` unless `[record]` requests one of `kinds`.
    fn recording(&self, kinds: &[RecordedFlights]) -> Result<Option<McapRecorder>, Failure> {
        let wanted = kinds.contains(&self.mission.config.record.flights);
        wanted.then(|| flight_record::begin(self.mission, self.directory)).transpose()
    }

    /// Fails if another process has the place of one of this flight: it must not be used for it. A simulator is refused also
    /// beside a vehicle and cameras at links: its truth would be recorded as theirs.
    fn refuse_running_processes(&self, bus: &Bus) -> Result<(), Failure> {
        let InstancePaths { instance, .. } = bus.paths();
        let roles = self.paths.roles(&self.mission.config).into_iter();
        for role in roles.filter(|role| *role != Role::Recorder).chain([Role::Plant]) {
            let Some(holder) = bus.holder(&role.health())? else { continue };
            let message = format!(
                "{holder} already runs on instance `{instance}`; fly on another --instance, or land its vehicle with `oqtal ctl land {}` and end it",
                bus.paths().flags()
            );
            return Err(Failure::new(Exit::Peer, message));
        }
        Ok(())
    }

    /// `failure` of a process, with the command that shows the flight until then, if it was recorded.
    fn with_recording(&self, failure: Failure) -> Failure {
        let Failure { exit, mut message } = failure;
        if self.directory.recording().is_file() {
            let directory = quoted(&self.directory.path().display().to_string());
            message += &format!("\nrecorded until then: `oqtal report {directory}`");
        }
        Failure::new(exit, message)
    }

    fn fly_at(&self, paths: &InstancePaths) -> Result<RecordedFlight, Failure> {
        let bus = Bus::open(paths)?;
        let config = &self.mission.config;
        self.refuse_running_processes(&bus).inspect_err(|_| self.directory.discard())?;
        // The readers are opened before any process publishes.
        let recording = self.recording(&[RecordedFlights::Processes, RecordedFlights::All])?;
        let topics = match recording {
            Some(_) => McapRecorder::topics(config),
            None => Recorder::TOPICS.to_vec(),
        };
        let observer = BusObserver::open(&bus, &topics)?;
        let lockstep = config.clock.kind == ClockKind::Lockstep;
        let _one_processor = lockstep.then(OneProcessor::bind);
        if lockstep && config.control.controller == ControllerName::External {
            say(&format!(
                "oqtal: the flight begins when a law connects at {}",
                paths.law().display()
            ));
        }
        let (flight, interrupts) = ((self.mission, self.paths), self.interrupts);
        let mut processes = ProcessGroup::start(flight, self.directory, interrupts)?;
        let stop = StopFlag::default();
        let watch = ProcessWatch::new(paths, config, &stop);
        let flight = std::thread::scope(|threads| {
            let (watch, processes, interrupts) = (&watch, &mut processes, self.interrupts);
            threads.spawn(move || watch.run(processes, interrupts));
            // The watch ends with the recording in any case.
            let _over = watch.end_on_drop();
            let link = &self.paths.commands;
            FlightRecording { mission: self.mission, link, bus: &bus, stop: &stop }
                .run(observer, recording)
        });
        processes.shut_down();
        let flown = match watch.into_failure() {
            None => flight,
            Some(failure) => {
                let has_ticks = flight.is_ok_and(|(flight, _)| !flight.samples.is_empty());
                Err(if has_ticks { self.with_recording(failure) } else { failure })
            }
        };
        flown.inspect(|(flight, _)| report_missing_rights(flight))
    }
}

/// Reports the real-time settings that were requested but not granted by the kernel. In virtual time none are requested.
fn report_missing_rights(flight: &Flight) {
    let Some(daemon) = &flight.daemon else { return };
    let missing = daemon.realtime.missing(&flight.config.realtime);
    if flight.config.clock.kind == ClockKind::Real && !missing.is_empty() {
        say(&format!(
            "oqtal: this machine did not grant {}; `oqtal doctor` names the remedies",
            missing.join(" and ")
        ));
    }
}
