//! Prescribed attitudes. Only the configured law flies them; the fallback of a law that fails closes the position loop.

use oqtal_bus::time::Time;
use oqtal_control::estimator::Estimate;
use oqtal_control::trajectory::Reference;

use super::FlightCourse;

impl FlightCourse {
    /// Begins a tick at `now` of a vehicle at `estimate`. If `law_fails`, a prescribed attitude ends, and the vehicle comes to rest.
    pub(in crate::cycle) fn begin_tick(&mut self, now: Time, estimate: &Estimate, law_fails: bool) {
        self.vehicle = [estimate.position, estimate.velocity];
        self.begins_hold = false;
        if law_fails && self.stream.prescribes_attitude() {
            self.end_stream(now);
        }
    }

    /// The reference of a fallback law while an attitude is prescribed: by a trajectory, its position; by a planner, the motion of the
    /// vehicle, from which it comes to rest. `None` while no attitude is prescribed.
    pub(in crate::cycle) fn without_attitude(&self, now: Time) -> Option<Reference> {
        let reference = self.setpoint.reference.filter(|reference| reference.attitude.is_some())?;
        if !self.stream.prescribes_attitude() {
            return Some(Reference { attitude: None, ..reference });
        }
        self.motion(now).map(|motion| motion.reference())
    }
}
