//! Intake of the cycle: poses and vehicle messages in, the motion of the vehicle out.

use oqtal_bus::code::Cause;
use oqtal_bus::message::{Header, PoseV1, VehicleV1};
use oqtal_bus::obstacle::ArmingObstacles;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::estimator::{Estimate, Estimator};
use oqtal_control::euler::{EulerAngles, shorter_turn};
use oqtal_control::options::OptionError;
use oqtal_control::predictive::{CommandReport, MotionTracker};
use oqtal_control::trajectory::{Phase, Reference, Trajectory};

use crate::arming::{ArmingCheck, ArmingPath, ArmingView};
use crate::command::VehicleCommand;
use crate::command_model::{CommandModel, motion_tracker};
use crate::consistency::{Expectation, PoseConsistency};
use crate::floor::AIRBORNE_M;
use crate::guard::{AcceptedPose, Guard};
use crate::measured_noise::MeasuredNoise;
use crate::vehicle::VehicleWatch;

/// Time without an accepted pose after which poses count as missing \[periods\]: the second deadline in a row, three periods after the last
/// pose. Sources that poll, that are late by a frame, or that are slightly slower than the loop miss the first deadline.
const MISSING_PERIODS: f64 = 2.5;
/// Share of answered requests below which the vehicle is not expected to follow its commands \[0..1\].
const LEAST_LINK: f64 = 0.3;
/// Distance from the reference above which a vehicle counts as on its way to it \[m\]; a law that counteracts a disturbance holds the
/// vehicle closer.
const AWAY_M: f64 = 0.1;
/// Mean change of the reference heading from tick to tick above which it turns \[rad\], and the share of a tick in the mean \[-\]. A heading
/// that turns more slowly, or jitters, does not disturb the oscillation that shows whether poses follow the vehicle.
const TURNS_RAD: f64 = 1e-3;
const TURN_SHARE: f64 = 0.1;
/// Age of the tracked motion above which it is propagated without poses \[s\]: less than the time for which commands are stored.
const OLD_TRACK_S: f64 = 0.5;
/// Age of the motion after this propagation \[s\]: greater than the age of any pose that is accepted.
const PROPAGATED_TRACK_S: f64 = 0.25;

/// Observations of the daemon, and the motion that follows from them.
#[derive(Clone, Debug)]
pub(super) struct Intake {
    /// Time without accepted poses in flight during which the vehicle is flown on the predicted motion.
    predict: Span,
    /// Time after which poses count as missing.
    missing_after: Span,
    /// Good poses in a row that allow a flight \[-\].
    recovery_poses: u32,
    guard: Guard,
    noise: MeasuredNoise,
    consistency: PoseConsistency,
    tracker: MotionTracker,
    commands: CommandModel,
    estimator: Estimator,
    vehicle: VehicleWatch,
    arming: ArmingCheck,
    /// The newest pose since the last tick, if it was accepted.
    fresh: Option<Header>,
    /// The last tick on an accepted pose.
    fresh_at: Option<Time>,
    /// Reason why the last due pose is missing.
    missing: Cause,
    /// Whether poses since the last accepted one contradict the motion predicted from those before.
    contradicts_motion: bool,
    /// Last instant at which no test had evidence that the poses do not agree with the vehicle.
    undisputed_at: Time,
    /// Whether the vehicle lands: it may stand on something already.
    is_landing: bool,
    /// Reference in the last tick; `None` without one.
    reference: Option<Reference>,
    /// Mean change of the reference heading from tick to tick \[rad\].
    turn_rad: f64,
}

impl Intake {
    /// The intake of `config`, for flights of `trajectory`.
    ///
    /// # Errors
    /// The vehicle has no model.
    pub(super) fn new(config: &Config, trajectory: &Trajectory) -> Result<Self, OptionError> {
        let commands = CommandModel::new(config)?;
        let mut intake = Self {
            predict: Span::from_seconds(config.safety.predict_ms * 1e-3),
            missing_after: Span::period_of(config.control.rate_hz).scaled(MISSING_PERIODS),
            recovery_poses: config.safety.recovery_poses,
            guard: Guard::new(config),
            noise: MeasuredNoise::new(config),
            consistency: PoseConsistency::new(config),
            tracker: motion_tracker(config, commands.model),
            commands,
            estimator: Estimator::new(config.control.estimator),
            vehicle: VehicleWatch::new(&config.safety),
            arming: ArmingCheck::new(config, trajectory),
            fresh: None,
            fresh_at: None,
            missing: Cause::NoPose,
            contradicts_motion: false,
            undisputed_at: Time::UNSET,
            is_landing: false,
            reference: None,
            turn_rad: 0.0,
        };
        // A flight may begin before any noise was measured.
        intake.use_measured_noise();
        Ok(intake)
    }

    /// Takes a pose, `flying` or not; returns whether it was accepted. Unless `keeps`, the last position is discarded after a jump.
    pub(super) fn take_pose(
        &mut self,
        now: Time,
        arrival: &(Header, PoseV1),
        flying: bool,
        keeps: bool,
    ) -> bool {
        if flying && self.consistency.contradicts() {
            self.missing = self.contradiction();
            self.guard.ignore(&arrival.0);
            return false;
        }
        match self.guard.check(&mut self.tracker, now, arrival, flying) {
            Ok(accepted) => {
                let captured_s = accepted.captured_at.seconds();
                let estimate = self.estimator.update(
                    captured_s,
                    accepted.pose.position,
                    accepted.pose.attitude,
                );
                if self.tracker.track().is_none() {
                    self.tracker.rest(&estimate);
                }
                self.check_consistency(now, &accepted);
                self.fresh = Some(arrival.0);
                self.arming.take(&accepted);
                self.contradicts_motion = false;
                true
            }
            Err(cause) => {
                self.missing = cause;
                // A single outlier says nothing about the poses before it.
                self.contradicts_motion |= matches!(cause, Cause::Relabel | Cause::Frozen);
                if !keeps {
                    self.guard.forget();
                }
                false
            }
        }
    }

    /// Takes the state of the vehicle, and the instant at which a command took effect.
    pub(super) fn receive_vehicle(&mut self, now: Time, header: &Header, vehicle: &VehicleV1) {
        self.vehicle.receive(now, header.source, vehicle);
        if vehicle.body_rate_at.is_set() {
            self.consistency.receive_rate(vehicle.body_rate_at.seconds(), vehicle.body_rate.into());
        }
        let follows = self.vehicle.follows(header.sequence);
        let applied_at = header.stamps.applied_at;
        if applied_at.is_set() {
            let remaining = Span::from_nanos(vehicle.wire_ns + vehicle.air_ns);
            let acts_s = (applied_at + remaining).seconds();
            let sequence = vehicle.command_sequence;
            self.tracker.applied(CommandReport { sequence, acts_s, follows });
        }
    }

    /// Measures the noise of an accepted pose, and checks that it follows the vehicle.
    fn check_consistency(&mut self, now: Time, accepted: &AcceptedPose) {
        let (captured_s, pose) = (accepted.captured_at.seconds(), accepted.pose);
        let noise = self.noise.deviations();
        let obeys = !(self.is_landing || self.vehicle.link_quality() < LEAST_LINK);
        let is_away = self.reference.is_some_and(|reference| {
            let distance_m = (reference.position - pose.position).norm();
            distance_m > AWAY_M || reference.phase == Phase::TakeOff
        });
        let is_prescribed = self.reference.is_some_and(|reference| reference.attitude.is_some());
        let turns = is_prescribed || self.turn_rad.abs() > TURNS_RAD;
        let expected = Expectation { obeys, is_away, turns };
        self.consistency.take(&self.tracker, (captured_s, &pose), &noise, &expected);
        if !self.consistency.is_disputed() {
            self.undisputed_at = now;
        } else if self.consistency.contradicts() {
            self.missing = self.contradiction();
        }
        if self.noise.take(captured_s, &pose, self.consistency.is_quiet()) {
            self.use_measured_noise();
        }
    }

    fn use_measured_noise(&mut self) {
        let noise = self.noise.deviations();
        self.tracker.set_measured_noise(noise.position_m, noise.attitude_rad);
        self.guard.set_noise(&noise);
    }

    /// Cause for poses that do not follow the vehicle. If it has not replied since they last did, it may not receive commands.
    fn contradiction(&self) -> Cause {
        if self.is_vehicle_silent() { Cause::NoVehicle } else { Cause::Contradiction }
    }

    /// Whether the vehicle has not replied since the poses followed it.
    pub(super) fn is_vehicle_silent(&self) -> bool {
        self.vehicle.is_silent_since(self.undisputed_at)
    }

    /// Records whether the vehicle lands, and its reference.
    pub(super) fn record_course(&mut self, is_landing: bool, reference: Option<&Reference>) {
        let pair = reference.zip(self.reference.as_ref());
        let turn_rad = pair.map_or(0.0, |(now, before)| shorter_turn(now.yaw_rad - before.yaw_rad));
        self.turn_rad += (turn_rad - self.turn_rad) * TURN_SHARE;
        (self.is_landing, self.reference) = (is_landing, reference.copied());
    }

    /// Records the command published at `sent_at`.
    pub(super) fn sent(&mut self, sequence: u64, sent_at: Time, command: &VehicleCommand) {
        self.tracker.sent(sequence, sent_at.seconds(), self.commands.input(command));
    }

    /// Begins a tick at `now`; returns the header of the newest pose, if it was accepted. `arrived`: whether a pose arrived in this tick.
    pub(super) fn begin_tick(&mut self, now: Time, arrived: bool) -> Option<Header> {
        let fresh = self.fresh.take();
        if fresh.is_some() {
            self.fresh_at = Some(now);
        } else if !arrived {
            self.missing = Cause::NoPose;
        }
        self.tracker.expect_reports();
        if self.poses_missing(now) {
            self.guard.missed();
            let now_s = now.seconds();
            self.guard.propagate(
                &mut self.tracker,
                now_s - OLD_TRACK_S,
                now_s - PROPAGATED_TRACK_S,
            );
        }
        fresh
    }

    /// Whether poses have been missing for longer than the longest pause of a regular source.
    pub(super) fn poses_missing(&self, now: Time) -> bool {
        self.fresh_at.is_none_or(|at| now.since(at) > self.missing_after)
    }

    /// Whether a pose waits for the next tick.
    pub(super) fn has_fresh(&self) -> bool {
        self.fresh.is_some()
    }

    /// Reason why the last due pose is missing.
    pub(super) fn missing(&self) -> Cause {
        self.missing
    }

    /// Whether poses since the last accepted one contradict the motion predicted from those before: a lasting jump, or frozen poses.
    pub(super) fn contradicts_motion(&self) -> bool {
        self.contradicts_motion
    }

    /// Age of the last accepted pose; `None` before the first.
    pub(super) fn pose_age(&self, now: Time) -> Option<Span> {
        self.guard.last().map(|last| now.since(last.captured_at))
    }

    /// Heading of the vehicle in the last accepted pose \[rad\]; `None` before the first.
    pub(super) fn heading_rad(&self) -> Option<f64> {
        self.guard.last().map(|last| EulerAngles::from_attitude(&last.pose.attitude).yaw)
    }

    /// The last accepted pose.
    pub(super) fn last_pose(&self) -> Option<&AcceptedPose> {
        self.guard.last()
    }

    /// The motion estimated from poses.
    pub(super) fn estimate(&self) -> Estimate {
        self.estimator.latest()
    }

    /// The motion for a tick at `now`: the estimate in a tick with a pose, `fresh`; else the predicted one, as old as that of the last
    /// tick with a pose. `None` if poses have been missing for too long, and where no motion is predicted.
    pub(super) fn motion(&self, now: Time, fresh: bool) -> Option<Estimate> {
        if fresh {
            return Some(self.estimator.latest());
        }
        let (last, fresh_at) = (self.guard.last()?, self.fresh_at?);
        if now.since(fresh_at) > self.predict {
            return None;
        }
        let t_s = (last.captured_at + now.since(fresh_at)).seconds();
        self.tracker.predict(t_s).map(|track| track.estimate())
    }

    /// The tracked motion and the commands in flight.
    pub(super) fn tracker(&self) -> &MotionTracker {
        &self.tracker
    }

    /// The guard of the poses, with its counters.
    pub(super) fn guard(&self) -> &Guard {
        &self.guard
    }

    /// The measured noise of the poses.
    pub(super) fn noise(&self) -> &MeasuredNoise {
        &self.noise
    }

    /// The tests of the consistency of poses and vehicle.
    pub(super) fn consistency(&self) -> &PoseConsistency {
        &self.consistency
    }

    /// The state of the vehicle.
    pub(super) fn vehicle(&self) -> &VehicleWatch {
        &self.vehicle
    }

    /// Continues the flight with the model, the noise and the adaptation of `tracker`, for another law.
    pub(super) fn change_law(&mut self, tracker: &MotionTracker) {
        self.tracker.change_law(tracker);
        self.use_measured_noise();
    }

    /// Exchanges the path that is checked before the next flight.
    pub(super) fn exchange_path(&mut self, path: &mut ArmingPath) {
        self.arming.exchange_path(path);
    }

    /// Reasons against a flight.
    pub(super) fn obstacles(&self, now: Time, configs_differ: bool) -> ArmingObstacles {
        self.arming.obstacles(&ArmingView {
            poses_good: self.guard.good_in_a_row() >= self.recovery_poses,
            last: self.guard.last(),
            vehicle: self.vehicle.answer(now),
            configs_differ,
        })
    }

    /// Begins a flight at the last accepted pose.
    pub(super) fn begin_flight(&mut self, now: Time) {
        self.undisputed_at = now;
        self.vehicle.begin_flight(now);
        self.consistency.restart();
        self.guard.begin_flight(&mut self.tracker);
    }

    /// Whether the vehicle was in the air at the last accepted pose.
    pub(super) fn was_airborne(&self) -> bool {
        let lowest_m = self.tracker.floor_m() + AIRBORNE_M;
        self.guard.last().is_some_and(|last| last.pose.position.z > lowest_m)
    }

    /// Ends the flight; `is_stopped` if by a Stop, after which the vehicle may still fall.
    pub(super) fn end_flight(&mut self, is_stopped: bool) {
        if is_stopped && self.was_airborne() {
            self.arming.forget_rest();
        }
        self.guard.end_flight(&mut self.tracker);
        self.consistency.restart();
    }
}
