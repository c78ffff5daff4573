//! Level and descend: what a vehicle that holds an attitude by itself does where the daemon has been blind for too long.

use oqtal_bus::time::Time;
use oqtal_control::euler::EulerAngles;

use super::Cycle;
use crate::command::VehicleCommand;
use crate::floor::AIRBORNE_M;
use crate::guard::seconds;

/// Age of the predicted motion from which on it is carried forward \[s\]: less than the commands that are remembered.
const OLD_TRACK_S: f64 = 0.5;
/// Age of the motion that is carried forward \[s\]: more than that of any pose that is accepted.
const CARRIED_TRACK_S: f64 = 0.25;

impl Cycle {
    /// Whether the vehicle may descend without poses: it stays level by itself, was in the air when it was seen last, and has
    /// not descended for too long.
    pub(super) fn may_descend(&self, now: Time) -> bool {
        let Some(last) = self.guard.last().filter(|_| self.is_flying() && !self.is_held()) else {
            return false;
        };
        self.descent.is_possible(now.since(last.captured_at))
            && last.position.z > self.guard.motion.floor_m() + AIRBORNE_M
    }

    /// Whether the predicted motion has reached the floor.
    pub(super) fn is_down(&self, now: Time) -> bool {
        let floor_m = self.guard.motion.floor_m();
        self.guard.motion.predict(seconds(now)).is_some_and(|track| track.is_at_floor(floor_m))
    }

    /// The command of the descent: level at the last heading, with a thrust below that of a hover.
    pub(super) fn descend(&self, now: Time) -> VehicleCommand {
        let heading = EulerAngles::from_attitude(&self.estimator.latest().attitude).yaw;
        let track = self.guard.motion.predict(seconds(now));
        let lift = track.map_or(0.0, |track| track.external_acceleration().z);
        VehicleCommand::level(self.interface, heading, self.descent.thrust_n(lift))
    }

    /// Carries the predicted motion forward where poses have been missing for longer than commands are remembered.
    pub(super) fn carry_motion(&mut self, now: Time) {
        let now_s = seconds(now);
        self.guard.motion.carry(now_s - OLD_TRACK_S, now_s - CARRIED_TRACK_S);
    }
}
