//! The geometric law, against its own formulas in rotation matrices.

use oqtal_control::controller::GeometricOptions;

use super::*;

fn matrix(attitude: &Attitude) -> Matrix3<f64> {
    attitude.unit_quaternion().to_rotation_matrix().into_inner()
}

/// `x` of the skew matrix `x^`.
fn vee(skew: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(skew[(2, 1)], skew[(0, 2)], skew[(1, 0)])
}

proptest! {
    #[test]
    fn the_law_is_that_of_its_source(state in state(), reference in reference()) {
        let inertia = uneven_inertia();
        let input = TorqueInput::new(inertia, 1e6).unwrap();
        let options = ControlOptions::spacecraft();
        let command =
            first_command(law(ControllerName::Geometric, &options, input), &state, &reference);

        let GeometricOptions { attitude_gain, rate_gain_per_s, .. } = options.geometric;
        let (r, r_d) = (matrix(&state.attitude), matrix(&reference.attitude));
        let (omega, omega_d) = (state.rate.0, reference.rate.0);
        let c = r.transpose() * r_d;
        let e_r = vee(&(r_d.transpose() * r - r.transpose() * r_d)) / 2.0;
        let e_omega = omega - c * omega_d;
        let j = inertia.matrix();
        let expected = -(j * (attitude_gain * e_r + rate_gain_per_s * e_omega))
            + omega.cross(&(j * omega))
            - j * (omega.cross_matrix() * c * omega_d - c * reference.acceleration.0);
        prop_assert!((command - expected).amax() < 1e-9 * (1.0 + expected.amax()));
    }

    /// The attitude error of the source, `2 lambda eps` elsewhere in this crate.
    #[test]
    fn the_feedback_fades_towards_half_a_turn(axis in vector(1.0)) {
        prop_assume!(axis.norm() > 1e-3);
        let pull = |degrees: f64| {
            let turn = axis.normalize() * degrees.to_radians();
            let law = law(ControllerName::Geometric, &ControlOptions::spacecraft(), spacecraft());
            let level = AttitudeReference::default();
            first_command(law, &at_rest(Attitude::from_rotation_vector(turn)), &level).norm()
        };
        prop_assert!((pull(175.0) - pull(5.0)).abs() < 1e-9);
    }
}

/// A command is held for a period while the rate follows it: on a reference that accelerates, it must be ahead by so much that the
/// rate grows as that of the reference does. The lag is the configured one, or one that was told in flight.
#[test]
fn the_feed_forward_inverts_the_lag_of_the_rate() {
    let (configured_s, told_s) = (0.05, 0.1);
    let acceleration = Vector3::new(1.5, -1.0, 0.5);
    let reference = AttitudeReference {
        rate: BodyRate(Vector3::new(0.3, -0.2, 0.1)),
        acceleration: AngularAcceleration(acceleration),
        ..AttitudeReference::default()
    };
    let state = AttitudeState { rate: reference.rate, ..AttitudeState::default() };
    let input = sticks().with_lag(configured_s, DT_S).unwrap();
    let mut law = law(ControllerName::Geometric, &ControlOptions::default(), input);
    for lag_s in [configured_s, told_s] {
        law.set_rate_lag(lag_s, DT_S);
        law.reset();
        let aim = law.update(&state, &reference, DT_S).numbers() * 2.0;
        let grown = (aim - state.rate.0) * -(-DT_S / lag_s).exp_m1();
        assert!((grown - acceleration * DT_S).amax() < 1e-9, "{lag_s} s: {grown}");
    }
}
