//! The laws in closed loop with a body, integrated by Runge-Kutta of fourth order at 1 kHz.

use nalgebra::{Quaternion, SVector, UnitQuaternion, Vector4};
use oqtal_control::euler::EulerAngles;
use oqtal_control::rigid_body::quaternion_rate;
use oqtal_control::schedule::Resolve;
use oqtal_control::tracking_error::AttitudeError;

use super::*;

const STEP_S: f64 = 1e-3;

/// `[q1 q2 q3 eta p q r]`.
type Motion = SVector<f64, 7>;

fn motion(state: &AttitudeState) -> Motion {
    Motion::from_iterator(state.attitude.xyzw().into_iter().chain(state.rate.0.iter().copied()))
}

fn state_of(motion: &Motion) -> AttitudeState {
    let q =
        UnitQuaternion::from_quaternion(Quaternion::from(Vector4::from(motion.fixed_rows::<4>(0))));
    AttitudeState {
        attitude: Attitude::from_unit_quaternion(q),
        rate: BodyRate(motion.fixed_rows::<3>(4).into()),
    }
}

/// One step of a body whose rate changes by `omega_dot` at each state.
pub(super) fn step(
    state: &AttitudeState,
    mut omega_dot: impl FnMut(&AttitudeState) -> Vector3<f64>,
) -> AttitudeState {
    let mut rate = |motion: Motion| {
        let state = state_of(&motion);
        let (q_dot, omega_dot) = (quaternion_rate(&state.attitude, state.rate), omega_dot(&state));
        Motion::from_iterator(q_dot.iter().chain(&omega_dot).copied())
    };
    let start = motion(state);
    let k1 = rate(start);
    let k2 = rate(start + STEP_S / 2.0 * k1);
    let k3 = rate(start + STEP_S / 2.0 * k2);
    let k4 = rate(start + STEP_S * k3);
    state_of(&(start + STEP_S / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)))
}

/// One step of a vehicle whose rate follows its sticks, Eq. (61), with a drift.
fn step_of_sticks(
    state: &AttitudeState,
    sticks: Vector3<f64>,
    drift: Vector3<f64>,
) -> AttitudeState {
    let rate = BodyRate(2.0 * sticks + drift);
    step(&AttitudeState { rate, ..*state }, |_| Vector3::zeros())
}

fn error(state: &AttitudeState, reference: &AttitudeReference) -> AttitudeError {
    AttitudeError::between(&reference.attitude, &state.attitude)
}

/// Steps the vehicle from `state` for 6 seconds and returns the value of `measure` for each state.
fn fly_sticks(
    mut law: Controller<RateInput>,
    mut state: AttitudeState,
    reference: &AttitudeReference,
    measure: impl Fn(&AttitudeState) -> f64,
) -> Vec<f64> {
    let mut measured = vec![measure(&state)];
    for _ in 0..6000 {
        let sticks = law.update(&state, reference, STEP_S).numbers();
        state = step_of_sticks(&state, sticks, Vector3::zeros());
        measured.push(measure(&state));
    }
    assert_eq!(law.failed_solves(), 0);
    measured
}

fn assert_falls_to_zero(measured: &[f64]) {
    for (tick, pair) in measured.windows(2).enumerate() {
        assert!(
            pair[1] < pair[0] || pair[1] < 1e-12,
            "{} after {} in step {tick}",
            pair[1],
            pair[0]
        );
    }
    assert!(measured[measured.len() - 1] < 1e-6, "ends at {}", measured[measured.len() - 1]);
}

fn far_turn() -> impl Strategy<Value = Vector3<f64>> {
    vector(170.0_f64.to_radians())
}

/// A target and an attitude `turn` away from it. The classic law converges from smaller turns only.
fn far_from(
    name: ControllerName,
    target: Attitude,
    turn: Vector3<f64>,
) -> (AttitudeReference, Attitude) {
    if name == ControllerName::Lqr {
        (resting(Attitude::LEVEL), Attitude::LEVEL.turned_by(turn / 4.0))
    } else {
        (resting(target), target.turned_by(turn))
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// The paper's claim (49) to (52), for the law and not for `omega_e = -eps`: in rate form the
    /// command and `eps` form an acute angle in every cell, so `2 (1 - lambda)` falls all the way.
    #[test]
    fn the_lyapunov_function_falls_in_rate_form(
        target in attitude(),
        turn in far_turn(),
    ) {
        let options = without_integral_action(ControlOptions::default());
        let reference = resting(target);
        let state = at_rest(target.turned_by(turn));
        for name in [ControllerName::Pid, ControllerName::Oqtal] {
            let law = law(name, &options, sticks());
            assert_falls_to_zero(&fly_sticks(law, state, &reference, |state| {
                error(state, &reference).lyapunov()
            }));
        }
    }

    /// The same for the classic law: the distance in Euler angles decreases if the model is that of the present
    /// attitude and no stick is saturated.
    #[test]
    fn the_distance_in_euler_angles_falls_under_the_classic_law(
        from in prop::array::uniform3(-1.0..1.0),
        to in prop::array::uniform3(-1.0..1.0),
    ) {
        let mut options = without_integral_action(ControlOptions::default());
        options.lqr.resolve = Resolve::EveryTick;
        options.lqr.attitude_weight = 0.05;
        let [theta, theta_d] = [from, to].map(Vector3::from);
        let [attitude, desired] = [theta, theta_d]
            .map(|angles| Attitude::from_xyzw(EulerAngles::from_vector(&angles).xyzw()).unwrap());
        let distance = |state: &AttitudeState| {
            (EulerAngles::from_attitude(&state.attitude).vector() - theta_d).norm()
        };
        let law = law(ControllerName::Lqr, &options, sticks());
        let distances = fly_sticks(law, at_rest(attitude), &resting(desired), distance);
        for pair in distances.windows(2) {
            assert!(
                pair[1] < pair[0] || pair[1] < 1e-9,
                "{} after {}",
                pair[1],
                pair[0]
            );
        }
    }

    /// With integral action, cells and limits every law comes to its reference. The error need not decrease
    /// monotonically until the integral has settled.
    #[test]
    fn every_law_reaches_its_reference_in_rate_form(
        target in attitude(),
        turn in far_turn(),
    ) {
        for name in ALL {
            let (reference, attitude) = far_from(name, target, turn);
            let state = at_rest(attitude);
            let law = law(name, &ControlOptions::default(), sticks());
            let measured = fly_sticks(law, state, &reference, |state| {
                error(state, &reference).lyapunov()
            });
            assert!(measured[6000] < 1e-3, "{name:?} ends at {}", measured[6000]);
        }
    }

    /// In torque form a body at rest must first gather speed, so it is the energy
    /// `sqrt(q/r) 2 (1 - lambda) + omega' J omega / 2` that falls: by `omega' K_omega omega`, since
    /// the law cancels the gyroscopic torque and its gain on `eps` is `sqrt(q/r)` times the
    /// identity for any inertia.
    #[test]
    fn the_energy_falls_under_oqtal_in_torque_form(
        target in attitude(),
        turn in far_turn(),
    ) {
        let (reference, inertia) = (resting(target), uneven_inertia());
        let options = with_cells(ControlOptions::spacecraft(), Cells::Truncated, 100.0);
        let mut law = law(
            ControllerName::Oqtal,
            &options,
            TorqueInput::new(inertia, 1e6).unwrap(),
        );
        let energy = |state: &AttitudeState| {
            let omega = state.rate.0;
            16.0 * error(state, &reference).lyapunov()
                + (omega.dot(&(inertia.matrix() * omega))) / 2.0
        };
        let mut state = at_rest(target.turned_by(turn));
        for _ in 0..3000 {
            let before = energy(&state);
            state = step(&state, |state| {
                inertia
                    .acceleration(state.rate, law.update(state, &reference, STEP_S))
                    .0
            });
            assert!(
                energy(&state) <= before + 1e-12,
                "{} after {before}",
                energy(&state)
            );
        }
        assert_eq!(law.riccati_solves(), 1);
    }

    #[test]
    fn every_law_reaches_its_reference_in_torque_form(
        target in attitude(),
        turn in far_turn(),
        spin in vector(0.5),
    ) {
        let mut options = ControlOptions::spacecraft();
        (options.pid.gain, options.pid.rate_gain_per_s) = (4.0, 6.0);
        options.pid.integral_time_s = 4.0;
        let input = TorqueInput::new(uneven_inertia(), MAX_TORQUE).unwrap();
        // At a thousand steps a second programs take most of the time; `mpc` has a test of its own at the rate of a loop.
        for name in ALL.into_iter().filter(|name| *name != ControllerName::Mpc) {
            let (reference, attitude) = far_from(name, target, turn);
            let mut state = AttitudeState {
                attitude,
                rate: BodyRate(spin),
            };
            let mut law = law(name, &options, input);
            for _ in 0..15_000 {
                let torque = law.update(&state, &reference, STEP_S);
                state = step(&state, |state| {
                    uneven_inertia().acceleration(state.rate, torque).0
                });
            }
            let (left, failed) = (error(&state, &reference).lyapunov(), law.failed_solves());
            assert!(
                left < 1e-3 && failed == 0,
                "{name:?} ends at {left}, {failed} failures"
            );
        }
    }

    /// Without error only the torque of the motion itself is commanded.
    #[test]
    fn without_error_only_the_gyroscopic_torque_is_commanded(reference in reference()) {
        let state = AttitudeState {
            attitude: reference.attitude,
            rate: reference.rate,
        };
        for name in INTEGRATING {
            let command = first_command(
                law(
                    name,
                    &with_rate_error(ControlOptions::default()),
                    sticks(),
                ),
                &state,
                &reference,
            );
            assert!(command.amax() < 1e-12, "{name:?} commands {command}");
            let input = TorqueInput::new(uneven_inertia(), MAX_TORQUE).unwrap();
            let command = first_command(
                law(
                    name,
                    &with_rate_error(ControlOptions::spacecraft()),
                    input,
                ),
                &state,
                &reference,
            );
            let cancels = [ControllerName::Oqtal, ControllerName::Geometric].contains(&name);
            let cancels = f64::from(u8::from(cancels));
            let expected = cancels * uneven_inertia().gyroscopic_torque(state.rate).0;
            assert!(
                (command - expected).amax() < 1e-12,
                "{name:?} commands {command}"
            );
        }
    }

    /// Fed forward, the reference's motion is followed without any error to correct.
    #[test]
    fn with_feed_forward_a_reference_is_followed_without_error(reference in reference()) {
        let mut options = ControlOptions::default();
        options.oqtal.feed_forward = true;
        let state = AttitudeState {
            attitude: reference.attitude,
            rate: reference.rate,
        };
        let input = TorqueInput::new(uneven_inertia(), 1e6).unwrap();
        for name in [ControllerName::Oqtal, ControllerName::OqtalDt, ControllerName::Geometric] {
            let torque = law(name, &options, input).update(&state, &reference, DT_S);
            let omega_dot = uneven_inertia().acceleration(state.rate, torque);
            assert!((omega_dot.0 - reference.acceleration.0).amax() < 1e-9, "{name:?}");
        }

        let slow = AttitudeReference {
            rate: BodyRate(0.5 * reference.rate.0),
            ..reference
        };
        for name in INTEGRATING {
            let mut options = options;
            (options.pid.feed_forward, options.lqr.feed_forward) = (true, true);
            let command = first_command(
                law(name, &options, sticks()),
                &at_rest(slow.attitude),
                &slow,
            );
            assert!(
                (2.0 * command - slow.rate.0).amax() < 1e-12,
                "{name:?} commands {command}"
            );
        }
    }
}

/// The integral learns the drift of the rotors; without it a steady error stays.
#[test]
fn integral_action_removes_a_steady_disturbance() {
    let drift = Vector3::new(0.035, -0.026, 0.017);
    for name in INTEGRATING {
        let left = |options: &ControlOptions| {
            let mut law = law(name, options, sticks());
            let mut state = AttitudeState::default();
            for _ in 0..60_000 {
                let sticks = law.update(&state, &AttitudeReference::default(), STEP_S).numbers();
                state = step_of_sticks(&state, sticks, drift);
            }
            error(&state, &AttitudeReference::default()).eps().norm()
        };
        let with = left(&ControlOptions::default());
        let without = left(&without_integral_action(ControlOptions::default()));
        assert!(
            without > 1e-3 && with < 1e-2 * without,
            "{name:?}: {with} with, {without} without"
        );
    }
}
