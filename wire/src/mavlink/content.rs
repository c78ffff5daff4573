//! Meaning of messages.

use super::address::MavlinkAddress;
use super::autopilot::AutopilotFirmware;
use super::command::{AckResult, VehicleCommandLong};
use super::parameter::{ParameterName, ParameterValue};

/// Sign of life, and the state of an autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MavlinkHeartbeat {
    /// Firmware of the sender.
    pub autopilot: AutopilotFirmware,
    /// Mode \[-\]: see [`super::ArduPilotMode`], [`super::Px4Mode`].
    pub custom_mode: u32,
    /// Whether the motors run, or may at any moment.
    pub is_armed: bool,
    /// Whether the vehicle is emulated, or its motors are disconnected.
    pub is_simulated: bool,
}

/// Quantity that a set-point sets besides thrust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SetpointKind {
    /// Body rates \[rad/s, body\].
    Rates([f64; 3]),
    /// Attitude and yaw rate.
    Attitude {
        /// Attitude, scalar last \[body to world\].
        attitude: [f64; 4],
        /// Yaw rate \[rad/s, body z\].
        yaw_rate: f64,
    },
    /// Attitude with body rates, roll and pitch rate zero: ArduPilot ignores an attitude with only some of the rates.
    AttitudeAndRates {
        /// Attitude, scalar last \[body to world\].
        attitude: [f64; 4],
        /// Yaw rate \[rad/s, body z\].
        yaw_rate: f64,
    },
}

/// Set-point, SET_ATTITUDE_TARGET.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeTarget {
    /// The vehicle.
    pub target: MavlinkAddress,
    /// Time since the sender's start \[ms\].
    pub time_ms: u32,
    /// Quantity that is set.
    pub kind: SetpointKind,
    /// Thrust \[0..1\].
    pub thrust: f64,
}

/// Pose of a motion-capture system, ODOMETRY or VISION_POSITION_ESTIMATE.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MavlinkPose {
    /// Instant of capture by the cameras, on the sender's clock \[us\].
    pub time_us: u64,
    /// Position \[m, world\].
    pub position: [f64; 3],
    /// Attitude, scalar last \[body to world\].
    pub attitude: [f64; 4],
    /// Standard deviation of the position, each axis \[m\].
    pub position_sd_m: f64,
    /// Standard deviation of the attitude, each axis \[rad\].
    pub attitude_sd_rad: f64,
}

/// Exchange of clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timesync {
    /// 0 in a request; in an answer the clock of the answering end \[ns\].
    pub answered: i64,
    /// Clock of the requesting end \[ns\].
    pub asked: i64,
}

/// Severity of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TextSeverity {
    /// Something is wrong: emergency to warning.
    Trouble,
    /// Notice, information, debug.
    Information,
}

/// Line of text, or a piece of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MavlinkText {
    /// Severity.
    pub severity: TextSeverity,
    /// The text, zeros behind it.
    pub text: [u8; 50],
    /// Number of this piece of a longer text, from 0 \[-\].
    pub piece: u8,
}

/// Position by the vehicle's own estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MavlinkPosition {
    /// Time since the vehicle's start \[ms\].
    pub time_ms: u32,
    /// Position \[m, world\].
    pub position: [f64; 3],
    /// Velocity \[m/s, world\].
    pub velocity: [f64; 3],
}

/// Attitude by the vehicle's own estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MavlinkAttitude {
    /// Time since the vehicle's start \[ms\].
    pub time_ms: u32,
    /// Attitude, scalar last \[body to world\].
    pub attitude: [f64; 4],
    /// Body rate \[rad/s, body\].
    pub rate: [f64; 3],
}

/// True motion of a vehicle in an autopilot's own simulator, SIM_STATE or HIL_STATE_QUATERNION. Received only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MavlinkTruth {
    /// The vehicle's clock \[us\]; `None` if it is not sent.
    pub time_us: Option<u64>,
    /// Latitude \[1e-7 deg\].
    pub latitude_e7: i32,
    /// Longitude \[1e-7 deg\].
    pub longitude_e7: i32,
    /// Altitude \[m\].
    pub altitude_m: f64,
    /// Steps in which the altitude is counted \[m\].
    pub altitude_step_m: f64,
    /// Velocity \[m/s, world whose x is north\].
    pub velocity: [f64; 3],
    /// Attitude, scalar last \[body to world whose x is north\].
    pub attitude: [f64; 4],
    /// Body rate \[rad/s, body\].
    pub rate: [f64; 3],
}

/// Content of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MavlinkContent {
    /// HEARTBEAT.
    Heartbeat(MavlinkHeartbeat),
    /// SYS_STATUS: battery voltage \[V\]; NaN if it is not measured.
    Battery(f64),
    /// TIMESYNC.
    Timesync(Timesync),
    /// SET_ATTITUDE_TARGET.
    AttitudeTarget(AttitudeTarget),
    /// ODOMETRY by vision, in its own frames.
    Odometry(MavlinkPose),
    /// VISION_POSITION_ESTIMATE.
    VisionPosition(MavlinkPose),
    /// SET_GPS_GLOBAL_ORIGIN: the place on earth of the world's origin, which is arbitrary.
    GlobalOrigin {
        /// The vehicle's system \[-\].
        system: u8,
    },
    /// COMMAND_LONG.
    Command(VehicleCommandLong),
    /// COMMAND_ACK.
    Acknowledged {
        /// Number of the command \[-\].
        command: u16,
        /// Result of the command.
        result: AckResult,
        /// Sender of the command; all if the vehicle does not state it.
        target: MavlinkAddress,
    },
    /// STATUSTEXT.
    Text(MavlinkText),
    /// PARAM_REQUEST_READ by name.
    ParameterRequest {
        /// The vehicle.
        target: MavlinkAddress,
        /// The parameter.
        name: ParameterName,
    },
    /// PARAM_SET.
    ParameterSet {
        /// The vehicle.
        target: MavlinkAddress,
        /// The parameter.
        name: ParameterName,
        /// New value.
        value: ParameterValue,
    },
    /// PARAM_VALUE.
    Parameter {
        /// The parameter.
        name: ParameterName,
        /// Value of the parameter.
        value: ParameterValue,
    },
    /// LOCAL_POSITION_NED.
    Position(MavlinkPosition),
    /// ATTITUDE_QUATERNION.
    Attitude(MavlinkAttitude),
    /// ESTIMATOR_STATUS of PX4, EKF_STATUS_REPORT of ArduPilot: flags that mean the same in both \[-\].
    Estimator(u16),
    /// SIM_STATE, HIL_STATE_QUATERNION.
    Truth(MavlinkTruth),
    /// A valid message that is not used.
    Other,
}

impl MavlinkContent {
    /// Flags of an estimator that has attitude, horizontal velocity, position and height.
    pub const ESTIMATOR_READY: u16 = 1 | 2 | 8 | 32;
}
