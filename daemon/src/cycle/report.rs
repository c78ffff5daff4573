//! Telemetry of a tick, for observers.

use oqtal_bus::message::{Header, PoseV1, TelemetryV1};
use oqtal_bus::time::{Span, Time};
use oqtal_control::predictive::AdaptedModel;
use oqtal_control::trajectory::Reference;

use super::Cycle;
use crate::mission::ActiveMission;
use crate::stack::ControlOutput;

impl Cycle {
    /// Fills in an accepted pose, as it was measured, and what the control stack's own filter made of it.
    pub(super) fn record_pose(&mut self, header: &Header, pose: &PoseV1) {
        let telemetry = &mut self.telemetry;
        telemetry.pose_captured_at = header.stamps.captured_at;
        telemetry.pose_published_at = header.stamps.pose_published_at;
        telemetry.pose_sequence = header.pose_sequence;
        telemetry.pose_position = pose.position;
        telemetry.pose_attitude = pose.attitude;
        telemetry.pose_residual_m = pose.residual_m;
        let Some((motion, innovation)) = self.stack.active().filtered() else { return };
        telemetry.filter_position = motion.position.into();
        telemetry.filter_velocity = motion.velocity.into();
        telemetry.filter_attitude = motion.attitude.xyzw();
        telemetry.filter_rate = motion.rate.into();
        let unknown = [f64::NAN; 3];
        telemetry.innovation_position = innovation.map_or(unknown, |i| i.position.into());
        telemetry.innovation_attitude = innovation.map_or(unknown, |i| i.attitude.into());
        telemetry.nis = innovation.map_or([f64::NAN; 2], |i| [i.position_nis, i.attitude_nis]);
        if let Some(adapted) = self.stack.active().adapted() {
            record_adapted(telemetry, &adapted);
        }
    }

    /// Fills in the telemetry of this tick.
    pub(super) fn record(&mut self, now: Time, output: Option<&ControlOutput>, fresh: bool) {
        let reference = self.memory.setpoint.reference;
        let estimate = self.estimator.latest();
        let age_s = self.pose_age(now).map_or(f64::NAN, Span::seconds);
        let obstacles = if self.is_armed() { 0 } else { self.memory.obstacles.bits() };
        let telemetry = &mut self.telemetry;
        telemetry.time = now;
        telemetry.tick += 1;
        telemetry.mission_s =
            self.mission.as_ref().map_or(f64::NAN, |mission| mission.elapsed_s(now));
        telemetry.planned_landing_s =
            self.mission.as_ref().map_or(f64::NAN, ActiveMission::planned_landing_s);
        telemetry.position = estimate.position.into();
        telemetry.velocity = estimate.velocity.into();
        telemetry.attitude = estimate.attitude.xyzw();
        telemetry.rate = estimate.rate.0.into();
        telemetry.pose_age_s = age_s;
        telemetry.riccati_solves = u64::from(self.stack.active().riccati_solves());
        telemetry.riccati_failures = u64::from(self.stack.active().riccati_failures());
        telemetry.poses_lost = self.guard.lost();
        telemetry.poses_superseded = self.guard.superseded();
        telemetry.poses_refused = self.guard.refused();
        telemetry.obstacles = obstacles;
        telemetry.mode = self.mode.code();
        telemetry.state = self.supervisor.state().code();
        telemetry.cause = self.supervisor.cause().code();
        telemetry.fresh = u8::from(fresh);
        let scored = self.mission.as_ref().is_some_and(|mission| mission.is_scored(now));
        telemetry.scored = u8::from(scored);
        telemetry.phase = reference.map_or(0, |reference| reference.phase as u8);
        record_commands(telemetry, reference.as_ref(), output);
    }
}

/// Fills in the model adapted in flight.
fn record_adapted(telemetry: &mut TelemetryV1, adapted: &AdaptedModel) {
    telemetry.adapted_rate_gain = adapted.rate_gain;
    telemetry.adapted_rate_lag_s = adapted.rate_lag_s;
    telemetry.adapted_delay_s = adapted.delay_s;
    telemetry.adapted_thrust_gain = adapted.thrust_gain;
    telemetry.fell_back = u8::from(adapted.fell_back);
}

/// Fills in reference and commands: the last ones while coasting, NaN when not flying.
fn record_commands(
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
        }
    }
    if let Some(ControlOutput { setpoint, saturated, .. }) = output {
        telemetry.velocity_command = setpoint.velocity.into();
        telemetry.attitude_command = setpoint.attitude.attitude.xyzw();
        telemetry.saturated = u8::from(*saturated);
    }
}
