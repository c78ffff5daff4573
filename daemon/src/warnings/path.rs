//! Warnings of a path that the vehicle cannot follow.

use nalgebra::Vector3;
use oqtal_config::Config;
use oqtal_control::trajectory::{FlightPlan, Phase, Reference, TrajectoryKind};

/// Distance between hover point and first waypoint above which a note is printed \[m\].
const TOLD_JUMP_M: f64 = 0.5;

/// Where a reference whose acceleration jumps accelerates most, if that is more than the limit of the tilt allows.
pub(super) fn too_hard(samples: &[(f64, Reference)], config: &Config) -> Option<String> {
    let (most, t_s, _) = greatest(samples, |reference| reference.acceleration.xy().norm())?;
    let tilt_deg = config.position.tilt_limit_deg;
    let limit = config.vehicle.gravity_m_s2 * tilt_deg.to_radians().tan();
    (most > limit).then(|| {
        format!(
            "at {:.2} s the trajectory accelerates by {most:.2} m/s^2, and position.tilt-limit-deg = {tilt_deg} gives {limit:.2}: the vehicle leaves the path there; fly it {:.1} times slower, or set trajectory.waypoints-curve to \"minimum-snap\"",
            t_s - config.trajectory.start_s(),
            // Rounded up, so that the remedy suffices.
            (10.0 * (most / limit).sqrt()).ceil() / 10.0
        )
    })
}

/// Where the reference is fastest along an axis, if it is faster than the limit of the commanded velocity there.
pub(super) fn too_fast(
    samples: &[(f64, Reference)],
    config: &Config,
    (axis, limit): (&str, f64),
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
        "{what} moves at {fastest:.2} m/s, and position.{axis}-velocity-limit-m-s is {limit}: the vehicle will stay behind; {remedy}, or raise the limit"
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
    let distance_m = (after.position - before.position).norm();
    let ([x, y, z], [from_x, from_y, from_z]): ([f64; 3], [f64; 3]) =
        (after.position.into(), before.position.into());
    (distance_m > TOLD_JUMP_M).then(|| {
        format!(
            "the first waypoint [{x:.2}, {y:.2}, {z:.2}] m is {distance_m:.2} m from the hover point [{from_x:.2}, {from_y:.2}, {from_z:.2}] m: the reference jumps there; begin at the hover point, or set trajectory.height-m"
        )
    })
}
