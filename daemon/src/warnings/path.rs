//! Warnings of a path that the vehicle cannot follow.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use oqtal_config::{Config, Interface};
use oqtal_control::trajectory::{
    FlightPlan, Phase, Reference, Trajectory, TrajectoryKind, WaypointCurve,
};

use crate::flight_room::{is_flyable, known_start};
use crate::flyable::least_settle_s;

/// Jump of the acceleration above which a note is printed \[m/s^2\]: below it, the predictive stack stays within 2 cm of the path.
const MOST_JUMP_M_S2: f64 = 1.5;
/// Distance between hover point and first waypoint above which a note is printed \[m\].
const TOLD_JUMP_M: f64 = 0.05;
/// Distance beside the hover point within which another height is a remedy \[m\].
const BESIDE_M: f64 = 0.5;

/// Warning of the greatest acceleration of the reference, if the limit of the tilt does not allow it.
pub(super) fn too_hard(samples: &[(f64, Reference)], config: &Config) -> Option<String> {
    let (most, t_s, _) = greatest(samples, |reference| reference.acceleration.xy().norm())?;
    let tilt_deg = config.position.tilt_limit_deg;
    let limit = config.vehicle.gravity_m_s2 * tilt_deg.to_radians().tan();
    (most > limit).then(|| {
        format!(
            "at {:.2} s the trajectory accelerates by {most:.2} m/s^2, and position.tilt-limit-deg = {tilt_deg} gives {limit:.2}: the vehicle leaves the path there; fly it {:.1} times slower",
            t_s - config.trajectory.start_s(),
            slower(most / limit)
        )
    })
}

/// Factor of the times that divides an acceleration by `excess`, rounded up, so that the remedy suffices \[-\].
fn slower(excess: f64) -> f64 {
    (10.0 * excess.sqrt()).ceil() / 10.0
}

/// Warning of the greatest jump of the acceleration of `trajectory`, for the predictive stack: it feeds the acceleration forward and cannot
/// turn the thrust at once, whatever the limit of the tilt.
pub(super) fn jerks(
    samples: &[(f64, Reference)],
    config: &Config,
    trajectory: &Trajectory,
) -> Option<String> {
    let jump = |pair: &[(f64, Reference)]| {
        let [before, after] = [0, 1].map(|side| pair[side].1.acceleration.xy());
        ((after - before).norm(), pair[1].0)
    };
    let flown = samples
        .windows(2)
        .filter(|pair| pair.iter().any(|(_, reference)| reference.phase == Phase::Trajectory));
    let (most, t_s) = flown.map(jump).max_by(|a, b| a.0.total_cmp(&b.0))?;
    (most > MOST_JUMP_M_S2).then(|| {
        let smooth = trajectory.clone().along(WaypointCurve::MinimumSnap);
        let or_smooth = match is_flyable(config, &smooth, known_start(config)) {
            true => "set trajectory.waypoints-curve to \"minimum-snap\", or ",
            false => "",
        };
        format!(
            "at {:.2} s the acceleration of the trajectory jumps by {most:.2} m/s^2, faster than the vehicle turns: it leaves the path after that; {or_smooth}fly it {:.1} times slower, with jumps below {MOST_JUMP_M_S2} m/s^2",
            t_s - config.trajectory.start_s(),
            // Between two points the acceleration changes by a little more than it jumps.
            slower(1.05 * most / MOST_JUMP_M_S2)
        )
    })
}

/// Warning that names where the reference is fastest along an axis, if it is faster there than the limit of the commanded velocity.
/// `or_else` is a further remedy.
pub(super) fn too_fast(
    samples: &[(f64, Reference)],
    config: &Config,
    (axis, limit, or_else): (&str, f64, &str),
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
    Some(format!(
        "{what} moves at {fastest:.2} m/s, and position.{axis}-velocity-limit-m-s is {limit}: the vehicle will stay behind; {remedy}{or_else}"
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
    let higher = match way.xy().norm() < BESIDE_M {
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

/// Time between two samples of a prescribed attitude \[s\], and maximum number of samples \[-\].
const ATTITUDE_STEP_S: f64 = 1e-3;
const MOST_ATTITUDES: f64 = 200_000.0;
/// Time of the difference that gives the attitude's rate \[s\]; the difference of the rate uses the time between two samples.
const DIFFERENCE_S: f64 = 1e-5;
/// Share of the sufficient amplitude or frequency that a remedy states \[-\], since the greatest rate may lie between two samples.
const REMEDY_SHARE: f64 = 0.99;
/// Ratio of successive chirp frequencies that are tried \[-\], and number of tries.
const CHIRP_SHARE: f64 = 0.99;
const MOST_TRIES: i32 = 8;

/// The greatest rate command that a prescribed attitude takes.
struct GreatestCommand {
    /// Share of the authority \[-\].
    share: f64,
    t_s: f64,
    axis: usize,
    rate_rad_s: f64,
}

impl GreatestCommand {
    /// That of `trajectory`; `None` without a prescribed attitude.
    fn of(config: &Config, trajectory: &Trajectory) -> Option<Self> {
        let limits = config.vehicle.rate_authority_rad_s;
        let step_s = ATTITUDE_STEP_S.max(trajectory.duration_s() / MOST_ATTITUDES);
        let times = (0..(trajectory.duration_s() / step_s) as u32).map(|k| f64::from(k) * step_s);
        let lag_s = followed_lag_ms(config) * 1e-3;
        let commands = times.filter_map(|t_s| Some((t_s, commanded_rate(trajectory, t_s, lag_s)?)));
        let all = commands.flat_map(|(t_s, rate)| {
            (0..3).map(move |axis| {
                let rate_rad_s = rate[axis].abs();
                Self { share: rate_rad_s / limits[axis], t_s, axis, rate_rad_s }
            })
        });
        all.max_by(|a, b| a.share.total_cmp(&b.share))
    }
}

/// Lag that a command compensates \[ms\]: an excitation identifies it; only a chirp is to be followed.
fn followed_lag_ms(config: &Config) -> f64 {
    let is_chirp = config.trajectory.kind == TrajectoryKind::AttitudeChirp;
    if is_chirp { config.vehicle.rate_lag_ms } else { 0.0 }
}

/// Warning that names the instant at which a prescribed attitude turns fastest, if the vehicle has too little authority for it.
pub(super) fn turns_too_fast(config: &Config, trajectory: &Trajectory) -> Option<String> {
    // Of a vehicle commanded by torque the rates have no limit of their own.
    if config.vehicle.interface == Interface::Torque {
        return None;
    }
    let greatest = GreatestCommand::of(config, trajectory).filter(|it| it.share > 1.0)?;
    let GreatestCommand { share, t_s, axis, rate_rad_s } = greatest;
    let (name, limit) = (["roll", "pitch", "yaw"][axis], config.vehicle.rate_authority_rad_s[axis]);
    let with_lag = match followed_lag_ms(config) {
        0.0 => String::new(),
        lag_ms => format!(", with vehicle.rate-lag-ms = {lag_ms}"),
    };
    Some(format!(
        "at {t_s:.2} s the trajectory prescribes an attitude that takes a command of {rate_rad_s:.2} rad/s in {name}{with_lag}, and vehicle.rate-authority-rad-s is {limit}: the vehicle will stay behind; lower {}",
        slower_attitude(config, REMEDY_SHARE / share)
    ))
}

/// The rate command with which a vehicle with this lag of the rates \[s\] turns like the attitude that `trajectory` prescribes at `t_s`
/// \[rad/s, body\]; `None` without one. Where the rate steps, it is the smaller one of both sides.
fn commanded_rate(trajectory: &Trajectory, t_s: f64, lag_s: f64) -> Option<Vector3<f64>> {
    let at = |t_s: f64| trajectory.sample(t_s).attitude.map(|prescribed| prescribed.attitude);
    let rate = |t_s: f64, side: f64| {
        let step_s = side * DIFFERENCE_S;
        Some(at(t_s)?.rotation_to(&at(t_s + step_s)?) / step_s)
    };
    let commands = [-1.0, 1.0].into_iter().filter_map(|side| {
        let (here, there) = (rate(t_s, side)?, rate(t_s + side * ATTITUDE_STEP_S, side)?);
        Some(here + (there - here) * (lag_s / (side * ATTITUDE_STEP_S)))
    });
    commands.min_by(|a, b| a.norm().total_cmp(&b.norm()))
}

/// The settings with which a prescribed attitude takes `factor` times the rate command \[-\].
fn slower_attitude(config: &Config, factor: f64) -> String {
    let (path, chirp) = (&config.trajectory, &config.trajectory.attitude_chirp);
    match path.kind {
        TrajectoryKind::AttitudeChirp => {
            let most_hz = slower_chirp_hz(config, factor);
            let both = [("from-hz", chirp.from_hz), ("to-hz", chirp.to_hz)];
            let keys = both.iter().filter(|(_, hz)| *hz > most_hz).map(|(key, _)| *key);
            // With a smaller amplitude the delays would remain too long for so high a frequency.
            let keys = keys.collect::<Vec<_>>().join(" and ");
            format!("{keys} in trajectory.attitude-chirp to {most_hz:.2}")
        }
        _ => format!(
            "trajectory.excitation.tilt-deg to {:.2}",
            hundredths(path.excitation.tilt_deg * factor)
        ),
    }
}

/// The highest frequency of a chirp that takes at most `factor` times the rate command \[Hz\].
fn slower_chirp_hz(config: &Config, factor: f64) -> f64 {
    let chirp = &config.trajectory.attitude_chirp;
    // A sine at f takes a command of f sqrt(1 + (2 pi lag f)^2) times a constant; that of a chirp is greater by up to a hundredth.
    let squared = (TAU * config.vehicle.rate_lag_ms * 1e-3).powi(2);
    let high_hz = chirp.from_hz.max(chirp.to_hz);
    let gain = (high_hz * factor).powi(2) * (1.0 + squared * high_hz * high_hz);
    let sine_hz = hundredths((2.0 * gain / (1.0 + (1.0 + 4.0 * squared * gain).sqrt())).sqrt());
    let suffices = |most_hz: &f64| {
        let mut slower = config.clone();
        let chirp = &mut slower.trajectory.attitude_chirp;
        (chirp.from_hz, chirp.to_hz) = (chirp.from_hz.min(*most_hz), chirp.to_hz.min(*most_hz));
        let trajectory = slower.trajectory.trajectory(None);
        trajectory
            .and_then(|it| GreatestCommand::of(&slower, &it))
            .is_none_or(|command| command.share <= 1.0)
    };
    let mut tries = (0..MOST_TRIES).map(|k| hundredths(sine_hz * CHIRP_SHARE.powi(k)));
    tries.find(suffices).unwrap_or(sine_hz)
}

fn hundredths(value: f64) -> f64 {
    (value * 100.0).trunc() / 100.0
}
