//! The room that a flight needs: its path compared with the fence, before the start and at arming.

use nalgebra::Vector3;
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_control::trajectory::{
    FlightPlan, Phase, Reference, StartPoint, Trajectory, TrajectoryKind,
};
use oqtal_runtime::process::Failure;

use crate::fence::{Braking, Fence};
use crate::floor::LEAST_WAY_M;
use crate::flyable::check_demand;
use crate::waypoint_file::trajectory as trajectory_of;

/// Points of a flight that are compared with the fence \[-\].
const PATH_POINTS: u32 = 256;
/// Differences from position \[m\] and speed \[m/s\] of the reference that a flight may have without being held by the fence.
const POSITION_ERROR_M: f64 = 0.1;
const SPEED_ERROR_M_S: f64 = 0.1;
/// Points of a flight whose height is compared with the floor \[-\].
const HEIGHT_POINTS: u32 = 4096;

/// The path of a flight relative to its start: times from the beginning of the trajectory, after the take-off \[s\], and positions \[m\].
pub(crate) fn path(config: &Config, trajectory: &Trajectory) -> Vec<(f64, Vector3<f64>)> {
    let references = sampled(config, trajectory, PATH_POINTS);
    references.map(|(t_s, reference)| (t_s, reference.position)).collect()
}

/// The same of the points at which the vehicle would stop if it had to brake from a motion faster by [`SPEED_ERROR_M_S`].
pub(crate) fn stops(config: &Config, trajectory: &Trajectory) -> Vec<(f64, Vector3<f64>)> {
    let braking = Braking::of(config);
    let references = sampled(config, trajectory, PATH_POINTS);
    let stop = |Reference { position, velocity, acceleration, .. }| {
        let mut error = velocity.try_normalize(0.0).unwrap_or_default() * SPEED_ERROR_M_S;
        // A descent ends at the floor.
        error.z = error.z.max(0.0);
        braking.stopping_point(&position, &(velocity + error), &acceleration.xy())
    };
    references.map(|(t_s, reference)| (t_s, stop(reference))).collect()
}

/// References of a flight at `points` instants, from the beginning of the trajectory \[s\].
fn sampled(
    config: &Config,
    trajectory: &Trajectory,
    points: u32,
) -> impl Iterator<Item = (f64, Reference)> {
    let plan = FlightPlan::new(&config.trajectory, trajectory.clone(), StartPoint::default());
    let step_s = plan.end_s() / f64::from(points);
    let begin_s = config.trajectory.start_s();
    let times = (0..points).map(move |index| f64::from(index) * step_s);
    times.map(move |t_s| (t_s - begin_s, plan.sample(t_s)))
}

/// Whether `trajectory` fits inside the soft border of the fence: from anywhere, or from `start` \[m, world\] where it is known.
///
/// # Errors
/// The key of the border, and the points of the trajectory for which it leaves no room.
fn check_room(
    config: &Config,
    trajectory: &Trajectory,
    start: Option<Vector3<f64>>,
) -> Result<(), OptionError> {
    let (path, stops) = (path(config, trajectory), stops(config, trajectory));
    let soft_m = config.fence.soft_margin_m + POSITION_ERROR_M;
    let check = |path, margin_m| match start {
        Some(start) => check_from(config, path, (start, margin_m)),
        None => check_span(config, path, margin_m),
    };
    check(&path, soft_m)?;
    check(&stops, 0.0)?;
    check_height(config, trajectory)
}

/// Whether waypoints stay above the floor on which the flight begins.
fn check_height(config: &Config, trajectory: &Trajectory) -> Result<(), OptionError> {
    let file = config.trajectory.waypoints_file.as_ref();
    let is_flown = config.trajectory.kind == TrajectoryKind::Waypoints;
    let Some(file) = file.filter(|_| is_flown) else { return Ok(()) };
    let flown = sampled(config, trajectory, HEIGHT_POINTS)
        .filter(|(_, reference)| reference.phase == Phase::Trajectory);
    let by_height =
        |a: &(f64, Reference), b: &(f64, Reference)| a.1.position.z.total_cmp(&b.1.position.z);
    let Some((t_s, lowest)) = flown.min_by(by_height) else { return Ok(()) };
    let [x, y, z]: [f64; 3] = lowest.position.into();
    // A comparison with NaN is false.
    let is_high = z >= LEAST_WAY_M;
    if is_high {
        return Ok(());
    }
    let allowed = format!(
        "at least {LEAST_WAY_M} m above the floor on which the flight begins; at {t_s:.1} s the trajectory is at [{x:.3}, {y:.3}, {z:.3}] m"
    );
    Err(OptionError::new("trajectory.waypoints-file", file.display(), allowed))
}

/// Whether `path` is narrower than the fence by `margin_m` \[m\] on both sides.
fn check_span(
    config: &Config,
    path: &[(f64, Vector3<f64>)],
    margin_m: f64,
) -> Result<(), OptionError> {
    let (low, high) = corners(config);
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let along = |point: &(f64, Vector3<f64>)| point.1[axis];
        let by = |a: &&_, b: &&_| along(a).total_cmp(&along(b));
        let (Some(from), Some(to)) = (path.iter().min_by(by), path.iter().max_by(by)) else {
            return Ok(());
        };
        // A flight begins on the floor, at the lower border or above it.
        let (span_m, margins) =
            if name == "z" { (along(to), 1.0) } else { (along(to) - along(from), 2.0) };
        let needed_m = span_m + margins * margin_m;
        let width_m = high[axis] - low[axis];
        // A comparison with NaN is false.
        let fits = needed_m < width_m;
        if !fits {
            let allowed = format!(
                "wider than {needed_m:.2} m, {}: the trajectory goes from {name} = {:.2} m at {:.1} s to {name} = {:.2} m at {:.1} s",
                room(margin_m),
                along(from),
                from.0.max(0.0),
                along(to),
                to.0.max(0.0)
            );
            return Err(border_error(config, name, allowed));
        }
    }
    Ok(())
}

/// The words for an instant from the beginning of the trajectory \[s\].
fn when(t_s: f64) -> String {
    if t_s < 0.0 { "in the take-off".to_owned() } else { format!("at {t_s:.1} s") }
}

/// The words for a path with this margin \[m\], or with the way to stop.
fn room(margin_m: f64) -> &'static str {
    if margin_m > 0.0 {
        "soft-margin-m and 0.1 m for tracking included"
    } else {
        "the way to brake included"
    }
}

/// The words before a point of a path with this margin \[m\], or of one with the way to stop.
fn place(margin_m: f64) -> &'static str {
    match margin_m > 0.0 {
        true => "the trajectory is at",
        false => "the vehicle is so fast that it would come to rest at",
    }
}

/// Whether `trajectory` can be flown: whether it fits inside the soft border of the fence, from anywhere, or from `start` \[m, world\]
/// where it is known, and whether the vehicle can follow it.
///
/// # Errors
/// The key of the border, or of the limit of the vehicle, the points of the trajectory that exceed it, and the setting at fault (exit code 78).
pub fn require_flyable(
    config: &Config,
    trajectory: &Trajectory,
    start: Option<Vector3<f64>>,
) -> Result<(), Failure> {
    let check = |config: &Config, trajectory: &Trajectory| {
        check_room(config, trajectory, start).and_then(|()| check_demand(config, trajectory))
    };
    check(config, trajectory).map_err(|error| {
        // A configuration whose trajectory cannot be built fails with another error.
        let breaks = |config: &Config| {
            trajectory_of(config)
                .is_ok_and(|path| check(config, &path).is_err_and(|other| other.key == error.key))
        };
        config.locate_change(&error, |config| !breaks(config)).into()
    })
}

/// Whether a flight along `path` from `start` \[m, world\] stays inside the fence by `margin_m` \[m\].
fn check_from(
    config: &Config,
    path: &[(f64, Vector3<f64>)],
    (start, margin_m): (Vector3<f64>, f64),
) -> Result<(), OptionError> {
    let fence = Fence::new(&config.fence);
    let is_outside = |point: &&(f64, Vector3<f64>)| {
        let is_inside = fence.inside_by_m(&(start + point.1), margin_m) > 0.0;
        !is_inside
    };
    let Some((t_s, point)) = path.iter().find(is_outside) else { return Ok(()) };
    let at = start + point;
    let (low, high) = corners(config);
    // The soft border is that of the sides and of the top: a vehicle may stand on the floor.
    let lower_m = |axis: usize| if axis == 2 { 0.0 } else { margin_m };
    let beyond = |axis: &usize| {
        let (over, under) = (at[*axis] - high[*axis] + margin_m, low[*axis] - at[*axis]);
        over.max(under + lower_m(*axis))
    };
    let (is_polygon, is_high) = (!config.fence.polygon_m.is_empty(), beyond(&2) > 0.0);
    let axis = match is_polygon && !is_high {
        true => 0,
        false => (0..3).max_by(|a, b| beyond(a).total_cmp(&beyond(b))).unwrap_or_default(),
    };
    // A vehicle on a floor that is the border is outside.
    let is_on_floor = axis == 2 && at.z <= low.z && point.z == 0.0;
    let remedy = if is_on_floor {
        "let the fence begin below the floor".to_owned()
    } else if is_polygon && axis != 2 {
        let outside_m = |(_, point): &(_, _)| -fence.inside_by_m(&(start + point), margin_m);
        let most_m = path.iter().map(outside_m).fold(0.0, f64::max);
        let other = other(config, margin_m);
        format!("it needs sides up to {most_m:.2} m further outside, or {other}")
    } else {
        wider(config, path, (start, margin_m), (axis, lower_m(axis)))
    };
    let allowed = format!(
        "around the whole trajectory, {}: {} {} [{:.2}, {:.2}, {:.2}] m; {remedy}",
        room(margin_m),
        when(*t_s),
        place(margin_m),
        at.x,
        at.y,
        at.z
    );
    Err(border_error(config, ["x", "y", "z"][axis], allowed))
}

/// The fence along `axis` that is wide enough for a flight along `path` from `start` \[m, world\], by `margin_m` at its upper border and by
/// `lower_m` at the lower one \[m\].
fn wider(
    config: &Config,
    path: &[(f64, Vector3<f64>)],
    (start, margin_m): (Vector3<f64>, f64),
    (axis, lower_m): (usize, f64),
) -> String {
    let (low, high) = corners(config);
    // A border that is moved is moved to the next centimetre outside.
    let along = || path.iter().map(|(_, point)| (start[axis] + point[axis]) * 100.0);
    let from = along().map(|at| ((at - lower_m * 100.0).ceil() - 1.0) / 100.0);
    let to = along().map(|at| ((at + margin_m * 100.0).floor() + 1.0) / 100.0);
    let (from, to) = (from.fold(low[axis], f64::min), to.fold(high[axis], f64::max));
    let (name, other) = (["x", "y", "z"][axis], other(config, margin_m));
    format!("it needs a fence from {from:.2} to {to:.2} m in {name}, or {other}")
}

/// Remedies other than a larger fence, for a path with this margin \[m\], or for one with the way to stop.
fn other(config: &Config, margin_m: f64) -> &'static str {
    match config.trajectory.kind {
        _ if margin_m == 0.0 => "a slower trajectory",
        TrajectoryKind::Waypoints => {
            "a smaller fence.soft-margin-m, or waypoints that are closer together (trajectory.waypoints-file)"
        }
        _ => "a smaller fence.soft-margin-m, or smaller lengths in [trajectory]",
    }
}

/// Opposite corners of the box around the fence \[m, world\].
fn corners(config: &Config) -> (Vector3<f64>, Vector3<f64>) {
    let fence = &config.fence;
    let mut ranges = [fence.x_m, fence.y_m, fence.z_m];
    if !fence.polygon_m.is_empty() {
        for (axis, range) in ranges.iter_mut().enumerate().take(2) {
            let along = || fence.polygon_m.iter().map(|corner| corner[axis]);
            *range =
                [along().fold(f64::INFINITY, f64::min), along().fold(f64::NEG_INFINITY, f64::max)];
        }
    }
    (Vector3::from(ranges.map(|[low, _]| low)), Vector3::from(ranges.map(|[_, high]| high)))
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
mod tests {
    use super::*;
    use crate::trajectory;
    use oqtal_config::Setting;
    use oqtal_control::trajectory::Waypoints;

    fn check(settings: &[&str], start: Option<Vector3<f64>>) -> Result<(), String> {
        let settings: Vec<_> =
            settings.iter().map(|text| Setting::parse("test", text).unwrap()).collect();
        let config = Config::from_settings(&settings).unwrap();
        let trajectory = trajectory(&config).unwrap();
        check_room(&config, &trajectory, start).map_err(|error| error.to_string())
    }

    #[test]
    fn a_trajectory_that_fits_nowhere_is_refused_with_its_ends_and_the_border() {
        assert_eq!(check(&[], None), Ok(()));
        let circle = ["trajectory.kind=\"circle\"", "trajectory.circle.radius-m=4.0"];
        assert_eq!(check(&circle, None), Ok(()));
        let narrow = |border| check(&[&circle[..], &[border]].concat(), None).unwrap_err();
        let told = narrow("fence.x-m=[-4.5, 4.5]");
        assert!(told.starts_with("`fence.x-m` is [-4.5, 4.5]"), "{told}");
        assert!(told.contains("wider than 10.20 m") && told.contains("x = "), "{told}");
        let polygon = "fence.polygon-m=[[-9.0, -4.9], [9.0, -4.9], [9.0, 4.9], [-9.0, 4.9]]";
        assert!(narrow(polygon).starts_with("`fence.polygon-m`"), "{}", narrow(polygon));
        let told = check(&["trajectory.height-m=3.0", "fence.z-m=[0.0, 3.5]"], None).unwrap_err();
        assert!(told.starts_with("`fence.z-m`") && told.contains("z = 3.00 m"), "{told}");
    }

    #[test]
    fn of_a_room_that_is_too_narrow_the_setting_that_made_it_so_is_named() {
        let blamed = |settings: [&str; 3]| {
            let settings = settings.iter().enumerate();
            let settings: Vec<_> = settings
                .map(|(index, text)| Setting::parse(&format!("flag {index}"), text).unwrap())
                .collect();
            let config = Config::from_settings(&settings).unwrap();
            let path = trajectory(&config).unwrap();
            require_flyable(&config, &path, Some(Vector3::zeros())).unwrap_err().to_string()
        };
        let (border, margin) = ("fence.y-m=[-2.25, 2.25]", "fence.soft-margin-m=0.5");
        let told = blamed([border, margin, "fence.soft-margin-m=1.0"]);
        let blame = "flag 2: with `fence.soft-margin-m` = 1.0: `fence.y-m` is [-2.25, 2.25]";
        assert!(told.starts_with(blame), "{told}");
        let told = blamed([margin, border, "fence.y-m=[-1.7, 1.7]"]);
        assert!(told.starts_with("flag 2: `fence.y-m` is [-1.7, 1.7]"), "{told}");
        let told = blamed([border, margin, "trajectory.square.side-m=2.0"]);
        assert!(told.starts_with("flag 2: with `trajectory.square.side-m` = 2.0"), "{told}");
    }

    #[test]
    fn waypoints_near_the_floor_are_refused() {
        let settings = ["trajectory.kind=waypoints", "trajectory.waypoints-file=way.csv"];
        let settings = settings.map(|text| Setting::parse("test", text).unwrap());
        let config = Config::from_settings(&settings).unwrap();
        let check = |height: f64| {
            let text = format!("t,x,y,z\n0,0,0,1\n60,0,0,{height}\n61,0,0,1\n");
            let waypoints = Waypoints::parse(&text).unwrap();
            check_height(&config, &config.trajectory.trajectory(Some(waypoints)).unwrap())
        };
        assert_eq!(check(0.11), Ok(()));
        let told = check(0.09).unwrap_err().to_string();
        assert!(told.contains("at 60.0 s the trajectory is at [0.000, 0.000, 0.090] m"), "{told}");
    }

    #[test]
    fn a_polygon_that_is_too_narrow_is_named_with_the_distance() {
        let settings = ["trajectory.kind=hover", "fence.polygon-m=[[-2, -2], [2, -2], [0, 2]]"];
        let told = check(&settings, Some(Vector3::zeros())).unwrap_err();
        // The sides are 2 / sqrt(5) m from the origin, the margins are 1.1 m.
        let remedy = "it needs sides up to 0.21 m further outside";
        assert!(told.starts_with("`fence.polygon-m`") && told.contains(remedy), "{told}");
        let low = [
            "trajectory.kind=hover",
            "fence.polygon-m=[[-9, -9], [9, -9], [0, 9]]",
            "fence.z-m=[-0.5, 1.9]",
        ];
        let told = check(&low, Some(Vector3::zeros())).unwrap_err();
        assert!(told.starts_with("`fence.z-m`"), "{told}");
    }

    #[test]
    fn from_a_known_start_a_point_outside_is_reported() {
        let settings = ["fence.x-m=[-0.5, 9.0]", "fence.soft-margin-m=0.2"];
        assert_eq!(check(&settings, Some(Vector3::x() * 3.0)), Ok(()));
        let near =
            ["fence.x-m=[-0.8, 9.0]", "fence.soft-margin-m=1.0", "trajectory.kind=\"hover\""];
        let told = check(&near, Some(Vector3::zeros())).unwrap_err();
        assert!(told.starts_with("`fence.x-m`") && told.contains("from -1.11 to 9.00"), "{told}");
        let top = ["trajectory.height-m=3.2", "fence.z-m=[-0.5, 4.0]", "trajectory.kind=\"hover\""];
        let told = check(&top, Some(Vector3::zeros())).unwrap_err();
        assert!(told.contains("from -0.50 to 4.31 m in z"), "{told}");
        let told = check(&settings, Some(Vector3::x() * 8.0)).unwrap_err();
        assert!(
            told.starts_with("`fence.x-m`")
                && told.contains("it needs a fence from -0.50 to ")
                && told.contains("at ["),
            "{told}"
        );
    }
}
