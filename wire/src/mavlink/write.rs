//! Messages of the crate, from their meaning.

use mavlink::dialects::common::*;
use mavlink::types::CharArray;

use super::autopilot::AutopilotFirmware;
use super::axes::{vector_axes, wire_angles, wire_quaternion};
use super::command::{AckResult, CommandKind, FORCE, VehicleCommandLong};
use super::content::{
    AttitudeTarget, MavlinkAttitude, MavlinkContent, MavlinkHeartbeat, MavlinkPose,
    MavlinkPosition, MavlinkText, SetpointKind, TextSeverity, Timesync,
};
use super::origin;
use super::parameter::{ParameterName, ParameterValue};
use crate::link::AutopilotKind;

/// The message with this meaning; `None` for [`MavlinkContent::Other`], and for what is only received.
pub(super) fn message(content: &MavlinkContent) -> Option<MavMessage> {
    use MavlinkContent as C;
    Some(match content {
        C::Heartbeat(heartbeat) => MavMessage::HEARTBEAT(heartbeat_of(heartbeat)),
        C::Battery(volts) => MavMessage::SYS_STATUS(system_status(*volts)),
        C::Timesync(Timesync { answered, asked }) => MavMessage::TIMESYNC(TIMESYNC_DATA {
            tc1: *answered,
            ts1: *asked,
            ..TIMESYNC_DATA::DEFAULT
        }),
        C::AttitudeTarget(target) => MavMessage::SET_ATTITUDE_TARGET(attitude_target(target)),
        C::Odometry(pose) => MavMessage::ODOMETRY(odometry(pose)),
        C::VisionPosition(pose) => MavMessage::VISION_POSITION_ESTIMATE(vision(pose)),
        C::GlobalOrigin { system } => origin::message(*system),
        C::Command(command) => MavMessage::COMMAND_LONG(command_long(command)?),
        C::Acknowledged { command, result } => {
            MavMessage::COMMAND_ACK(acknowledgement(*command, *result)?)
        }
        C::Text(text) => MavMessage::STATUSTEXT(status_text(text)),
        C::ParameterRequest { .. } | C::ParameterSet { .. } | C::Parameter { .. } => {
            return parameter(content);
        }
        C::Position(position) => MavMessage::LOCAL_POSITION_NED(local_position(position)),
        C::Attitude(attitude) => MavMessage::ATTITUDE_QUATERNION(attitude_quaternion(attitude)),
        C::Estimator(flags) => MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA {
            flags: EstimatorStatusFlags::from_bits_truncate(*flags),
            ..ESTIMATOR_STATUS_DATA::DEFAULT
        }),
        C::Truth(_) | C::Other => return None,
    })
}

/// The message about a parameter; `None` for any other content.
fn parameter(content: &MavlinkContent) -> Option<MavMessage> {
    Some(match content {
        MavlinkContent::ParameterRequest { target, name } => {
            MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
                param_index: -1,
                target_system: target.system,
                target_component: target.component,
                param_id: name_of(name),
            })
        }
        MavlinkContent::ParameterSet { target, name, value } => {
            MavMessage::PARAM_SET(PARAM_SET_DATA {
                param_value: value.raw,
                target_system: target.system,
                target_component: target.component,
                param_id: name_of(name),
                param_type: type_of(value),
            })
        }
        MavlinkContent::Parameter { name, value } => MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: value.raw,
            param_count: 1,
            param_index: u16::MAX,
            param_id: name_of(name),
            param_type: type_of(value),
        }),
        _ => return None,
    })
}

fn heartbeat_of(heartbeat: &MavlinkHeartbeat) -> HEARTBEAT_DATA {
    let flag = |is_set: bool, flag| if is_set { flag } else { MavModeFlag::empty() };
    let (mavtype, autopilot) = match heartbeat.autopilot {
        AutopilotFirmware::Known(AutopilotKind::Px4) => {
            (MavType::MAV_TYPE_QUADROTOR, MavAutopilot::MAV_AUTOPILOT_PX4)
        }
        AutopilotFirmware::Known(AutopilotKind::ArduPilot) => {
            (MavType::MAV_TYPE_QUADROTOR, MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA)
        }
        AutopilotFirmware::Unknown => {
            (MavType::MAV_TYPE_QUADROTOR, MavAutopilot::MAV_AUTOPILOT_GENERIC)
        }
        AutopilotFirmware::None => {
            (MavType::MAV_TYPE_ONBOARD_CONTROLLER, MavAutopilot::MAV_AUTOPILOT_INVALID)
        }
    };
    HEARTBEAT_DATA {
        custom_mode: heartbeat.custom_mode,
        mavtype,
        autopilot,
        base_mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | flag(heartbeat.is_armed, MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED)
            | flag(heartbeat.is_simulated, MavModeFlag::MAV_MODE_FLAG_HIL_ENABLED),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    }
}

fn system_status(volts: f64) -> SYS_STATUS_DATA {
    let millivolts = (volts * 1000.0).round();
    // `as` keeps a number within its range; one that is none means "not measured".
    let voltage_battery = if volts.is_nan() { u16::MAX } else { millivolts as u16 };
    SYS_STATUS_DATA {
        voltage_battery,
        current_battery: -1,
        battery_remaining: -1,
        ..SYS_STATUS_DATA::DEFAULT
    }
}

fn attitude_target(target: &AttitudeTarget) -> SET_ATTITUDE_TARGET_DATA {
    // Built explicitly: the default of the crate ignores the roll rate.
    let (type_mask, q, rates) = match target.kind {
        SetpointKind::Rates(rates) => (
            AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE,
            [1.0, 0.0, 0.0, 0.0],
            vector_axes(rates),
        ),
        SetpointKind::Attitude { attitude, yaw_rate } => (
            AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
                | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE,
            wire_quaternion(attitude),
            vector_axes([0.0, 0.0, yaw_rate]),
        ),
    };
    let [roll, pitch, yaw] = rates.map(|rate| rate as f32);
    SET_ATTITUDE_TARGET_DATA {
        time_boot_ms: target.time_ms,
        q,
        body_roll_rate: roll,
        body_pitch_rate: pitch,
        body_yaw_rate: yaw,
        thrust: target.thrust as f32,
        target_system: target.target.system,
        target_component: target.target.component,
        type_mask,
        thrust_body: [0.0; 3],
    }
}

/// Upper right triangle of the covariance of a pose: diagonal.
fn covariance(pose: &MavlinkPose) -> [f32; 21] {
    let mut triangle = [0.0; 21];
    let (position, attitude) = (pose.position_sd_m.powi(2), pose.attitude_sd_rad.powi(2));
    for (place, variance) in [0, 6, 11].into_iter().zip([position; 3]) {
        triangle[place] = variance as f32;
    }
    for (place, variance) in [15, 18, 20].into_iter().zip([attitude; 3]) {
        triangle[place] = variance as f32;
    }
    triangle
}

fn odometry(pose: &MavlinkPose) -> ODOMETRY_DATA {
    let [x, y, z] = vector_axes(pose.position).map(|number| number as f32);
    let mut unknown = [0.0; 21];
    unknown[0] = f32::NAN;
    ODOMETRY_DATA {
        time_usec: pose.time_us,
        x,
        y,
        z,
        q: wire_quaternion(pose.attitude),
        // Not measured.
        vx: f32::NAN,
        vy: f32::NAN,
        vz: f32::NAN,
        rollspeed: f32::NAN,
        pitchspeed: f32::NAN,
        yawspeed: f32::NAN,
        pose_covariance: covariance(pose),
        velocity_covariance: unknown,
        frame_id: MavFrame::MAV_FRAME_LOCAL_FRD,
        child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
        reset_counter: 0,
        // PX4 takes one of a motion-capture system to a topic that its estimator does not read.
        estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_VISION,
        quality: 100,
    }
}

fn vision(pose: &MavlinkPose) -> VISION_POSITION_ESTIMATE_DATA {
    let [x, y, z] = vector_axes(pose.position).map(|number| number as f32);
    let [roll, pitch, yaw] = wire_angles(pose.attitude);
    VISION_POSITION_ESTIMATE_DATA {
        usec: pose.time_us,
        x,
        y,
        z,
        roll,
        pitch,
        yaw,
        covariance: covariance(pose),
        reset_counter: 0,
    }
}

fn command_long(command: &VehicleCommandLong) -> Option<COMMAND_LONG_DATA> {
    let number = |is: bool| f32::from(u8::from(is));
    let [param1, param2, param3] = match command.kind {
        CommandKind::SetMode { mode, sub_mode } => [1.0, mode as f32, sub_mode as f32],
        CommandKind::Arm { run, is_forced } => [number(run), FORCE * number(is_forced), 0.0],
        CommandKind::MessageInterval { message, interval_us } => {
            [message as f32, interval_us as f32, 0.0]
        }
        CommandKind::RequestMessage { message } => [message as f32, 0.0, 0.0],
        CommandKind::Reboot => [1.0, 0.0, 0.0],
    };
    Some(COMMAND_LONG_DATA {
        param1,
        param2,
        param3,
        command: number_of_command(command.kind.number())?,
        target_system: command.target.system,
        target_component: command.target.component,
        confirmation: command.confirmation,
        ..COMMAND_LONG_DATA::DEFAULT
    })
}

fn number_of_command(number: u16) -> Option<MavCmd> {
    [
        MavCmd::MAV_CMD_DO_SET_MODE,
        MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        MavCmd::MAV_CMD_REQUEST_MESSAGE,
        MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
    ]
    .into_iter()
    .find(|command| *command as u16 == number)
}

fn acknowledgement(command: u16, result: AckResult) -> Option<COMMAND_ACK_DATA> {
    let result = match result {
        AckResult::Accepted => MavResult::MAV_RESULT_ACCEPTED,
        AckResult::TemporarilyRejected => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
        AckResult::Denied => MavResult::MAV_RESULT_DENIED,
        AckResult::Unsupported => MavResult::MAV_RESULT_UNSUPPORTED,
        AckResult::Failed | AckResult::OtherResult => MavResult::MAV_RESULT_FAILED,
        AckResult::InProgress => MavResult::MAV_RESULT_IN_PROGRESS,
    };
    let command = number_of_command(command)?;
    Some(COMMAND_ACK_DATA { command, result, ..COMMAND_ACK_DATA::DEFAULT })
}

fn status_text(text: &MavlinkText) -> STATUSTEXT_DATA {
    let severity = match text.severity {
        TextSeverity::Trouble => MavSeverity::MAV_SEVERITY_CRITICAL,
        TextSeverity::Information => MavSeverity::MAV_SEVERITY_INFO,
    };
    STATUSTEXT_DATA { severity, text: CharArray::new(text.text), id: 0, chunk_seq: text.piece }
}

fn name_of(name: &ParameterName) -> CharArray<16> {
    CharArray::new(name.0)
}

fn type_of(value: &ParameterValue) -> MavParamType {
    match value.code {
        1 => MavParamType::MAV_PARAM_TYPE_UINT8,
        2 => MavParamType::MAV_PARAM_TYPE_INT8,
        3 => MavParamType::MAV_PARAM_TYPE_UINT16,
        4 => MavParamType::MAV_PARAM_TYPE_INT16,
        5 => MavParamType::MAV_PARAM_TYPE_UINT32,
        ParameterValue::INT32 => MavParamType::MAV_PARAM_TYPE_INT32,
        _ => MavParamType::MAV_PARAM_TYPE_REAL32,
    }
}

fn local_position(position: &MavlinkPosition) -> LOCAL_POSITION_NED_DATA {
    let [x, y, z] = vector_axes(position.position).map(|number| number as f32);
    let [vx, vy, vz] = vector_axes(position.velocity).map(|number| number as f32);
    LOCAL_POSITION_NED_DATA { time_boot_ms: position.time_ms, x, y, z, vx, vy, vz }
}

fn attitude_quaternion(attitude: &MavlinkAttitude) -> ATTITUDE_QUATERNION_DATA {
    let [q1, q2, q3, q4] = wire_quaternion(attitude.attitude);
    let [rollspeed, pitchspeed, yawspeed] = vector_axes(attitude.rate).map(|number| number as f32);
    ATTITUDE_QUATERNION_DATA {
        time_boot_ms: attitude.time_ms,
        q1,
        q2,
        q3,
        q4,
        rollspeed,
        pitchspeed,
        yawspeed,
        ..ATTITUDE_QUATERNION_DATA::DEFAULT
    }
}
