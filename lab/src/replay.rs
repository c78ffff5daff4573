//! Replay of a recording through the daemon: the daemon's code processes the recorded poses, vehicle messages, wake-ups and
//! requests turn by turn in virtual time.
//!
//! With the same settings every command equals the recorded one bit for bit, since all inputs of the daemon and the instants of
//! its turns are recorded. With other settings a replay is open loop: it computes the daemon's commands for the recorded poses.

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

use oqtal_bus::code::{Actuation, Cause, InputKind, OperatorCommand, SafetyState};
use oqtal_bus::error::BusError;
use oqtal_bus::memory::{MemoryBus, MemoryReader, MemoryWriter};
use oqtal_bus::message::{
    CommandV1, ControlRequestV1, EventV1, ExternalV1, Header, Message, PoseV1, ReferenceV1, Stamps,
    StateV1, TelemetryV1, VehicleV1,
};
use oqtal_bus::stop::StopSwitch;
use oqtal_bus::text::LongText;
use oqtal_bus::time::Time;
use oqtal_bus::topic::{COMMAND, POSE, REFERENCE, TELEMETRY, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_config::Config;
use oqtal_control::trajectory::Waypoints;
use oqtal_daemon::{
    CacheWarmup, Cycle, DaemonPorts, DaemonTurn, ExternalLaw, LawPort, LiveSettings,
    OperatorRequests, Refusal, loop_handoff, reason_of, trajectory_along,
};
use oqtal_observe::recording::{DaemonHistory, RecordedTurn, RecordingFile, WAYPOINTS_FILE};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::turn::{Turn, TurnClock};

use crate::study::args::say_notes;

/// A tick, recorded and replayed.
#[derive(Clone, Copy, Debug)]
pub struct ReplayedTick {
    /// Instant of the tick.
    pub time: Time,
    /// Telemetry of the replayed tick.
    pub telemetry: TelemetryV1,
    /// Replayed command.
    pub command: CommandV1,
    /// Recorded command.
    pub recorded: CommandV1,
    /// Whether commands, stamps and telemetry equal the recorded ones bit for bit.
    pub is_identical: bool,
}

/// A tick without a counterpart.
#[derive(Clone, Copy, Debug)]
pub struct UnmatchedTick {
    /// Instant of the tick.
    pub time: Time,
    /// Whether the tick occurs in the recording; otherwise it occurs in the replay.
    pub is_recorded: bool,
}

/// The result of a replay.
#[derive(Clone, Debug, Default)]
pub struct ReplayResult {
    /// Turns executed \[-\].
    pub turns: u64,
    /// Requests executed \[-\].
    pub requests: u64,
    /// Ticks that occur in the recording and in the replay.
    pub ticks: Vec<ReplayedTick>,
    /// Ticks that occur only in the recording or only in the replay.
    pub unmatched: Vec<UnmatchedTick>,
    /// Number of messages that the daemon received or sent but the recording lacks \[-\].
    pub missing: u64,
}

impl ReplayResult {
    /// The first tick in which the replayed daemon has stopped the motors and the recorded one ran them.
    pub fn own_stop(&self) -> Option<&ReplayedTick> {
        let is_off = |command: &CommandV1| command.actuation == Actuation::Disarmed.code();
        let is_stop = |tick: &&ReplayedTick| {
            tick.telemetry.state == SafetyState::Stop.code() && !is_off(&tick.recorded)
        };
        self.ticks.iter().find(is_stop)
    }

    /// Whether every command equals the recorded one bit for bit.
    pub fn is_identical(&self) -> bool {
        let agree = self.ticks.iter().all(|tick| tick.is_identical);
        agree && self.unmatched.is_empty() && self.missing == 0
    }
}

/// Points of the waypoint files of a recording, by the name of the attachment.
#[derive(Clone, Debug, Default)]
pub struct RecordedWaypoints(BTreeMap<String, Waypoints>);

impl RecordedWaypoints {
    /// The points in `file`.
    ///
    /// # Errors
    /// A waypoint file in the recording is malformed.
    pub fn of(file: &RecordingFile) -> Result<Self, Failure> {
        let names = file.attachments.iter().filter(|(name, _)| name.ends_with(".csv"));
        let parsed = names.map(|(name, bytes)| {
            let points = Waypoints::parse(&String::from_utf8_lossy(bytes)).map_err(|error| {
                Failure::new(Exit::Data, format!("{} ({name}): {error}", file.path.display()))
            })?;
            Ok((name.clone(), points))
        });
        parsed.collect::<Result<_, _>>().map(Self)
    }

    /// The points that the daemon of `history` had at its start.
    fn at_start(&self, history: &DaemonHistory) -> Option<&Waypoints> {
        self.0.get(&history.waypoints_at_start()).or_else(|| self.0.get(WAYPOINTS_FILE))
    }
}

/// Replays the `history` of a daemon under `config`, with the recorded points of its waypoint files.
///
/// # Errors
/// An option of the law is invalid.
pub fn replay(
    config: &Config,
    waypoints: &RecordedWaypoints,
    history: &DaemonHistory,
) -> Result<ReplayResult, Failure> {
    let mut turns = history.turns.iter();
    let Some(start) = turns.next() else { return Ok(ReplayResult::default()) };
    say_notes(note_on_answers(config, history));
    let mut bench = ReplayBench::open(config, waypoints.at_start(history), start)?;
    for turn in turns {
        match InputKind::from_code(turn.input.kind) {
            Some(InputKind::Turn) => bench.turn(turn)?,
            Some(InputKind::Request) => {
                let name = history.waypoints_of_request(turn.input.event);
                bench.settings.expect_waypoints(waypoints.0.get(&name).cloned());
                bench.request(turn)?;
            }
            Some(InputKind::FilesLost) => bench.daemon.cycle.lose_files(turn.input.time),
            Some(InputKind::Start) | None => {}
        }
    }
    Ok(bench.result)
}

/// Note on the commands of an external law under `config` that never answered in `history`; `None` if it did, and for a built-in law.
fn note_on_answers(config: &Config, history: &DaemonHistory) -> Option<String> {
    let mut answers = history.turns.iter().filter_map(|turn| turn.answer.as_ref());
    let has_answered = answers.any(|answer| answer.answered_at.is_set());
    (config.control.is_external() && !has_answered).then(|| {
        let fallback = config.control.built_in().name();
        format!(
            "the recording has no answers of an external law: the commands are those of the fallback law, {fallback}"
        )
    })
}

/// Daemon with writers for its inputs and readers for its outputs.
struct ReplayBench {
    poses: MemoryWriter<PoseV1>,
    vehicles: MemoryWriter<VehicleV1>,
    references: MemoryWriter<ReferenceV1>,
    settings: LiveSettings,
    stop: StopSwitch,
    daemon: DaemonTurn<'static, MemoryBus>,
    /// Recorded answer of an external law in the present turn.
    answer: Rc<Cell<Option<ExternalV1>>>,
    requests: OperatorRequests,
    commands: MemoryReader<CommandV1>,
    telemetry: MemoryReader<TelemetryV1>,
    result: ReplayResult,
}

impl ReplayBench {
    fn open(
        config: &Config,
        waypoints: Option<&Waypoints>,
        start: &RecordedTurn,
    ) -> Result<Self, Failure> {
        let bus = MemoryBus::new();
        let trajectory = trajectory_along(config, waypoints.cloned())?;
        let mut cycle = Cycle::new(config, trajectory, start.input.time)
            .map_err(|error| config.locate(&error))?;
        if start.input.stays == 1 {
            cycle.cancel_automatic(start.input.cause == Cause::EndedInFlight.code());
        }
        if start.input.request == OperatorCommand::Fly.code() {
            cycle.expect_flight();
        }
        let (handle, requests) = loop_handoff();
        let ports = DaemonPorts::open(&bus)?;
        let answer = Rc::new(Cell::new(None));
        let law = LawPort::of(RecordedLaw(Rc::clone(&answer)));
        Ok(Self {
            poses: bus.writer(&POSE)?,
            vehicles: bus.writer(&VEHICLE)?,
            references: bus.writer(&REFERENCE)?,
            settings: LiveSettings::along(config, waypoints.cloned()),
            stop: bus.stop_switch()?,
            daemon: DaemonTurn { ports, cycle, warmup: CacheWarmup::never(), handle, law },
            answer,
            requests,
            commands: bus.observer(&COMMAND)?,
            telemetry: bus.observer(&TELEMETRY)?,
            result: ReplayResult::default(),
        })
    }

    /// Executes a turn with its recorded inputs and instants.
    fn turn(&mut self, turn: &RecordedTurn) -> Result<(), BusError> {
        let RecordedTurn { input, pose, vehicle, reference, command, answer, .. } = turn;
        let taken = [
            (input.pose_number, pose.is_some()),
            (input.vehicle_number, vehicle.is_some()),
            (input.external_number, answer.is_some()),
            (input.reference_number, reference.is_some()),
        ];
        let missing = taken.iter().filter(|(number, is_recorded)| *number != 0 && !is_recorded);
        self.result.missing += missing.count() as u64;
        if let Some((header, pose)) = pose {
            self.poses.forward(*header, *pose);
        }
        if let Some((header, vehicle)) = vehicle {
            self.vehicles.forward(*header, *vehicle);
        }
        let is_told =
            |answer: &ExternalV1| answer.answered_at.is_set() || reason_of(answer).is_some();
        self.answer.set(answer.filter(is_told));
        if let Some((header, reference)) = reference {
            self.references.forward(*header, *reference);
        }
        self.requests.note_configs_differ(input.configs_differ == 1);
        if input.stop == 1 {
            self.stop.raise();
        }
        let stamps = command.map_or_else(Stamps::default, |(header, _)| header.stamps);
        self.daemon.turn(&mut ReplayClock::new(input.time, &stamps))?;
        self.result.turns += 1;
        self.compare(turn)
    }

    /// Compares the outputs of a turn with the recorded outputs.
    fn compare(&mut self, turn: &RecordedTurn) -> Result<(), BusError> {
        let produced = self.commands.latest()?.zip(self.telemetry.latest()?);
        let time = turn.input.time;
        match (produced, turn.input.command_sequence) {
            (None, 0) => {}
            (Some(((header, command), (_, telemetry))), 1..) => {
                let Some((recorded_header, recorded)) = turn.command else {
                    self.result.missing += 1;
                    return Ok(());
                };
                self.result.missing += u64::from(turn.telemetry.is_none());
                let telemetry_agrees =
                    turn.telemetry.is_none_or(|recorded| bits(&recorded) == bits(&telemetry));
                let is_identical = bits(&recorded) == bits(&command)
                    && content(&recorded_header) == content(&header)
                    && telemetry_agrees;
                let tick = ReplayedTick { time, telemetry, command, recorded, is_identical };
                self.result.ticks.push(tick);
            }
            (produced, _) => {
                let is_recorded = produced.is_none();
                self.result.unmatched.push(UnmatchedTick { time, is_recorded });
            }
        }
        Ok(())
    }

    /// Executes a request, unless it was refused before it reached the controller.
    fn request(&mut self, turn: &RecordedTurn) -> Result<(), Failure> {
        let input = &turn.input;
        if let Some(command) = OperatorCommand::from_code(input.request)
            && !Cause::from_code(input.cause).is_some_and(Cause::prevents_execution)
        {
            self.daemon.cycle.notice_configurations(input.configs_differ == 1);
            match &turn.event {
                _ if !command.changes_flight() => {
                    let _ = self.daemon.cycle.request(input.time, command);
                }
                Some(event) => self.change(input.time, command, event)?,
                None => self.result.missing += 1,
            }
            self.result.requests += 1;
        }
        Ok(())
    }

    /// Makes a recorded change of the flight or its settings.
    fn change(
        &mut self,
        now: Time,
        command: OperatorCommand,
        event: &EventV1,
    ) -> Result<(), Failure> {
        let EventV1 { point, yaw, text, .. } = *event;
        let request = ControlRequestV1 { point, yaw, text, ..ControlRequestV1::of(command) };
        let refused = |refusal: Refusal| Failure::new(Exit::Data, refusal.reason);
        let prepared = self.settings.prepare(command, &request);
        // Under other settings than in flight, an undo takes back what it took back in flight.
        let is_other = command == OperatorCommand::Undo
            && prepared.as_ref().ok().is_none_or(|undo| undo.text != text);
        let prepared = match is_other {
            true => self.settings.prepare(OperatorCommand::Set, &with_values(&request)),
            false => prepared,
        };
        let mut prepared = prepared.map_err(refused)?;
        self.settings.commit(&mut prepared);
        self.daemon.cycle.change(now, &mut prepared.change);
        Ok(())
    }
}

/// `request` with the lines of its text that give a key its value.
fn with_values(request: &ControlRequestV1) -> ControlRequestV1 {
    let lines = request.text.as_str().lines().filter(|line| line.contains('='));
    ControlRequestV1 { text: LongText::of_lines(lines).unwrap_or(request.text), ..*request }
}

/// An external law that gives its recorded answers.
struct RecordedLaw(Rc<Cell<Option<ExternalV1>>>);

impl ExternalLaw for RecordedLaw {
    fn reset(&mut self) {}

    fn answer(&mut self, _: &StateV1) -> Option<ExternalV1> {
        self.0.get()
    }
}

/// The bytes of a message.
fn bits<M: Message>(message: &M) -> Vec<u8> {
    let mut bytes = vec![0; M::SIZE];
    message.encode(&mut bytes);
    bytes
}

/// Fields of a header that do not depend on the writer.
fn content(header: &Header) -> (u64, u64, [u64; 8]) {
    (header.sequence, header.pose_sequence, header.stamps.to_words())
}

/// A clock with the recorded instants of a turn, in the order in which the daemon reads them.
struct ReplayClock {
    last: Time,
    instants: std::cell::RefCell<VecDeque<Time>>,
}

impl ReplayClock {
    fn new(woken_at: Time, stamps: &Stamps) -> Self {
        let stamped = [stamps.computed_at, stamps.command_published_at];
        let stamped = stamped.into_iter().filter(|instant| instant.is_set());
        let instants: VecDeque<Time> = std::iter::once(woken_at).chain(stamped).collect();
        let last = instants.back().copied().unwrap_or(woken_at);
        Self { last, instants: std::cell::RefCell::new(instants) }
    }
}

impl TurnClock for ReplayClock {
    fn now(&self) -> Time {
        self.instants.borrow_mut().pop_front().unwrap_or(self.last)
    }

    fn announce<M: Message>(&mut self, _: &impl Publish<M>) -> Result<(), BusError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::message::InputV1;
    use oqtal_config::Setting;

    #[test]
    fn an_external_law_without_recorded_answers_has_a_note_that_names_the_fallback() {
        let config = |name: &str| {
            Config::from_settings(&[Setting::flag("test", "control.controller", name)]).unwrap()
        };
        let history = |answer: Option<ExternalV1>| {
            let (input, event, command) = (InputV1::default(), None, None);
            let (pose, vehicle, reference, telemetry) = (None, None, None, None);
            let turn =
                RecordedTurn { input, pose, vehicle, answer, reference, event, command, telemetry };
            let mut history = DaemonHistory::default();
            history.turns.push(turn);
            history
        };
        let absent = ExternalV1::default();
        let answered = ExternalV1 { answered_at: Time::VIRTUAL_START, ..absent };
        let note = |name, answer| note_on_answers(&config(name), &history(answer));
        for answer in [None, Some(absent)] {
            assert!(note("external", answer).unwrap().ends_with("the fallback law, geometric"));
            assert_eq!(note("oqtal", answer), None);
        }
        assert_eq!(note("external", Some(answered)), None);
    }
}
