//! Number and times of gain computations.

use oqtal_control::controller::EpsDdot;
use oqtal_control::error_model::Jacobian;
use oqtal_control::schedule::Resolve;

use super::*;

/// A body that swings about level by 0.2 rad with noise on its measured attitude.
fn solves_while_rocking(name: ControllerName, cells: Cells) -> u32 {
    let mut law = law(name, &with_cells(ControlOptions::default(), cells, 0.5), sticks());
    for tick in 0..600 {
        let t = f64::from(tick) * DT_S;
        let rocking = Vector3::new(t.sin(), (1.3 * t).sin(), (0.7 * t).sin()) * 0.2;
        let trembling = Vector3::new((91.0 * t).sin(), (83.0 * t).sin(), (97.0 * t).sin()) * 0.004;
        let state = at_rest(Attitude::from_rotation_vector(rocking + trembling));
        let reference = resting(Attitude::from_rotation_vector(rocking));
        law.update(&state, &reference, DT_S);
    }
    assert_eq!(law.failed_solves(), 0);
    law.riccati_solves()
}

#[test]
fn tracking_closely_oqtal_solves_once_unless_cells_have_a_border_at_zero() {
    for cells in [Cells::Centred, Cells::Truncated, Cells::Deadband] {
        assert_eq!(solves_while_rocking(ControllerName::Oqtal, cells), 1, "{cells:?}");
    }
    assert!(solves_while_rocking(ControllerName::Oqtal, Cells::Floor) > 100);
}

#[test]
fn the_classic_law_solves_more_often_the_further_the_body_turns() {
    let solves = |name, turn: f64| {
        let mut law = law(name, &ControlOptions::default(), sticks());
        for tick in 0..100 {
            let attitude = Attitude::from_rotation_vector(Vector3::new(
                turn * f64::from(tick) / 100.0,
                0.0,
                0.0,
            ));
            law.update(&at_rest(attitude), &resting(attitude), DT_S);
        }
        law.riccati_solves()
    };
    assert_eq!(solves(ControllerName::Lqr, 0.4), 1);
    assert_eq!(solves(ControllerName::Lqr, 1.4), 3);
    assert_eq!(solves(ControllerName::Oqtal, 1.4), 1);
}

/// The rate is not a state of the model in rate form: neither error nor noise in it may select a gain.
#[test]
fn in_rate_form_the_rate_does_not_affect_when_oqtal_solves() {
    let mut law = law(ControllerName::Oqtal, &ControlOptions::default(), sticks());
    for tick in 0..10 {
        let rate = BodyRate(Vector3::repeat(f64::from(tick)));
        law.update(
            &AttitudeState { rate, ..AttitudeState::default() },
            &AttitudeReference::default(),
            DT_S,
        );
    }
    assert_eq!(law.riccati_solves(), 1);
}

/// With this rule the number of solutions is near that of Table V.
#[test]
fn the_rate_affects_when_the_classic_law_solves() {
    let mut law = law(ControllerName::Lqr, &ControlOptions::default(), sticks());
    for p in [0.0, 0.4, 0.6, 1.1] {
        let rate = BodyRate(Vector3::new(p, 0.0, 0.0));
        law.update(
            &AttitudeState { rate, ..AttitudeState::default() },
            &AttitudeReference::default(),
            DT_S,
        );
    }
    assert_eq!(law.riccati_solves(), 3);
}

#[test]
fn every_tick_is_a_solution_in_every_step() {
    let mut options = ControlOptions::default();
    options.lqr.resolve = Resolve::EveryTick;
    options.oqtal.resolve = Resolve::EveryTick;
    for name in SCHEDULED {
        let mut law = law(name, &options, sticks());
        for _ in 0..10 {
            law.update(&AttitudeState::default(), &AttitudeReference::default(), DT_S);
        }
        assert_eq!(law.riccati_solves(), 10);
    }
}

/// Section VII.C: the second derivative consists of noise, which moves the gain from cell to cell.
#[test]
fn the_second_derivative_of_eps_makes_noise_solve_and_a_filter_less() {
    let solves = |jacobian, eps_ddot| {
        let mut options = ControlOptions::spacecraft();
        (options.oqtal.jacobian, options.oqtal.eps_ddot) = (jacobian, eps_ddot);
        let mut law = law(ControllerName::Oqtal, &options, spacecraft());
        for tick in 0..600 {
            let t = f64::from(tick) * DT_S;
            let trembling = Vector3::new((91.0 * t).sin(), (83.0 * t).sin(), (97.0 * t).sin());
            let rate = BodyRate(trembling * 0.02);
            let state = AttitudeState { rate, ..at_rest(Attitude::LEVEL) };
            law.update(&state, &AttitudeReference::default(), DT_S);
        }
        law.riccati_solves()
    };
    let [dropped, filtered, differenced] =
        [EpsDdot::Dropped, EpsDdot::Filtered, EpsDdot::Differenced]
            .map(|eps_ddot| solves(Jacobian::Exact, eps_ddot));
    assert_eq!(dropped, 1);
    assert!(filtered < differenced / 2, "{filtered} with a filter, {differenced} without");
    assert!(differenced > 100, "{differenced}");
}

#[test]
fn a_new_flight_does_not_use_the_second_derivative_of_the_last() {
    let mut options = ControlOptions::spacecraft();
    (options.oqtal.jacobian, options.oqtal.eps_ddot) = (Jacobian::Exact, EpsDdot::Differenced);
    let fresh = law(ControllerName::Oqtal, &options, spacecraft());
    let moving = AttitudeState { rate: BodyRate(Vector3::x()), ..AttitudeState::default() };
    let mut used = fresh;
    used.update(&moving, &AttitudeReference::default(), DT_S);
    used.update(&AttitudeState::default(), &AttitudeReference::default(), DT_S);
    used.reset();
    let turned = at_rest(Attitude::from_rotation_vector(Vector3::new(0.1, -0.2, 0.3)));
    let command = used.update(&turned, &AttitudeReference::default(), DT_S).numbers();
    assert_eq!(command, first_command(fresh, &turned, &AttitudeReference::default()));
}
