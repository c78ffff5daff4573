//! The recording sink.

use std::io;
use std::path::{Path, PathBuf};

use oqtal_bus::code::{Answer, InputKind, SafetyState};
use oqtal_bus::message::{EventV1, InputV1, PoseV1, TelemetryV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Sample};
use oqtal_config::{ClockKind, Config, read_waypoints};

use super::cdr;
use super::channel::Channel;
use super::chunk::McapMessage;
use super::closing::closing_facts;
use super::facts::{AT_START, CONFIG_FILE, Facts, WAYPOINTS_FILE, waypoints_of_request};
use super::fault_schedule::FaultSchedule;
use super::scene::{self, LogSeverity, ScenePose};
use super::thread::{FilePlan, RecordingResult, RecordingThread};
use super::truth::TruthSelection;
use super::writer::Preamble;
use crate::event::{self, DaemonCondition};
use crate::flight::Flight;
use crate::provenance::Provenance;
use crate::sink::{Reception, Sink};

/// Time between two recorded clock offsets.
const CLOCK_PERIOD: Span = Span::from_millis(1000);

/// Contents, build and files of a recording.
#[derive(Debug)]
pub struct RecordingPlan<'a> {
    /// Path of the first file.
    pub path: PathBuf,
    /// The effective configuration.
    pub config: &'a Config,
    /// The build that records.
    pub provenance: Provenance,
    /// Whether further files are started after the size and duration of `[record]`.
    pub rotates: bool,
    /// Reports that a file cannot be attached, and, once, that writing has failed.
    pub complain: fn(&str),
}

/// Recorder of every sample into MCAP files.
#[derive(Debug)]
pub struct McapRecorder {
    thread: RecordingThread,
    /// Offset from message instants to times of the file; zero in virtual time.
    wall_offset: Span,
    is_real: bool,
    /// Number of messages so far, by channel.
    sequences: Vec<u32>,
    /// Time of the latest message in the file \[ns since the epoch\].
    latest: u64,
    truth: TruthSelection,
    scratch: Vec<u8>,
    /// State of the daemon in its last tick.
    condition: Option<DaemonCondition>,
    /// Source of the daemon's messages; `None` before the first.
    daemon: Option<u64>,
    clock_due: Time,
    faults: FaultSchedule,
    /// The waypoint file, and its text when the recording began; `None` if the configuration names none.
    waypoints: Option<(PathBuf, Option<String>)>,
}

impl McapRecorder {
    /// Topics recorded in a flight under `config`.
    pub fn topics(config: &Config) -> Vec<ObservedTopic> {
        use ObservedTopic::{External, PoseRead, State, VehicleRead};
        let is_published = |topic: &ObservedTopic| match topic {
            // Published only if injected faults alter the daemon's inputs.
            PoseRead | VehicleRead => !config.fault.inject.is_empty(),
            State | External => config.control.is_external(),
            _ => true,
        };
        ObservedTopic::all().filter(is_published).collect()
    }

    /// Creates the first file and starts the writing thread.
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
        let file = config.trajectory.waypoints_file.clone();
        let waypoints = file.map(|file| {
            let told = |error: &_| {
                complain(&format!("{}: {error}: a replay needs this file", file.display()));
            };
            let text = read_waypoints(&file).inspect_err(told).ok();
            (file, text)
        });
        let text = waypoints.as_ref().and_then(|(_, text)| text.clone());
        let preamble = preamble(config, *provenance, wall_offset, text);
        Ok(Self {
            thread: RecordingThread::start(files, preamble)?,
            wall_offset,
            is_real,
            sequences: vec![0; Channel::all().count()],
            latest: 0,
            truth: TruthSelection::new(limits.truth_hz),
            scratch: Vec::with_capacity(1024),
            condition: None,
            daemon: None,
            clock_due: Time::UNSET,
            faults: FaultSchedule::of(config),
            waypoints,
        })
    }

    /// Records a table of facts.
    pub fn facts(&mut self, facts: Facts) {
        self.thread.facts(facts);
    }

    /// Whether writing has failed.
    pub fn has_failed(&self) -> bool {
        self.thread.has_failed()
    }

    /// Records the offset of the wall clock once a second in real time, and writes messages that are old at `now`, an instant of
    /// the monotonic clock. To be called with every poll.
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

    /// Records the closing facts of `flight` and finishes the recording.
    pub fn close(mut self, flight: &Flight) -> RecordingResult {
        self.facts(closing_facts(flight));
        self.finish()
    }

    /// Records the waiting messages, closes the file, and ends the thread.
    pub fn finish(mut self) -> RecordingResult {
        self.truth.choose_newest();
        self.record_truth();
        self.thread.finish()
    }

    /// Queues the encoded message in `scratch`; returns its header.
    fn put(&mut self, channel: Channel, received_at: Time, published_at: Time) -> McapMessage {
        let number = Channel::all().position(|other| other == channel);
        let number = number.expect("every channel is in the list");
        // A selected truth sample may have waited for its tick; the times in a file do not decrease.
        self.latest = self.latest.max((received_at + self.wall_offset).nanos());
        self.sequences[number] = self.sequences[number].wrapping_add(1);
        let message = McapMessage {
            channel: number as u16,
            sequence: self.sequences[number],
            log_time: self.latest,
            publish_time: (published_at + self.wall_offset).nanos(),
        };
        self.thread.message(message, &self.scratch);
        message
    }

    /// Records a sample published at an instant.
    fn record(&mut self, reception: &Reception, sample: Sample<'_>, at: Time) -> McapMessage {
        cdr::encode(&reception.header, sample.body(), &mut self.scratch);
        let published_at = if at.is_set() { at } else { reception.received_at };
        self.put(Channel::Topic(sample.topic()), reception.received_at, published_at)
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

    /// Records an event as text.
    fn event(&mut self, at: (Time, Time), severity: LogSeverity, entry: (&str, &str)) {
        let (received_at, happened_at) = at;
        let nanos = (happened_at + self.wall_offset).nanos();
        scene::write_log(nanos, severity, entry, &mut self.scratch);
        self.put(Channel::Events, received_at, happened_at);
    }

    /// Records the truth samples that were selected.
    fn record_truth(&mut self) {
        for (reception, truth) in self.truth.take() {
            self.record(&reception, Sample::Truth(&truth), truth.time);
            let pose = (truth.time, truth.position, truth.attitude);
            self.show(Channel::True, reception.received_at, pose);
        }
    }

    /// Records the injected faults and disturbances that have begun or ended at `now`.
    fn note_faults(&mut self, received_at: Time, now: Time) {
        while let Some((at, source, text)) = self.faults.due(now) {
            self.event((received_at, at), LogSeverity::Warning, (source, &text));
        }
    }

    /// Records a change of the daemon's state.
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

    /// Records which daemon publishes. Another daemon has the settings of its own configuration; the message of its start may be lost.
    fn note_daemon(&mut self, source: u64, starts: bool) {
        if self.daemon.replace(source).is_some_and(|last| last != source) || starts {
            self.thread.clear_repeated();
        }
    }

    fn pose(&mut self, reception: &Reception, pose: &PoseV1) {
        let stamps = &reception.header.stamps;
        self.record(reception, Sample::Pose(pose), stamps.pose_published_at);
        if pose.tracked == 1 {
            let pose = (stamps.captured_at, pose.position, pose.attitude);
            self.show(Channel::Measured, reception.received_at, pose);
        }
    }

    fn telemetry(&mut self, reception: &Reception, telemetry: &TelemetryV1) {
        let (at, received_at) = (telemetry.time, reception.received_at);
        self.note_daemon(reception.header.source, false);
        self.note_faults(received_at, at);
        // The truth first: a reader of the file needs it before the tick.
        self.truth.tick(at);
        self.record_truth();
        self.record(reception, Sample::Telemetry(telemetry), at);
        let TelemetryV1 { position, attitude, reference_position, attitude_command, .. } =
            *telemetry;
        // The estimate is that of the newest accepted pose, the reference that of the tick.
        let captured_at = telemetry.pose_captured_at;
        let estimated_at = if captured_at.is_set() { captured_at } else { at };
        self.show(Channel::Estimate, received_at, (estimated_at, position, attitude));
        self.show(Channel::Transform, received_at, (estimated_at, position, attitude));
        self.show(Channel::Reference, received_at, (at, reference_position, attitude_command));
        self.note_condition(received_at, telemetry);
    }

    fn operator_event(&mut self, reception: &Reception, event: &EventV1) {
        // Events use the machine's clock, also in virtual time.
        let time = if self.is_real { event.time } else { reception.received_at };
        let message = self.record(reception, Sample::Event(event), time);
        if event::changes_settings(event) {
            self.thread.repeat(event, message, &self.scratch);
        }
        self.attach_waypoints(reception.header.source, event);
        let at = (reception.received_at, time);
        self.event(at, LogSeverity::Info, ("daemon", &event::of_operator(event)));
    }

    /// Attaches the waypoint file that a request names: a replay flies its points, whatever becomes of the file.
    fn attach_waypoints(&mut self, source: u64, event: &EventV1) {
        let lines = event.text.as_str().lines();
        let value = lines.filter_map(|line| line.strip_prefix("trajectory.waypoints-file=")).next();
        let is_refused = event.answer == Answer::Refused.code();
        let Some(path) = value.filter(|_| !is_refused).map(|value| value.trim_matches('"')) else {
            return;
        };
        // Without it a replay reports which file it needs.
        if let Ok(content) = read_waypoints(Path::new(path)) {
            self.thread.file(waypoints_file((source, event.number), content));
        }
    }

    /// Attaches the waypoint file for the daemon `source`, which has just started, if it was edited since the recording began.
    fn attach_edited_waypoints(&mut self, source: u64) {
        let Some((file, known)) = &self.waypoints else { return };
        if let Ok(text) = read_waypoints(file)
            && Some(&text) != known.as_ref()
        {
            self.thread.file(waypoints_file((source, AT_START), text));
        }
    }

    fn input(&mut self, reception: &Reception, input: &InputV1) {
        let is_start = input.kind == InputKind::Start.code();
        self.note_daemon(reception.header.source, is_start);
        if is_start {
            self.attach_edited_waypoints(reception.header.source);
        }
        self.record(reception, Sample::Input(input), input.time);
        if let Some(text) = event::of_input(input) {
            let at = (reception.received_at, input.time);
            self.event(at, LogSeverity::Info, ("daemon", &text));
        }
    }
}

/// First records of every file, with the text of the waypoint file, if there is one.
fn preamble(
    config: &Config,
    provenance: Provenance,
    wall_offset: Span,
    waypoints: Option<String>,
) -> Preamble {
    let settings = (CONFIG_FILE.to_owned(), "application/toml", config.to_toml().into_bytes());
    let waypoints =
        waypoints.map(|text| (WAYPOINTS_FILE.to_owned(), "text/csv", text.into_bytes()));
    Preamble {
        facts: vec![Facts::of_recording(config, provenance, wall_offset), Facts::of_machine()],
        files: [settings].into_iter().chain(waypoints).collect(),
        library: format!("oqtal {}", provenance.version),
    }
}

/// Attachment with the waypoints that the daemon `source` read for the request `number`.
fn waypoints_file((source, number): (u64, u64), text: String) -> (String, &'static str, Vec<u8>) {
    (waypoints_of_request(source, number), "text/csv", text.into_bytes())
}

impl Sink for McapRecorder {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        let stamps = &reception.header.stamps;
        let published_at = match sample {
            Sample::Truth(truth) => {
                self.note_faults(reception.received_at, truth.time);
                self.truth.sample((*reception, *truth));
                return self.record_truth();
            }
            Sample::Telemetry(telemetry) => return self.telemetry(reception, telemetry),
            Sample::Pose(pose) => return self.pose(reception, pose),
            Sample::Event(event) => return self.operator_event(reception, event),
            Sample::Input(input) => return self.input(reception, input),
            Sample::Command(command) => {
                self.faults.command(&reception.header, command);
                stamps.command_published_at
            }
            Sample::Vehicle(vehicle) => {
                self.faults.vehicle(vehicle);
                stamps.applied_at
            }
            Sample::Reference(reference) => reference.time,
            // Health messages use the machine's clock, also in virtual time.
            Sample::Health(_, health) if self.is_real => health.time,
            Sample::State(state) => state.time,
            Sample::External(answer) => answer.asked_at,
            Sample::PoseRead(_) | Sample::VehicleRead(_) | Sample::Health(..) => Time::UNSET,
        };
        self.record(reception, sample, published_at);
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        let at = Time::from_nanos(self.latest) - self.wall_offset;
        let text = format!("{count} samples of `{topic}` were lost before they were recorded");
        self.event((at, at), LogSeverity::Error, ("recording", &text));
    }
}
