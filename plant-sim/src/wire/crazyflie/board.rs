//! Emulated on-board computer of a Crazyflie: packets to set-points, answers. Pure.
//!
//! The vehicle flies by the newest set-point. The first set-point without thrust unlocks the thrust of those after it. Roll and
//! pitch are rates or angles as `flightmode.stabModeRoll` and `…Pitch` say.

use std::collections::VecDeque;

use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, TruthV1};
use oqtal_bus::time::Time;
use oqtal_config::PlantOptions;
use oqtal_control::euler::EulerAngles;
use oqtal_control::options::OptionError;
use oqtal_control::quaternion::Attitude;
use oqtal_wire::crtp::{
    CrtpPacket, CrtpPose, CrtpReply, CrtpRequest, CrtpThrustCurve, CrtpValue, LegacySetpoint,
    SUPERVISOR_PROTOCOL, Supervision, SupervisorAnswer, SupervisorCommand,
};

use super::super::on_board::Measured;
use super::logs::LogBlocks;
use super::supervisor::SupervisorModel;
use super::tables::{Logged, PARAMETERS, STABILISATION, element, info};

/// Last byte of the vehicle's radio address, as it is delivered \[-\].
const ADDRESS_END: u8 = 0xE7;

/// On-board computer of a Crazyflie.
#[derive(Clone, Debug)]
pub struct CrazyflieBoard {
    started: Time,
    protocol: u8,
    curve: CrtpThrustCurve,
    max_thrust: f64,
    authority: [f64; 3],
    attitude_gain: f64,
    holds_attitude: bool,
    supervisor: SupervisorModel,
    parameters: [f64; PARAMETERS.len()],
    logs: LogBlocks,
    setpoint: LegacySetpoint,
    is_thrust_locked: bool,
    /// Pose that a host sent last.
    pose: Option<CrtpPose>,
}

impl CrazyflieBoard {
    /// The on-board computer of `plant`, switched on at `now`.
    ///
    /// # Errors
    /// The thrust curve does not rise.
    pub fn new(plant: &PlantOptions, now: Time) -> Result<Self, OptionError> {
        let options = &plant.wire.crtp;
        let curve = CrtpThrustCurve::new(options.thrust_curve_n).ok_or_else(|| {
            let found = format!("{:?}", options.thrust_curve_n);
            OptionError::new("plant.wire.crtp.thrust-curve-n", found, "a curve that rises")
        })?;
        Ok(Self {
            started: now,
            protocol: options.protocol as u8,
            curve,
            max_thrust: plant.max_thrust_n,
            authority: plant.rate_authority_rad_s,
            attitude_gain: plant.attitude_gain_per_s,
            holds_attitude: plant.interface.holds_attitude(),
            supervisor: SupervisorModel::new(now, options.arms_itself),
            parameters: PARAMETERS.map(|(_, _, _, value)| value),
            logs: LogBlocks::default(),
            setpoint: LegacySetpoint::ZERO,
            is_thrust_locked: true,
            pose: None,
        })
    }

    /// Instant at which log data are due next.
    #[must_use]
    pub fn next_event(&self) -> Option<Time> {
        self.logs.next_event()
    }

    /// Executes a packet, and appends the replies to `answers`.
    pub fn execute(&mut self, now: Time, packet: &CrtpPacket, answers: &mut VecDeque<CrtpPacket>) {
        let Some(request) = CrtpRequest::read(packet) else { return };
        let mut reply = |reply: CrtpReply| answers.push_back(reply.packet());
        match request {
            CrtpRequest::Null => reply(CrtpReply::Null),
            CrtpRequest::Echo(stamp) => reply(CrtpReply::Echo(stamp)),
            CrtpRequest::Source => reply(CrtpReply::Source),
            CrtpRequest::ProtocolVersion => reply(CrtpReply::ProtocolVersion(self.protocol)),
            CrtpRequest::Supervision if self.has_supervisor_port() => {
                reply(CrtpReply::Supervision(self.supervisor.bits()));
            }
            CrtpRequest::Supervision => {}
            CrtpRequest::Supervisor(command) => {
                if self.has_supervisor_port() {
                    let answer = self.supervise(now, command);
                    answers.push_back(answer.packet(command, self.supervisor.bits()));
                }
            }
            CrtpRequest::LegacySupervisor(command) => {
                let answer = self.supervise(now, command);
                if matches!(command, SupervisorCommand::Arm(_) | SupervisorCommand::Recover) {
                    reply(CrtpReply::Granted(answer));
                }
            }
            CrtpRequest::Setpoint(setpoint) => self.take_setpoint(now, setpoint),
            CrtpRequest::Stop => self.take_setpoint(now, LegacySetpoint::ZERO),
            CrtpRequest::EndOfSetpoints(_) => {
                self.setpoint = LegacySetpoint::ZERO;
                self.supervisor.relax();
            }
            CrtpRequest::Pose(pose) => self.pose = Some(pose),
            CrtpRequest::Poses(poses) => {
                let own = poses.poses().iter().find(|pose| pose.vehicle == ADDRESS_END);
                self.pose = own.map(|pose| pose.pose()).or(self.pose);
            }
            CrtpRequest::MemoryCount => reply(CrtpReply::MemoryCount(0)),
            other => self.look_up(now, other, &mut reply),
        }
    }

    fn has_supervisor_port(&self) -> bool {
        self.protocol >= SUPERVISOR_PROTOCOL
    }

    fn supervise(&mut self, now: Time, command: SupervisorCommand) -> SupervisorAnswer {
        let granted = self.supervisor.command(now, command);
        self.supervisor.tick(now, self.setpoint.thrust > 0);
        SupervisorAnswer { is_arming: matches!(command, SupervisorCommand::Arm(_)), granted }
    }

    /// Answers requests about tables, parameters and log blocks.
    fn look_up(&mut self, now: Time, request: CrtpRequest, reply: &mut impl FnMut(CrtpReply)) {
        match request {
            CrtpRequest::TableInfo(table) => reply(CrtpReply::TableInfo(table, info(table))),
            CrtpRequest::TableElement(table, id) => reply(
                element(table, id)
                    .map_or(CrtpReply::NoElement(table), |e| CrtpReply::TableElement(table, e)),
            ),
            CrtpRequest::ReadParameter(id) => reply(self.read_parameter(id)),
            CrtpRequest::WriteParameter(id, value) => {
                if let Some(written) = self.write_parameter(id, value) {
                    reply(written);
                }
            }
            CrtpRequest::ResetLogging => reply(self.logs.reset()),
            CrtpRequest::CreateBlock(block) => reply(self.logs.create(block)),
            CrtpRequest::StartBlock { id, period } => reply(self.logs.start(now, id, period)),
            _ => {}
        }
    }

    fn read_parameter(&self, id: u16) -> CrtpReply<'static> {
        match PARAMETERS.get(usize::from(id)) {
            Some((_, _, kind, _)) => {
                let number = self.parameters[usize::from(id)];
                CrtpReply::Parameter(id, CrtpValue::of(*kind, number))
            }
            None => CrtpReply::NoParameter(id),
        }
    }

    /// Writes a parameter; a value of another type is ignored.
    fn write_parameter(&mut self, id: u16, value: CrtpValue) -> Option<CrtpReply<'static>> {
        let Some((_, _, kind, _)) = PARAMETERS.get(usize::from(id)) else {
            return Some(CrtpReply::NoParameter(id));
        };
        self.parameters[usize::from(id)] = value.number(*kind)?;
        Some(CrtpReply::Written(id, value))
    }

    fn take_setpoint(&mut self, now: Time, setpoint: LegacySetpoint) {
        let numbers = [setpoint.roll, setpoint.pitch, setpoint.yaw_rate];
        if !numbers.into_iter().all(f64::is_finite) {
            return;
        }
        self.is_thrust_locked &= setpoint.thrust > 0;
        let thrust = if self.is_thrust_locked { 0 } else { setpoint.thrust };
        self.setpoint = LegacySetpoint { thrust, ..setpoint };
        self.supervisor.take_setpoint(now, thrust > 0);
    }

    /// Applies the supervisor's rules at `now`, and appends the log data that are due to `answers`.
    pub fn tick(&mut self, now: Time, measured: &Measured, answers: &mut VecDeque<CrtpPacket>) {
        self.supervisor.tick(now, self.setpoint.thrust > 0);
        if self.next_event().is_none_or(|at| at > now) {
            return;
        }
        let logged = Logged {
            battery_v: measured.battery_v,
            supervision: self.supervisor.bits(),
            estimate: self.estimate(&measured.truth),
        };
        let clock_ms = now.since(self.started).nanos() / 1_000_000;
        let clock_ms = u32::try_from(clock_ms).unwrap_or_default();
        self.logs.tick(now, clock_ms, &logged, |packet| answers.push_back(packet));
    }

    /// The vehicle's own estimate: roll and pitch of its sensors, position and heading as they were sent to it last.
    fn estimate(&self, truth: &TruthV1) -> CrtpPose {
        let sent =
            self.pose.unwrap_or(CrtpPose { position: [0.0; 3], attitude: [0.0, 0.0, 0.0, 1.0] });
        let EulerAngles { roll, pitch, .. } = angles(truth.attitude);
        let yaw = angles(sent.attitude).yaw;
        CrtpPose { position: sent.position, attitude: EulerAngles { roll, pitch, yaw }.xyzw() }
    }

    /// State of the supervisor.
    #[must_use]
    pub fn supervision(&self) -> Supervision {
        self.supervisor.bits()
    }

    /// Whether the motors run, or would with thrust.
    #[must_use]
    pub fn motors_run(&self) -> bool {
        self.supervisor.may_run()
    }

    /// Command that the vehicle follows in the state `truth`; "disarmed" while its motors may not run.
    #[must_use]
    pub fn command(&self, truth: &TruthV1) -> CommandV1 {
        if !self.supervisor.may_run() {
            return CommandV1::default();
        }
        let thrust = self.curve.force(self.setpoint.thrust) / self.max_thrust;
        let base = CommandV1 { thrust, ..CommandV1::default() };
        let setpoint = if self.supervisor.levels_out() {
            LegacySetpoint { thrust: self.setpoint.thrust, ..LegacySetpoint::ZERO }
        } else {
            self.setpoint
        };
        let [roll, pitch] = [0, 1].map(|axis| self.is_angle(axis) || self.supervisor.levels_out());
        let LegacySetpoint { roll: wanted_roll, pitch: wanted_pitch, yaw_rate, .. } = setpoint;
        let now = angles(truth.attitude);
        if self.holds_attitude && roll && pitch {
            // The heading ahead of the present one towards which the attitude loop turns at the commanded yaw rate.
            let yaw = now.yaw + yaw_rate / self.attitude_gain;
            let attitude = EulerAngles { roll: wanted_roll, pitch: wanted_pitch, yaw }.xyzw();
            return CommandV1 { actuation: Actuation::Attitude.code(), attitude, ..base };
        }
        // On-board, angles become rates.
        let towards = |is_angle: bool, wanted: f64, is: f64| {
            if is_angle { self.attitude_gain * (wanted - is) } else { wanted }
        };
        let rates = [
            towards(roll, wanted_roll, now.roll),
            towards(pitch, wanted_pitch, now.pitch),
            yaw_rate,
        ];
        let sticks = [0, 1, 2].map(|axis| rates[axis] / self.authority[axis]);
        CommandV1 { actuation: Actuation::Sticks.code(), sticks, ..base }
    }

    /// Whether the set-point of an axis, roll or pitch, is an angle.
    fn is_angle(&self, axis: usize) -> bool {
        self.parameters[STABILISATION[axis]] != 0.0
    }
}

fn angles(attitude: [f64; 4]) -> EulerAngles {
    EulerAngles::from_attitude(&Attitude::from_xyzw(attitude).unwrap_or_default())
}
