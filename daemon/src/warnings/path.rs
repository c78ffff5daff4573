//! Warnings of a path that the vehicle cannot follow.

use nalgebra::{Vector2, Vector3};
use oqtal_config::{Config, Interface};
use oqtal_control::trajectory::{
    FlightPlan, Phase, Reference, Trajectory, TrajectoryKind, WaypointCurve,
};

use crate::flight_room::{is_flyable, known_start};
use crate::flyable::{RATE_SHARE, least_settle_s};
use crate::supervisor::FAR_OFF_MS;

/// Distance between hover point and first waypoint above which a note is printed \[m\].
const TOLD_JUMP_M: f64 = 0.5;

/// Warning of the greatest acceleration of the reference, if the limit of the tilt does not allow it. `jumps`: whether the acceleration
/// is discontinuous.
pub(super) fn too_hard(
    samples: &[(f64, Reference)],
    config: &Config,
    (trajectory, jumps): (&Trajectory, bool),
) -> Option<String> {
    let (most, t_s, _) = greatest(samples, |reference| reference.acceleration.xy().norm())?;
    let tilt_deg = config.position.tilt_limit_deg;
    let limit = config.vehicle.gravity_m_s2 * tilt_deg.to_radians().tan();
    (most > limit).then(|| {
        let smooth = trajectory.clone().along(WaypointCurve::MinimumSnap);
        let is_remedy = jumps && config.control.is_predictive();
        let or_smooth = match is_remedy && is_flyable(config, &smooth, known_start(config)) {
            true => ", or set trajectory.waypoints-curve to \"minimum-snap\"",
            false => "",
        };
        format!(
            "at {:.2} s the trajectory accelerates by {most:.2} m/s^2, and position.tilt-limit-deg = {tilt_deg} gives {limit:.2}: the vehicle leaves the path there; fly it {:.1} times slower{or_smooth}",
            t_s - config.trajectory.start_s(),
            // Rounded up, so that the remedy suffices.
            (10.0 * (most / limit).sqrt()).ceil() / 10.0
        )
    })
}

/// Where the reference is fastest along an axis, if it is faster than the limit of the commanded velocity there. `can_rise`: whether a
/// higher limit is a remedy.
pub(super) fn too_fast(
    samples: &[(f64, Reference)],
    config: &Config,
    (axis, limit, can_rise): (&str, f64, bool),
    speed: impl Fn(&Vector3<f64>) -> f64,
) -> Option<String> {
    let (fastest, t_s, reference) = greatest(samples, |reference| speed(&reference.velocity))?;
    if fastest <= limit {
        return None;
    }
    let (what, remedy) = match reference.phase {
        Phase::TakeOff => ("the take-off".to_owned(), "raise trajectory.take-off-s".to_owned()),
        Phase::Landing => ("the landing".to_owned(), "lower trajectory.descent-m-s".to_owned()),
        Phase::Settle | Phase::Trajectory => (
            format!("at {:.2} s the trajectory", t_s - config.trajectory.start_s()),
            // Rounded up, so that the remedy suffices.
            format!("fly it {:.1} times slower", (10.0 * fastest / limit).ceil() / 10.0),
        ),
    };
    let or_raise = if can_rise { ", or raise the limit" } else { "" };
    Some(format!(
        "{what} moves at {fastest:.2} m/s, and position.{axis}-velocity-limit-m-s is {limit}: the vehicle will stay behind; {remedy}{or_raise}"
    ))
}

/// The greatest `value` of the samples, with its time \[s\] and reference; `None` without a sample.
fn greatest(
    samples: &[(f64, Reference)],
    value: impl Fn(&Reference) -> f64,
) -> Option<(f64, f64, &Reference)> {
    let values = samples.iter().map(|(t_s, reference)| (value(reference), *t_s, reference));
    values.max_by(|a, b| a.0.total_cmp(&b.0))
}

/// Time within which a vehicle reacts to a step of its reference, at most \[s\].
const REACTION_S: f64 = 0.25;
/// Shortest step that is looked at \[m\].
const LEAST_STEP_M: f64 = 0.1;
/// Steps in which a limit with which the flight is not ended is sought \[m, m/s\], and most steps \[-\].
const LIMIT_STEP: f64 = 0.1;
const MOST_STEPS: u32 = 200;

/// A step of the reference after which the daemon lands the vehicle (F44), since it does not arrive in time.
pub(super) fn too_far_a_step(samples: &[(f64, Reference)], config: &Config) -> Option<String> {
    let (limit_m, speed_m_s) =
        (config.safety.tracking_limit_m, config.position.horizontal_velocity_limit_m_s);
    let acceleration_m_s2 =
        config.vehicle.gravity_m_s2 * config.position.tilt_limit_deg.to_radians().tan();
    let far = |limit_m, speed_m_s| far_since(samples, limit_m, (speed_m_s, acceleration_m_s2));
    let (t_s, distance_m) = far(limit_m, speed_m_s)?;
    let higher = |from: f64| {
        let next = move |step: u32| ((from + f64::from(step) * LIMIT_STEP) * 10.0).ceil() / 10.0;
        (1..MOST_STEPS).map(next)
    };
    let remedies = [
        higher(limit_m)
            .find(|limit_m| far(*limit_m, speed_m_s).is_none())
            .map(|limit_m| format!("set safety.tracking-limit-m to {limit_m}")),
        higher(speed_m_s)
            .find(|speed_m_s| far(limit_m, *speed_m_s).is_none())
            .map(|speed_m_s| format!("position.horizontal-velocity-limit-m-s to {speed_m_s}")),
    ];
    let remedies: Vec<String> = remedies.into_iter().flatten().collect();
    Some(format!(
        "the reference steps, and {t_s:.1} s after arming it is {distance_m:.2} m from the vehicle: at position.horizontal-velocity-limit-m-s = {speed_m_s} the vehicle is further than safety.tracking-limit-m = {limit_m} from it for about {} s, after which the daemon lands it; make the step smaller{}",
        FAR_OFF_MS as f64 * 1e-3,
        remedies.iter().map(|remedy| format!(", or {remedy}")).collect::<String>()
    ))
}

/// When a vehicle that makes up for steps of the reference with this greatest speed and acceleration \[m/s, m/s^2\] is further than
/// `limit_m` \[m\] from it, horizontally, for longer than the daemon allows: the beginning \[s\], and the distance there \[m\].
fn far_since(
    samples: &[(f64, Reference)],
    limit_m: f64,
    (speed_m_s, acceleration_m_s2): (f64, f64),
) -> Option<(f64, f64)> {
    let (mut behind, mut velocity) = (Vector2::zeros(), Vector2::zeros());
    let mut since: Option<(f64, f64)> = None;
    for pair in samples.windows(2) {
        let (t_s, dt_s) = (pair[1].0, pair[1].0 - pair[0].0);
        let [(_, before), (_, after)] = [&pair[0], &pair[1]];
        // A motion that the velocity of the reference does not explain is a step.
        let moved = (before.velocity + after.velocity).xy() * (0.5 * dt_s);
        let step = (after.position - before.position).xy() - moved;
        behind += if step.norm() > LEAST_STEP_M { step } else { Vector2::zeros() };
        let wanted = behind * (speed_m_s / behind.norm().max(speed_m_s));
        velocity += (wanted - velocity).cap_magnitude(acceleration_m_s2 * dt_s);
        behind -= velocity * dt_s;
        // A prescribed attitude does not follow the position.
        let is_far = behind.norm() > limit_m && after.attitude.is_none();
        since = is_far.then(|| since.unwrap_or((t_s, behind.norm())));
        if since.is_some_and(|(from_s, _)| t_s - from_s > FAR_OFF_MS as f64 * 1e-3 - REACTION_S) {
            return since;
        }
    }
    None
}

/// The distance from the hover point to the first waypoint, if it is far.
pub(super) fn jump(plan: &FlightPlan, config: &Config) -> Option<String> {
    if config.trajectory.kind != TrajectoryKind::Waypoints {
        return None;
    }
    let at = config.trajectory.start_s();
    // Half a millisecond before: rounding must not take the sample for one of the trajectory.
    let (before, after) = (plan.sample((at - 5e-4).max(0.0)), plan.sample(at + 1e-9));
    let way = after.position - before.position;
    let distance_m = way.norm();
    let higher = match way.xy().norm() < TOLD_JUMP_M {
        true => format!(", or set trajectory.height-m to {}", after.position.z),
        false => String::new(),
    };
    let ([x, y, z], [from_x, from_y, from_z]): ([f64; 3], [f64; 3]) =
        (after.position.into(), before.position.into());
    (distance_m > TOLD_JUMP_M).then(|| {
        format!(
            "the first waypoint [{x:.2}, {y:.2}, {z:.2}] m is {distance_m:.2} m from the hover point [{from_x:.2}, {from_y:.2}, {from_z:.2}] m: the reference jumps there; begin at the hover point{higher}"
        )
    })
}

/// The turn to the heading of the first waypoint, if the vehicle has too little time for it.
pub(super) fn first_turn(config: &Config, trajectory: &Trajectory) -> Option<String> {
    // Of a vehicle commanded by torque the rates have no limit of their own.
    let is_limited = config.vehicle.interface != Interface::Torque;
    let least_s = least_settle_s(config, trajectory).filter(|_| is_limited)?;
    let turn_deg = trajectory.sample(0.0).yaw_rad.to_degrees();
    Some(format!(
        "the vehicle turns to the heading of the first waypoint, {turn_deg:.0} deg, within trajectory.settle-s = {}, faster than vehicle.rate-authority-rad-s allows: set trajectory.settle-s to {least_s:.1}",
        config.trajectory.settle_s
    ))
}

/// Time between two points at which a prescribed attitude is looked at, and most points \[s, -\].
const ATTITUDE_STEP_S: f64 = 1e-3;
const MOST_ATTITUDES: f64 = 200_000.0;
/// Time over which its rate is a difference \[s\].
const DIFFERENCE_S: f64 = 1e-5;
/// Share of the amplitude or frequency that would do \[-\]: the greatest rate may lie between two points.
const REMEDY_SHARE: f64 = 0.99;

/// Where a prescribed attitude turns fastest, if the vehicle has too little authority for it.
pub(super) fn turns_too_fast(config: &Config, trajectory: &Trajectory) -> Option<String> {
    // Of a vehicle commanded by torque the rates have no limit of their own.
    if config.vehicle.interface == Interface::Torque {
        return None;
    }
    let limits = config.vehicle.rate_authority_rad_s;
    let step_s = ATTITUDE_STEP_S.max(trajectory.duration_s() / MOST_ATTITUDES);
    let times = (0..(trajectory.duration_s() / step_s) as u32).map(|k| f64::from(k) * step_s);
    let rates = times.filter_map(|t_s| Some((t_s, prescribed_rate(trajectory, t_s)?)));
    let shares = rates.flat_map(|(t_s, rate)| {
        (0..3).map(move |axis| (rate[axis].abs() / limits[axis], t_s, axis, rate[axis].abs()))
    });
    let (share, t_s, axis, rate) = shares.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let factor = RATE_SHARE / share;
    (factor < 1.0).then(|| {
        let (name, limit) = (["roll", "pitch", "yaw"][axis], limits[axis]);
        format!(
            "at {t_s:.2} s the trajectory prescribes an attitude that turns at {rate:.2} rad/s in {name}, and {RATE_SHARE} of vehicle.rate-authority-rad-s is {:.2}: the vehicle will stay behind; lower {}",
            RATE_SHARE * limit,
            slower_attitude(config, factor * REMEDY_SHARE)
        )
    })
}

/// The rate of the attitude that `trajectory` prescribes at `t_s` \[rad/s, body\], that of a side without a step; `None` without one.
fn prescribed_rate(trajectory: &Trajectory, t_s: f64) -> Option<Vector3<f64>> {
    let at = |t_s: f64| trajectory.sample(t_s).attitude.map(|prescribed| prescribed.attitude);
    let (now, sides) = (at(t_s)?, [t_s - DIFFERENCE_S, t_s + DIFFERENCE_S]);
    let rates =
        sides.into_iter().filter_map(|side_s| Some(now.rotation_to(&at(side_s)?) / DIFFERENCE_S));
    rates.min_by(|a, b| a.norm().total_cmp(&b.norm()))
}

/// The settings that make a prescribed attitude turn `factor` times as fast \[-\].
fn slower_attitude(config: &Config, factor: f64) -> String {
    let scaled = |value: f64| (value * factor * 100.0).trunc() / 100.0;
    let (path, chirp) = (&config.trajectory, &config.trajectory.attitude_chirp);
    match path.kind {
        TrajectoryKind::AttitudeChirp => {
            let most_hz = scaled(chirp.from_hz.max(chirp.to_hz));
            let both = [("from-hz", chirp.from_hz), ("to-hz", chirp.to_hz)];
            let keys = both.iter().filter(|(_, hz)| *hz > most_hz).map(|(key, _)| *key);
            format!(
                "{} in trajectory.attitude-chirp to {most_hz:.2}, or amplitude-deg to {:.2}",
                keys.collect::<Vec<_>>().join(" and "),
                scaled(chirp.amplitude_deg)
            )
        }
        _ => format!("trajectory.excitation.tilt-deg to {:.2}", scaled(path.excitation.tilt_deg)),
    }
}
