//! Emulated on-board computer of a Crazyflie: packets to set-points, answers. Pure.
//!
//! The vehicle follows the newest set-point. The first set-point without thrust unlocks the thrust of later ones.
//! `flightmode.stabModeRoll` and `…Pitch` select rates or angles for roll and pitch.

use std::collections::VecDeque;

use oqtal_bus::message::{CommandV1, TruthV1};
use oqtal_bus::time::Time;
use oqtal_config::PlantOptions;
use oqtal_control::euler::EulerAngles;
use oqtal_control::options::OptionError;
use oqtal_wire::crtp::{
    CrtpPacket, CrtpPose, CrtpReply, CrtpRequest, CrtpThrustCurve, CrtpValue, LegacySetpoint,
    SUPERVISOR_PROTOCOL, Supervision, SupervisorAnswer, SupervisorCommand,
};

use super::logs::LogBlocks;
use super::supervisor::SupervisorModel;
use super::tables::{Logged, PARAMETERS, STABILISATION, element, info};
use crate::wire::command::{angles, rate_command, turning_command};
use crate::wire::vehicle::{FrameCounters, Measured, OnBoardComputer};

/// Last byte of the vehicle's radio address in factory settings \[-\].
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
    /// Newest pose that a host sent.
    pose: Option<CrtpPose>,
    /// Replies and log data to be sent.
    replies: VecDeque<CrtpPacket>,
    counters: FrameCounters,
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
            replies: VecDeque::with_capacity(64),
            counters: FrameCounters::default(),
        })
    }

    fn queue(&mut self, reply: &CrtpReply<'_>) {
        self.replies.push_back(reply.packet());
    }

    /// Executes a packet and queues the replies.
    fn execute(&mut self, now: Time, packet: &CrtpPacket) {
        let Some(request) = CrtpRequest::read(packet) else { return };
        match request {
            CrtpRequest::Null => self.queue(&CrtpReply::Null),
            CrtpRequest::Echo(stamp) => self.queue(&CrtpReply::Echo(stamp)),
            CrtpRequest::Source => self.queue(&CrtpReply::Source),
            CrtpRequest::ProtocolVersion => self.queue(&CrtpReply::ProtocolVersion(self.protocol)),
            CrtpRequest::Supervision if self.has_supervisor_port() => {
                self.queue(&CrtpReply::Supervision(self.supervisor.bits()));
            }
            CrtpRequest::Supervision => {}
            CrtpRequest::Supervisor(command) => {
                if self.has_supervisor_port() {
                    let answer = self.supervise(now, command);
                    self.replies.push_back(answer.packet(command, self.supervisor.bits()));
                }
            }
            CrtpRequest::LegacySupervisor(command) => {
                let answer = self.supervise(now, command);
                if matches!(command, SupervisorCommand::Arm(_) | SupervisorCommand::Recover) {
                    self.queue(&CrtpReply::Granted(answer));
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
            CrtpRequest::MemoryCount => self.queue(&CrtpReply::MemoryCount(0)),
            other => self.look_up(now, other),
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
    fn look_up(&mut self, now: Time, request: CrtpRequest) {
        let reply = match request {
            CrtpRequest::TableInfo(table) => CrtpReply::TableInfo(table, info(table)),
            CrtpRequest::TableElement(table, id) => element(table, id)
                .map_or(CrtpReply::NoElement(table), |e| CrtpReply::TableElement(table, e)),
            CrtpRequest::ReadParameter(id) => self.read_parameter(id),
            CrtpRequest::WriteParameter(id, value) => {
                let Some(written) = self.write_parameter(id, value) else { return };
                written
            }
            CrtpRequest::ResetLogging => self.logs.reset(),
            CrtpRequest::CreateBlock(block) => self.logs.create(block),
            CrtpRequest::StartBlock { id, period } => self.logs.start(now, id, period),
            _ => return,
        };
        self.queue(&reply);
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

    /// The vehicle's own estimate: roll and pitch from its sensors, position and heading from the newest received pose.
    fn estimate(&self, truth: &TruthV1) -> CrtpPose {
        let sent =
            self.pose.unwrap_or(CrtpPose { position: [0.0; 3], attitude: [0.0, 0.0, 0.0, 1.0] });
        let EulerAngles { roll, pitch, .. } = angles(truth.attitude);
        let yaw = angles(sent.attitude).yaw;
        CrtpPose { position: sent.position, attitude: EulerAngles { roll, pitch, yaw }.xyzw() }
    }

    /// State of the supervisor.
    pub fn supervision(&self) -> Supervision {
        self.supervisor.bits()
    }

    /// Whether the motors run, or would run with thrust.
    pub fn motors_run(&self) -> bool {
        self.supervisor.may_run()
    }

    /// Whether the set-point of an axis, roll or pitch, is an angle.
    fn is_angle(&self, axis: usize) -> bool {
        self.parameters[STABILISATION[axis]] != 0.0
    }
}

impl OnBoardComputer for CrazyflieBoard {
    /// Instant at which log data are due next.
    fn next_event(&self) -> Option<Time> {
        self.logs.next_event()
    }

    fn receive(&mut self, now: Time, bytes: &[u8], _: &Measured) {
        match CrtpPacket::parse(bytes) {
            Ok(packet) => {
                self.counters.read += 1;
                self.execute(now, &packet);
            }
            Err(_) => self.counters.damaged += 1,
        }
    }

    /// Applies the supervisor's rules at `now`, and queues the log data that are due.
    fn tick(&mut self, now: Time, measured: &Measured) {
        self.supervisor.tick(now, self.setpoint.thrust > 0);
        if self.next_event().is_none_or(|at| at > now) {
            return;
        }
        let logged = Logged {
            battery_v: measured.battery_v,
            supervision: self.supervisor.bits(),
            estimate: self.estimate(&measured.truth),
            rate: measured.rate,
        };
        let clock_ms = now.since(self.started).nanos() / 1_000_000;
        let clock_ms = u32::try_from(clock_ms).unwrap_or_default();
        let Self { logs, replies, .. } = self;
        logs.tick(now, clock_ms, &logged, |packet| replies.push_back(packet));
    }

    fn reply(&mut self, send: &mut dyn FnMut(&[u8])) {
        self.replies.drain(..).for_each(|packet| send(packet.as_bytes()));
    }

    fn command(&self, _: Time, truth: &TruthV1) -> CommandV1 {
        if !self.supervisor.may_run() {
            return CommandV1::default();
        }
        let thrust = self.curve.force(self.setpoint.thrust) / self.max_thrust;
        let is_level = self.supervisor.levels_out();
        let setpoint = if is_level { LegacySetpoint::ZERO } else { self.setpoint };
        let LegacySetpoint { roll, pitch, yaw_rate, .. } = setpoint;
        let are_angles = [0, 1].map(|axis| self.is_angle(axis) || is_level);
        let present = angles(truth.attitude);
        let gain = self.attitude_gain;
        if self.holds_attitude && are_angles == [true; 2] {
            return turning_command([roll, pitch], (present.yaw, yaw_rate), gain, thrust);
        }
        // The on-board loop turns angles into rates.
        let rate = |is_angle: bool, wanted: f64, present: f64| {
            if is_angle { gain * (wanted - present) } else { wanted }
        };
        let rates = [
            rate(are_angles[0], roll, present.roll),
            rate(are_angles[1], pitch, present.pitch),
            yaw_rate,
        ];
        rate_command(rates, self.authority, thrust)
    }

    fn counters(&self) -> FrameCounters {
        self.counters
    }
}
