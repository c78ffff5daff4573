//! What is being flown, and since when.

use nalgebra::Vector3;
use oqtal_bus::time::Time;
use oqtal_control::estimator::Estimate;
use oqtal_control::trajectory::{FlightPlan, Phase, Reference};

/// A vehicle this close above where it took off, with its reference below the floor, has landed \[m\].
const LANDED_HEIGHT_M: f64 = 0.04;

/// A flight under way.
#[derive(Clone, Debug)]
pub struct Mission {
    began: Time,
    path: Path,
}

#[derive(Clone, Debug)]
enum Path {
    /// A flight from take-off to landing, and the height of the floor \[m\].
    Plan(FlightPlan, f64),
    /// A point, for a vehicle that is only watched.
    Watch(Vector3<f64>),
}

impl Mission {
    /// The flight of `plan`, from now on, from the floor at `floor_m` \[m, world z\].
    #[must_use]
    pub fn fly(plan: FlightPlan, floor_m: f64, now: Time) -> Self {
        Self { began: now, path: Path::Plan(plan, floor_m) }
    }

    /// Watching a vehicle whose reference is `point` \[m, world\].
    #[must_use]
    pub fn watch(point: Vector3<f64>, now: Time) -> Self {
        Self { began: now, path: Path::Watch(point) }
    }

    /// Begins at `now` instead.
    pub fn begin_again(&mut self, now: Time) {
        self.began = now;
    }

    /// Time since it began \[s\].
    #[must_use]
    pub fn elapsed_s(&self, now: Time) -> f64 {
        now.since(self.began).seconds()
    }

    /// Where the vehicle should be.
    #[must_use]
    pub fn reference(&self, now: Time) -> Reference {
        match &self.path {
            Path::Plan(plan, _) => plan.sample(self.elapsed_s(now)),
            Path::Watch(point) => Reference::rest(*point, Phase::Trajectory),
        }
    }

    /// Whether the flight is judged now.
    #[must_use]
    pub fn is_scored(&self, now: Time) -> bool {
        match &self.path {
            Path::Plan(plan, _) => plan.scored(self.elapsed_s(now)),
            Path::Watch(_) => false,
        }
    }

    /// Lands early: where the vehicle is, from the height of its reference.
    pub fn land(&mut self, now: Time, estimate: &Estimate) {
        let height = self.reference(now).position.z;
        let from = estimate.position.xy().push(height);
        let elapsed_s = self.elapsed_s(now);
        if let Path::Plan(plan, _) = &mut self.path {
            plan.land_from(elapsed_s, from);
        }
    }

    /// Whether the vehicle stands on the floor and is meant to.
    #[must_use]
    pub fn has_landed(&self, reference: &Reference, estimate: &Estimate) -> bool {
        let Path::Plan(_, floor_m) = &self.path else { return false };
        reference.phase == Phase::Landing
            && reference.position.z < *floor_m
            && estimate.position.z < floor_m + LANDED_HEIGHT_M
    }
}
