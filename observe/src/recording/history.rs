//! What the daemon took in, turn by turn, from a recording.

use std::collections::HashMap;

use oqtal_bus::code::InputKind;
use oqtal_bus::message::{CommandV1, Header, InputV1, PoseV1, TelemetryV1, VehicleV1};

use crate::sink::{ObservedTopic, Reception, Sink};

/// Writer of a message, and its number among those of the writer.
type Identity = (u64, u64);

/// A record of the daemon's inputs, with the messages that it names.
#[derive(Clone, Debug)]
pub struct RecordedTurn {
    /// The record.
    pub input: InputV1,
    /// The pose taken.
    pub pose: Option<(Header, PoseV1)>,
    /// The vehicle message taken.
    pub vehicle: Option<(Header, VehicleV1)>,
    /// The command published.
    pub command: Option<(Header, CommandV1)>,
    /// The telemetry published.
    pub telemetry: Option<TelemetryV1>,
}

/// The turns of one daemon, from its start to its end.
#[derive(Clone, Debug, Default)]
pub struct DaemonHistory {
    /// The turns; the first is the start.
    pub turns: Vec<RecordedTurn>,
    /// Records that are missing among the turns, by the gaps in their numbers \[-\].
    pub missing: u64,
    source: u64,
    number: u64,
}

impl DaemonHistory {
    /// Whether the history begins with the start of the daemon and has no gap.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        let first = self.turns.first().map(|turn| turn.input.kind);
        first == Some(InputKind::Start.code()) && self.missing == 0
    }
}

/// Collects the histories of all daemons of a recording.
#[derive(Debug, Default)]
pub struct InputHistory {
    histories: Vec<DaemonHistory>,
    poses: HashMap<Identity, (Header, PoseV1)>,
    vehicles: HashMap<Identity, (Header, VehicleV1)>,
    commands: HashMap<Identity, (Header, CommandV1)>,
    /// Samples as the daemon read them, by daemon and number.
    poses_read: HashMap<Identity, PoseV1>,
    vehicles_read: HashMap<Identity, VehicleV1>,
    /// By writer and instant of the tick.
    telemetry: HashMap<(u64, u64), TelemetryV1>,
}

impl InputHistory {
    /// The histories, one for each daemon, in order.
    #[must_use]
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

    /// Whether a turn names a message after the last one recorded: the recording ended between the two.
    fn is_beyond_end(&self, source: u64, turn: &RecordedTurn) -> bool {
        fn is_last<M>(messages: &HashMap<Identity, M>, (source, number): Identity) -> bool {
            !messages.keys().any(|(other, later)| *other == source && *later >= number)
        }
        let InputV1 { pose_source, pose_number, vehicle_source, vehicle_number, .. } = turn.input;
        let command = (source, turn.input.command_sequence);
        (pose_number > 0 && turn.pose.is_none() && is_last(&self.poses, (pose_source, pose_number)))
            || (vehicle_number > 0
                && turn.vehicle.is_none()
                && is_last(&self.vehicles, (vehicle_source, vehicle_number)))
            || (command.1 > 0 && turn.command.is_none() && is_last(&self.commands, command))
            || (turn.input.pose_read > 0
                && turn.pose.is_none()
                && is_last(&self.poses_read, (source, turn.input.pose_read)))
            || (turn.input.vehicle_read > 0
                && turn.vehicle.is_none()
                && is_last(&self.vehicles_read, (source, turn.input.vehicle_read)))
    }

    /// Finds what a turn names and was recorded after it: a message may be published, taken and recorded as taken while an
    /// observer is between two topics.
    fn complete(&self, source: u64, turn: &mut RecordedTurn) {
        let named = self.named(source, turn.input);
        turn.pose = turn.pose.or(named.pose);
        turn.vehicle = turn.vehicle.or(named.vehicle);
        turn.command = turn.command.or(named.command);
        turn.telemetry = self.telemetry.get(&(source, turn.input.time.nanos())).copied();
    }

    /// A record with the messages that it names, as far as they are known.
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
            command: self.commands.get(&(source, input.command_sequence)).copied(),
            telemetry: None,
        }
    }
}

/// A sample as the daemon read it: the copy of that number, or as it was sent if there is none; `None` if the copy is missing.
fn as_read<M: Copy>(
    sent: (Header, M),
    copy: Identity,
    copies: &HashMap<Identity, M>,
) -> Option<(Header, M)> {
    let (header, body) = sent;
    let read = if copy.1 == 0 { body } else { *copies.get(&copy)? };
    Some((header, read))
}

impl Sink for InputHistory {
    fn pose(&mut self, reception: &Reception, pose: &PoseV1) {
        let header = reception.header;
        self.poses.insert((header.source, header.sequence), (header, *pose));
    }

    fn vehicle(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        let header = reception.header;
        self.vehicles.insert((header.source, header.sequence), (header, *vehicle));
    }

    fn command(&mut self, reception: &Reception, command: &CommandV1) {
        let header = reception.header;
        self.commands.insert((header.source, header.sequence), (header, *command));
    }

    fn telemetry(&mut self, reception: &Reception, telemetry: &TelemetryV1) {
        self.telemetry.insert((reception.header.source, telemetry.time.nanos()), *telemetry);
    }

    fn pose_read(&mut self, reception: &Reception, pose: &PoseV1) {
        let Header { source, sequence, .. } = reception.header;
        self.poses_read.insert((source, sequence), *pose);
    }

    fn vehicle_read(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        let Header { source, sequence, .. } = reception.header;
        self.vehicles_read.insert((source, sequence), *vehicle);
    }

    fn input(&mut self, reception: &Reception, input: &InputV1) {
        let Header { source, sequence, .. } = reception.header;
        // Now, not at the end: in a flight in one process numbers begin anew when a process does.
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

    /// Losses show as gaps in the numbers.
    fn lost(&mut self, _: ObservedTopic, _: u64) {}
}
