//! `oqtal-dt` with commands held between the steps of a loop at 60 Hz.

use oqtal_control::controller::{OqtalDt, OqtalDtOptions};
use oqtal_control::tracking_error::AttitudeError;

use super::closed_loop::step;
use super::*;

/// Steps of the body, of one millisecond, for each of the loop: 62.5 Hz.
const STEPS: u32 = 16;
const PERIOD_S: f64 = 0.016;

fn lagged() -> RateInput {
    sticks().with_lag(0.05, DT_S).unwrap()
}

/// The largest modulus of a closed-loop pole: the limit of `norm(A^n)^(1/n)`, by squaring. An iteration that finds the poles themselves
/// need not end.
fn spectral_radius<I: Form>(options: OqtalDtOptions, input: I) -> f64 {
    let law = OqtalDt::new(options, input, DT_S).unwrap();
    let (a, b) = OqtalDt::plant(&input, DT_S);
    let (mut power, mut radius_ln) = (a - b * law.gain(), 0.0);
    for doublings in 0..48 {
        let norm = power.norm();
        radius_ln += norm.ln() * 0.5_f64.powi(doublings);
        power /= norm;
        power *= power;
    }
    radius_ln.exp()
}

proptest! {
    /// As printed, the gains are unstable at 60 Hz from `q/r = 2^12` on.
    #[test]
    fn every_pole_lies_inside_the_unit_circle_for_any_weights(
        attitude in 0.0..20.0_f64,
        rate in -10.0..20.0_f64,
        input in 0.0..20.0_f64,
    ) {
        let weights = [attitude, rate, input].map(f64::exp2);
        let [attitude_weight, rate_weight, input_weight] = weights;
        let options = OqtalDtOptions { attitude_weight, rate_weight, input_weight };
        prop_assert!(spectral_radius(options, spacecraft()) < 1.0);
        prop_assert!(spectral_radius(options, lagged()) < 1.0);
    }
}

/// With equal weights on attitude and rate one pole stays at 0.5 rad/s for any weight.
#[test]
fn split_weights_have_no_slow_pole() {
    let alike = OqtalDtOptions {
        attitude_weight: 1_048_576.0,
        rate_weight: 1_048_576.0,
        input_weight: 1.0,
    };
    let slow = (-0.5 * DT_S).exp();
    assert!((spectral_radius(alike, spacecraft()) - slow).abs() < 1e-4);
    assert!(spectral_radius(OqtalDtOptions::spacecraft(), spacecraft()) < (-20.0 * DT_S).exp());
}

#[test]
fn a_rate_that_follows_at_once_is_not_a_state() {
    let law = OqtalDt::new(OqtalDtOptions::default(), sticks(), DT_S).unwrap();
    assert_eq!(law.gain().fixed_columns::<3>(0).amax(), 0.0);
    assert!(law.gain()[(0, 3)] > 1.0);
}

#[test]
fn weights_without_a_gain_are_refused() {
    let options = OqtalDtOptions { attitude_weight: f64::MAX, ..OqtalDtOptions::default() };
    assert_eq!(OqtalDt::new(options, lagged(), DT_S).unwrap_err().key, "attitude-weight");
    assert_eq!(OqtalDt::new(OqtalDtOptions::default(), lagged(), 0.0).unwrap_err().key, "period-s");
}

/// The error `2 (1 - lambda)` of a body after `seconds` under held torques.
fn left_after(mut state: AttitudeState, input: TorqueInput, inertia: Inertia, seconds: f64) -> f64 {
    let mut law = OqtalDt::new(OqtalDtOptions::spacecraft(), input, PERIOD_S).unwrap();
    let reference = AttitudeReference::default();
    for _ in 0..(seconds / PERIOD_S) as u32 {
        let torque = law.update(&state, &reference, PERIOD_S);
        assert!(torque.0.iter().all(|torque| torque.is_finite()));
        for _ in 0..STEPS {
            state = step(&state, |state| inertia.acceleration(state.rate, torque).0);
        }
    }
    AttitudeError::between(&reference.attitude, &state.attitude).lyapunov()
}

fn direction() -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-1.0..1.0_f64)
        .prop_filter_map("no direction", |numbers| Vector3::from(numbers).try_normalize(1e-3))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn oqtal_dt_recovers_from_175_degrees(axis in direction(), weak: bool) {
        let turn = axis * 175.0_f64.to_radians();
        let max_torque = if weak { 1.0 } else { MAX_TORQUE };
        let input = TorqueInput::new(uneven_inertia(), max_torque).unwrap();
        let state = at_rest(Attitude::from_rotation_vector(turn));
        let left = left_after(state, input, uneven_inertia(), 20.0);
        prop_assert!(left < 1e-9, "ends at {left}");
    }

    #[test]
    fn oqtal_dt_recovers_from_a_tumble_of_20_rad_per_s(
        axis in direction(),
        attitude in attitude(),
        weak: bool,
    ) {
        let rate = BodyRate(axis * 20.0);
        let max_torque = if weak { 2.0 } else { MAX_TORQUE };
        let input = TorqueInput::new(uneven_inertia(), max_torque).unwrap();
        let left = left_after(AttitudeState { attitude, rate }, input, uneven_inertia(), 30.0);
        prop_assert!(left < 1e-9, "ends at {left}");
    }
}

/// A body that turns with its reference stays with it, from step to step, although the torque is held.
#[test]
fn a_turning_reference_is_followed() {
    let inertia = uneven_inertia();
    let input = TorqueInput::new(inertia, 1e3).unwrap();
    let mut law = OqtalDt::new(OqtalDtOptions::spacecraft(), input, PERIOD_S).unwrap();
    let course = |t: f64| {
        let angle = Vector3::z() * (0.3 * t).sin();
        AttitudeReference {
            attitude: Attitude::from_rotation_vector(angle),
            rate: BodyRate(Vector3::z() * (0.3 * (0.3 * t).cos())),
            acceleration: AngularAcceleration(Vector3::z() * (-0.09 * (0.3 * t).sin())),
        }
    };
    let start = course(0.0);
    let mut state = AttitudeState { attitude: start.attitude, rate: start.rate };
    for tick in 0..1000 {
        let reference = course(f64::from(tick) * PERIOD_S);
        assert!(state.attitude.angle_to(&reference.attitude) < 2e-6);
        let torque = law.update(&state, &reference, PERIOD_S);
        for _ in 0..STEPS {
            state = step(&state, |state| inertia.acceleration(state.rate, torque).0);
        }
    }
}
