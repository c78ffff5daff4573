//! Places in flight: the point of a `goto`, and those from which a trajectory fits inside the fence.

use nalgebra::Vector4;
use oqtal_bus::code::Cause;
use oqtal_config::Config;
use oqtal_control::trajectory::{Phase, Trajectory, TrajectoryKind};

use super::remedies::{above, below};
use super::ways::{POSITION_ERROR_M, Way, corners, references};
use crate::fence::Fence;
use crate::floor::LEAST_WAY_M;
use crate::refusal::Refusal;

/// Requires that a vehicle on its way to `target`, x, y, z \[m, world\] and yaw \[rad\], has room for its tracking error inside the soft
/// border of the fence.
///
/// # Errors
/// The point, and the fence.
pub(crate) fn require_target(config: &Config, target: &Vector4<f64>) -> Result<(), Refusal> {
    let fence = &config.fence;
    let margin_m = fence.soft_margin_m + POSITION_ERROR_M;
    // A comparison with NaN is false.
    let is_inside = Fence::new(fence).inside_by_m(&target.xyz(), margin_m) > 0.0;
    if is_inside && !target.w.is_infinite() {
        return Ok(());
    }
    let [x, y, z, w]: [f64; 4] = (*target).into();
    let yaw = if w.is_nan() { String::new() } else { format!(", yaw {} deg,", w.to_degrees()) };
    let reason = format!(
        "the point [{x}, {y}, {z}] m{yaw} must be more than {POSITION_ERROR_M} m inside the soft border of the fence, at the sides and the top, and above its lower border: fence.x-m = {:?}, fence.y-m = {:?}, fence.z-m = {:?}, fence.soft-margin-m = {}",
        fence.x_m, fence.y_m, fence.z_m, fence.soft_margin_m
    );
    Err(Refusal { cause: Cause::Fence, reason })
}

/// Reason for which `trajectory`, flown from the present place, leaves the fence, with the points from which it does not, or with its
/// extent if the fence has corners.
pub(crate) fn fitting_starts(config: &Config, trajectory: &Trajectory) -> String {
    if config.trajectory.kind == TrajectoryKind::Waypoints {
        return "with its waypoints, which are relative to the start of the flight, it leaves the soft border of the fence".to_owned();
    }
    let first = trajectory.sample(0.0).position;
    let flown = references(config, trajectory).filter(|(_, it)| it.phase == Phase::Trajectory);
    let ways = Way::both_flown(config, flown, (-first, 1.0));
    let (low, high) = corners(config);
    let (mut extents, mut starts) = (Vec::new(), Vec::new());
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let (mut from_m, mut to_m) = (f64::NEG_INFINITY, f64::INFINITY);
        for way in &ways {
            let Some([(_, least_m), (_, greatest_m)]) = way.ends(axis) else { continue };
            let (bottom_m, margin_m) = match name {
                "z" => (low.z.max(LEAST_WAY_M), 0.0),
                _ => (low[axis], way.margin_m),
            };
            from_m = from_m.max(bottom_m + margin_m - least_m);
            to_m = to_m.min(high[axis] - way.margin_m - greatest_m);
        }
        let ends = ways[0].ends(axis).map_or([0.0; 2], |ends| ends.map(|(_, end_m)| end_m));
        extents.push(format!("{name} = {:.2} to {:.2}", ends[0], ends[1]));
        starts.extend(
            Some([above(from_m), below(to_m)])
                .filter(|[from_m, to_m]| from_m <= to_m)
                .map(|[from_m, to_m]| format!("{name} = {from_m:.2} to {to_m:.2}")),
        );
    }
    let leaves = "from where the vehicle is, it leaves the soft border of the fence";
    match config.fence.polygon_m.is_empty() && starts.len() == 3 {
        true => {
            format!("{leaves}; it fits from {} m: `goto` such a point first", starts.join(", "))
        }
        false => format!(
            "{leaves}: relative to its start it goes from {} m: `goto` a point with this room first",
            extents.join(", ")
        ),
    }
}
