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
    /// By writer and instant of the tick.
    telemetry: HashMap<(u64, u64), TelemetryV1>,
}

impl InputHistory {
    /// The histories, one for each daemon, in order.
    #[must_use]
    pub fn finish(mut self) -> Vec<DaemonHistory> {
        for history in &mut self.histories {
            for turn in &mut history.turns {
                turn.telemetry =
                    self.telemetry.get(&(history.source, turn.input.time.nanos())).copied();
            }
        }
        self.histories
    }
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

    fn input(&mut self, reception: &Reception, input: &InputV1) {
        let Header { source, sequence, .. } = reception.header;
        let starts = input.kind == InputKind::Start.code();
        let is_other = self.histories.last().is_none_or(|history| history.source != source);
        if starts || is_other {
            // A daemon counts its records from 1.
            let number = if starts { sequence - 1 } else { 0 };
            self.histories.push(DaemonHistory { source, number, ..DaemonHistory::default() });
        }
        let Some(history) = self.histories.last_mut() else { return };
        history.missing += sequence.saturating_sub(history.number + 1);
        history.number = sequence;
        // The messages were recorded before the record that names them: numbers begin anew when a process does.
        history.turns.push(RecordedTurn {
            input: *input,
            pose: self.poses.get(&(input.pose_source, input.pose_number)).copied(),
            vehicle: self.vehicles.get(&(input.vehicle_source, input.vehicle_number)).copied(),
            command: self.commands.get(&(source, input.command_sequence)).copied(),
            telemetry: None,
        });
    }

    /// Losses show as gaps in the numbers.
    fn lost(&mut self, _: ObservedTopic, _: u64) {}
}
