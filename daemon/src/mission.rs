//! The flight under way: its plan, and when it began.

use nalgebra::Vector3;
use oqtal_bus::time::Time;
use oqtal_control::estimator::Estimate;
use oqtal_control::trajectory::{FlightPlan, Phase, Reference};

/// Height above the floor below which a vehicle has landed, once its reference is below the floor \[m\].
const LANDED_HEIGHT_M: f64 = 0.04;

/// A flight under way.
#[derive(Clone, Debug)]
pub struct ActiveMission {
    began: Time,
    path: FlightPath,
}

#[derive(Clone, Debug)]
enum FlightPath {
    /// A flight from take-off to landing, and the height of the floor \[m\].
    Plan(FlightPlan, f64),
    /// The point \[m, world\] that is the reference while the daemon only observes.
    Observe(Vector3<f64>),
}

impl ActiveMission {
    /// The flight of `plan` from `now` on, from the floor at `floor_m` \[m, world z\].
    #[must_use]
    pub fn fly(plan: FlightPlan, floor_m: f64, now: Time) -> Self {
        Self { began: now, path: FlightPath::Plan(plan, floor_m) }
    }

    /// Observes a vehicle with the fixed reference `point` \[m, world\].
    #[must_use]
    pub fn observe(point: Vector3<f64>, now: Time) -> Self {
        Self { began: now, path: FlightPath::Observe(point) }
    }

    /// Moves the beginning to `now`.
    pub fn restart(&mut self, now: Time) {
        self.began = now;
    }

    /// Time since the flight began \[s\].
    #[must_use]
    pub fn elapsed_s(&self, now: Time) -> f64 {
        now.since(self.began).seconds()
    }

    /// The reference at `now`.
    #[must_use]
    pub fn reference(&self, now: Time) -> Reference {
        match &self.path {
            FlightPath::Plan(plan, _) => plan.sample(self.elapsed_s(now)),
            FlightPath::Observe(point) => Reference::rest(*point, Phase::Trajectory),
        }
    }

    /// Whether `now` lies in the scored window.
    #[must_use]
    pub fn is_scored(&self, now: Time) -> bool {
        match &self.path {
            FlightPath::Plan(plan, _) => plan.scored(self.elapsed_s(now)),
            FlightPath::Observe(_) => false,
        }
    }

    /// Lands early, above the present position, from the height of the reference.
    pub fn land(&mut self, now: Time, estimate: &Estimate) {
        let height = self.reference(now).position.z;
        let from = estimate.position.xy().push(height);
        let elapsed_s = self.elapsed_s(now);
        if let FlightPath::Plan(plan, _) = &mut self.path {
            plan.land_from(elapsed_s, from);
        }
    }

    /// Whether the vehicle stands on the floor at the end of its landing.
    #[must_use]
    pub fn has_landed(&self, reference: &Reference, estimate: &Estimate) -> bool {
        let FlightPath::Plan(_, floor_m) = &self.path else { return false };
        reference.phase == Phase::Landing
            && reference.position.z < *floor_m
            && estimate.position.z < floor_m + LANDED_HEIGHT_M
    }
}
