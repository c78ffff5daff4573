//! The sink that records.

use std::io;
use std::path::PathBuf;

use oqtal_bus::code::SafetyState;
use oqtal_bus::message::{
    CommandV1, HealthV1, InputV1, Message, PoseV1, TelemetryV1, TruthV1, VehicleV1,
};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_config::{ClockKind, Config};

use super::cdr;
use super::channel::{Channel, HEALTH};
use super::closing::ClosingFacts;
use super::facts::{CONFIG_FILE, Facts, WAYPOINTS_FILE};
use super::fault_schedule::FaultSchedule;
use super::scene::{self, LogSeverity, ScenePose};
use super::thread::{FilePlan, RecordingResult, RecordingThread};
use super::truth::TruthSelection;
use super::writer::{McapMessage, Preamble};
use crate::event::{self, DaemonCondition};
use crate::flight::Flight;
use crate::provenance::Provenance;
use crate::sink::{ObservedTopic, Reception, Sink};

/// Time between two recorded clock offsets.
const CLOCK_PERIOD: Span = Span::from_millis(1000);

/// What is recorded, by which build, into which files.
#[derive(Debug)]
pub struct RecordingPlan<'a> {
    /// The first file.
    pub path: PathBuf,
    /// The effective configuration.
    pub config: &'a Config,
    /// The build that records.
    pub provenance: Provenance,
    /// Whether other files follow, after the size and duration of `[record]`.
    pub rotates: bool,
    /// Tells people, once, that nothing more can be written.
    pub complain: fn(&str),
}

/// Records every sample into MCAP files.
#[derive(Debug)]
pub struct McapRecorder {
    thread: RecordingThread,
    /// From instants of messages to times of the file; zero in virtual time.
    wall_offset: Span,
    is_real: bool,
    /// Messages so far by channel.
    sequences: Vec<u32>,
    /// Time of the latest message in the file \[ns since the epoch\].
    latest: u64,
    truth: TruthSelection,
    scratch: Vec<u8>,
    /// Condition of the daemon in its last tick.
    condition: Option<DaemonCondition>,
    clock_due: Time,
    faults: FaultSchedule,
}

impl McapRecorder {
    /// The topics that are recorded in a flight under `config`.
    #[must_use]
    pub fn topics(config: &Config) -> Vec<ObservedTopic> {
        let topics = Channel::all().filter_map(|channel| match channel {
            // Published where faults by hand alter what the daemon reads.
            Channel::Topic(ObservedTopic::PoseRead | ObservedTopic::VehicleRead)
                if config.fault.inject.is_empty() =>
            {
                None
            }
            Channel::Topic(topic) => Some(topic),
            _ => None,
        });
        topics.collect()
    }

    /// Creates the first file and starts the thread that writes.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(plan: &RecordingPlan<'_>) -> io::Result<Self> {
        let RecordingPlan { path, config, provenance, rotates, complain } = plan;
        let is_real = config.clock.kind == ClockKind::Real;
        let wall_offset = if is_real { Time::wall_offset() } else { Span::ZERO };
        let limits = &config.record;
        let files = FilePlan {
            path: path.clone(),
            max_bytes: rotates.then_some((limits.file_mb * 1e6) as u64),
            max_ns: rotates.then_some((limits.file_min * 60e9) as u64),
            waits: !is_real,
            complain: *complain,
        };
        let preamble = preamble(config, *provenance, wall_offset)?;
        Ok(Self {
            thread: RecordingThread::start(files, preamble)?,
            wall_offset,
            is_real,
            sequences: vec![0; Channel::all().count()],
            latest: 0,
            truth: TruthSelection::new(limits.truth_hz),
            scratch: Vec::with_capacity(1024),
            condition: None,
            clock_due: Time::UNSET,
            faults: FaultSchedule::of(config),
        })
    }

    /// Records a table of facts.
    pub fn facts(&mut self, facts: Facts) {
        self.thread.facts(facts);
    }

    /// Whether nothing more can be written.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        self.thread.has_failed()
    }

    /// Records the offset of the wall clock, once a second in real time; `now` is an instant of the monotonic clock. To be called
    /// with every poll: messages that have waited for others are written.
    pub fn note_clock(&mut self, now: Time) {
        if !self.is_real {
            return;
        }
        self.thread.hand_over_at((now + self.wall_offset).nanos());
        if now < self.clock_due {
            return;
        }
        self.clock_due = now + CLOCK_PERIOD;
        scene::write_clock(now.nanos(), Time::wall_offset().nanos(), &mut self.scratch);
        self.put(Channel::Clock, now, now);
    }

    /// Records what is known of `flight` now that it is over, and finishes.
    #[must_use]
    pub fn close(mut self, flight: &Flight) -> RecordingResult {
        self.facts(ClosingFacts::of(flight).to_facts());
        self.finish()
    }

    /// Records what waits, closes the file, and ends the thread.
    #[must_use]
    pub fn finish(mut self) -> RecordingResult {
        self.choose_truth(|truth, choose| truth.finish(choose));
        self.thread.finish()
    }

    /// Queues the encoded message in `scratch`.
    fn put(&mut self, channel: Channel, received_at: Time, published_at: Time) {
        let Some(number) = Channel::all().position(|other| other == channel) else { return };
        // A chosen sample of the truth may have waited for its tick: times of a file never go back.
        self.latest = self.latest.max((received_at + self.wall_offset).nanos());
        self.sequences[number] = self.sequences[number].wrapping_add(1);
        let message = McapMessage {
            channel: number as u16,
            sequence: self.sequences[number],
            log_time: self.latest,
            publish_time: (published_at + self.wall_offset).nanos(),
        };
        self.thread.message(message, &self.scratch);
    }

    /// Records a message of a topic, published at an instant.
    fn record<M: Message>(&mut self, topic: ObservedTopic, sample: (&Reception, &M), at: Time) {
        let (reception, body) = sample;
        cdr::encode(&reception.header, body, &mut self.scratch);
        let published_at = if at.is_set() { at } else { reception.received_at };
        self.put(Channel::Topic(topic), reception.received_at, published_at);
    }

    /// Records a pose for viewers.
    fn show(&mut self, channel: Channel, received_at: Time, pose: (Time, [f64; 3], [f64; 4])) {
        let (at, position, attitude) = pose;
        if !position.iter().all(|coordinate| coordinate.is_finite()) {
            return;
        }
        let pose = ScenePose { at_ns: (at + self.wall_offset).nanos(), position, attitude };
        match channel {
            Channel::Transform => pose.write_transform("vehicle", &mut self.scratch),
            _ => pose.write_pose(&mut self.scratch),
        }
        self.put(channel, received_at, at);
    }

    /// Records an event in words.
    fn event(&mut self, at: (Time, Time), severity: LogSeverity, entry: (&str, &str)) {
        let (received_at, happened_at) = at;
        let nanos = (happened_at + self.wall_offset).nanos();
        scene::write_log(nanos, severity, entry, &mut self.scratch);
        self.put(Channel::Events, received_at, happened_at);
    }

    /// Records the samples of the truth that `work` chooses.
    fn choose_truth(
        &mut self,
        work: impl FnOnce(&mut TruthSelection, &mut dyn FnMut(&(Reception, TruthV1))),
    ) {
        let mut chosen = Vec::new();
        work(&mut self.truth, &mut |sample| chosen.push(*sample));
        for (reception, truth) in &chosen {
            self.record(ObservedTopic::Truth, (reception, truth), truth.time);
            let pose = (truth.time, truth.position, truth.attitude);
            self.show(Channel::True, reception.received_at, pose);
        }
    }

    /// Records the faults by hand and disturbances that have begun or ended at `now`.
    fn note_faults(&mut self, received_at: Time, now: Time) {
        while let Some((at, source, text)) = self.faults.due(now) {
            self.event((received_at, at), LogSeverity::Warning, (source, &text));
        }
    }

    /// Records a change of the daemon's condition.
    fn note_condition(&mut self, received_at: Time, telemetry: &TelemetryV1) {
        let condition = DaemonCondition::of(telemetry);
        if self.condition.replace(condition) == Some(condition) {
            return;
        }
        let is_well = condition.state() == Some(SafetyState::Nominal) && !condition.fell_back();
        let severity = match is_well {
            true => LogSeverity::Info,
            false => LogSeverity::Warning,
        };
        let text = condition.to_string();
        self.event((received_at, telemetry.time), severity, ("daemon", &text));
    }
}

/// What every file begins with.
fn preamble(config: &Config, provenance: Provenance, wall_offset: Span) -> io::Result<Preamble> {
    let mut files =
        vec![(CONFIG_FILE.to_owned(), "application/toml", config.to_toml().into_bytes())];
    if let Some(path) = &config.trajectory.waypoints_file {
        files.push((WAYPOINTS_FILE.to_owned(), "text/csv", std::fs::read(path)?));
    }
    Ok(Preamble {
        facts: vec![Facts::of_recording(config, provenance, wall_offset), Facts::of_machine()],
        files,
        library: format!("oqtal {}", provenance.version),
    })
}

impl Sink for McapRecorder {
    fn truth(&mut self, reception: &Reception, truth: &TruthV1) {
        self.note_faults(reception.received_at, truth.time);
        let sample = (*reception, *truth);
        self.choose_truth(|selection, choose| selection.sample(sample, choose));
    }

    fn pose(&mut self, reception: &Reception, pose: &PoseV1) {
        let stamps = &reception.header.stamps;
        self.record(ObservedTopic::Pose, (reception, pose), stamps.pose_published_at);
        if pose.tracked == 1 {
            let pose = (stamps.captured_at, pose.position, pose.attitude);
            self.show(Channel::Measured, reception.received_at, pose);
        }
    }

    fn pose_read(&mut self, reception: &Reception, pose: &PoseV1) {
        self.record(ObservedTopic::PoseRead, (reception, pose), Time::UNSET);
    }

    fn vehicle_read(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        self.record(ObservedTopic::VehicleRead, (reception, vehicle), Time::UNSET);
    }

    fn command(&mut self, reception: &Reception, command: &CommandV1) {
        self.faults.command(&reception.header, command);
        let at = reception.header.stamps.command_published_at;
        self.record(ObservedTopic::Command, (reception, command), at);
    }

    fn vehicle(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        self.faults.vehicle(vehicle);
        let at = reception.header.stamps.applied_at;
        self.record(ObservedTopic::Vehicle, (reception, vehicle), at);
    }

    fn telemetry(&mut self, reception: &Reception, telemetry: &TelemetryV1) {
        let at = telemetry.time;
        self.note_faults(reception.received_at, at);
        // The truth first: whoever reads the file knows it when the tick comes.
        self.choose_truth(|selection, choose| selection.tick(at, choose));
        self.record(ObservedTopic::Telemetry, (reception, telemetry), at);
        let received_at = reception.received_at;
        let TelemetryV1 { position, attitude, reference_position, attitude_command, .. } =
            *telemetry;
        self.show(Channel::Estimate, received_at, (at, position, attitude));
        self.show(Channel::Transform, received_at, (at, position, attitude));
        self.show(Channel::Reference, received_at, (at, reference_position, attitude_command));
        self.note_condition(received_at, telemetry);
    }

    fn input(&mut self, reception: &Reception, input: &InputV1) {
        self.record(ObservedTopic::Input, (reception, input), input.time);
        if let Some(text) = event::of_input(input) {
            let at = (reception.received_at, input.time);
            self.event(at, LogSeverity::Info, ("daemon", &text));
        }
    }

    fn health(&mut self, reception: &Reception, role: Role, health: &HealthV1) {
        if HEALTH.contains(&role) {
            // Health keeps the machine's time, which is not that of a flight in virtual time.
            let at = if self.is_real { health.time } else { Time::UNSET };
            self.record(ObservedTopic::Health(role), (reception, health), at);
        }
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        let at = Time::from_nanos(self.latest) - self.wall_offset;
        let text = format!("{count} samples of `{topic}` were lost before they were recorded");
        self.event((at, at), LogSeverity::Error, ("recording", &text));
    }
}
