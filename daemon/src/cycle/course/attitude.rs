//! Prescribed attitudes. Only the configured law flies them; the fallback of a law that fails closes the position loop.

use nalgebra::Vector4;
use oqtal_bus::time::Time;
use oqtal_control::estimator::Estimate;
use oqtal_control::trajectory::{Reference, ReferenceMotion};

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

    /// The motion of the reference at `now`; `None` on the ground. Of a planner's attitude it is the motion of the vehicle.
    pub(super) fn motion(&self, now: Time) -> Option<ReferenceMotion> {
        let mission = self.mission.as_ref()?;
        let Some(mut motion) = self.stream.motion(now) else { return Some(mission.motion(now)) };
        if self.stream.prescribes_attitude() {
            let [position, velocity] = self.vehicle;
            motion.value = position.xy().push(motion.value.z).push(motion.value.w);
            motion.rate = velocity.xy().push(0.0).push(0.0);
            motion.acceleration = Vector4::zeros();
        }
        Some(motion)
    }

    /// Whether the reference of this tick prescribes an attitude.
    pub(in crate::cycle) fn prescribes_attitude(&self) -> bool {
        self.setpoint.reference.is_some_and(|reference| reference.attitude.is_some())
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
