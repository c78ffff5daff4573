//! The current flight: its plan and its start.

use nalgebra::{Vector3, Vector4};
use oqtal_bus::time::{Span, Time};
use oqtal_control::estimator::Estimate;
use oqtal_control::trajectory::{
    Detour, FlightPlan, Phase, Reference, ReferenceMotion, StartPoint,
};

use crate::floor::LANDED_M;

/// Time after the end of the landing's reference within which the vehicle must have landed \[s\].
const LANDING_GRACE_S: f64 = 8.0;
/// Time for which a flight may be held, all holds together.
const MOST_HELD: Span = Span::from_millis(10_000);
/// Time over which the motion of the reference is a difference \[s\].
const DIFFERENCE_S: f64 = 1e-3;

/// The current flight.
#[derive(Clone, Debug)]
pub struct ActiveMission {
    began: Time,
    path: FlightPath,
    /// Number of changes of the plan \[-\].
    changes: u32,
    /// Since when the mission waits, and the reference meanwhile.
    held: Option<(Time, Reference)>,
    /// Total duration of earlier holds since an operator's last change of course.
    held_before: Span,
}

// Not boxed: the real-time thread does not allocate.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)]
enum FlightPath {
    /// A flight from take-off to landing, and the height of the floor \[m\].
    Plan(FlightPlan, f64),
    /// The point \[m, world\] that is the reference while the daemon only observes.
    Observe(Vector3<f64>),
}

impl ActiveMission {
    /// The flight of `plan` from `now` on, from the floor at `floor_m` \[m, world z\].
    pub fn fly(plan: FlightPlan, floor_m: f64, now: Time) -> Self {
        Self::begin(now, FlightPath::Plan(plan, floor_m))
    }

    /// Observes a vehicle with the fixed reference `point` \[m, world\].
    pub fn observe(point: Vector3<f64>, now: Time) -> Self {
        Self::begin(now, FlightPath::Observe(point))
    }

    fn begin(began: Time, path: FlightPath) -> Self {
        Self { began, path, changes: 0, held: None, held_before: Span::ZERO }
    }

    /// Number of changes of the plan so far, for example by a landing \[-\]; the reference may jump at a change.
    pub fn changes(&self) -> u32 {
        self.changes
    }

    /// Moves the beginning to `now`.
    pub fn restart(&mut self, now: Time) {
        self.began = now;
    }

    /// Time since the flight began \[s\].
    pub fn elapsed_s(&self, now: Time) -> f64 {
        let now = self.held.map_or(now, |(since, _)| since);
        now.since(self.began).seconds()
    }

    /// Holds the vehicle at `reference` unless it is held already; the mission waits.
    pub fn hold(&mut self, now: Time, reference: Reference) {
        if self.held.is_none() {
            self.held = Some((now, reference));
            self.changes += 1;
        }
    }

    /// Continues the mission where it was held.
    pub fn resume(&mut self, now: Time) {
        if let Some((since, _)) = self.held.take() {
            self.began = self.began + now.since(since);
            self.held_before = self.held_before + now.since(since);
            self.changes += 1;
        }
    }

    /// Whether all holds together have lasted 10 s.
    pub fn is_held_too_long(&self, now: Time) -> bool {
        let present = self.held.map_or(Span::ZERO, |(since, _)| now.since(since));
        self.held_before + present >= MOST_HELD
    }

    /// Whether the landing should have ended by `now`.
    pub fn is_landing_overdue(&self, now: Time) -> bool {
        self.overdue_s(now) > LANDING_GRACE_S
    }

    /// Time since the end of the landing's reference \[s\]: negative before.
    pub fn overdue_s(&self, now: Time) -> f64 {
        match &self.path {
            FlightPath::Plan(plan, _) => self.elapsed_s(now) - plan.end_s(),
            FlightPath::Observe(_) => f64::NEG_INFINITY,
        }
    }

    /// Time from the start at which the landing is planned \[s\]; infinite where nothing is flown.
    pub fn planned_landing_s(&self) -> f64 {
        match &self.path {
            FlightPath::Plan(plan, _) => plan.planned_landing_s(),
            FlightPath::Observe(_) => f64::INFINITY,
        }
    }

    /// The reference at `now`.
    pub fn reference(&self, now: Time) -> Reference {
        if let Some((_, reference)) = self.held {
            return reference;
        }
        match &self.path {
            FlightPath::Plan(plan, _) => plan.sample(self.elapsed_s(now)),
            FlightPath::Observe(point) => Reference::rest(*point, Phase::Trajectory),
        }
    }

    /// Whether the reference rests at the end of a change of the plan.
    pub fn has_arrived(&self, now: Time) -> bool {
        match &self.path {
            FlightPath::Plan(plan, _) => plan.has_arrived(self.elapsed_s(now)),
            FlightPath::Observe(_) => false,
        }
    }

    /// Whether the mission waits.
    pub fn is_held(&self) -> bool {
        self.held.is_some()
    }

    /// The motion of the reference at `now`.
    pub fn motion(&self, now: Time) -> ReferenceMotion {
        let FlightPath::Plan(plan, _) = &self.path else {
            let still = self.reference(now);
            return ReferenceMotion::between(&still, &still, DIFFERENCE_S);
        };
        if let Some((_, still)) = &self.held {
            return ReferenceMotion::between(still, still, DIFFERENCE_S);
        }
        let t_s = self.elapsed_s(now);
        ReferenceMotion::between(&plan.sample(t_s - DIFFERENCE_S), &plan.sample(t_s), DIFFERENCE_S)
    }

    /// The point on the floor at which the flight began, with its heading \[m, world; rad\].
    pub fn origin(&self) -> Vector4<f64> {
        match &self.path {
            FlightPath::Plan(plan, _) => plan.origin(),
            FlightPath::Observe(point) => point.push(0.0),
        }
    }

    /// Flies `detour` from `now` on, in place of the rest of the plan; no landing is planned any more.
    pub fn redirect(&mut self, now: Time, detour: Detour) {
        let elapsed_s = self.elapsed_s(now);
        if let FlightPath::Plan(plan, _) = &mut self.path {
            plan.redirect(elapsed_s, detour);
            self.changes += 1;
        }
    }

    /// Restarts the count of the time in holds.
    pub fn forget_holds(&mut self) {
        self.held_before = Span::ZERO;
    }

    /// Whether `now` is in the scored window, which excludes the time in which the mission waits.
    pub fn is_scored(&self, now: Time) -> bool {
        match &self.path {
            FlightPath::Plan(plan, _) => !self.is_held() && plan.scored(self.elapsed_s(now)),
            FlightPath::Observe(_) => false,
        }
    }

    /// Lands from `point`, also a vehicle that has left the path of a landing in progress.
    pub fn land_again_from(&mut self, now: Time, point: StartPoint) {
        if let FlightPath::Plan(plan, _) = &mut self.path {
            plan.forget_landing();
        }
        self.land_from(now, point);
    }

    /// Lands early from `point`.
    pub fn land_from(&mut self, now: Time, point: StartPoint) {
        self.resume(now);
        let elapsed_s = self.elapsed_s(now);
        if let FlightPath::Plan(plan, _) = &mut self.path {
            plan.land_from(elapsed_s, point);
            self.changes += 1;
        }
    }

    /// Whether the vehicle stands on the floor at the end of its landing.
    pub fn has_landed(&self, reference: &Reference, estimate: &Estimate) -> bool {
        let FlightPath::Plan(_, floor_m) = &self.path else { return false };
        reference.phase == Phase::Landing
            && reference.position.z < *floor_m
            && estimate.position.z < floor_m + LANDED_M
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::room::StoppingRoom;
    use oqtal_config::Config;

    /// Whatever a law does at the border of the fence: the holds of a flight are counted together.
    #[test]
    fn f47_a_flight_is_held_for_ten_seconds_in_all_and_a_new_course_begins_the_count_again() {
        let config = Config::default();
        let trajectory = crate::trajectory(&config).unwrap();
        let plan = FlightPlan::from_origin(&config.trajectory, &trajectory);
        let mut mission = ActiveMission::fly(plan, 0.0, Time::VIRTUAL_START);
        let still = Reference::rest(Vector3::z(), Phase::Trajectory);
        let mut now = Time::VIRTUAL_START;
        for hold in 0..19 {
            mission.hold(now, still);
            assert!(!mission.is_held_too_long(now), "{hold}");
            now = now + Span::from_millis(520);
            mission.resume(now);
            now = now + Span::from_millis(300);
        }
        mission.hold(now, still);
        assert!(!mission.is_held_too_long(now + Span::from_millis(119)));
        assert!(mission.is_held_too_long(now + Span::from_millis(120)));
        now = now + Span::from_millis(120);
        mission.resume(now);
        assert!(mission.is_held_too_long(now), "until the vehicle has landed");
        let stop = StoppingRoom::new(&config).stop(&mission.motion(now));
        mission.redirect(now, Detour::stay(stop));
        assert!(mission.is_held_too_long(now), "a planner does not begin the count again");
        mission.forget_holds();
        assert!(!mission.is_held_too_long(now));
    }
}
