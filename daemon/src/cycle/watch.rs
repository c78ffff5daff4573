//! The limits of a tick, and what keeps a flight from beginning.

use oqtal_bus::code::SafetyState;
use oqtal_bus::message::VehicleV1;
use oqtal_bus::obstacle::ArmingObstacles;
use oqtal_bus::time::Time;

use super::Cycle;
use crate::arming::ArmingView;
use crate::command::VehicleCommand;
use crate::guard::seconds;
use crate::limits::{FlightView, LimitConditions};
use crate::loop_health::TickFrames;

impl Cycle {
    /// Everything that keeps a flight from beginning; nothing in flight and of a recording.
    pub(super) fn obstacles(&self, now: Time) -> ArmingObstacles {
        if self.is_armed() || self.observe_only {
            return ArmingObstacles::default();
        }
        self.arming.obstacles(&ArmingView {
            poses_good: self.guard.good_in_a_row() >= self.timing.recovery_poses,
            last: self.guard.last(),
            vehicle: self.vehicle.answer(now),
            configs_differ: self.requests.configs_differ,
        })
    }

    /// The limits of this tick. In flight the motion is that at the instant at which a command takes effect.
    pub(super) fn limit_conditions(&mut self, now: Time, fresh: bool) -> LimitConditions {
        let age = self.pose_age(now).filter(|_| fresh);
        let (accepted, bad) = (self.guard.accepted(), self.guard.lost() + self.guard.refused());
        self.health.tick(age, TickFrames { accepted, bad });
        let mut conditions = LimitConditions {
            configs_differ: self.requests.configs_differ,
            ..LimitConditions::default()
        };
        if !self.is_flying() {
            return conditions;
        }
        self.health.judge(&mut conditions);
        conditions.setpoint_refused = self.memory.setpoint.is_refused;
        if let Some(vehicle) = self.vehicle.answer(now) {
            let vehicle: &VehicleV1 = vehicle;
            self.limits.judge_vehicle(vehicle, &mut conditions);
        }
        self.judge_motion(now, &mut conditions);
        conditions
    }

    fn judge_motion(&mut self, now: Time, conditions: &mut LimitConditions) {
        // A Stop decided in the next tick, whose command is late by a period, takes effect then.
        let acts_at = now + self.timing.period.scaled(2.0);
        let acts_s = seconds(acts_at) + self.guard.motion.delay_s();
        let motion = self.guard.motion.predict(acts_s);
        let (Some(mission), Some(reference), Some(motion)) =
            (&self.mission, &self.memory.setpoint.reference, &motion)
        else {
            return;
        };
        conditions.landing_overdue = mission.is_landing_overdue(now);
        let thrust_n = match self.memory.sent {
            VehicleCommand::Armed { thrust_n, .. } => thrust_n,
            VehicleCommand::Disarmed => 0.0,
        };
        let flight = FlightView {
            motion,
            floor_m: self.guard.motion.floor_m(),
            reference,
            thrust_n,
            is_descent: self.supervisor.state() == SafetyState::Descend,
        };
        self.limits.judge(&flight, conditions);
        if !conditions.in_fence_margin {
            self.memory.inside = Some(motion.motion.position);
        }
    }
}
