//! The safety conditions of a tick.

use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::time::{Span, Time};

use super::Cycle;
use crate::supervisor::SafetyConditions;

/// Time without an accepted pose after which the daemon coasts \[periods\]: the second deadline in a row, three periods after
/// the last pose. Sources that poll, are late by a frame or are a little slower than the loop miss the first one.
const COAST_PERIODS: f64 = 2.5;
/// Gap after which the first good pose is accepted at once \[periods\]; after longer gaps several are needed.
const SHORT_GAP_PERIODS: f64 = 6.0;

impl Cycle {
    /// Age of the last accepted pose; `None` before the first.
    pub(super) fn pose_age(&self, now: Time) -> Option<Span> {
        self.guard.last().map(|last| now.since(last.captured_at))
    }

    /// Collects the safety conditions and changes the safety state.
    pub(super) fn supervise(&mut self, now: Time, fresh: bool) {
        if fresh {
            self.memory.last_seen = Some(now);
        }
        let poses_missing = self.is_past(now, self.memory.last_seen, COAST_PERIODS);
        if poses_missing {
            self.guard.missed();
            self.carry_motion(now);
        }
        let conditions = self.conditions(now, fresh, poses_missing);
        let state = self.supervisor.step(now, &conditions, self.memory.missing);
        if state <= SafetyState::Degraded && fresh {
            self.memory.last_nominal = Some(now);
        }
    }

    /// The safety conditions of this tick. Takes the requests that end a flight.
    fn conditions(&mut self, now: Time, fresh: bool, poses_missing: bool) -> SafetyConditions {
        let age = self.pose_age(now);
        let is_armed = self.is_armed();
        // A recording has no vehicle.
        let vehicle_silent = !is_armed && !self.observe_only && !self.vehicle.answers(now);
        let vehicle_lost = std::mem::take(&mut self.requests.vehicle_replaced)
            || self.is_flying() && self.vehicle.is_lost(now);
        let briefly_unseen = self.supervisor.cause() == Cause::NoPose
            && !self.is_past(now, self.memory.last_nominal, SHORT_GAP_PERIODS);
        let blind_too_long = is_armed && age.is_none_or(|age| age > self.timing.coast);
        let needed = if briefly_unseen { 1 } else { self.timing.recovery_poses };
        SafetyConditions {
            poses_missing,
            poses_good: fresh && self.guard.good_in_a_row() >= needed,
            may_descend: self.may_descend(now),
            // Only a blind vehicle is asked for: the answer costs a prediction.
            is_down: blind_too_long && self.is_down(now),
            blind_too_long,
            vehicle_silent,
            vehicle_lost,
            control_taken: self.is_flying() && self.vehicle.control_is_taken(),
            operator_stops: std::mem::take(&mut self.requests.stop),
            // No operator arms a recording: its state follows its poses.
            operator_arms: self.mode == Mode::Waiting || self.observe_only,
            is_flying: self.is_flying(),
            limits: self.limit_conditions(now, fresh),
        }
    }

    /// Whether `instant` is more than `periods` ago, or unset.
    fn is_past(&self, now: Time, instant: Option<Time>, periods: f64) -> bool {
        instant.is_none_or(|instant| now.since(instant) > self.timing.period.scaled(periods))
    }
}
