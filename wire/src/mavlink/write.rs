//! Payloads of messages, from their meaning: fields in the order of the wire.

use super::autopilot::AutopilotFirmware;
use super::axes::{vector_axes, wire_angles, wire_quaternion};
use super::command::{CommandKind, FORCE, VehicleCommandLong};
use super::content::{
    AttitudeTarget, MavlinkAttitude, MavlinkContent, MavlinkHeartbeat, MavlinkPose,
    MavlinkPosition, MavlinkText, SetpointKind, TextSeverity,
};
use super::parameter::ParameterValue;
use super::payload::{MavlinkId, MavlinkPayload};

/// MAV_TYPE_QUADROTOR.
const QUADROTOR: u8 = 2;
/// MAV_TYPE_ONBOARD_CONTROLLER.
const ONBOARD_CONTROLLER: u8 = 18;
/// MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.
const CUSTOM_MODE_ENABLED: u8 = 1;
/// MAV_MODE_FLAG_HIL_ENABLED \[-\].
pub(super) const HIL_ENABLED: u8 = 32;
/// MAV_MODE_FLAG_SAFETY_ARMED \[-\].
pub(super) const SAFETY_ARMED: u8 = 128;
/// MAV_STATE_ACTIVE.
const ACTIVE: u8 = 4;
/// Version of the protocol in a heartbeat.
const MAVLINK_VERSION: u8 = 3;
/// ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE: body rates and thrust \[-\].
pub(super) const RATES_MASK: u8 = 128;
/// ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE and …_BODY_PITCH_RATE_IGNORE: attitude, yaw rate and thrust \[-\].
pub(super) const ATTITUDE_MASK: u8 = 1 | 2;
/// Nothing ignored: attitude, rates and thrust \[-\].
pub(super) const ATTITUDE_AND_RATES_MASK: u8 = 0;
/// MAV_FRAME_LOCAL_FRD, MAV_FRAME_BODY_FRD: frames of a pose \[-\].
pub(super) const POSE_FRAMES: [u8; 2] = [20, 12];
/// MAV_ESTIMATOR_TYPE_VISION. PX4 passes poses of a motion-capture system to a topic that its estimator does not read \[-\].
pub(super) const VISION: u8 = 2;
/// Quality of a pose \[%\].
const QUALITY: u8 = 100;
/// MAV_SEVERITY_CRITICAL.
const CRITICAL: u8 = 2;
/// MAV_SEVERITY_INFO.
const INFO: u8 = 6;
/// MAV_SYS_STATUS_SENSOR_3D_GYRO.
const GYROSCOPE: u32 = 1;
/// Place on earth of the world's origin: arbitrary, off the poles, where autopilots have a model of the magnetic field
/// \[1e-7 deg, 1e-7 deg, mm\].
const ORIGIN: [i32; 3] = [473_977_419, 85_455_938, 488_000];

/// Id and payload of the message with this meaning; `None` for [`MavlinkContent::Other`], and for messages that are only received.
pub(super) fn message(content: &MavlinkContent) -> Option<(u32, MavlinkPayload)> {
    use MavlinkContent as C;
    let mut payload = MavlinkPayload::new();
    let to = &mut payload;
    let id = match content {
        C::Heartbeat(heartbeat) => put_heartbeat(to, heartbeat),
        C::Battery(volts) => put_system_status(to, *volts),
        C::Timesync(sync) => {
            to.u64(sync.answered.cast_unsigned()).u64(sync.asked.cast_unsigned());
            MavlinkId::TIMESYNC
        }
        C::AttitudeTarget(target) => put_attitude_target(to, target),
        C::Odometry(pose) => put_odometry(to, pose),
        C::VisionPosition(pose) => put_vision_position(to, pose),
        C::GlobalOrigin { system } => put_global_origin(to, *system),
        C::Command(command) => put_command(to, command),
        C::Acknowledged { command, result, target } => {
            // Progress and detail are not stated.
            to.u16(*command).u8(result.code()).u8(0).u32(0);
            to.u8(target.system).u8(target.component);
            MavlinkId::COMMAND_ACK
        }
        C::Text(text) => put_text(to, text),
        C::ParameterRequest { .. } | C::ParameterSet { .. } | C::Parameter { .. } => {
            return parameter(content);
        }
        C::Position(position) => put_position(to, position),
        C::Attitude(attitude) => put_attitude(to, attitude),
        C::Estimator(flags) => {
            // Time and quality of the estimate are not stated.
            to.u64(0).f32s(&[0.0; 8]).u16(*flags);
            MavlinkId::ESTIMATOR_STATUS
        }
        C::Truth(_) | C::Other => return None,
    };
    Some((id, payload))
}

/// Message about a parameter; `None` for any other content.
fn parameter(content: &MavlinkContent) -> Option<(u32, MavlinkPayload)> {
    let mut payload = MavlinkPayload::new();
    let to = &mut payload;
    let id = match content {
        MavlinkContent::ParameterRequest { target, name } => {
            // By name, not by index.
            to.u16(u16::MAX).u8(target.system).u8(target.component).put(&name.0);
            MavlinkId::PARAM_REQUEST_READ
        }
        MavlinkContent::ParameterSet { target, name, value } => {
            to.f32s(&[value.raw]).u8(target.system).u8(target.component);
            to.put(&name.0).u8(type_code(value));
            MavlinkId::PARAM_SET
        }
        MavlinkContent::Parameter { name, value } => {
            // One parameter, whose index is not stated.
            to.f32s(&[value.raw]).u16(1).u16(u16::MAX).put(&name.0).u8(type_code(value));
            MavlinkId::PARAM_VALUE
        }
        _ => return None,
    };
    Some((id, payload))
}

/// MAV_PARAM_TYPE of a value: an integer of at most 32 bits, or a real number.
fn type_code(value: &ParameterValue) -> u8 {
    match value.code {
        code @ 1..=ParameterValue::INT32 => code,
        _ => ParameterValue::REAL32,
    }
}

fn put_heartbeat(to: &mut MavlinkPayload, heartbeat: &MavlinkHeartbeat) -> u32 {
    let flag = |is_set: bool, flag: u8| if is_set { flag } else { 0 };
    let is_autopilot = heartbeat.autopilot != AutopilotFirmware::None;
    to.u32(heartbeat.custom_mode)
        .u8(if is_autopilot { QUADROTOR } else { ONBOARD_CONTROLLER })
        .u8(heartbeat.autopilot.code())
        .u8(CUSTOM_MODE_ENABLED
            | flag(heartbeat.is_armed, SAFETY_ARMED)
            | flag(heartbeat.is_simulated, HIL_ENABLED))
        .u8(ACTIVE)
        .u8(MAVLINK_VERSION);
    MavlinkId::HEARTBEAT
}

fn put_system_status(to: &mut MavlinkPayload, volts: f64) -> u32 {
    // `as` saturates; u16::MAX means "not measured".
    let millivolts = if volts.is_nan() { u16::MAX } else { (volts * 1000.0).round() as u16 };
    // A gyroscope that is present, enabled and healthy; the load is not stated.
    to.u32(GYROSCOPE).u32(GYROSCOPE).u32(GYROSCOPE).u16(0);
    // Current and remaining charge are not measured; no errors.
    to.u16(millivolts).u16(u16::MAX).put(&[0; 12]).u8(u8::MAX);
    MavlinkId::SYS_STATUS
}

fn put_attitude_target(to: &mut MavlinkPayload, target: &AttitudeTarget) -> u32 {
    let (mask, quaternion, rates) = match target.kind {
        SetpointKind::Rates(rates) => (RATES_MASK, [1.0, 0.0, 0.0, 0.0], rates),
        SetpointKind::Attitude { attitude, yaw_rate } => {
            (ATTITUDE_MASK, wire_quaternion(attitude), [0.0, 0.0, yaw_rate])
        }
        SetpointKind::AttitudeAndRates { attitude, yaw_rate } => {
            (ATTITUDE_AND_RATES_MASK, wire_quaternion(attitude), [0.0, 0.0, yaw_rate])
        }
    };
    to.u32(target.time_ms).f32s(&quaternion).f32s(&single(vector_axes(rates)));
    to.f32s(&[target.thrust as f32]).u8(target.target.system).u8(target.target.component).u8(mask);
    MavlinkId::SET_ATTITUDE_TARGET
}

fn single(vector: [f64; 3]) -> [f32; 3] {
    vector.map(|number| number as f32)
}

/// Upper right triangle of the covariance of a pose: diagonal.
fn covariance(pose: &MavlinkPose) -> [f32; 21] {
    let mut triangle = [0.0; 21];
    for place in [0, 6, 11] {
        triangle[place] = pose.position_sd_m.powi(2) as f32;
    }
    for place in [15, 18, 20] {
        triangle[place] = pose.attitude_sd_rad.powi(2) as f32;
    }
    triangle
}

fn put_odometry(to: &mut MavlinkPayload, pose: &MavlinkPose) -> u32 {
    // NaN: velocity, rates and their covariance are not measured.
    let mut unknown = [0.0; 21];
    unknown[0] = f32::NAN;
    to.u64(pose.time_us).f32s(&single(vector_axes(pose.position)));
    to.f32s(&wire_quaternion(pose.attitude)).f32s(&[f32::NAN; 6]);
    to.f32s(&covariance(pose)).f32s(&unknown).put(&POSE_FRAMES);
    // The reset counter is 0.
    to.u8(0).u8(VISION).u8(QUALITY);
    MavlinkId::ODOMETRY
}

fn put_vision_position(to: &mut MavlinkPayload, pose: &MavlinkPose) -> u32 {
    to.u64(pose.time_us).f32s(&single(vector_axes(pose.position)));
    to.f32s(&wire_angles(pose.attitude)).f32s(&covariance(pose));
    MavlinkId::VISION_POSITION_ESTIMATE
}

fn put_global_origin(to: &mut MavlinkPayload, system: u8) -> u32 {
    for number in ORIGIN {
        to.u32(number.cast_unsigned());
    }
    to.u8(system);
    MavlinkId::SET_GPS_GLOBAL_ORIGIN
}

fn put_command(to: &mut MavlinkPayload, command: &VehicleCommandLong) -> u32 {
    let number = |is: bool| f32::from(u8::from(is));
    let parameters = match command.kind {
        CommandKind::SetMode { mode, sub_mode } => [1.0, mode as f32, sub_mode as f32],
        CommandKind::Arm { run, is_forced } => [number(run), FORCE * number(is_forced), 0.0],
        CommandKind::MessageInterval { message, interval_us } => {
            [message as f32, interval_us as f32, 0.0]
        }
        CommandKind::RequestMessage { message } => [message as f32, 0.0, 0.0],
        CommandKind::Reboot => [1.0, 0.0, 0.0],
    };
    // Four further parameters.
    to.f32s(&parameters).f32s(&[0.0; 4]).u16(command.kind.number());
    to.u8(command.target.system).u8(command.target.component).u8(command.confirmation);
    MavlinkId::COMMAND_LONG
}

fn put_text(to: &mut MavlinkPayload, text: &MavlinkText) -> u32 {
    let severity = match text.severity {
        TextSeverity::Trouble => CRITICAL,
        TextSeverity::Information => INFO,
    };
    // The id of a text in pieces is 0.
    to.u8(severity).put(&text.text).u16(0).u8(text.piece);
    MavlinkId::STATUSTEXT
}

fn put_position(to: &mut MavlinkPayload, position: &MavlinkPosition) -> u32 {
    to.u32(position.time_ms);
    to.f32s(&single(vector_axes(position.position)));
    to.f32s(&single(vector_axes(position.velocity)));
    MavlinkId::LOCAL_POSITION_NED
}

fn put_attitude(to: &mut MavlinkPayload, attitude: &MavlinkAttitude) -> u32 {
    to.u32(attitude.time_ms).f32s(&wire_quaternion(attitude.attitude));
    to.f32s(&single(vector_axes(attitude.rate)));
    MavlinkId::ATTITUDE_QUATERNION
}
