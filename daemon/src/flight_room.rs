//! The room that a flight needs: its path compared with the fence and the floor, before the start and at arming.

mod remedies;
mod starts;
mod ways;

use std::cell::OnceCell;
use std::collections::VecDeque;

use nalgebra::Vector3;
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_control::trajectory::{Trajectory, TrajectoryKind};
use oqtal_runtime::process::Failure;

use crate::fence::Fence;
use crate::floor::LEAST_PLAN_M;
use crate::flyable::{SampledPoints, check_demand, least_settle_s};
use crate::setpoint::{LARGEST_TURN_RAD, turns_round};
use crate::waypoint_file::trajectory as trajectory_of;
use ways::{TICK_POINTS, corners, lowest, point_s, references};

pub(crate) use starts::{fitting_starts, require_target};
pub(crate) use ways::Way;

/// Whether `trajectory` fits inside the soft border of the fence: from anywhere, or from `start` \[m, world\] where it is known.
///
/// # Errors
/// The key of the border, and the points of the trajectory for which it leaves no room.
fn check_room(
    config: &Config,
    trajectory: &Trajectory,
    start: Option<Vector3<f64>>,
) -> Result<(), OptionError> {
    let ways = Way::both(config, trajectory, start.unwrap_or_default());
    match start {
        Some(start) => check_from(config, trajectory, (start, &ways)),
        None => check_span(config, &ways),
    }
}

/// Whether `trajectory` leaves the fence when it is flown this many times as slowly \[-\], from `start` \[m, world\] as in [`check_room`].
fn lacks_room(
    config: &Config,
    trajectory: &Trajectory,
    start: Option<Vector3<f64>>,
) -> impl Fn(f64, SampledPoints) -> bool {
    let sampled = OnceCell::new();
    move |slower, points| {
        let all: &Vec<_> = sampled.get_or_init(|| references(config, trajectory).collect());
        let looked_at = all.iter().copied().step_by(points.step(all.len()));
        let from = start.unwrap_or_default();
        let ways = Way::both_flown(config, looked_at, (from, slower));
        match start {
            Some(_) => !ways.iter().all(|way| way.is_inside(&Fence::new(&config.fence))),
            None => check_span(config, &ways).is_err(),
        }
    }
}

/// Whether the trajectory stays above the floor on which the flight begins.
fn check_height(config: &Config, trajectory: &Trajectory) -> Result<(), OptionError> {
    let Some((t_s, lowest)) = lowest(config, trajectory) else { return Ok(()) };
    // A comparison with NaN is false.
    let is_high = lowest.z >= LEAST_PLAN_M;
    if is_high {
        return Ok(());
    }
    let [x, y, z]: [f64; 3] = lowest.into();
    let at = format!(
        "at least {LEAST_PLAN_M} m above the floor on which the flight begins; at {t_s:.1} s the trajectory is at [{x:.3}, {y:.3}, {z:.3}] m"
    );
    if let Some(file) = waypoints_file(config) {
        return Err(OptionError::new("trajectory.waypoints-file", file, at));
    }
    let remedy = remedies::higher(config, trajectory, LEAST_PLAN_M - z);
    // Around a point that is too low itself, a smaller trajectory is too low as well.
    let or_smaller = match config.trajectory.height_m >= LEAST_PLAN_M {
        true => ", or the trajectory smaller",
        false => "",
    };
    let allowed = format!("{remedy}{or_smaller}: the trajectory must stay {at}");
    Err(OptionError::new("trajectory.height-m", config.trajectory.height_m, allowed))
}

/// The name of the waypoint file that is flown.
fn waypoints_file(config: &Config) -> Option<String> {
    let file = config.trajectory.waypoints_file.as_ref();
    let is_flown = config.trajectory.kind == TrajectoryKind::Waypoints;
    file.filter(|_| is_flown).map(|file| file.display().to_string())
}

/// Whether the daemon accepts every set-point of the flight, whenever its ticks come: heading and attitude do not reverse.
fn check_turns(config: &Config, trajectory: &Trajectory) -> Result<(), OptionError> {
    // A tick is never longer than this many points.
    const LONGEST_TICK: usize = TICK_POINTS as usize + 1;
    let mut before = VecDeque::with_capacity(LONGEST_TICK);
    // The first reversal within each number of points.
    let mut reversed = [None; LONGEST_TICK];
    for (t_s, next) in references(config, trajectory) {
        for (first, last) in reversed.iter_mut().zip(&before) {
            if first.is_none() && turns_round(last, &next) {
                *first = Some(t_s);
            }
        }
        before.truncate(LONGEST_TICK - 1);
        before.push_front(next);
    }
    let Some(t_s) = reversed.into_iter().flatten().next() else { return Ok(()) };
    let most_deg = LARGEST_TURN_RAD.to_degrees().floor();
    let options = &config.trajectory;
    let is_first = t_s <= point_s(config) * f64::from(TICK_POINTS + 1);
    if let Some(least_s) = least_settle_s(config, trajectory).filter(|_| is_first) {
        let allowed = format!(
            "at least {least_s:.1}: the vehicle turns to the heading of the first waypoint"
        );
        return Err(OptionError::new("trajectory.settle-s", options.settle_s, allowed));
    }
    let turn = format!(
        "at {t_s:.2} s it turns by more than {most_deg} deg in one tick, which the daemon refuses"
    );
    Err(match waypoints_file(config) {
        Some(file) => OptionError::new(
            "trajectory.waypoints-file",
            file,
            format!("a path that turns more slowly: {turn}"),
        ),
        None => OptionError::new(
            "trajectory.step.angle-deg",
            options.step.angle_deg,
            format!("between -{most_deg} and {most_deg}: {turn}"),
        ),
    })
}

/// Whether each of `ways` is narrower than the fence by its margin on both sides.
fn check_span(config: &Config, ways: &[Way]) -> Result<(), OptionError> {
    let (low, high) = corners(config);
    let too_wide = ["x", "y", "z"].into_iter().enumerate().filter_map(|(axis, name)| {
        let needed = ways.iter().filter_map(|way| {
            let [from, to] = way.ends(axis)?;
            // A flight begins on the floor, at the lower border or above it.
            let (span_m, margins) = if name == "z" { (to.1, 1.0) } else { (to.1 - from.1, 2.0) };
            Some((span_m + margins * way.margin_m, way, [from, to]))
        });
        let (needed_m, way, [from, to]) = needed.max_by(|a, b| a.0.total_cmp(&b.0))?;
        // A comparison with NaN is false.
        let fits = needed_m < high[axis] - low[axis];
        let needed_m = remedies::above(needed_m);
        let extent = if name == "z" { "high above the place of the start" } else { "wide" };
        let allowed = format!(
            "at least {needed_m:.2} m {extent}, {}: the trajectory goes from {name} = {:.2} m at {:.1} s to {name} = {:.2} m at {:.1} s",
            way.room(), from.1, from.0, to.1, to.0
        );
        (!fits).then(|| border_error(config, name, allowed))
    });
    let errors = too_wide.reduce(|first, OptionError { key, allowed, .. }| OptionError {
        allowed: format!("{}; `{key}` must be {allowed}", first.allowed),
        ..first
    });
    errors.map_or(Ok(()), Err)
}

/// The words for an instant from the beginning of the trajectory \[s\].
fn when(t_s: f64) -> String {
    if t_s < 0.0 { "in the take-off".to_owned() } else { format!("at {t_s:.1} s") }
}

/// Starting point of a flight \[m, world\] if it is known in advance: with emulated cameras it is the origin.
pub fn known_start(config: &Config) -> Option<Vector3<f64>> {
    config.receiver.link.is_empty().then(Vector3::zeros)
}

/// Whether `trajectory` can be flown: whether it stays above the floor and fits inside the soft border of the fence, from anywhere, or from
/// `start` \[m, world\] where it is known, whether the vehicle can follow it, and whether the daemon accepts each of its set-points.
///
/// # Errors
/// The key of the border, or of the limit of the vehicle, the points of the trajectory that exceed it, and the setting at fault (exit code 78).
pub fn require_flyable(
    config: &Config,
    trajectory: &Trajectory,
    start: Option<Vector3<f64>>,
) -> Result<(), Failure> {
    require(config, trajectory, |config, trajectory| check_flyable(config, trajectory, start))
}

/// Whether [`require_flyable`] accepts `trajectory`.
pub(crate) fn is_flyable(
    config: &Config,
    trajectory: &Trajectory,
    start: Option<Vector3<f64>>,
) -> bool {
    check_flyable(config, trajectory, start).is_ok()
}

/// Like [`require_flyable`], for a trajectory that begins at the vehicle's position in flight; the loop compares its path with the floor.
/// The heights of waypoints are those above the floor, and are checked here, too.
///
/// # Errors
/// Like [`require_flyable`].
pub(crate) fn require_flyable_in_flight(
    config: &Config,
    trajectory: &Trajectory,
) -> Result<(), Failure> {
    match config.trajectory.kind {
        TrajectoryKind::Waypoints => require_flyable(config, trajectory, None),
        _ => require(config, trajectory, |config, trajectory| {
            check_motion(config, (trajectory, None), check_room(config, trajectory, None))
        }),
    }
}

/// The check of [`require_flyable`].
fn check_flyable(
    config: &Config,
    trajectory: &Trajectory,
    start: Option<Vector3<f64>>,
) -> Result<(), OptionError> {
    let room =
        check_height(config, trajectory).and_then(|()| check_room(config, trajectory, start));
    check_motion(config, (trajectory, start.or_else(|| known_start(config))), room)
}

/// Whether the vehicle can follow `trajectory`, and the daemon accepts its set-points, in addition to the check of its `room`, since with
/// the remedy for one the flight could still be refused by the other. If a factor of time exists that also gives room from `start`
/// \[m, world\], it is that one.
fn check_motion(
    config: &Config,
    (trajectory, start): (&Trajectory, Option<Vector3<f64>>),
    room: Result<(), OptionError>,
) -> Result<(), OptionError> {
    let lacks_room = lacks_room(config, trajectory, start);
    let motion =
        check_demand(config, trajectory, lacks_room).and_then(|()| check_turns(config, trajectory));
    match (room, motion) {
        (Err(room), Err(motion)) => {
            let allowed = format!("{}; with that room, {motion}", room.allowed);
            Err(OptionError { allowed, ..room })
        }
        (room, motion) => room.and(motion),
    }
}

/// Requires that `check` passes, and names the setting with which it does not.
fn require(
    config: &Config,
    trajectory: &Trajectory,
    check: impl Fn(&Config, &Trajectory) -> Result<(), OptionError>,
) -> Result<(), Failure> {
    check(config, trajectory).map_err(|error| {
        // A configuration whose trajectory cannot be built fails with another error.
        let breaks = |config: &Config| {
            trajectory_of(config)
                .is_ok_and(|path| check(config, &path).is_err_and(|other| other.key == error.key))
        };
        config.locate_change(&error, |config| !breaks(config)).into()
    })
}

/// Whether a flight along `ways` from `start` \[m, world\] stays inside the fence.
fn check_from(
    config: &Config,
    trajectory: &Trajectory,
    (start, ways): (Vector3<f64>, &[Way; 2]),
) -> Result<(), OptionError> {
    let fence = Fence::new(&config.fence);
    let outside = ways.iter().find_map(|way| {
        let is_inside = |point| fence.inside_by_m(point, way.margin_m) > 0.0;
        let outside = way.points.iter().find(|(_, point)| !is_inside(point))?;
        Some((way, outside))
    });
    let Some((way, (t_s, at))) = outside else { return Ok(()) };
    let (low, high) = corners(config);
    // The soft border is that of the sides and of the top: a vehicle may stand on the floor.
    let lower_m = |axis: usize| if axis == 2 { 0.0 } else { way.margin_m };
    let beyond = |axis: &usize| {
        let (over, under) = (at[*axis] - high[*axis] + way.margin_m, low[*axis] - at[*axis]);
        over.max(under + lower_m(*axis))
    };
    let is_polygon = !config.fence.polygon_m.is_empty();
    let axis = match is_polygon && beyond(&2) <= 0.0 {
        true => 0,
        false => (0..3).max_by(|a, b| beyond(a).total_cmp(&beyond(b))).unwrap_or_default(),
    };
    let place = match way.margin_m > 0.0 {
        true => "the trajectory is at",
        false => "the vehicle is so fast that it would come to rest at",
    };
    let remedies = remedies::of_room(config, trajectory, (start, ways));
    let allowed = format!(
        "around the whole trajectory, {}: {} {place} [{:.2}, {:.2}, {:.2}] m; it needs {remedies}",
        way.room(),
        when(*t_s),
        at.x,
        at.y,
        at.z
    );
    Err(border_error(config, ["x", "y", "z"][axis], allowed))
}

fn border_error(config: &Config, axis: &str, allowed: String) -> OptionError {
    let fence = &config.fence;
    let range = |key: &str, [low, high]: [f64; 2]| {
        OptionError::new(key, format_args!("[{low}, {high}]"), &allowed)
    };
    match axis {
        "z" => range("fence.z-m", fence.z_m),
        _ if !fence.polygon_m.is_empty() => {
            OptionError::new("fence.polygon-m", format_args!("{:?}", fence.polygon_m), &allowed)
        }
        "x" => range("fence.x-m", fence.x_m),
        _ => range("fence.y-m", fence.y_m),
    }
}

#[cfg(test)]
mod tests;
