//! Meaning of messages, from their payloads: fields in the order of the wire. Numbers that are not finite are kept: the callers check
//! them.

use super::address::MavlinkAddress;
use super::autopilot::AutopilotFirmware;
use super::axes::{from_wire_angles, from_wire_quaternion, vector_axes};
use super::command::{AckResult, CommandKind, FORCE, VehicleCommandLong};
use super::content::{
    AttitudeTarget, MavlinkAttitude, MavlinkContent, MavlinkHeartbeat, MavlinkPose,
    MavlinkPosition, MavlinkText, MavlinkTruth, SetpointKind, TextSeverity, Timesync,
};
use super::parameter::{ParameterName, ParameterValue};
use super::payload::{MavlinkId, MavlinkPayload};
use super::write::{
    ATTITUDE_AND_RATES_MASK, ATTITUDE_MASK, HIL_ENABLED, POSE_FRAMES, RATES_MASK, SAFETY_ARMED,
    VISION,
};
use crate::bytes::ByteReader;

/// MAV_SEVERITY_WARNING: the least severe of the texts that report trouble.
const WARNING: u8 = 4;

/// Meaning of the message `id` with this payload.
pub(super) fn content(id: u32, payload: &[u8]) -> MavlinkContent {
    let payload = MavlinkPayload::received(payload);
    understood(id, &mut payload.reader()).unwrap_or(MavlinkContent::Other)
}

/// Meaning of a message; `None` for a message that is not used.
fn understood(id: u32, from: &mut ByteReader<'_>) -> Option<MavlinkContent> {
    use MavlinkContent as C;
    Some(match id {
        MavlinkId::HEARTBEAT => C::Heartbeat(heartbeat(from)?),
        MavlinkId::SYS_STATUS => C::Battery(battery_v(from)?),
        MavlinkId::TIMESYNC => C::Timesync(Timesync {
            answered: from.u64()?.cast_signed(),
            asked: from.u64()?.cast_signed(),
        }),
        MavlinkId::SET_ATTITUDE_TARGET => C::AttitudeTarget(attitude_target(from)?),
        MavlinkId::ODOMETRY => C::Odometry(odometry(from)?),
        MavlinkId::VISION_POSITION_ESTIMATE => C::VisionPosition(vision_position(from)?),
        MavlinkId::SET_GPS_GLOBAL_ORIGIN => {
            let [_latitude, _longitude, _altitude] = [from.u32()?, from.u32()?, from.u32()?];
            C::GlobalOrigin { system: from.u8()? }
        }
        MavlinkId::COMMAND_LONG => C::Command(command_long(from)?),
        MavlinkId::COMMAND_ACK => {
            let (command, result) = (from.u16()?, AckResult::from_code(from.u8()?));
            let (_progress, _detail) = (from.u8()?, from.u32()?);
            C::Acknowledged { command, result, target: address(from)? }
        }
        MavlinkId::STATUSTEXT => C::Text(text(from)?),
        MavlinkId::PARAM_REQUEST_READ => {
            let _index = from.u16()?;
            C::ParameterRequest { target: address(from)?, name: ParameterName(from.take()?) }
        }
        MavlinkId::PARAM_SET => {
            let (raw, target) = (from.f32()?, address(from)?);
            let name = ParameterName(from.take()?);
            C::ParameterSet { target, name, value: ParameterValue::new(raw, from.u8()?) }
        }
        MavlinkId::PARAM_VALUE => {
            let (raw, [_count, _index]) = (from.f32()?, [from.u16()?, from.u16()?]);
            let name = ParameterName(from.take()?);
            C::Parameter { name, value: ParameterValue::new(raw, from.u8()?) }
        }
        _ => return motion(id, from),
    })
}

/// Meaning of a message about the motion of a vehicle, or its estimator; `None` for any other.
fn motion(id: u32, from: &mut ByteReader<'_>) -> Option<MavlinkContent> {
    use MavlinkContent as C;
    Some(match id {
        MavlinkId::LOCAL_POSITION_NED => C::Position(MavlinkPosition {
            time_ms: from.u32()?,
            position: vector(from)?,
            velocity: vector(from)?,
        }),
        MavlinkId::ATTITUDE_QUATERNION => C::Attitude(MavlinkAttitude {
            time_ms: from.u32()?,
            attitude: quaternion(from)?,
            rate: vector(from)?,
        }),
        MavlinkId::ESTIMATOR_STATUS => {
            let (_time, _quality) = (from.u64()?, from.f32s::<8>()?);
            C::Estimator(from.u16()?)
        }
        MavlinkId::EKF_STATUS_REPORT => {
            let _variances = from.f32s::<5>()?;
            C::Estimator(from.u16()?)
        }
        MavlinkId::SIM_STATE => C::Truth(sim_state(from)?),
        MavlinkId::HIL_STATE_QUATERNION => C::Truth(hil_state(from)?),
        _ => return None,
    })
}

fn address(from: &mut ByteReader<'_>) -> Option<MavlinkAddress> {
    Some(MavlinkAddress { system: from.u8()?, component: from.u8()? })
}

/// Vector in our axes.
fn vector(from: &mut ByteReader<'_>) -> Option<[f64; 3]> {
    from.f32s().map(|numbers| vector_axes(numbers.map(f64::from)))
}

/// Attitude in our axes, scalar last.
fn quaternion(from: &mut ByteReader<'_>) -> Option<[f64; 4]> {
    from.f32s().map(from_wire_quaternion)
}

fn heartbeat(from: &mut ByteReader<'_>) -> Option<MavlinkHeartbeat> {
    let (custom_mode, [_type, autopilot, base_mode]) = (from.u32()?, from.take()?);
    Some(MavlinkHeartbeat {
        autopilot: AutopilotFirmware::from_code(autopilot),
        custom_mode,
        is_armed: base_mode & SAFETY_ARMED != 0,
        is_simulated: base_mode & HIL_ENABLED != 0,
    })
}

fn battery_v(from: &mut ByteReader<'_>) -> Option<f64> {
    let (_sensors, _load) = (from.bytes(12)?, from.u16()?);
    Some(match from.u16()? {
        // Some autopilots without a sensor send 0.
        0 | u16::MAX => f64::NAN,
        millivolts => f64::from(millivolts) / 1000.0,
    })
}

/// Set-point; `None` for a type mask other than those that are sent.
fn attitude_target(from: &mut ByteReader<'_>) -> Option<AttitudeTarget> {
    let (time_ms, attitude) = (from.u32()?, quaternion(from)?);
    let (rates, thrust) = (vector(from)?, f64::from(from.f32()?));
    let target = address(from)?;
    let kind = match from.u8()? {
        RATES_MASK => SetpointKind::Rates(rates),
        ATTITUDE_MASK => SetpointKind::Attitude { attitude, yaw_rate: rates[2] },
        ATTITUDE_AND_RATES_MASK => SetpointKind::AttitudeAndRates { attitude, yaw_rate: rates[2] },
        _ => return None,
    };
    Some(AttitudeTarget { target, time_ms, kind, thrust })
}

/// Standard deviations of position \[m\] and attitude \[rad\], from the upper right triangle of the covariance.
fn deviations(from: &mut ByteReader<'_>) -> Option<[f64; 2]> {
    let triangle = from.f32s::<21>()?;
    Some([triangle[0], triangle[15]].map(|variance| f64::from(variance).sqrt()))
}

/// Pose; `None` for one in other frames, or of an estimator that vehicles do not use.
fn odometry(from: &mut ByteReader<'_>) -> Option<MavlinkPose> {
    let (time_us, position, attitude) = (from.u64()?, vector(from)?, quaternion(from)?);
    let _velocity_and_rates = from.f32s::<6>()?;
    let [position_sd_m, attitude_sd_rad] = deviations(from)?;
    let _velocity_covariance = from.f32s::<21>()?;
    let (frames, [_reset, estimator]) = (from.take()?, from.take()?);
    let is_ours = frames == POSE_FRAMES && estimator == VISION;
    is_ours.then_some(MavlinkPose { time_us, position, attitude, position_sd_m, attitude_sd_rad })
}

fn vision_position(from: &mut ByteReader<'_>) -> Option<MavlinkPose> {
    let (time_us, position) = (from.u64()?, vector(from)?);
    let attitude = from_wire_angles(from.f32s()?);
    let [position_sd_m, attitude_sd_rad] = deviations(from)?;
    Some(MavlinkPose { time_us, position, attitude, position_sd_m, attitude_sd_rad })
}

/// Command; `None` if it is not supported.
fn command_long(from: &mut ByteReader<'_>) -> Option<VehicleCommandLong> {
    let [first, second, third, ..] = from.f32s::<7>()?;
    let kind = match from.u16()? {
        CommandKind::SET_MODE => {
            CommandKind::SetMode { mode: second as u32, sub_mode: third as u32 }
        }
        CommandKind::ARM => CommandKind::Arm { run: first > 0.5, is_forced: second == FORCE },
        CommandKind::MESSAGE_INTERVAL => {
            CommandKind::MessageInterval { message: first as u32, interval_us: second as u32 }
        }
        CommandKind::REQUEST_MESSAGE => CommandKind::RequestMessage { message: first as u32 },
        CommandKind::REBOOT => CommandKind::Reboot,
        _ => return None,
    };
    Some(VehicleCommandLong { target: address(from)?, kind, confirmation: from.u8()? })
}

fn text(from: &mut ByteReader<'_>) -> Option<MavlinkText> {
    let severity =
        if from.u8()? <= WARNING { TextSeverity::Trouble } else { TextSeverity::Information };
    let (text, _id) = (from.take()?, from.u16()?);
    Some(MavlinkText { severity, text, piece: from.u8()? })
}

fn sim_state(from: &mut ByteReader<'_>) -> Option<MavlinkTruth> {
    let attitude = quaternion(from)?;
    let [_euler_angles, _acceleration] = [from.f32s::<3>()?, from.f32s::<3>()?];
    let rate = vector(from)?;
    let [_latitude, _longitude, altitude] = from.f32s()?;
    let _deviations = from.f32s::<2>()?;
    Some(MavlinkTruth {
        time_us: None,
        velocity: vector(from)?,
        latitude_e7: from.i32()?,
        longitude_e7: from.i32()?,
        altitude_m: f64::from(altitude),
        // A real number on the wire, which ArduPilot computes from centimetres.
        altitude_step_m: 0.01,
        attitude,
        rate,
    })
}

fn hil_state(from: &mut ByteReader<'_>) -> Option<MavlinkTruth> {
    let (time_us, attitude, rate) = (from.u64()?, quaternion(from)?, vector(from)?);
    let [latitude_e7, longitude_e7, altitude_mm] = [from.i32()?, from.i32()?, from.i32()?];
    let speed_cm_s = [from.i16()?, from.i16()?, from.i16()?];
    Some(MavlinkTruth {
        time_us: Some(time_us),
        latitude_e7,
        longitude_e7,
        altitude_m: f64::from(altitude_mm) / 1000.0,
        altitude_step_m: 0.001,
        velocity: vector_axes(speed_cm_s.map(|speed| f64::from(speed) / 100.0)),
        attitude,
        rate,
    })
}
