//! The ways of a flight: its path, and the points at which the vehicle would stop on it.

use nalgebra::Vector3;
use oqtal_config::Config;
use oqtal_control::trajectory::{FlightPlan, Phase, Reference, Trajectory};

use crate::fence::{Braking, Fence};

/// Points of a flight in one tick \[-\], and most points that are looked at \[-\].
pub(super) const TICK_POINTS: u32 = 4;
const MOST_POINTS: f64 = 600_000.0;
/// Points of a flight that are compared with the fence at arming, beside those furthest out \[-\].
const ARMING_POINTS: usize = 256;
/// Differences from position \[m\] and speed \[m/s\] of the reference that a flight may have without being held by the fence.
pub(super) const POSITION_ERROR_M: f64 = 0.1;
const SPEED_ERROR_M_S: f64 = 0.1;

/// Times from the beginning of the trajectory, after the take-off \[s\], and positions \[m\].
pub(super) type Points = Vec<(f64, Vector3<f64>)>;

/// A way of a flight, and the distance that it keeps from the border at the sides and at the top \[m\].
pub(crate) struct Way {
    pub(super) points: Points,
    pub(super) margin_m: f64,
}

impl Way {
    /// The path of a flight and the points at which the vehicle would stop on it, from `start` \[m, world\].
    pub(crate) fn both(config: &Config, trajectory: &Trajectory, start: Vector3<f64>) -> [Self; 2] {
        Self::both_flown(config, references(config, trajectory), (start, 1.0))
    }

    /// Like [`Way::both`], on a trajectory with these `references` flown `slower` times as slowly \[-\].
    pub(super) fn both_flown(
        config: &Config,
        references: impl Iterator<Item = (f64, Reference)>,
        (start, slower): (Vector3<f64>, f64),
    ) -> [Self; 2] {
        let braking = Braking::of(config);
        let both = references.map(|(t_s, reference)| {
            let stop = stop(&reference, &braking, slower);
            ((t_s, start + reference.position), (t_s, start + stop))
        });
        let (path, stops): (Points, Points) = both.unzip();
        let soft_m = config.fence.soft_margin_m + POSITION_ERROR_M;
        [(path, soft_m), (stops, 0.0)].map(|(points, margin_m)| Self { points, margin_m })
    }

    /// Whether every point of the way is inside the fence by its margin.
    pub(super) fn is_inside(&self, fence: &Fence) -> bool {
        self.points.iter().all(|(_, point)| fence.inside_by_m(point, self.margin_m) > 0.0)
    }

    /// The words for this way in a room.
    pub(super) fn room(&self) -> &'static str {
        if self.margin_m > 0.0 {
            "soft-margin-m and 0.1 m for tracking included"
        } else {
            "the way to brake included"
        }
    }

    /// Least and greatest coordinate, with their times \[s, m\]; `None` without a point.
    pub(super) fn ends(&self, axis: usize) -> Option<[(f64, f64); 2]> {
        let along = || self.points.iter().map(|(t_s, point)| (t_s.max(0.0), point[axis]));
        let by = |a: &(f64, f64), b: &(f64, f64)| a.1.total_cmp(&b.1);
        Some([along().min_by(by)?, along().max_by(by)?])
    }

    /// Some of the points for the check at arming, with those furthest along each axis.
    pub(crate) fn thinned(&self) -> impl Iterator<Item = Vector3<f64>> {
        let furthest = (0..6).filter_map(|side| {
            let along = |(_, point): &(f64, Vector3<f64>)| {
                if side < 3 { point[side] } else { -point[side - 3] }
            };
            self.points.iter().max_by(|a, b| along(a).total_cmp(&along(b)))
        });
        let some = self.points.iter().step_by(self.points.len() / ARMING_POINTS + 1);
        some.chain(furthest).map(|(_, point)| *point)
    }
}

/// The point at which the vehicle would stop if it had to brake at `reference` from a motion faster by [`SPEED_ERROR_M_S`], relative to the
/// start of the flight \[m\], on the trajectory flown `slower` times as slowly \[-\].
pub(super) fn stop(reference: &Reference, braking: &Braking, slower: f64) -> Vector3<f64> {
    let slower = if reference.phase == Phase::Trajectory { slower } else { 1.0 };
    let velocity = reference.velocity / slower;
    let mut error = velocity.try_normalize(0.0).unwrap_or_default() * SPEED_ERROR_M_S;
    // A descent ends at the floor.
    error.z = error.z.max(0.0);
    let acceleration = reference.acceleration.xy() / (slower * slower);
    braking.stopping_point(&reference.position, &(velocity + error), &acceleration)
}

/// References of a flight, several in every tick, at times from the beginning of the trajectory \[s\].
pub(super) fn references(
    config: &Config,
    trajectory: &Trajectory,
) -> impl Iterator<Item = (f64, Reference)> {
    let plan = FlightPlan::from_origin(&config.trajectory, trajectory);
    let step_s = point_s(config).max(plan.end_s() / MOST_POINTS);
    let begin_s = config.trajectory.start_s();
    let times = (0..=(plan.end_s() / step_s) as u32).map(move |index| f64::from(index) * step_s);
    times.map(move |t_s| (t_s - begin_s, plan.sample(t_s)))
}

/// Time between two points of a flight \[s\].
pub(super) fn point_s(config: &Config) -> f64 {
    1.0 / (config.control.rate_hz * f64::from(TICK_POINTS))
}

/// The lowest point of the trajectory, with its time \[s, m\].
pub(super) fn lowest(config: &Config, trajectory: &Trajectory) -> Option<(f64, Vector3<f64>)> {
    let flown =
        references(config, trajectory).filter(|(_, other)| other.phase == Phase::Trajectory);
    let points = flown.map(|(t_s, reference)| (t_s, reference.position));
    points.min_by(|a, b| a.1.z.total_cmp(&b.1.z))
}

/// Opposite corners of the box around the fence \[m, world\].
pub(super) fn corners(config: &Config) -> (Vector3<f64>, Vector3<f64>) {
    let ranges = config.fence.ranges_m();
    (Vector3::from(ranges.map(|[low, _]| low)), Vector3::from(ranges.map(|[_, high]| high)))
}
