//! One turn of the loop: guard, estimate, position loops, attitude law, limits. Pure: poses and time come in, a command goes
//! out. The same object runs behind the bus and in an in-process flight.

mod operator;
mod report;

use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps, TelemetryV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::estimator::{Estimate, Estimator};
use oqtal_control::euler::EulerAngles;
use oqtal_control::trajectory::{FlightPlan, StartPoint, Trajectory, TrajectoryOptions};

use crate::guard::Guard;
use crate::mission::Mission;
use crate::pilot::{Pilot, finite_or_neutral};
use crate::supervisor::{Conditions, Supervisor};
use crate::vehicle::VehicleWatch;

pub use operator::AtStart;

/// Without a pose the loop acts this many periods after its last tick.
const DEADLINE_PERIODS: f64 = 1.5;
/// Without a believable pose for so many periods the daemon coasts: at the second deadline in a row, three periods after the
/// last pose. The first one is missed by every source that is polled, late by a frame or a little slower than the loop.
const COAST_PERIODS: f64 = 2.5;
/// A vehicle unseen for no longer than this many periods is believed at once when it is seen again.
const SHORT_GAP_PERIODS: f64 = 6.0;

/// What one tick puts out.
#[derive(Clone, Copy, Debug)]
pub struct Tick {
    /// Sequence of the pose that the command is about; 0 for none.
    pub pose_sequence: u64,
    /// The stations passed so far.
    pub stamps: Stamps,
    /// The command.
    pub command: CommandV1,
}

/// Listens to the vehicle of `config`. A bridge says after `silence` at the latest that it starts motors, or that it gave up.
fn watch(config: &Config) -> VehicleWatch {
    let millis = |millis: f64| Span::from_seconds(millis * 1e-3);
    let silence = millis(config.safety.vehicle_silence_ms);
    VehicleWatch::new(silence, millis(config.bridge.motor_sequence_ms) + silence)
}

/// The controller between its events.
#[derive(Clone, Debug)]
pub struct Cycle {
    period: Span,
    /// Two ticks are at least this far apart: faster cameras are decimated.
    spacing: Span,
    decimates: bool,
    coast: Span,
    recovery_poses: u32,
    watches_only: bool,
    trajectory: Trajectory,
    options: TrajectoryOptions,

    guard: Guard,
    vehicle: VehicleWatch,
    estimator: Estimator,
    supervisor: Supervisor,
    pilot: Pilot,
    mode: Mode,
    /// Whether a flight that is waited for begins with the next tick or not at all.
    arms_at_once: bool,
    at_start: AtStart,
    mission: Option<Mission>,
    stop_requested: bool,
    /// Whether another vehicle took the place of the one that a flight was asked for.
    vehicle_replaced: bool,

    last_tick: Time,
    /// The last tick on a believable pose, and the last such tick in Nominal.
    last_seen: Option<Time>,
    last_nominal: Option<Time>,
    /// The newest pose since the last tick, if it was believed.
    fresh: Option<Header>,
    /// Why the last pose that was due is not there.
    missing: Cause,
    held: CommandV1,
    /// What the last tick put out.
    sent: CommandV1,
    telemetry: TelemetryV1,
}

impl Cycle {
    /// The controller of `config`, ready to fly `trajectory`, disarmed at `now`.
    ///
    /// # Errors
    /// An option of the law has no meaning; says which.
    pub fn new(config: &Config, trajectory: Trajectory, now: Time) -> Result<Self, String> {
        let period = Span::period_of(config.control.rate_hz);
        let poses_per_tick = config.poses_per_tick();
        Ok(Self {
            period,
            spacing: period.scaled(1.0 - 0.5 / poses_per_tick),
            decimates: poses_per_tick > 1.0,
            coast: Span::from_seconds(config.safety.coast_ms * 1e-3),
            recovery_poses: config.safety.recovery_poses,
            watches_only: config.is_replay(),
            trajectory,
            options: config.trajectory.clone(),
            guard: Guard::new(&config.safety),
            vehicle: watch(config),
            estimator: Estimator::new(config.control.estimator),
            supervisor: Supervisor::default(),
            pilot: Pilot::new(config)?,
            mode: Mode::Disarmed,
            arms_at_once: false,
            at_start: match config.safety.arm_at_start && !config.is_replay() {
                true => AtStart::Awaited,
                false => AtStart::Nothing,
            },
            mission: None,
            stop_requested: false,
            vehicle_replaced: false,
            last_tick: now,
            last_seen: None,
            last_nominal: None,
            fresh: None,
            missing: Cause::NoPose,
            held: CommandV1::default(),
            sent: CommandV1::default(),
            telemetry: TelemetryV1 {
                mission_s: f64::NAN,
                pose_age_s: f64::NAN,
                ..TelemetryV1::default()
            },
        })
    }

    /// When the loop acts if no pose comes before. A pose that came too soon after the last tick, and after which no other
    /// is expected before long, is acted on as soon as a tick is allowed again: the pose after it then finds the loop ready,
    /// and ticks fall in step with poses at once.
    #[must_use]
    pub fn next_event(&self) -> Time {
        if self.fresh.is_some() && !self.decimates {
            self.last_tick + self.spacing
        } else {
            self.last_tick + self.period.scaled(DEADLINE_PERIODS)
        }
    }

    /// Looks at a pose, if one came, and acts if it is time to; `None` if not.
    pub fn step(&mut self, now: Time, arrival: Option<&(Header, PoseV1)>) -> Option<Tick> {
        if let Some((header, pose)) = arrival {
            self.take(now, header, pose);
        }
        let due = if arrival.is_some() { self.last_tick + self.spacing } else { self.next_event() };
        (now >= due).then(|| self.tick(now, arrival.map(|(header, _)| header)))
    }

    /// Learns at `now` how the vehicle is, and when a command began to act.
    pub fn hear(&mut self, now: Time, header: &Header, vehicle: &VehicleV1) {
        self.notice_speaker(header.source);
        self.vehicle.hear(now, header.source, vehicle);
        let applied_at = header.stamps.applied_at;
        if applied_at.is_set() {
            let still_to_go = Span::from_nanos(vehicle.wire_ns + vehicle.air_ns);
            self.pilot.applied(vehicle.command_sequence, applied_at + still_to_go);
        }
    }

    /// What the last tick knew and decided, once its command is out.
    pub fn report(&mut self, stamps: &Stamps, command_sequence: u64) -> TelemetryV1 {
        self.pilot.sent(command_sequence, stamps.command_published_at, &self.sent);
        let late = stamps.pose_published_at.is_set()
            && stamps.command_published_at.since(stamps.pose_published_at) > self.period;
        self.telemetry.deadline_misses += u64::from(late);
        self.telemetry.command_sequence = command_sequence;
        self.telemetry
    }

    /// What the last tick knew and decided.
    #[must_use]
    pub fn telemetry(&self) -> &TelemetryV1 {
        &self.telemetry
    }

    fn begin_flight(&mut self, now: Time, estimate: &Estimate) {
        let start = StartPoint {
            position: estimate.position,
            yaw_rad: EulerAngles::from_attitude(&estimate.attitude).yaw,
        };
        let plan = FlightPlan::new(&self.options, self.trajectory.clone(), start);
        self.pilot.reset();
        self.vehicle.begin_flight(now);
        self.mission = Some(Mission::fly(plan, estimate.position.z, now));
        self.mode = Mode::Flying;
        if self.at_start == AtStart::Awaited {
            self.at_start = AtStart::Taken;
        }
    }

    fn end_flight(&mut self) {
        self.mission = None;
        self.mode = Mode::Disarmed;
    }

    fn is_flying(&self) -> bool {
        matches!(self.mode, Mode::Flying | Mode::Landing) && !self.watches_only
    }

    /// Whether the flight stands at its beginning, until the motors run.
    fn is_held(&self) -> bool {
        self.is_flying() && self.vehicle.holds_flight()
    }

    /// Lets the guard judge a pose and the estimator take it.
    fn take(&mut self, now: Time, header: &Header, pose: &PoseV1) {
        let flying = self.is_flying();
        match self.guard.judge(now, header, pose, flying) {
            Ok(believed) => {
                // Times since the clock's origin keep microseconds in an f64 for a century.
                let captured_s = believed.captured_at.since(Time::UNSET).seconds();
                let estimate =
                    self.estimator.update(captured_s, believed.position, believed.attitude);
                self.pilot.observe(believed.captured_at, &estimate);
                self.fresh = Some(*header);
            }
            Err(cause) => {
                self.missing = cause;
                if !flying || self.supervisor.state() == SafetyState::Stop {
                    self.guard.forget();
                }
            }
        }
    }

    fn tick(&mut self, now: Time, arrival: Option<&Header>) -> Tick {
        let deadline = self.next_event();
        let dt =
            now.since(self.last_tick).min(self.period.scaled(2.0)).max(self.period.scaled(0.5));
        let fresh = self.fresh.take();
        if arrival.is_none() && fresh.is_none() {
            self.missing = Cause::NoPose;
        }
        self.supervise(now, fresh.is_some());
        self.change_mode(now, fresh.is_some());
        let command = self.command(now, dt.seconds(), fresh.is_some());
        self.last_tick = now;

        // A held command is about no pose: what came was not believed.
        let about = fresh.as_ref();
        let woken_for = arrival.map_or(deadline, |header| header.stamps.pose_published_at);
        self.telemetry.wakeup_lateness_ns = now.since(woken_for).nanos();
        let stamps = about.map_or_else(Stamps::default, |header| header.stamps);
        Tick {
            pose_sequence: about.map_or(0, |header| header.pose_sequence),
            stamps: Stamps { woken_at: now, ..stamps },
            command,
        }
    }

    /// How long the vehicle has been out of sight.
    fn pose_age(&self, now: Time) -> Option<Span> {
        self.guard.last().map(|last| now.since(last.captured_at))
    }

    /// Whether it is more than so many periods ago, or never was.
    fn is_past(&self, now: Time, instant: Option<Time>, periods: f64) -> bool {
        instant.is_none_or(|instant| now.since(instant) > self.period.scaled(periods))
    }

    fn supervise(&mut self, now: Time, fresh: bool) {
        if fresh {
            self.last_seen = Some(now);
        }
        let poses_missing = self.is_past(now, self.last_seen, COAST_PERIODS);
        if poses_missing {
            self.guard.missed();
        }
        let age = self.pose_age(now);
        let armed = matches!(self.mode, Mode::Flying | Mode::Landing);
        // What is only watched has no vehicle.
        let vehicle_silent = !armed && !self.watches_only && !self.vehicle.answers(now);
        let vehicle_lost = std::mem::take(&mut self.vehicle_replaced)
            || self.is_flying() && self.vehicle.is_lost(now);
        let briefly_unseen = self.supervisor.cause() == Cause::NoPose
            && !self.is_past(now, self.last_nominal, SHORT_GAP_PERIODS);
        let needed = if briefly_unseen { 1 } else { self.recovery_poses };
        let conditions = Conditions {
            poses_missing,
            poses_good: fresh && self.guard.good_in_a_row() >= needed,
            blind_too_long: armed && age.is_none_or(|age| age > self.coast),
            vehicle_silent,
            vehicle_back: !vehicle_silent && self.supervisor.cause() == Cause::NoVehicle,
            vehicle_lost,
            operator_stops: std::mem::take(&mut self.stop_requested),
            // A vehicle that is only watched has nobody to arm it: its state follows its poses.
            operator_arms: self.mode == Mode::Waiting || self.watches_only,
        };
        let cause = match conditions {
            Conditions { operator_stops: true, .. } => Cause::Operator,
            Conditions { blind_too_long: true, .. } => self.missing,
            Conditions { vehicle_lost: true, .. } => Cause::NoVehicle,
            Conditions { vehicle_silent: true, poses_missing: false, .. } => Cause::NoVehicle,
            _ => self.missing,
        };
        if self.supervisor.step(&conditions, cause) == SafetyState::Nominal && fresh {
            self.last_nominal = Some(now);
        }
    }

    fn change_mode(&mut self, now: Time, fresh: bool) {
        let estimate = self.estimator.latest();
        let by_itself = self.takes_off_by_itself();
        match (self.mode, self.supervisor.state()) {
            (Mode::Disarmed, SafetyState::Nominal) if fresh && by_itself => {
                self.begin_flight(now, &estimate);
            }
            (Mode::Disarmed, SafetyState::Nominal) if self.watches_only => {
                self.pilot.reset();
                self.mission = Some(Mission::watch(estimate.position, now));
                self.mode = Mode::Flying;
            }
            // Armed now or not at all: the poses were good when the operator asked.
            (Mode::Waiting, SafetyState::Coast | SafetyState::Stop) if self.arms_at_once => {
                self.mode = Mode::Disarmed;
            }
            (Mode::Waiting, SafetyState::Nominal) if fresh => {
                self.begin_flight(now, &estimate);
            }
            (Mode::Flying | Mode::Landing, SafetyState::Stop) if !self.watches_only => {
                self.end_flight();
            }
            (Mode::Flying | Mode::Landing, _) if self.is_held() => {
                self.pilot.reset();
                if let Some(mission) = &mut self.mission {
                    mission.begin_again(now);
                }
            }
            (Mode::Flying | Mode::Landing, _) => {
                if let Some(mission) = &self.mission {
                    let reference = mission.reference(now);
                    if mission.has_landed(&reference, &estimate) {
                        self.end_flight();
                    } else if reference.phase == oqtal_control::trajectory::Phase::Landing {
                        self.mode = Mode::Landing;
                    }
                }
            }
            _ => {}
        }
    }

    /// The command of this tick: the pilot's on a fresh pose, the last one without, neutral when not flying, nothing but the
    /// setpoint to fly until the motors run.
    fn command(&mut self, now: Time, dt_s: f64, fresh: bool) -> CommandV1 {
        let estimate = self.estimator.latest();
        let reference = self.mission.as_ref().map(|mission| mission.reference(now));
        let held = self.is_held();
        let output = match &reference {
            Some(reference) if fresh && !held => {
                self.pilot.decide((now, dt_s), &estimate, reference)
            }
            _ => None,
        };
        let wanted = match &output {
            _ if reference.is_none() => CommandV1::default(),
            _ if held => self.pilot.idle(),
            Some(output) => finite_or_neutral(output.command),
            None => self.held,
        };
        self.note(now, reference.as_ref(), output.as_ref(), fresh);
        self.telemetry.sticks = wanted.sticks;
        self.telemetry.torque = wanted.torque;
        self.telemetry.thrust = wanted.thrust;
        self.held = wanted;
        // A vehicle that is only watched is told nothing; telemetry says what it would have been told.
        self.sent = if self.watches_only { CommandV1::default() } else { wanted };
        self.sent
    }
}
