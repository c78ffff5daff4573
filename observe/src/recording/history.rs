//! Inputs of the daemon in a recording, turn by turn.

use std::collections::HashMap;

use oqtal_bus::code::InputKind;
use oqtal_bus::message::{
    CommandV1, EventV1, ExternalV1, Header, InputV1, PoseV1, ReferenceV1, TelemetryV1, VehicleV1,
};
use oqtal_bus::topic::Sample;

use super::facts::{AT_START, waypoints_of_request};
use crate::sink::{Reception, Sink};

/// Writer of a message, and message number of that writer.
type Identity = (u64, u64);

/// Record of the daemon's inputs in one turn, with the messages that it refers to.
#[derive(Clone, Debug)]
pub struct RecordedTurn {
    /// The record.
    pub input: InputV1,
    /// The pose taken.
    pub pose: Option<(Header, PoseV1)>,
    /// The vehicle message taken.
    pub vehicle: Option<(Header, VehicleV1)>,
    /// The answer of an external law, or the record that there was none.
    pub answer: Option<ExternalV1>,
    /// The planner's reference taken.
    pub reference: Option<(Header, ReferenceV1)>,
    /// The request that changed the flight or its settings.
    pub event: Option<EventV1>,
    /// The command published.
    pub command: Option<(Header, CommandV1)>,
    /// The telemetry published.
    pub telemetry: Option<TelemetryV1>,
}

/// Turns of one daemon, from start to end.
#[derive(Clone, Debug, Default)]
pub struct DaemonHistory {
    /// The turns; the first is the start.
    pub turns: Vec<RecordedTurn>,
    /// Number of missing turn records, from gaps in their numbers \[-\].
    pub missing: u64,
    source: u64,
    number: u64,
}

impl DaemonHistory {
    /// Whether the history begins with the start of the daemon and has no gap.
    pub fn is_complete(&self) -> bool {
        let first = self.turns.first().map(|turn| turn.input.kind);
        first == Some(InputKind::Start.code()) && self.missing == 0
    }

    /// Name of the attachment with the waypoints that the daemon read at its start, if these are not those of the beginning of the
    /// recording.
    pub fn waypoints_at_start(&self) -> String {
        waypoints_of_request(self.source, AT_START)
    }

    /// Name of the attachment with the waypoints that the request `number` named.
    pub fn waypoints_of_request(&self, number: u64) -> String {
        waypoints_of_request(self.source, number)
    }
}

/// Collector of the histories of all daemons of a recording.
#[derive(Debug, Default)]
pub struct InputHistory {
    histories: Vec<DaemonHistory>,
    poses: HashMap<Identity, (Header, PoseV1)>,
    vehicles: HashMap<Identity, (Header, VehicleV1)>,
    answers: HashMap<Identity, ExternalV1>,
    references: HashMap<Identity, (Header, ReferenceV1)>,
    /// Events by daemon and number of the request.
    events: HashMap<Identity, EventV1>,
    commands: HashMap<Identity, (Header, CommandV1)>,
    /// Samples as read by the daemon, by daemon and number.
    poses_read: HashMap<Identity, PoseV1>,
    vehicles_read: HashMap<Identity, VehicleV1>,
    /// Telemetry by writer and instant of the tick.
    telemetry: HashMap<(u64, u64), TelemetryV1>,
}

impl InputHistory {
    /// Histories, one per daemon, in order.
    pub fn finish(mut self) -> Vec<DaemonHistory> {
        let mut histories = std::mem::take(&mut self.histories);
        for history in &mut histories {
            for turn in &mut history.turns {
                self.complete(history.source, turn);
            }
            let end =
                history.turns.iter().position(|turn| self.is_beyond_end(history.source, turn));
            history.turns.truncate(end.unwrap_or(history.turns.len()));
        }
        histories
    }

    /// Whether a turn refers to a message after the last recorded one: the recording ended between the two.
    fn is_beyond_end(&self, source: u64, turn: &RecordedTurn) -> bool {
        fn is_missing<M, T>(
            found: Option<T>,
            messages: &HashMap<Identity, M>,
            (source, number): Identity,
        ) -> bool {
            let is_last =
                || !messages.keys().any(|(other, later)| *other == source && *later >= number);
            number > 0 && found.is_none() && is_last()
        }
        let RecordedTurn { input, pose, vehicle, answer, reference, command, .. } = turn;
        let named = (input.reference_source, input.reference_number);
        let is_later = |(other, at): &(u64, u64)| *other == source && *at > input.time.nanos();
        let lacks_telemetry = turn.telemetry.is_none() && input.command_sequence > 0;
        lacks_telemetry && !self.telemetry.keys().any(is_later)
            || is_missing(*pose, &self.poses, (input.pose_source, input.pose_number))
            || is_missing(*vehicle, &self.vehicles, (input.vehicle_source, input.vehicle_number))
            || is_missing(*answer, &self.answers, (source, input.external_number))
            || is_missing(*reference, &self.references, named)
            || is_missing(*command, &self.commands, (source, input.command_sequence))
            || is_missing(*pose, &self.poses_read, (source, input.pose_read))
            || is_missing(*vehicle, &self.vehicles_read, (source, input.vehicle_read))
    }

    /// Adds messages that a turn refers to and that were recorded after it: a message may be published, read and recorded as read while an
    /// observer is polling another topic.
    fn complete(&self, source: u64, turn: &mut RecordedTurn) {
        let named = self.named(source, turn.input);
        turn.pose = turn.pose.or(named.pose);
        turn.vehicle = turn.vehicle.or(named.vehicle);
        turn.answer = turn.answer.or(named.answer);
        turn.reference = turn.reference.or(named.reference);
        turn.event = turn.event.or(named.event);
        turn.command = turn.command.or(named.command);
        turn.telemetry = self.telemetry.get(&(source, turn.input.time.nanos())).copied();
    }

    /// Turn of `input` with the messages that it refers to, as far as they were recorded.
    fn named(&self, source: u64, input: InputV1) -> RecordedTurn {
        RecordedTurn {
            input,
            pose: self
                .poses
                .get(&(input.pose_source, input.pose_number))
                .and_then(|sent| as_read(*sent, (source, input.pose_read), &self.poses_read)),
            vehicle: self
                .vehicles
                .get(&(input.vehicle_source, input.vehicle_number))
                .and_then(|sent| as_read(*sent, (source, input.vehicle_read), &self.vehicles_read)),
            answer: self.answers.get(&(source, input.external_number)).copied(),
            reference: self
                .references
                .get(&(input.reference_source, input.reference_number))
                .copied(),
            event: self.events.get(&(source, input.event)).copied(),
            command: self.commands.get(&(source, input.command_sequence)).copied(),
            telemetry: None,
        }
    }
}

/// A sample as read by the daemon: the altered copy with this number, or the original if there is no copy number; `None` if the
/// copy is missing.
fn as_read<M: Copy>(
    sent: (Header, M),
    copy: Identity,
    copies: &HashMap<Identity, M>,
) -> Option<(Header, M)> {
    let (header, body) = sent;
    let read = if copy.1 == 0 { body } else { *copies.get(&copy)? };
    Some((header, read))
}

impl InputHistory {
    fn input(&mut self, Header { source, sequence, .. }: Header, input: &InputV1) {
        // Resolved immediately, not at the end: in an in-process flight, numbers restart when a process does.
        let turn = self.named(source, *input);
        let starts = input.kind == InputKind::Start.code();
        let is_other = self.histories.last().is_none_or(|history| history.source != source);
        if starts || is_other {
            let number = sequence.saturating_sub(1);
            self.histories.push(DaemonHistory { source, number, ..DaemonHistory::default() });
        }
        let Some(history) = self.histories.last_mut() else { return };
        history.missing += sequence.saturating_sub(history.number + 1);
        history.number = sequence;
        history.turns.push(turn);
    }
}

impl Sink for InputHistory {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        let header = reception.header;
        let identity = (header.source, header.sequence);
        match sample {
            Sample::Pose(pose) => drop(self.poses.insert(identity, (header, *pose))),
            Sample::Vehicle(vehicle) => drop(self.vehicles.insert(identity, (header, *vehicle))),
            Sample::Command(command) => drop(self.commands.insert(identity, (header, *command))),
            Sample::Telemetry(telemetry) => {
                self.telemetry.insert((header.source, telemetry.time.nanos()), *telemetry);
            }
            Sample::PoseRead(pose) => drop(self.poses_read.insert(identity, *pose)),
            Sample::VehicleRead(vehicle) => drop(self.vehicles_read.insert(identity, *vehicle)),
            Sample::Reference(reference) => {
                self.references.insert(identity, (header, *reference));
            }
            // A request that the loop refused has a second event, which is not made again.
            Sample::Event(event) => {
                self.events.entry((header.source, event.number)).or_insert(*event);
            }
            Sample::Input(input) => self.input(header, input),
            Sample::External(answer) => drop(self.answers.insert(identity, *answer)),
            Sample::Truth(_) | Sample::State(_) | Sample::Health(..) => {}
        }
    }
}
