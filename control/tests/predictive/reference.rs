//! The reference model, and the attitude for its acceleration.

use nalgebra::Vector2;
use oqtal_control::controller::AttitudeReference;
use oqtal_control::predictive::{
    CommandFilter, Course, Force, LookAhead, MotionLimits, ReferenceModel, ReferenceModelOptions,
};
use oqtal_control::quantity::{AngularAcceleration, BodyRate};
use oqtal_control::quaternion::Attitude;

use super::*;

/// Overshoot allowed past a target at rest \[m\].
const MOST_PAST_M: f64 = 1e-6;

const LIMITS: MotionLimits = MotionLimits { speed: 0.8, acceleration: 2.3, jerk: f64::INFINITY };

/// The way to a target at rest, from rest at the origin: where the reference is after every tick.
fn towards(
    target: Vector3<f64>,
    (options, limits): (ReferenceModelOptions, MotionLimits),
    seconds: f64,
) -> Vec<Course> {
    let mut model = ReferenceModel::new(options, limits);
    let target = Course { position: target, ..Course::default() };
    let ticks = (seconds / PERIOD_S) as usize;
    (0..ticks)
        .map(|_| {
            model.advance(&target, PERIOD_S);
            model.course()
        })
        .collect()
}

/// Whether these courses keep all limits; the violation otherwise.
fn within(
    courses: &[Course],
    (options, limits): (ReferenceModelOptions, MotionLimits),
) -> Result<(), TestCaseError> {
    for course in courses {
        prop_assert!(course.velocity.norm() <= limits.speed * (1.0 + 1e-9));
        prop_assert!(course.acceleration.norm() <= limits.acceleration * (1.0 + 1e-9));
        prop_assert!(course.jerk.norm() <= options.jerk_limit_m_s3 * (1.0 + 1e-9));
    }
    Ok(())
}

/// Options and limits of a vehicle from wide ranges, though not all that a configuration may hold; the greatest jerk such
/// that the acceleration is there in two seconds.
fn any_options() -> impl Strategy<Value = (ReferenceModelOptions, MotionLimits)> {
    let limits = (0.05..5.0_f64, 0.1..15.0_f64).prop_map(|(speed, a)| MotionLimits {
        speed,
        acceleration: a,
        jerk: f64::INFINITY,
    });
    (0.1..50.0_f64, 0.05..20.0_f64, 0.5..1000.0_f64, limits).prop_map(|(k_p, a_b, jerk, limits)| {
        let options = ReferenceModelOptions {
            position_gain_per_s: k_p,
            braking_m_s2: a_b,
            jerk_limit_m_s3: jerk.max(limits.acceleration / 2.0),
        };
        (options, limits)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn the_reference_keeps_its_limits_arrives_and_brakes_in_time(target in vector(3.0)) {
        let options = (ReferenceModelOptions::default(), LIMITS);
        let courses = towards(target, options, 15.0);
        within(&courses, options)?;
        for course in &courses {
            let past = course.position.dot(&target) / target.norm() - target.norm();
            prop_assert!(past <= MOST_PAST_M, "{past} m past {target}");
        }
        let last = courses[courses.len() - 1];
        prop_assert!((last.position - target).norm() < 1e-3);
    }

    #[test]
    fn the_reference_brakes_in_time_for_any_options(target in vector(3.0), options in any_options()) {
        let courses = towards(target, options, 15.0);
        within(&courses, options)?;
        for course in &courses {
            let past = course.position.dot(&target) / target.norm() - target.norm();
            prop_assert!(past <= MOST_PAST_M, "{past} m past {target} with {options:?}");
        }
    }

    /// The limits hold for any jumps of the target.
    #[test]
    fn the_reference_keeps_its_limits_when_the_target_jumps(
        targets in prop::collection::vec((vector(3.0), 1..90_usize), 1..8),
        options in any_options(),
    ) {
        let mut model = ReferenceModel::new(options.0, options.1);
        let mut courses = Vec::new();
        for (position, ticks) in targets {
            let target = Course { position, ..Course::default() };
            for _ in 0..ticks {
                model.advance(&target, PERIOD_S);
                courses.push(model.course());
            }
        }
        within(&courses, options)?;
    }

    #[test]
    fn a_chase_neither_adds_both_speeds_nor_leaves_the_room_of_start_and_target(
        start in vector(3.0),
        turn in 0.0..std::f64::consts::TAU,
    ) {
        let (radius, rate) = (1.55, 1.29);
        let limits = MotionLimits { speed: 2.5, acceleration: 4.0, jerk: f64::INFINITY };
        let mut model = ReferenceModel::new(ReferenceModelOptions::default(), limits);
        model.restart(start, Vector3::zeros(), Vector3::zeros());
        for tick in 1..=1200 {
            let (sin, cos) = (turn + rate * PERIOD_S * f64::from(tick)).sin_cos();
            let (out, along) = (Vector3::new(cos, sin, 0.0), Vector3::new(-sin, cos, 0.0));
            let target = Course {
                position: out * radius,
                velocity: along * (radius * rate),
                acceleration: -out * (radius * rate.powi(2)),
                jerk: -along * (radius * rate.powi(3)),
                snap: out * (radius * rate.powi(4)),
            };
            model.advance(&target, PERIOD_S);
            let course = model.course();
            prop_assert!(course.velocity.norm() < 2.8, "{} m/s", course.velocity.norm());
            let past = course.position.norm() - start.norm().max(radius);
            prop_assert!(past < 0.05, "{past} m further out than start and target");
        }
        prop_assert!((model.course().position.norm() - radius).abs() < 1e-3, "not caught up");
    }

    /// Each derivative is the rate of change of the previous one in the last part of a tick.
    #[test]
    fn the_derivatives_are_those_of_the_position(target in vector(3.0)) {
        let courses = towards(target, (ReferenceModelOptions::default(), LIMITS), 3.0);
        for pair in courses.windows(2) {
            let [from, to] = [pair[0], pair[1]];
            let mean = |a: Vector3<f64>, b: Vector3<f64>| (a + b) / 2.0;
            let moved = (to.position - from.position) / PERIOD_S;
            prop_assert!((moved - mean(from.velocity, to.velocity)).norm() < 0.01);
            let sped_up = (to.velocity - from.velocity) / PERIOD_S;
            prop_assert!((sped_up - mean(from.acceleration, to.acceleration)).norm() < 0.1);
        }
    }

    /// The stated rate is the rate of the attitude.
    #[test]
    fn rate_and_acceleration_are_the_derivatives_of_the_attitude(
        value in vector(2.0),
        slope in vector(5.0),
        curvature in vector(10.0),
        [yaw, rate, bend] in prop::array::uniform3(-3.0..3.0_f64),
    ) {
        let force = |t: f64| Force {
            value: value + Vector3::z() * 9.81 + slope * t + curvature * (t * t / 2.0),
            slope: slope + curvature * t,
            curvature,
        };
        let h = 1e-3;
        let turning = |t: f64| [yaw + (rate + bend * (t / 2.0)) * t, rate + bend * t, bend];
        let (now, next) = (force(0.0).attitude(turning(0.0)), force(h).attitude(turning(h)));
        let turned = now.attitude.rotation_to(&next.attitude) / h;
        prop_assert!((turned - now.rate.0).amax() < 0.02);
        let accelerated = (next.rate.0 - now.rate.0) / h;
        prop_assert!((accelerated - now.acceleration.0).amax() < 0.5);
    }
}

#[test]
fn a_moving_target_is_followed_without_lag() {
    let mut model = ReferenceModel::new(ReferenceModelOptions::default(), LIMITS);
    let mut target = Course { velocity: Vector3::x() * 0.5, ..Course::default() };
    for _ in 0..600 {
        target = target.after(PERIOD_S);
        model.advance(&target, PERIOD_S);
    }
    let course = model.course();
    assert!((course.position - target.position).norm() < 1e-3);
    assert!((course.velocity - target.velocity).norm() < 1e-3);
}

#[test]
fn the_command_filter_is_critically_damped_and_exact() {
    let (w, input) = (14.0, Vector2::new(1.0, -2.0));
    let mut filter = CommandFilter::new(w);
    let mut smooth = filter.update(&input, 0.0);
    for _ in 0..10 {
        smooth = filter.update(&input, 0.01);
    }
    let step = 1.0 - (1.0 + w * 0.1) * (-w * 0.1_f64).exp();
    assert!((smooth.value - input * step).amax() < 1e-12);
    assert!((smooth.slope - input * (w * w * 0.1 * (-w * 0.1_f64).exp())).amax() < 1e-12);
    filter.reset();
    assert_eq!(filter.update(&Vector2::zeros(), 0.01).value, Vector2::zeros());
}

/// A sine of 3 Hz about body x, by 4 degrees.
fn sine(t_s: f64) -> AttitudeReference {
    let (amplitude, w) = (0.07, std::f64::consts::TAU * 3.0);
    let x = Vector3::x() * amplitude;
    AttitudeReference {
        attitude: Attitude::from_rotation_vector(x * (w * t_s).sin()),
        rate: BodyRate(x * (w * (w * t_s).cos())),
        acceleration: AngularAcceleration(-x * (w * w * (w * t_s).sin())),
    }
}

#[test]
fn a_prescribed_attitude_is_led_over_the_delay() {
    let mut lead = LookAhead::default();
    for tick in 0..60 {
        let t_s = f64::from(tick) * PERIOD_S;
        let led = lead.lead(&sine(t_s), PERIOD_S, DELAY_S);
        let (then, middle) = (sine(t_s + DELAY_S), sine(t_s + DELAY_S + PERIOD_S / 2.0));
        if tick > 0 {
            assert!(led.attitude.angle_to(&then.attitude) < 5e-4);
            assert!((led.rate.0 - then.rate.0).norm() < 0.08);
            assert!((led.acceleration.0 - middle.acceleration.0).norm() < 8.0);
        }
    }
}

#[test]
fn a_step_of_a_prescribed_attitude_leads_nowhere() {
    let mut lead = LookAhead::default();
    lead.lead(&sine(0.02), PERIOD_S, DELAY_S);
    let level = AttitudeReference::default();
    assert_eq!(lead.lead(&level, PERIOD_S, DELAY_S), level);
}
