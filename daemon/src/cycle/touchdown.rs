//! The end of a landing: thrust is lowered where the vehicle does not come down by its loops, and a vehicle that stands on
//! something has landed, wherever it is.

use oqtal_bus::time::{Span, Time};
use oqtal_control::trajectory::Phase;

use super::Cycle;
use crate::command::VehicleCommand;
use crate::floor;

/// Time after the end of the landing's reference from which on thrust is lowered \[s\].
const LOWERED_AFTER_S: f64 = 1.5;
/// Share of the thrust that is taken away in each second \[1/s\]: slowly enough that the vehicle sinks, not falls.
const LOWERED_PER_S: f64 = 0.1;
/// Greatest share of the thrust that is taken away \[-\].
const MOST_LOWERED: f64 = 0.5;
/// Speed below which a vehicle is at rest \[m/s\].
const STANDING_M_S: f64 = 0.1;
/// Time for which it must be.
const STANDING: Span = Span::from_millis(500);

impl Cycle {
    /// `command` with less thrust if the landing has not ended although its reference has: a vehicle whose thrust is greater, or
    /// whose mass is smaller, than configured stays above the reference by more than the loops correct.
    pub(super) fn lowered(&self, now: Time, command: VehicleCommand) -> VehicleCommand {
        let VehicleCommand::Armed { rotation, thrust_n, attitude } = command else {
            return command;
        };
        let overdue_s = self.mission.as_ref().map_or(0.0, |mission| mission.overdue_s(now));
        let lowered = (LOWERED_PER_S * (overdue_s - LOWERED_AFTER_S)).clamp(0.0, MOST_LOWERED);
        VehicleCommand::Armed { rotation, thrust_n: thrust_n * (1.0 - lowered), attitude }
    }

    /// Whether the vehicle, which lands, has been at rest for a while under a thrust that does not carry it: it stands on something.
    pub(super) fn stands(&mut self, now: Time, phase: Phase) -> bool {
        let thrust_n = match self.memory.sent {
            VehicleCommand::Armed { thrust_n, .. } => thrust_n,
            VehicleCommand::Disarmed => f64::INFINITY,
        };
        let is_at_rest = phase == Phase::Landing
            && thrust_n < floor::STANDING * self.limits.weight_n()
            && self.estimator.latest().velocity.norm() < STANDING_M_S;
        if !is_at_rest {
            self.memory.stands_since = None;
            return false;
        }
        now.since(*self.memory.stands_since.get_or_insert(now)) >= STANDING
    }
}
