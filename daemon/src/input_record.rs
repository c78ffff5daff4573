//! Records of the inputs of the loop, for topic `input`: with them a replay executes the same turns again.

use oqtal_bus::code::{Cause, InputKind, OperatorCommand};
use oqtal_bus::message::{ControlResponseV1, Header, InputV1, PoseV1, ReferenceV1, VehicleV1};
use oqtal_bus::time::Time;

/// The record of the start of the daemon: `stays` if the automatic flight at start-up was cancelled, with the cause of the Stop in which
/// the daemon begins, `expects_flight` if the command that started the daemon will request one.
pub fn start(now: Time, stays: bool, cause: Cause, expects_flight: bool) -> InputV1 {
    let (kind, stays, cause) = (InputKind::Start.code(), u8::from(stays), cause.code());
    let request = if expects_flight { OperatorCommand::Fly.code() } else { 0 };
    InputV1 { time: now, kind, request, stays, cause, ..InputV1::default() }
}

/// The record of a turn and of the samples taken in it, before its tick.
pub fn of(
    now: Time,
    pose: Option<&(Header, PoseV1)>,
    vehicle: Option<&(Header, VehicleV1)>,
    reference: Option<&(Header, ReferenceV1)>,
) -> InputV1 {
    let (pose_source, pose_number) = pose.map_or((0, 0), |(header, _)| identity(header));
    let (vehicle_source, vehicle_number) = vehicle.map_or((0, 0), |(header, _)| identity(header));
    let (reference_source, reference_number) =
        reference.map_or((0, 0), |(header, _)| identity(header));
    InputV1 {
        time: now,
        reference_source,
        reference_number,
        pose_source,
        pose_number,
        vehicle_source,
        vehicle_number,
        kind: InputKind::Turn.code(),
        ..InputV1::default()
    }
}

/// Writer of a message, and its number among those of the writer.
fn identity(header: &Header) -> (u64, u64) {
    (header.source, header.sequence)
}

/// The record of an operator's request.
pub fn request(now: Time, command: OperatorCommand, response: &ControlResponseV1) -> InputV1 {
    InputV1 {
        time: now,
        kind: InputKind::Request.code(),
        request: command.code(),
        answer: response.answer,
        cause: response.cause,
        ..InputV1::default()
    }
}

/// The record of a loss of files.
pub fn lost_files(now: Time) -> InputV1 {
    InputV1 { time: now, kind: InputKind::FilesLost.code(), ..InputV1::default() }
}

/// Whether the turn changed the state of the daemon: a sample was taken, or a tick was made.
pub fn is_worth_recording(input: &InputV1) -> bool {
    let InputV1 { pose_number, vehicle_number, reference_number, command_sequence, stop, .. } =
        *input;
    let words = [pose_number, vehicle_number, reference_number, command_sequence, u64::from(stop)];
    words.iter().any(|&word| word != 0)
}
