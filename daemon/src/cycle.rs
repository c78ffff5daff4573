//! One turn of the control loop: gate, estimate, control stack, limits. Pure: poses and time come in, a command goes out. The
//! same object runs behind the bus and in a flight in one process.

mod at_start;
mod blank;
mod descend;
mod mode;
mod operator;
mod report;
mod safety;
mod touchdown;
mod watch;

use nalgebra::Vector3;
use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps, TelemetryV1, VehicleV1};
use oqtal_bus::obstacle::ArmingObstacles;
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Interface};
use oqtal_control::estimator::{Estimate, Estimator};
use oqtal_control::euler::EulerAngles;
use oqtal_control::options::OptionError;
use oqtal_control::position::OuterLoop;
use oqtal_control::predictive::CommandReport;
use oqtal_control::scalar_pid::PidGains;
use oqtal_control::trajectory::{Trajectory, TrajectoryOptions};

use crate::arming::ArmingCheck;
use crate::command::VehicleCommand;
use crate::descent::BlindDescent;
use crate::guard::{Guard, seconds};
use crate::limits::FlightLimits;
use crate::loop_health::LoopHealth;
use crate::mission::ActiveMission;
use crate::setpoint::{CheckedSetpoint, SetpointGuard};
use crate::stack::{ControlOutput, ControlStack, ControlStep};
use crate::supervisor::Supervisor;
use crate::vehicle::VehicleWatch;

pub use at_start::AtStart;

/// Time after the last tick at which the loop acts without a pose \[periods\].
const DEADLINE_PERIODS: f64 = 1.5;

/// The output of one tick.
#[derive(Clone, Copy, Debug)]
pub struct Tick {
    /// Sequence of the pose that the command is about; 0 for none.
    pub pose_sequence: u64,
    /// The stamps of the pose, and the instant of the wake-up.
    pub stamps: Stamps,
    /// The command.
    pub command: CommandV1,
}

/// Time constants of the loop.
#[derive(Clone, Debug)]
struct LoopTiming {
    period: Span,
    /// Least time between two ticks: the poses of cameras faster than the loop are decimated.
    spacing: Span,
    decimates: bool,
    /// Time without accepted poses in flight during which the vehicle is flown on the predicted motion.
    predict: Span,
    /// Time without accepted poses in flight after which the motors stop.
    coast: Span,
    /// Good poses in a row after which poses are accepted again.
    recovery_poses: u32,
}

impl LoopTiming {
    fn of(config: &Config) -> Self {
        let period = Span::period_of(config.control.rate_hz);
        let poses_per_tick = config.poses_per_tick();
        Self {
            period,
            spacing: period.scaled(1.0 - 0.5 / poses_per_tick),
            decimates: poses_per_tick > 1.0,
            predict: Span::from_seconds(config.safety.predict_ms * 1e-3),
            coast: Span::from_seconds(config.safety.coast_ms * 1e-3),
            recovery_poses: config.safety.recovery_poses,
        }
    }
}

/// The instants and poses that the loop remembers between ticks.
#[derive(Clone, Debug)]
struct Memory {
    last_tick: Time,
    /// The deadline of the last tick.
    deadline: Time,
    /// The last tick on an accepted pose.
    last_seen: Option<Time>,
    /// The last such tick in Nominal.
    last_nominal: Option<Time>,
    /// The newest pose since the last tick, if it was accepted.
    fresh: Option<Header>,
    /// Why the last pose that was due is missing.
    missing: Cause,
    /// The reference of this tick, which is flown and by which the flight is judged.
    setpoint: CheckedSetpoint,
    /// What keeps a flight from beginning, as of the last tick.
    obstacles: ArmingObstacles,
    /// The last position inside the soft border of the fence \[m, world\].
    inside: Option<Vector3<f64>>,
    /// Since when the vehicle, which lands, stands on something.
    stands_since: Option<Time>,
    /// Whether the vehicle descends without poses.
    descends: bool,
    /// The last command of the control stack, repeated while poses are missing.
    held: VehicleCommand,
    /// The command of the last tick.
    sent: VehicleCommand,
}

impl Memory {
    fn starting_at(now: Time) -> Self {
        Self {
            last_tick: now,
            deadline: now,
            last_seen: None,
            last_nominal: None,
            fresh: None,
            missing: Cause::NoPose,
            setpoint: CheckedSetpoint::default(),
            obstacles: ArmingObstacles::default(),
            inside: None,
            stands_since: None,
            descends: false,
            held: VehicleCommand::Disarmed,
            sent: VehicleCommand::Disarmed,
        }
    }
}

/// The requests that change the mode in the next tick.
#[derive(Clone, Copy, Debug, Default)]
struct Requests {
    /// Whether a requested flight begins with the next tick or not at all.
    arms_at_once: bool,
    at_start: AtStart,
    stop: bool,
    /// Whether another vehicle took the place of the one for which a flight was requested.
    vehicle_replaced: bool,
    /// Whether processes of the instance run with different configurations.
    configs_differ: bool,
}

/// The controller between its events.
#[derive(Clone, Debug)]
pub struct Cycle {
    timing: LoopTiming,
    observe_only: bool,
    interface: Interface,
    max_thrust_n: f64,
    trajectory: Trajectory,
    options: TrajectoryOptions,

    guard: Guard,
    vehicle: VehicleWatch,
    estimator: Estimator,
    supervisor: Supervisor,
    limits: FlightLimits,
    descent: BlindDescent,
    arming: ArmingCheck,
    setpoint: SetpointGuard,
    health: LoopHealth,
    stack: ControlStack,
    mode: Mode,
    mission: Option<ActiveMission>,
    requests: Requests,
    memory: Memory,
    telemetry: TelemetryV1,
}

impl Cycle {
    /// The controller of `config`, ready to fly `trajectory`, disarmed at `now`.
    ///
    /// # Errors
    /// An option of the law or of the vehicle is not allowed.
    pub fn new(config: &Config, trajectory: Trajectory, now: Time) -> Result<Self, OptionError> {
        let limits = FlightLimits::new(config);
        let awaited = config.safety.arm_at_start && !config.safety.observe_only;
        let at_start = if awaited { AtStart::Awaited } else { AtStart::Nothing };
        Ok(Self {
            timing: LoopTiming::of(config),
            observe_only: config.safety.observe_only,
            interface: config.vehicle.interface,
            max_thrust_n: config.vehicle.max_thrust_n,
            options: config.trajectory.clone(),
            guard: Guard::new(config)?,
            vehicle: VehicleWatch::new(&config.safety),
            estimator: Estimator::new(config.control.estimator),
            supervisor: Supervisor::default(),
            arming: ArmingCheck::new(config, &trajectory),
            setpoint: SetpointGuard::new(limits.fence.clone()),
            health: LoopHealth::new(config),
            descent: BlindDescent::of(config),
            limits,
            stack: ControlStack::new(config)?,
            mode: Mode::Disarmed,
            mission: None,
            requests: Requests { at_start, ..Requests::default() },
            memory: Memory::starting_at(now),
            telemetry: blank::without_pose(),
            trajectory,
        })
    }

    /// The instant of the next tick if no pose arrives before. A pose that arrived too soon after the last tick, and after which
    /// no other is expected soon, is acted on as soon as a tick is allowed again; the next pose then arrives in time, and ticks
    /// are in step with poses at once.
    #[must_use]
    pub fn next_event(&self) -> Time {
        if self.memory.fresh.is_some() && !self.timing.decimates {
            self.memory.last_tick + self.timing.spacing
        } else {
            self.memory.last_tick + self.timing.period.scaled(DEADLINE_PERIODS)
        }
    }

    /// Takes a pose, if one arrived, and acts if a tick is due; returns `None` if not.
    pub fn step(&mut self, now: Time, arrival: Option<&(Header, PoseV1)>) -> Option<Tick> {
        if let Some((header, pose)) = arrival {
            self.take(now, header, pose);
        }
        let due = match arrival {
            Some(_) => self.memory.last_tick + self.timing.spacing,
            None => self.next_event(),
        };
        (now >= due).then(|| self.tick(now, arrival.map(|(header, _)| header)))
    }

    /// Takes the state of the vehicle, and the instant at which a command took effect.
    pub fn hear(&mut self, now: Time, header: &Header, vehicle: &VehicleV1) {
        self.cancel_if_vehicle_replaced(header.source);
        self.vehicle.hear(now, header.source, vehicle);
        self.requests.stop |= vehicle.stopped != 0 && self.is_flying();
        let follows = self.vehicle.follows(header.sequence);
        let applied_at = header.stamps.applied_at;
        if applied_at.is_set() {
            let still_to_go = Span::from_nanos(vehicle.wire_ns + vehicle.air_ns);
            let applied_s = seconds(applied_at + still_to_go);
            let sequence = vehicle.command_sequence;
            let report = CommandReport { sequence, acts_s: applied_s, follows };
            self.guard.motion.applied(report);
            self.stack.active_mut().applied(report);
        }
    }

    /// Records that the command of the last tick was published, and returns the telemetry of that tick.
    pub fn report(&mut self, stamps: &Stamps, command_sequence: u64) -> &TelemetryV1 {
        let sent_s = seconds(stamps.command_published_at);
        self.guard.motion.sent(command_sequence, sent_s, &self.memory.sent);
        self.stack.active_mut().sent(command_sequence, sent_s, &self.memory.sent);
        // A loop that turns late finds a recent pose: then the command is late by the deadline of its tick, not by its pose.
        let due = Some(stamps.pose_published_at).filter(|at| at.is_set());
        let due = due.map_or(self.memory.deadline, |at| at.min(self.memory.deadline));
        self.health.sent(due, stamps.command_published_at);
        self.telemetry.deadline_misses = self.health.deadline_misses();
        self.telemetry.command_sequence = command_sequence;
        &self.telemetry
    }

    /// Replaces the gains of one of the outer loops of Fig. 16, in flight; gains that do not pass their check are refused.
    ///
    /// # Errors
    /// The first gain that is not allowed.
    pub fn set_loop(&mut self, which: OuterLoop, gains: PidGains) -> Result<(), OptionError> {
        gains.check()?;
        self.stack.active_mut().set_loop(which, gains);
        Ok(())
    }

    /// The telemetry of the last tick.
    #[must_use]
    pub fn telemetry(&self) -> &TelemetryV1 {
        &self.telemetry
    }

    /// Passes a pose through the gate to estimator and control stack.
    fn take(&mut self, now: Time, header: &Header, pose: &PoseV1) {
        let flying = self.is_flying();
        match self.guard.gate(now, header, pose, flying) {
            Ok(accepted) => {
                let captured_s = seconds(accepted.captured_at);
                let estimate =
                    self.estimator.update(captured_s, accepted.position, accepted.attitude);
                self.stack.active_mut().observe(captured_s, &estimate);
                self.memory.fresh = Some(*header);
                self.record_pose(header, pose);
                self.arming.take(&accepted);
            }
            Err(cause) => {
                self.memory.missing = cause;
                if !flying || self.supervisor.state() == SafetyState::Stop {
                    self.guard.forget();
                }
            }
        }
    }

    fn tick(&mut self, now: Time, arrival: Option<&Header>) -> Tick {
        let deadline = self.next_event();
        let period = self.timing.period;
        let dt = now.since(self.memory.last_tick).min(period.scaled(2.0)).max(period.scaled(0.5));
        let fresh = self.memory.fresh.take();
        if arrival.is_none() && fresh.is_none() {
            self.memory.missing = Cause::NoPose;
        }
        self.check_setpoint(now);
        self.supervise(now, fresh.is_some());
        self.memory.obstacles = self.obstacles(now);
        self.change_mode(now, fresh.is_some());
        let step = ControlStep { now_s: seconds(now), dt_s: dt.seconds() };
        let command = self.command(now, step, fresh.is_some());
        self.memory.deadline = self.memory.last_tick + period.scaled(DEADLINE_PERIODS);
        self.memory.last_tick = now;

        let woken_for = arrival.map_or(deadline, |header| header.stamps.pose_published_at);
        self.telemetry.wakeup_lateness_ns = now.since(woken_for).nanos();
        // A repeated command is about no pose: none was accepted.
        let stamps = fresh.as_ref().map_or_else(Stamps::default, |header| header.stamps);
        Tick {
            pose_sequence: fresh.as_ref().map_or(0, |header| header.pose_sequence),
            stamps: Stamps { woken_at: now, ..stamps },
            command,
        }
    }

    /// The message of this tick, recorded in telemetry.
    fn command(&mut self, now: Time, step: ControlStep, fresh: bool) -> CommandV1 {
        let output = self.decide(now, step, fresh);
        let command = self.choose(now, output.as_ref());
        self.record(now, output.as_ref(), fresh);
        let message = command.to_message(self.interface, self.max_thrust_n);
        self.telemetry.sticks = message.sticks;
        self.telemetry.torque = message.torque;
        self.telemetry.attitude_sent = message.attitude;
        self.telemetry.thrust = message.thrust;
        self.memory.held = command;
        // Telemetry has the command that would have been sent.
        let (sent, message) = match self.observe_only {
            true => (VehicleCommand::Disarmed, CommandV1::default()),
            false => (command, message),
        };
        self.memory.sent = sent;
        message
    }

    /// The decision of the control stack, on a fresh pose or on the predicted motion; `None` where it has neither or is not asked.
    fn decide(&mut self, now: Time, step: ControlStep, fresh: bool) -> Option<ControlOutput> {
        let reference = self.memory.setpoint.reference?;
        if self.is_held() || self.supervisor.state() == SafetyState::Descend {
            return None;
        }
        let estimate = if fresh { self.estimator.latest() } else { self.predicted(now)? };
        self.stack.active_mut().decide(step, &estimate, &reference)
    }

    /// The command of this tick: the control stack's, else the last one; disarmed when not flying; idle rotors until the motors
    /// run; level where the vehicle descends without poses.
    fn choose(&self, now: Time, output: Option<&ControlOutput>) -> VehicleCommand {
        match output {
            _ if self.memory.setpoint.reference.is_none() => VehicleCommand::Disarmed,
            _ if self.is_held() => self.idle(),
            _ if self.supervisor.state() == SafetyState::Descend => self.descend(now),
            Some(output) => self.lowered(now, output.command.finite_or_disarmed()),
            None => self.memory.held,
        }
    }

    /// The command that keeps the rotors idling, at the present heading.
    fn idle(&self) -> VehicleCommand {
        let heading = EulerAngles::from_attitude(&self.estimator.latest().attitude).yaw;
        VehicleCommand::idle(self.interface, heading)
    }

    /// The motion to act on in a tick without a pose, as old as that of the last tick with one; `None` if poses have been missing
    /// for too long, and where no motion is predicted.
    fn predicted(&self, now: Time) -> Option<Estimate> {
        let (last, seen) = (self.guard.last()?, self.memory.last_seen?);
        if now.since(seen) > self.timing.predict {
            return None;
        }
        let t_s = seconds(last.captured_at + now.since(seen));
        self.guard.motion.predict(t_s).map(|track| track.estimate())
    }
}

#[cfg(test)]
mod tests;
