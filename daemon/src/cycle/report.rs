//! Report of the cycle: the telemetry of a tick.

use oqtal_bus::message::{CommandV1, Header, PoseV1, TelemetryV1};
use oqtal_bus::time::{Span, Time};
use oqtal_control::controller::LawTerms;
use oqtal_control::predictive::{AdaptedModel, MotionTracker};
use oqtal_control::trajectory::Reference;

use super::intake::Intake;
use super::supervision::FlightSupervision;
use crate::law_guard::GuardReport;
use crate::mission::ActiveMission;
use crate::stack::ControlOutput;

/// Telemetry of the last tick, filled in while the tick is computed.
#[derive(Clone, Debug)]
pub(super) struct TickReport {
    telemetry: TelemetryV1,
}

impl TickReport {
    /// The report before the first pose.
    pub(super) fn new() -> Self {
        let unknown = [f64::NAN; 3];
        let mut telemetry = TelemetryV1 {
            mission_s: f64::NAN,
            planned_landing_s: f64::NAN,
            reference_velocity: unknown,
            reference_yaw: f64::NAN,
            proportional_term: unknown,
            integral_term: unknown,
            feed_forward_term: unknown,
            disturbance_term: unknown,
            pose_age_s: f64::NAN,
            pose_position: unknown,
            pose_attitude: [f64::NAN; 4],
            pose_residual_m: f64::NAN,
            ..TelemetryV1::default()
        };
        clear_filter(&mut telemetry);
        Self { telemetry }
    }

    /// The telemetry.
    pub(super) fn telemetry(&self) -> &TelemetryV1 {
        &self.telemetry
    }

    /// Records an accepted pose as it was measured, and the motion that a law flies on.
    pub(super) fn record_pose(
        &mut self,
        (header, pose): &(Header, PoseV1),
        tracker: &MotionTracker,
    ) {
        let telemetry = &mut self.telemetry;
        telemetry.pose_captured_at = header.stamps.captured_at;
        telemetry.pose_published_at = header.stamps.pose_published_at;
        telemetry.pose_sequence = header.pose_sequence;
        telemetry.pose_position = pose.position;
        telemetry.pose_attitude = pose.attitude;
        telemetry.pose_residual_m = pose.residual_m;
        // The law may have changed since the last pose.
        clear_filter(telemetry);
        let Some((motion, innovation)) = tracker.filtered() else { return };
        telemetry.filter_position = motion.position.into();
        telemetry.filter_velocity = motion.velocity.into();
        telemetry.filter_attitude = motion.attitude.xyzw();
        telemetry.filter_rate = motion.rate.into();
        if let Some(innovation) = innovation {
            telemetry.innovation_position = innovation.position.into();
            telemetry.innovation_attitude = innovation.attitude.into();
            telemetry.nis = [innovation.position_nis, innovation.attitude_nis];
        }
        if let Some(adapted) = tracker.adapted() {
            record_adapted(telemetry, &adapted);
        }
    }

    /// Records a tick: the state of intake and supervision, and the output of the law, if it computed one.
    pub(super) fn record_tick(
        &mut self,
        now: Time,
        intake: &Intake,
        supervision: &FlightSupervision,
        output: Option<&ControlOutput>,
    ) {
        let telemetry = &mut self.telemetry;
        telemetry.time = now;
        telemetry.tick += 1;
        let mission = supervision.course().mission();
        telemetry.mission_s = mission.map_or(f64::NAN, |mission| mission.elapsed_s(now));
        telemetry.planned_landing_s = mission.map_or(f64::NAN, ActiveMission::planned_landing_s);
        telemetry.scored = u8::from(mission.is_some_and(|mission| mission.is_scored(now)));
        let estimate = intake.estimate();
        telemetry.position = estimate.position.into();
        telemetry.velocity = estimate.velocity.into();
        telemetry.attitude = estimate.attitude.xyzw();
        telemetry.rate = estimate.rate.0.into();
        telemetry.pose_age_s = intake.pose_age(now).map_or(f64::NAN, Span::seconds);
        let noise = intake.noise().deviations();
        telemetry.pose_noise_m = noise.position_m;
        telemetry.pose_noise_rad = noise.attitude_rad;
        let evidence = intake.consistency().evidence();
        telemetry.pose_evidence = [evidence.ending(), evidence.direction, evidence.drift];
        let guard = intake.guard();
        telemetry.poses_lost = guard.lost();
        telemetry.poses_superseded = guard.superseded();
        telemetry.poses_refused = guard.refused();
        telemetry.obstacles = supervision.obstacles().bits();
        telemetry.mode = supervision.mode().code();
        telemetry.state = supervision.safety().state().code();
        telemetry.cause = supervision.safety().cause().code();
        let offset_rad = intake.consistency().heading_offset_rad(now);
        let reference = supervision.course().setpoint().turned(offset_rad);
        telemetry.phase = reference.map_or(0, |reference| reference.phase as u8);
        record_setpoints(telemetry, reference.as_ref(), output);
    }

    /// Records the message of the tick, whether it is sent or not, with the law's counts of Riccati equations. `is_fresh` if the tick
    /// has a pose.
    pub(super) fn record_command(
        &mut self,
        message: &CommandV1,
        riccati_counts: [u32; 2],
        is_fresh: bool,
    ) {
        let telemetry = &mut self.telemetry;
        telemetry.fresh = u8::from(is_fresh);
        let [solves, failures] = riccati_counts.map(u64::from);
        (telemetry.riccati_solves, telemetry.riccati_failures) = (solves, failures);
        telemetry.sticks = message.sticks;
        telemetry.torque = message.torque;
        telemetry.attitude_sent = message.attitude;
        telemetry.thrust = message.thrust;
    }

    /// Records the selection between the law and its fallback.
    pub(super) fn record_law(&mut self, guard: &GuardReport) {
        self.telemetry.handovers = guard.handovers;
        self.telemetry.handover_cause = guard.cause.code();
        self.telemetry.fallback = u8::from(guard.is_fallback);
    }

    /// Records how late the loop was woken up.
    pub(super) fn record_wakeup(&mut self, lateness: Span) {
        self.telemetry.wakeup_lateness_ns = lateness.nanos();
    }

    /// Records the command `sequence` as sent, with the deadlines missed so far.
    pub(super) fn record_sent(&mut self, sequence: u64, deadline_misses: u64) {
        self.telemetry.command_sequence = sequence;
        self.telemetry.deadline_misses = deadline_misses;
    }
}

/// Sets the motion of a filter and the adapted model to unknown: not every law flies on them.
fn clear_filter(telemetry: &mut TelemetryV1) {
    let unknown = [f64::NAN; 3];
    telemetry.filter_position = unknown;
    telemetry.filter_velocity = unknown;
    telemetry.filter_attitude = [f64::NAN; 4];
    telemetry.filter_rate = unknown;
    telemetry.innovation_position = unknown;
    telemetry.innovation_attitude = unknown;
    telemetry.nis = [f64::NAN; 2];
    telemetry.adapted_rate_gain = unknown;
    telemetry.adapted_rate_lag_s = f64::NAN;
    telemetry.adapted_delay_s = f64::NAN;
    telemetry.adapted_thrust_gain = f64::NAN;
    telemetry.adapted_thrust_lag_s = f64::NAN;
    telemetry.fell_back = 0;
}

/// Fills in the model adapted in flight.
fn record_adapted(telemetry: &mut TelemetryV1, adapted: &AdaptedModel) {
    telemetry.adapted_rate_gain = adapted.rate_gain.into();
    telemetry.adapted_rate_lag_s = adapted.rate_lag_s;
    telemetry.adapted_delay_s = adapted.delay_s;
    telemetry.adapted_thrust_gain = adapted.thrust_gain;
    telemetry.adapted_thrust_lag_s = adapted.thrust_lag_s;
    telemetry.fell_back = u8::from(adapted.fell_back);
}

/// Fills in the terms of the law, in the order of [`LawTerms`].
fn record_terms(telemetry: &mut TelemetryV1, terms: [[f64; 3]; 4]) {
    [
        telemetry.proportional_term,
        telemetry.integral_term,
        telemetry.feed_forward_term,
        telemetry.disturbance_term,
    ] = terms;
}

/// Fills in reference and set-points: the last ones while coasting, NaN when not flying.
fn record_setpoints(
    telemetry: &mut TelemetryV1,
    reference: Option<&Reference>,
    output: Option<&ControlOutput>,
) {
    match reference {
        Some(reference) => {
            telemetry.reference_position = reference.position.into();
            telemetry.reference_velocity = reference.velocity.into();
            telemetry.reference_yaw = reference.yaw_rad;
        }
        None => {
            telemetry.reference_velocity = [f64::NAN; 3];
            telemetry.reference_yaw = f64::NAN;
            telemetry.velocity_command = [f64::NAN; 3];
            telemetry.attitude_command = [f64::NAN; 4];
            telemetry.saturated = 0;
            record_terms(telemetry, [[f64::NAN; 3]; 4]);
        }
    }
    if let Some(ControlOutput { setpoint, saturated, terms, .. }) = output {
        let LawTerms { proportional, integral, feed_forward, disturbance } = *terms;
        let terms = [proportional, integral, feed_forward, disturbance];
        record_terms(telemetry, terms.map(Into::into));
        telemetry.velocity_command = setpoint.velocity.into();
        telemetry.attitude_command = setpoint.attitude.attitude.xyzw();
        telemetry.saturated = u8::from(*saturated);
    }
}
