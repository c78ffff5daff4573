//! Robustness of the laws against invalid input.

use nalgebra::{Quaternion, UnitQuaternion};

use super::*;

/// The other quaternion of the same attitude.
fn negated(attitude: &Attitude) -> Attitude {
    Attitude::from_unit_quaternion(UnitQuaternion::new_unchecked(
        -attitude.unit_quaternion().into_inner(),
    ))
}

/// F08: the sign of a measured quaternion has no effect.
fn check_sign_of_quaternion<I: Form>(input: I, state: AttitudeState, reference: AttitudeReference) {
    for name in ALL {
        let law = law(name, &ControlOptions::default(), input);
        let command = first_command(law, &state, &reference);
        let turned = AttitudeState { attitude: negated(&state.attitude), ..state };
        assert_eq!(command, first_command(law, &turned, &reference), "{name:?}");
        let turned = AttitudeReference { attitude: negated(&reference.attitude), ..reference };
        assert_eq!(command, first_command(law, &state, &turned), "{name:?}");
    }
}

proptest! {
    #[test]
    fn q_and_minus_q_give_the_same_command(state in state(), reference in reference()) {
        check_sign_of_quaternion(sticks(), state, reference);
        check_sign_of_quaternion(spacecraft(), state, reference);
    }
}

#[test]
fn q_and_minus_q_give_the_same_command_half_a_turn_away() {
    for [x, y, z] in
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-0.6, 0.8, 0.0], [0.0, -0.6, 0.8]]
    {
        let upside_down = at_rest(Attitude::from_xyzw([x, y, z, 0.0]).unwrap());
        check_sign_of_quaternion(sticks(), upside_down, AttitudeReference::default());
        check_sign_of_quaternion(spacecraft(), upside_down, AttitudeReference::default());
    }
}

/// The terms of a law add up to its command before the limits.
fn check_terms<I: Form>(input: I, state: AttitudeState, reference: AttitudeReference) {
    for name in ALL {
        let mut law = law(name, &ControlOptions::default(), input);
        for _ in 0..3 {
            let command = law.update(&state, &reference, DT_S).numbers();
            let LawTerms { proportional, integral, feed_forward, disturbance } = law.terms();
            let sum = proportional + integral + feed_forward + disturbance;
            let off = (input.saturate(&sum) - command).amax();
            assert!(off < 1e-9, "{name:?}: {sum:?} for {command:?}");
        }
    }
}

proptest! {
    #[test]
    fn the_terms_of_a_law_add_up_to_its_command(state in state(), reference in reference()) {
        check_terms(sticks(), state, reference);
        check_terms(spacecraft(), state, reference);
    }
}

/// A number as a broken sensor or a corrupted message might give it.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -2.0..2.0_f64,
        1 => any::<u64>().prop_map(f64::from_bits),
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(f64::MAX), Just(5e-324)],
    ]
}

type Garbage = (AttitudeState, AttitudeReference, f64);

fn garbage() -> impl Strategy<Value = Garbage> {
    let vector = || prop::array::uniform3(any_number()).prop_map(Vector3::from);
    let attitude = || {
        prop::array::uniform4(any_number()).prop_map(|[x, y, z, w]| {
            Attitude::from_unit_quaternion(UnitQuaternion::new_unchecked(Quaternion::new(
                w, x, y, z,
            )))
        })
    };
    (attitude(), vector(), attitude(), vector(), vector(), any_number()).prop_map(
        |(actual, omega, desired, omega_d, omega_d_dot, dt_s)| {
            let state = AttitudeState { attitude: actual, rate: BodyRate(omega) };
            let acceleration = AngularAcceleration(omega_d_dot);
            (
                state,
                AttitudeReference { attitude: desired, rate: BodyRate(omega_d), acceleration },
                dt_s,
            )
        },
    )
}

/// F06: for any input the command is finite and in range, and the next valid input gives its usual command.
fn check_garbage<I: Form>(input: I, options: &ControlOptions, range: f64, garbage: &[Garbage]) {
    let (state, reference) = (
        at_rest(Attitude::from_rotation_vector(Vector3::new(0.1, -0.2, 0.3))),
        AttitudeReference::default(),
    );
    for name in ALL {
        let fresh = law(name, options, input);
        let mut law = fresh;
        for (state, reference, dt_s) in garbage {
            let before = law;
            let command = law.update(state, reference, *dt_s).numbers();
            assert!(
                command.iter().all(|number| number.abs() <= range),
                "{name:?} commands {command}"
            );
            if !(state.is_finite() && reference.is_finite() && dt_s.is_finite()) {
                assert_eq!(command, Vector3::zeros(), "{name:?}");
                assert_eq!(law, before, "{name:?} learnt from a number that is not one");
            }
        }
        let command = law.update(&state, &reference, DT_S).numbers();
        assert!(
            command.iter().all(|number| number.abs() <= range),
            "{name:?} then commands {command}"
        );
        law.reset();
        let command = law.update(&state, &reference, DT_S).numbers();
        assert_eq!(command, first_command(fresh, &state, &reference), "{name:?} was spoilt");
    }
}

proptest! {
    #[test]
    fn no_invalid_number_reaches_a_command(
        garbage in prop::collection::vec(garbage(), 1..5),
        feed_forward: bool,
    ) {
        let mut options = ControlOptions::default();
        options.pid.feed_forward = feed_forward;
        options.lqr.feed_forward = feed_forward;
        options.oqtal.feed_forward = feed_forward;
        options.pid.max_acceleration_rad_s2 = 2.0;
        check_garbage(sticks(), &options, 1.0, &garbage);
        check_garbage(spacecraft(), &options, MAX_TORQUE, &garbage);
    }
}

proptest! {
    /// E-19: the largest component is at the limit and the others in proportion.
    #[test]
    fn a_saturated_torque_keeps_its_direction(u in vector(100.0)) {
        let given = spacecraft().saturate(&u);
        if u.amax() <= MAX_TORQUE {
            assert_eq!(given, u);
        } else {
            assert_eq!(given.amax(), MAX_TORQUE);
            assert!((given.normalize() - u.normalize()).amax() < 1e-12);
        }
    }
}

/// A body is held far from its reference, then released at the reference: the integral has not wound up.
fn check_windup<I: Form>(input: I, options: &ControlOptions) {
    let far = at_rest(Attitude::from_rotation_vector(Vector3::new(0.0, 0.0, 2.0)));
    // An incremental law takes a body that does not move under its input for one that is disturbed by as much.
    for name in ALL.into_iter().filter(|name| *name != ControllerName::Indi) {
        let mut law = law(name, options, input);
        for _ in 0..600 {
            law.update(&far, &AttitudeReference::default(), DT_S);
        }
        let command =
            law.update(&AttitudeState::default(), &AttitudeReference::default(), DT_S).numbers();
        assert!(command.amax() < 1e-12, "{name:?} has wound up to {command}");
    }
}

#[test]
fn f21_integral_action_does_not_wind_up_while_the_command_is_saturated() {
    check_windup(sticks(), &ControlOptions::default());
    check_windup(TorqueInput::new(isotropic_inertia(), 0.1).unwrap(), &ControlOptions::default());
}

#[test]
fn the_slew_rate_limit_does_not_wind_up_the_pid() {
    let mut options = ControlOptions::default();
    options.pid.max_rate_rad_s = 0.1;
    let far = at_rest(Attitude::from_rotation_vector(Vector3::new(0.0, 0.0, 0.1)));
    let mut law = law(ControllerName::Pid, &options, sticks());
    for _ in 0..600 {
        let sticks = law.update(&far, &AttitudeReference::default(), DT_S).numbers();
        assert!(
            (sticks.z + 0.05).abs() < 1e-12,
            "the sticks ask for a rate other than the limit: {sticks}"
        );
    }
    let command =
        law.update(&AttitudeState::default(), &AttitudeReference::default(), DT_S).numbers();
    assert!(command.amax() < 1e-12, "wound up to {command}");
}

/// E-18: near the target the rate is one from which the body can stop with the acceleration `a`,
/// `omega^2 = 2 a angle`.
#[test]
fn the_slew_rate_of_the_pid_is_one_it_can_stop_from() {
    let (acceleration, angle) = (0.5, 1e-3);
    let mut options = ControlOptions::default();
    (options.pid.gain, options.pid.max_acceleration_rad_s2) = (1e3, acceleration);
    let state = at_rest(Attitude::from_rotation_vector(Vector3::new(0.0, angle, 0.0)));
    let command = first_command(
        law(ControllerName::Pid, &options, sticks()),
        &state,
        &AttitudeReference::default(),
    );
    let omega = -2.0 * command.y;
    assert!((omega - (2.0 * acceleration * angle).sqrt()).abs() < 1e-6, "slews at {omega}");
}

/// Euler angles jump by a turn at 180 degrees; the body does not.
#[test]
fn the_classic_law_turns_the_short_way_round() {
    let yaw =
        |degrees: f64| Attitude::from_rotation_vector(Vector3::new(0.0, 0.0, degrees.to_radians()));
    let law = || law(ControllerName::Lqr, &ControlOptions::default(), sticks());
    let across = first_command(law(), &at_rest(yaw(179.0)), &resting(yaw(-179.0)));
    let plain = first_command(law(), &at_rest(yaw(0.0)), &resting(yaw(2.0)));
    assert!(across.z > 0.0 && (across - plain).amax() < 1e-9, "{across} instead of {plain}");
}

#[test]
fn a_scheduled_law_solves_nothing_before_its_first_step_and_others_nothing_at_all() {
    for name in INTEGRATING {
        let mut law = law(name, &ControlOptions::default(), sticks());
        assert_eq!(law.riccati_solves(), 0);
        law.update(&AttitudeState::default(), &AttitudeReference::default(), DT_S);
        assert_eq!(law.riccati_solves(), u32::from(SCHEDULED.contains(&name)));
    }
}

#[test]
fn options_without_meaning_are_refused_by_name() {
    type Set = fn(&mut ControlOptions, f64);
    let cases: [(&str, Set); 13] = [
        ("pid.gain", |o, v| o.pid.gain = v),
        ("pid.integral-time-s", |o, v| o.pid.integral_time_s = v),
        ("lqr.operating-pitch-limit-rad", |o, v| o.lqr.operating_pitch_limit_rad = v),
        ("lqr.rate-weight", |o, v| o.lqr.rate_weight = v),
        ("oqtal.attitude-weight", |o, v| o.oqtal.attitude_weight = v),
        ("oqtal.cell-eps", |o, v| o.oqtal.cell_eps = v),
        ("oqtal.eps-ddot-cutoff-hz", |o, v| o.oqtal.eps_ddot_cutoff_hz = v),
        ("oqtal-dt.rate-weight", |o, v| o.oqtal_dt.rate_weight = v),
        ("oqtal-dt.input-weight", |o, v| o.oqtal_dt.input_weight = v),
        ("geometric.attitude-gain", |o, v| o.geometric.attitude_gain = v),
        ("px4.attitude-gain-per-s", |o, v| o.px4.attitude_gain_per_s = v),
        ("px4.yaw-weight", |o, v| o.px4.yaw_weight = v),
        ("indi.cutoff-hz", |o, v| o.indi.cutoff_hz = v),
    ];
    for (key, set) in cases {
        for value in [-1.0, f64::NAN, f64::NEG_INFINITY] {
            let mut options = ControlOptions::default();
            set(&mut options, value);
            assert_eq!(options.check().unwrap_err().key, key);
        }
    }
    assert!(
        ControlOptions::default().check().is_ok() && ControlOptions::spacecraft().check().is_ok()
    );
    assert!(RateInput::new(Vector3::new(2.0, 0.0, 2.0)).is_err());
    assert!(TorqueInput::new(isotropic_inertia(), f64::INFINITY).is_err());
}

#[test]
fn options_are_written_in_kebab_case_and_unknown_ones_refused() {
    let text = r#"{"controller": "lqr", "oqtal": {"jacobian": "printed-45", "cells": "deadband", "resolve": "every-tick"},
                   "pid": {"rate": "omega-e", "max-rate-rad-s": 1.5}}"#;
    let options: ControlOptions = serde_json::from_str(text).unwrap();
    assert_eq!((options.controller, options.oqtal.cells), (ControllerName::Lqr, Cells::Deadband));
    assert_eq!((options.pid.rate, options.pid.max_rate_rad_s), (RateFeedback::OmegaE, 1.5));
    for text in
        [r#"{"pid": {"gian": 8.0}}"#, r#"{"oqtal": {"delta": 0.5}}"#, r#"{"controller": "lee"}"#]
    {
        assert!(serde_json::from_str::<ControlOptions>(text).is_err(), "{text} was accepted");
    }
}
