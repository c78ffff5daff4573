//! Meaning of messages of the crate. Numbers that are not finite are kept: whoever uses them checks them.

use mavlink::dialects::common::*;

use super::address::MavlinkAddress;
use super::autopilot::AutopilotFirmware;
use super::axes::{from_wire_angles, from_wire_quaternion, vector_axes};
use super::command::{AckResult, CommandKind, FORCE, VehicleCommandLong};
use super::content::{
    AttitudeTarget, MavlinkAttitude, MavlinkContent, MavlinkHeartbeat, MavlinkPose,
    MavlinkPosition, MavlinkText, MavlinkTruth, SetpointKind, TextSeverity, Timesync,
};
use super::origin;
use super::parameter::{ParameterName, ParameterValue};
use crate::link::AutopilotKind;

/// The meaning of `message`.
pub(super) fn content(message: &MavMessage) -> MavlinkContent {
    use MavlinkContent as C;
    match message {
        MavMessage::HEARTBEAT(heartbeat) => C::Heartbeat(heartbeat_of(heartbeat)),
        MavMessage::SYS_STATUS(status) => C::Battery(battery_v(status)),
        MavMessage::TIMESYNC(sync) => C::Timesync(Timesync { answered: sync.tc1, asked: sync.ts1 }),
        MavMessage::SET_ATTITUDE_TARGET(target) => {
            attitude_target(target).map_or(C::Other, C::AttitudeTarget)
        }
        MavMessage::ODOMETRY(pose) => odometry(pose).map_or(C::Other, C::Odometry),
        MavMessage::VISION_POSITION_ESTIMATE(pose) => C::VisionPosition(vision(pose)),
        MavMessage::COMMAND_LONG(command) => command_long(command).map_or(C::Other, C::Command),
        MavMessage::COMMAND_ACK(ack) => {
            C::Acknowledged { command: ack.command as u16, result: result_of(ack.result) }
        }
        MavMessage::STATUSTEXT(text) => C::Text(text_of(text)),
        MavMessage::PARAM_REQUEST_READ(request) => C::ParameterRequest {
            target: address(request.target_system, request.target_component),
            name: ParameterName(*request.param_id),
        },
        MavMessage::PARAM_SET(set) => C::ParameterSet {
            target: address(set.target_system, set.target_component),
            name: ParameterName(*set.param_id),
            value: value_of(set.param_value, set.param_type),
        },
        MavMessage::PARAM_VALUE(value) => C::Parameter {
            name: ParameterName(*value.param_id),
            value: value_of(value.param_value, value.param_type),
        },
        MavMessage::LOCAL_POSITION_NED(position) => C::Position(local_position(position)),
        MavMessage::ATTITUDE_QUATERNION(attitude) => C::Attitude(attitude_of(attitude)),
        MavMessage::ESTIMATOR_STATUS(status) => C::Estimator(status.flags.bits()),
        MavMessage::SIM_STATE(state) => C::Truth(sim_state(state)),
        MavMessage::HIL_STATE_QUATERNION(state) => C::Truth(hil_state(state)),
        other => origin::system(other).map_or(C::Other, |system| C::GlobalOrigin { system }),
    }
}

fn address(system: u8, component: u8) -> MavlinkAddress {
    MavlinkAddress { system, component }
}

fn heartbeat_of(heartbeat: &HEARTBEAT_DATA) -> MavlinkHeartbeat {
    let autopilot = match heartbeat.autopilot {
        MavAutopilot::MAV_AUTOPILOT_PX4 => AutopilotFirmware::Known(AutopilotKind::Px4),
        MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => {
            AutopilotFirmware::Known(AutopilotKind::ArduPilot)
        }
        MavAutopilot::MAV_AUTOPILOT_INVALID => AutopilotFirmware::None,
        _ => AutopilotFirmware::Unknown,
    };
    MavlinkHeartbeat {
        autopilot,
        custom_mode: heartbeat.custom_mode,
        is_armed: heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED),
        is_simulated: heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_HIL_ENABLED),
    }
}

fn battery_v(status: &SYS_STATUS_DATA) -> f64 {
    match status.voltage_battery {
        // Some autopilots without a sensor send 0.
        0 | u16::MAX => f64::NAN,
        millivolts => f64::from(millivolts) / 1000.0,
    }
}

/// The set-point; `None` for a type mask other than the two that are sent.
fn attitude_target(target: &SET_ATTITUDE_TARGET_DATA) -> Option<AttitudeTarget> {
    let mask = target.type_mask.bits();
    let rates = [target.body_roll_rate, target.body_pitch_rate, target.body_yaw_rate];
    let rates = vector_axes(rates.map(f64::from));
    let kind = match mask {
        0b1000_0000 => SetpointKind::Rates(rates),
        0b0000_0011 => {
            SetpointKind::Attitude { attitude: from_wire_quaternion(target.q), yaw_rate: rates[2] }
        }
        _ => return None,
    };
    Some(AttitudeTarget {
        target: address(target.target_system, target.target_component),
        time_ms: target.time_boot_ms,
        kind,
        thrust: f64::from(target.thrust),
    })
}

/// The pose; `None` for one in other frames, or of an estimator that vehicles do not use.
fn odometry(pose: &ODOMETRY_DATA) -> Option<MavlinkPose> {
    let is_ours = pose.frame_id == MavFrame::MAV_FRAME_LOCAL_FRD
        && pose.child_frame_id == MavFrame::MAV_FRAME_BODY_FRD
        && pose.estimator_type == MavEstimatorType::MAV_ESTIMATOR_TYPE_VISION;
    is_ours.then(|| MavlinkPose {
        time_us: pose.time_usec,
        position: vector_axes([pose.x, pose.y, pose.z].map(f64::from)),
        attitude: from_wire_quaternion(pose.q),
        position_sd_m: f64::from(pose.pose_covariance[0]).sqrt(),
        attitude_sd_rad: f64::from(pose.pose_covariance[15]).sqrt(),
    })
}

fn vision(pose: &VISION_POSITION_ESTIMATE_DATA) -> MavlinkPose {
    MavlinkPose {
        time_us: pose.usec,
        position: vector_axes([pose.x, pose.y, pose.z].map(f64::from)),
        attitude: from_wire_angles([pose.roll, pose.pitch, pose.yaw]),
        position_sd_m: f64::from(pose.covariance[0]).sqrt(),
        attitude_sd_rad: f64::from(pose.covariance[15]).sqrt(),
    }
}

fn command_long(command: &COMMAND_LONG_DATA) -> Option<VehicleCommandLong> {
    let (first, second, third) = (command.param1, command.param2, command.param3);
    let kind = match command.command {
        MavCmd::MAV_CMD_DO_SET_MODE => {
            CommandKind::SetMode { mode: second as u32, sub_mode: third as u32 }
        }
        MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => {
            CommandKind::Arm { run: first > 0.5, is_forced: second == FORCE }
        }
        MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
            CommandKind::MessageInterval { message: first as u32, interval_us: second as u32 }
        }
        MavCmd::MAV_CMD_REQUEST_MESSAGE => CommandKind::RequestMessage { message: first as u32 },
        MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN => CommandKind::Reboot,
        _ => return None,
    };
    let target = address(command.target_system, command.target_component);
    Some(VehicleCommandLong { target, kind, confirmation: command.confirmation })
}

fn result_of(result: MavResult) -> AckResult {
    match result {
        MavResult::MAV_RESULT_ACCEPTED => AckResult::Accepted,
        MavResult::MAV_RESULT_TEMPORARILY_REJECTED => AckResult::TemporarilyRejected,
        MavResult::MAV_RESULT_DENIED => AckResult::Denied,
        MavResult::MAV_RESULT_UNSUPPORTED => AckResult::Unsupported,
        MavResult::MAV_RESULT_FAILED => AckResult::Failed,
        MavResult::MAV_RESULT_IN_PROGRESS => AckResult::InProgress,
        _ => AckResult::OtherResult,
    }
}

fn text_of(text: &STATUSTEXT_DATA) -> MavlinkText {
    let is_trouble = (text.severity as u8) <= MavSeverity::MAV_SEVERITY_WARNING as u8;
    MavlinkText {
        severity: if is_trouble { TextSeverity::Trouble } else { TextSeverity::Information },
        text: *text.text,
        piece: text.chunk_seq,
    }
}

fn value_of(raw: f32, kind: MavParamType) -> ParameterValue {
    let code = kind as u8;
    ParameterValue { raw, is_real: code >= ParameterValue::REAL32, code }
}

fn local_position(position: &LOCAL_POSITION_NED_DATA) -> MavlinkPosition {
    let vector = |vector: [f32; 3]| vector_axes(vector.map(f64::from));
    MavlinkPosition {
        time_ms: position.time_boot_ms,
        position: vector([position.x, position.y, position.z]),
        velocity: vector([position.vx, position.vy, position.vz]),
    }
}

fn attitude_of(attitude: &ATTITUDE_QUATERNION_DATA) -> MavlinkAttitude {
    let ATTITUDE_QUATERNION_DATA { q1, q2, q3, q4, .. } = *attitude;
    let rate = [attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed];
    MavlinkAttitude {
        time_ms: attitude.time_boot_ms,
        attitude: from_wire_quaternion([q1, q2, q3, q4]),
        rate: vector_axes(rate.map(f64::from)),
    }
}

fn sim_state(state: &SIM_STATE_DATA) -> MavlinkTruth {
    MavlinkTruth {
        time_us: None,
        latitude_e7: state.lat_int,
        longitude_e7: state.lon_int,
        altitude_m: f64::from(state.alt),
        // A real number on the wire, which ArduPilot computes from centimetres.
        altitude_step_m: 0.01,
        velocity: vector_axes([state.vn, state.ve, state.vd].map(f64::from)),
        attitude: from_wire_quaternion([state.q1, state.q2, state.q3, state.q4]),
        rate: vector_axes([state.xgyro, state.ygyro, state.zgyro].map(f64::from)),
    }
}

fn hil_state(state: &HIL_STATE_QUATERNION_DATA) -> MavlinkTruth {
    let centimetres = [state.vx, state.vy, state.vz].map(f64::from);
    MavlinkTruth {
        time_us: Some(state.time_usec),
        latitude_e7: state.lat,
        longitude_e7: state.lon,
        altitude_m: f64::from(state.alt) / 1000.0,
        altitude_step_m: 0.001,
        velocity: vector_axes(centimetres.map(|speed| speed / 100.0)),
        attitude: from_wire_quaternion(state.attitude_quaternion),
        rate: vector_axes([state.rollspeed, state.pitchspeed, state.yawspeed].map(f64::from)),
    }
}
