//! Clearance from the floor: raises a low reference so that a vehicle below it does not touch the floor.

use nalgebra::Vector3;
use oqtal_bus::time::Time;
use oqtal_control::trajectory::{Phase, Reference};

/// Time constant of the mean distance below the reference \[s\]; longer than the vehicle takes to follow a step of the height.
const MEAN_S: f64 = 1.0;
/// Greatest height by which a reference is raised \[m\].
const MOST_RAISED_M: f64 = 0.5;

/// The clearance of a vehicle in flight.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FloorClearance {
    /// Mean distance of the vehicle below its reference \[m\].
    below_m: f64,
    /// The instant of the last reference, and its height \[m, world\].
    last: Option<(Time, f64)>,
}

impl FloorClearance {
    /// Returns `reference` at `now`, raised so that a vehicle at `height_m` stays above `least_m` \[m, world\] if it remains as far below
    /// the reference as it has been. The references of take-off and landing are not changed.
    pub(crate) fn raise(
        &mut self,
        now: Time,
        reference: Reference,
        (height_m, least_m): (f64, f64),
    ) -> Reference {
        if !is_flight(&reference) {
            *self = Self::default();
            return reference;
        }
        if let Some((at, last_m)) = self.last {
            let share = (now.since(at).seconds() / MEAN_S).clamp(0.0, 1.0);
            let below_m = (last_m - height_m).clamp(0.0, MOST_RAISED_M);
            self.below_m += share * (below_m - self.below_m);
        }
        let raised = self.raised(reference, least_m);
        self.last = Some((now, raised.position.z));
        raised
    }

    /// `reference`, raised as by the last [`FloorClearance::raise`].
    pub(crate) fn raised(&self, reference: Reference, least_m: f64) -> Reference {
        match is_flight(&reference) {
            true => Self::at_least(reference, least_m + self.below_m),
            false => reference,
        }
    }

    /// `reference` at the height `least_m` \[m, world\] or above; a raised one does not climb or sink.
    fn at_least(reference: Reference, least_m: f64) -> Reference {
        let is_low = reference.position.z < least_m;
        if !is_low {
            return reference;
        }
        let level = |vector: Vector3<f64>| vector.xy().push(0.0);
        Reference {
            position: reference.position.xy().push(least_m),
            velocity: level(reference.velocity),
            acceleration: level(reference.acceleration),
            jerk: level(reference.jerk),
            snap: level(reference.snap),
            ..reference
        }
    }
}

/// Whether `reference` is neither of a take-off nor of a landing.
fn is_flight(reference: &Reference) -> bool {
    matches!(reference.phase, Phase::Settle | Phase::Trajectory)
}

#[cfg(test)]
mod tests {
    use oqtal_bus::time::Span;

    use super::*;

    const LEAST_M: f64 = 0.1;

    /// The height of a vehicle that stays `below_m` below its reference, 20 s after the reference sank to 0.1 m \[m\].
    fn height_m(below_m: f64) -> f64 {
        let (mut clearance, mut now) = (FloorClearance::default(), Time::VIRTUAL_START);
        let mut reference_m = 1.0;
        for tick in 0..1200 {
            now = now + Span::period_of(60.0);
            let wanted_m = f64::from(100 - tick.min(90)) / 100.0;
            let reference = Reference::rest(Vector3::z() * wanted_m, Phase::Trajectory);
            let raised = clearance.raise(now, reference, (reference_m - below_m, LEAST_M));
            reference_m = raised.position.z;
        }
        reference_m - below_m
    }

    #[test]
    fn a_vehicle_below_its_reference_stays_above_the_least_height() {
        for below_m in [0.0, 0.05, 0.15, 0.4] {
            assert!(
                (height_m(below_m) - LEAST_M).abs() < 1e-3,
                "{below_m} m: {}",
                height_m(below_m)
            );
        }
        assert!(height_m(-0.1) > LEAST_M, "above its reference");
    }

    #[test]
    fn a_reference_that_is_high_enough_or_lands_is_not_changed() {
        let mut clearance = FloorClearance::default();
        for (height_m, phase) in
            [(0.3, Phase::Trajectory), (0.05, Phase::TakeOff), (0.05, Phase::Landing)]
        {
            let reference = Reference::rest(Vector3::z() * height_m, phase);
            assert_eq!(clearance.raise(Time::VIRTUAL_START, reference, (0.0, LEAST_M)), reference);
        }
    }
}
