//! Remedies for a flight that has no room. Each of them suffices by itself.

use nalgebra::Vector3;
use oqtal_config::Config;
use oqtal_control::trajectory::{Reference, Trajectory, TrajectoryKind};

use super::ways::{POSITION_ERROR_M, Way, corners, lowest, references, stop};
use crate::fence::{Braking, Fence};
use crate::floor::LEAST_PLAN_M;
use crate::flyable::{SampledPoints, exceeding, least_sufficient};

/// Least distance of a remedy from the value at which the flight is refused \[m\], above the rounding of numbers.
const OUTWARD_M: f64 = 1e-12;

/// The next centimetre below `value_m` \[m\].
pub(super) fn below(value_m: f64) -> f64 {
    (((value_m - OUTWARD_M) * 100.0).ceil() - 1.0) / 100.0
}

/// The next centimetre above `value_m` \[m\].
pub(super) fn above(value_m: f64) -> f64 {
    (((value_m + OUTWARD_M) * 100.0).floor() + 1.0) / 100.0
}

/// The height with which a trajectory is `raised_m` \[m\] higher, and high enough to brake, with the fence that it needs then.
pub(super) fn higher(config: &Config, trajectory: &Trajectory, raised_m: f64) -> String {
    let ways = Way::both(config, trajectory, Vector3::zeros());
    let bottom_m = ways[1].ends(2).map_or(0.0, |[(_, bottom_m), _]| bottom_m);
    let raised_m = raised_m.max(above(corners(config).0.z - bottom_m));
    // A millimetre more: the least height itself is refused for its rounding.
    let height_m = ((config.trajectory.height_m + raised_m + 1e-3) * 100.0).ceil() / 100.0;
    let top_m = above(top(&ways) + height_m - config.trajectory.height_m);
    let fence = match top_m <= config.fence.z_m[1] {
        true => String::new(),
        false => format!(" in a fence up to z = {top_m:.2} m"),
    };
    format!("at least {height_m:.2}{fence}")
}

/// The least upper border, as far as heights are concerned \[m\].
fn top(ways: &[Way]) -> f64 {
    let tops = ways.iter().filter_map(|way| Some(way.ends(2)?[1].1 + way.margin_m));
    tops.fold(f64::NEG_INFINITY, f64::max)
}

/// Remedies for a flight that leaves the fence along `ways` from `start` \[m, world\].
pub(super) fn of_room(
    config: &Config,
    trajectory: &Trajectory,
    (start, ways): (Vector3<f64>, &[Way; 2]),
) -> String {
    let fence = Fence::new(&config.fence);
    let [path, stop] = ways;
    let remedies = [
        wider(config, ways, &fence),
        stop.is_inside(&fence).then(|| margin(path, &fence)).flatten(),
        path.is_inside(&fence).then(|| slower(config, trajectory, (start, &fence))).flatten(),
        other_height(config, start, ways),
        smaller(config, start),
    ];
    let remedies: Vec<String> = remedies.into_iter().flatten().collect();
    match remedies.is_empty() {
        true => "another start".to_owned(),
        false => remedies.join(", or "),
    }
}

/// The fence that is wide enough; `None` where the vehicle cannot brake above its lower border, since a lower one is below the floor.
fn wider(config: &Config, ways: &[Way; 2], fence: &Fence) -> Option<String> {
    let (low, high) = corners(config);
    let [path, stop] = ways;
    let mut needed = Vec::new();
    let outside_m = |way: &Way| {
        let sides = way.points.iter().map(|(_, point)| way.margin_m - fence.inside_sides_m(point));
        sides.fold(0.0, f64::max)
    };
    let (is_polygon, most_m) =
        (!config.fence.polygon_m.is_empty(), outside_m(path).max(outside_m(stop)));
    if is_polygon && most_m > 0.0 {
        needed.push(format!("sides up to {:.2} m further outside", above(most_m)));
    }
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate().skip(2 * usize::from(is_polygon)) {
        let (path_ends, stop_ends) = (path.ends(axis)?, stop.ends(axis)?);
        let mut from = below(path_ends[0].1 - if axis == 2 { 0.0 } else { path.margin_m });
        if axis < 2 {
            from = from.min(below(stop_ends[0].1));
        } else if stop_ends[0].1 <= low.z.min(from) {
            return None;
        }
        let to = above(path_ends[1].1 + path.margin_m).max(above(stop_ends[1].1));
        let (from, to) = (from.min(low[axis]), to.max(high[axis]));
        if from < low[axis] || to > high[axis] {
            needed.push(format!("from {from:.2} to {to:.2} m in {name}"));
        }
    }
    let fence = if is_polygon { "" } else { "a fence " };
    (!needed.is_empty()).then(|| format!("{fence}{}", needed.join(" and ")))
}

/// The soft margin with which `path` is inside.
fn margin(path: &Way, fence: &Fence) -> Option<String> {
    let below_top = |least: f64, (_, point): &(f64, Vector3<f64>)| {
        // Not by the distance to the floor, which has no margin.
        match fence.inside_by_m(point, 0.0) > 0.0 {
            true => least.min(fence.inside_upper_m(point)),
            false => f64::NEG_INFINITY,
        }
    };
    let most_m = below(path.points.iter().fold(f64::INFINITY, below_top) - POSITION_ERROR_M);
    (most_m >= 0.0).then(|| format!("fence.soft-margin-m of at most {most_m:.2}"))
}

/// Remedy: the factor by which the trajectory must be slowed down so that the vehicle can brake inside the fence and, if it can at any
/// speed, follow the trajectory.
fn slower(
    config: &Config,
    trajectory: &Trajectory,
    (start, fence): (Vector3<f64>, &Fence),
) -> Option<String> {
    let braking = Braking::of(config);
    let leaves = |reference: &Reference, slower| {
        let is_inside = fence.inside_m(&(start + stop(reference, &braking, slower))) > 0.0;
        !is_inside
    };
    let all = Vec::from_iter(references(config, trajectory));
    let exceeds = |slower, points: SampledPoints| {
        let mut looked_at = all.iter().step_by(points.step(all.len()));
        looked_at.any(|(_, reference)| leaves(reference, slower))
    };
    let demands = exceeding(config, trajectory);
    let factor =
        least_sufficient(|slower, points| exceeds(slower, points) || demands(slower, points));
    let factor = factor.or_else(|| least_sufficient(exceeds))?;
    Some(crate::flyable::slower(config.trajectory.kind, factor))
}

/// The height at which the trajectory has room between floor and top, if that suffices.
fn other_height(config: &Config, start: Vector3<f64>, ways: &[Way; 2]) -> Option<String> {
    let (low, high) = corners(config);
    let (bottom_m, top_m) = (ways[1].ends(2)?[0].1, top(ways));
    let raised_m = match bottom_m <= low.z {
        true => above(low.z - bottom_m),
        false => below(high.z - top_m),
    };
    let height_m = config.trajectory.height_m + raised_m;
    let mut other = config.clone();
    other.trajectory.height_m = height_m;
    has_room(&other, start).then(|| format!("trajectory.height-m = {height_m:.2}"))
}

/// A smaller trajectory, if a hover at the point to which it shrinks has room.
fn smaller(config: &Config, start: Vector3<f64>) -> Option<String> {
    let mut hover = config.clone();
    hover.trajectory.kind = TrajectoryKind::Hover;
    let remedy = match config.trajectory.kind {
        TrajectoryKind::Waypoints => {
            hover.trajectory.height_m = LEAST_PLAN_M;
            "waypoints that are closer to the point of the take-off (trajectory.waypoints-file)"
        }
        _ => "smaller lengths in [trajectory]",
    };
    has_room(&hover, start).then(|| remedy.to_owned())
}

/// Whether the flight of `config` has room; not known of waypoints.
fn has_room(config: &Config, start: Vector3<f64>) -> bool {
    let fence = Fence::new(&config.fence);
    config.trajectory.trajectory(None).is_some_and(|trajectory| {
        let ways = Way::both(config, &trajectory, start);
        lowest(config, &trajectory).is_none_or(|(_, point)| point.z >= LEAST_PLAN_M)
            && ways.iter().all(|way| way.is_inside(&fence))
    })
}
