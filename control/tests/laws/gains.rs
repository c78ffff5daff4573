//! Values and properties of the gains.

use nalgebra::{SMatrix, SVector};
use oqtal_control::controller::{
    AugmentedModel, ClassicLqr, Gain, LqrOptions, Oqtal, OqtalOptions,
};
use oqtal_control::error_model::{ErrorModel, Jacobian, OperatingPoint};

use super::*;

const JACOBIANS: [Jacobian; 5] = [
    Jacobian::Decoupled,
    Jacobian::Printed45,
    Jacobian::Printed75,
    Jacobian::ExactConstantLambda,
    Jacobian::Exact,
];

type Point = SVector<f64, 6>;

/// The rate and the attitude that select a gain.
fn point(rate: Vector3<f64>, attitude: Vector3<f64>) -> Point {
    Point::from_iterator(rate.iter().chain(&attitude).copied())
}

/// The 3 by 3 block of a gain that multiplies the rate (0), the attitude (1) or the integral (2).
fn block(gain: &Gain, which: usize) -> Matrix3<f64> {
    gain.fixed_view::<3, 3>(0, 3 * which).into_owned()
}

fn assert_scaled_identity(block: &Matrix3<f64>, scale: f64) {
    let difference = (block - Matrix3::from_diagonal_element(scale)).amax();
    assert!(difference <= 1e-9 * scale, "{block} is not {scale} times the identity");
}

/// The largest real part among the poles of the closed loop of the `N` states from `first` on.
fn slowest_pole<const N: usize>(model: &AugmentedModel, gain: &Gain, first: usize) -> f64
where
    nalgebra::Const<N>: nalgebra::DimSub<nalgebra::U1>,
    nalgebra::DefaultAllocator: nalgebra::allocator::Allocator<
            nalgebra::Const<N>,
            nalgebra::DimDiff<nalgebra::Const<N>, nalgebra::U1>,
        > + nalgebra::allocator::Allocator<nalgebra::DimDiff<nalgebra::Const<N>, nalgebra::U1>>,
{
    let closed: SMatrix<f64, N, N> =
        (model.a - model.b * gain).fixed_view::<N, N>(first, first).into_owned();
    // Without a bound on its iterations, and with the least tolerance, it need not end.
    let schur = closed.try_schur(1e-12, 10_000).expect("the iteration converges");
    schur.complex_eigenvalues().iter().map(|pole| pole.re).fold(f64::MIN, f64::max)
}

fn check_stable<I: Form>(model: &AugmentedModel, gain: &Gain, input: I, integral_action: bool) {
    let pole = match (input.inertia().is_some(), integral_action) {
        (true, true) => slowest_pole::<9>(model, gain, 0),
        (true, false) => slowest_pole::<6>(model, gain, 0),
        (false, true) => slowest_pole::<6>(model, gain, 3),
        (false, false) => slowest_pole::<3>(model, gain, 3),
    };
    assert!(pole < 0.0, "a pole at {pole}");
}

fn check_oqtal_stable<I: Form>(
    input: I,
    options: &OqtalOptions,
    rate: Vector3<f64>,
    eps: Vector3<f64>,
) {
    for jacobian in JACOBIANS {
        for integral_weight in [0.0, 0.01] {
            let options = OqtalOptions { jacobian, integral_weight, ..*options };
            let gain = Oqtal::gain_at(&options, &input, &point(rate, eps)).unwrap();
            let a = ErrorModel::at(jacobian, &OperatingPoint::new(eps, rate)).state_matrix();
            check_stable(&AugmentedModel::new(&a, &input), &gain, input, integral_weight > 0.0);
        }
    }
}

fn check_lqr_stable<I: Form>(
    input: I,
    options: &LqrOptions,
    rate: Vector3<f64>,
    theta: Vector3<f64>,
) {
    for integral_weight in [0.0, 0.01] {
        let options = LqrOptions { integral_weight, ..*options };
        let gain = ClassicLqr::gain_at(&options, &input, &point(rate, theta)).unwrap();
        let a = ClassicLqr::state_matrix(&options, &input, &point(rate, theta));
        check_stable(&AugmentedModel::new(&a, &input), &gain, input, integral_weight > 0.0);
    }
}

proptest! {
    /// Corners of cells are included; their norm may exceed that of any error.
    #[test]
    fn every_gain_of_oqtal_gives_a_stable_loop(
        rate in vector(3.0),
        eps in vector(1.5),
    ) {
        check_oqtal_stable(sticks(), &OqtalOptions::default(), Vector3::zeros(), eps);
        check_oqtal_stable(spacecraft(), &OqtalOptions::spacecraft(), rate, eps);
        let uneven = TorqueInput::new(uneven_inertia(), MAX_TORQUE).unwrap();
        check_oqtal_stable(uneven, &OqtalOptions::spacecraft(), rate, eps);
    }

    #[test]
    fn every_gain_of_the_classic_law_gives_a_stable_loop(
        rate in vector(3.0),
        theta in prop::array::uniform3(-3.2..3.2),
    ) {
        let theta = Vector3::from(theta);
        check_lqr_stable(sticks(), &LqrOptions::default(), rate, theta);
        check_lqr_stable(spacecraft(), &LqrOptions::spacecraft(), rate, theta);
        let uneven = TorqueInput::new(uneven_inertia(), MAX_TORQUE).unwrap();
        check_lqr_stable(uneven, &LqrOptions::spacecraft(), rate, theta);
    }

    /// Two double integrators about each axis: `K_eps = sqrt(q/r)`,
    /// `K_omega = sqrt(q/r + J K_eps)`.
    #[test]
    fn without_error_oqtal_is_a_double_integrator_regulator(
        q in 1.0..1e4_f64,
        r in 0.01..100.0_f64,
        j in 0.01..10.0_f64,
    ) {
        let inertia = Inertia::new(Matrix3::from_diagonal_element(j)).unwrap();
        let input = TorqueInput::new(inertia, MAX_TORQUE).unwrap();
        let options = OqtalOptions {
            attitude_weight: q,
            rate_weight: q,
            input_weight: r,
            ..OqtalOptions::spacecraft()
        };
        for jacobian in JACOBIANS {
            let gain = Oqtal::gain_at(
                &OqtalOptions {
                    jacobian,
                    ..options
                },
                &input,
                &Point::zeros(),
            )
            .unwrap();
            let k_eps = (q / r).sqrt();
            assert_scaled_identity(&block(&gain, 1), k_eps);
            assert_scaled_identity(&block(&gain, 0), (q / r + j * k_eps).sqrt());
            assert_eq!(block(&gain, 2), Matrix3::zeros());
        }
    }
}

/// Table IV: gains 16 and 16.248, poles at -32 and -0.5 rad/s.
#[test]
fn the_gravity_turn_regulator_has_the_known_gains_and_slow_pole() {
    let gain = Oqtal::gain_at(&OqtalOptions::spacecraft(), &spacecraft(), &Point::zeros()).unwrap();
    assert_scaled_identity(&block(&gain, 1), 16.0);
    assert_scaled_identity(&block(&gain, 0), 264.0_f64.sqrt());
    let a = ErrorModel::at(
        Jacobian::Decoupled,
        &OperatingPoint::new(Vector3::zeros(), Vector3::zeros()),
    )
    .state_matrix();
    let pole = slowest_pole::<6>(&AugmentedModel::new(&a, &spacecraft()), &gain, 0);
    assert!((pole + 0.5).abs() < 1e-3, "slow pole at {pole}");
}

#[test]
fn in_rate_form_the_rate_is_nullified_and_every_jacobian_the_same() {
    let at = point(Vector3::zeros(), Vector3::new(0.5, -0.5, 0.0));
    let gain = |jacobian| {
        Oqtal::gain_at(&OqtalOptions { jacobian, ..OqtalOptions::default() }, &sticks(), &at)
            .unwrap()
    };
    for jacobian in JACOBIANS {
        assert_eq!(block(&gain(jacobian), 0), Matrix3::zeros());
        assert_eq!(gain(jacobian), gain(Jacobian::Decoupled));
    }
}

/// `eps` is half an angle, so four times the weight has the same effect.
#[test]
fn near_level_the_classic_law_is_oqtal_with_four_times_the_weight() {
    let classic = LqrOptions::default();
    let q = 4.0 * classic.attitude_weight;
    let oqtal = OqtalOptions { attitude_weight: q, ..OqtalOptions::default() };
    let classic = ClassicLqr::gain_at(&classic, &sticks(), &Point::zeros()).unwrap();
    let oqtal = Oqtal::gain_at(&oqtal, &sticks(), &Point::zeros()).unwrap();
    // Theta = 2 eps: K_Theta Theta = K_eps eps.
    assert!((2.0 * classic - oqtal).amax() < 1e-9);

    let classic = LqrOptions::spacecraft();
    let oqtal = OqtalOptions {
        attitude_weight: 4.0 * classic.attitude_weight,
        rate_weight: classic.rate_weight,
        ..OqtalOptions::spacecraft()
    };
    let classic = ClassicLqr::gain_at(&classic, &spacecraft(), &Point::zeros()).unwrap();
    let oqtal = Oqtal::gain_at(&oqtal, &spacecraft(), &Point::zeros()).unwrap();
    assert!((2.0 * block(&classic, 1) - block(&oqtal, 1)).amax() < 1e-9);
    assert!((block(&classic, 0) - block(&oqtal, 0)).amax() < 1e-9);
}

proptest! {
    /// Near its reference, without integral action, OQTAL is a PD law with gains from a Riccati equation.
    #[test]
    fn near_its_reference_oqtal_is_the_pid_with_its_gains(
        state in state(),
        turn in vector(0.2),
        rate_error in vector(0.1),
    ) {
        let reference = AttitudeReference {
            attitude: state.attitude.turned_by(turn),
            ..AttitudeReference::default()
        };
        let mut options = without_integral_action(with_rate_error(ControlOptions::default()));
        // 2 k / K_delta = sqrt(q / r)
        options.pid.gain = options.oqtal.attitude_weight.sqrt();
        let state = AttitudeState {
            rate: BodyRate(rate_error),
            ..state
        };
        let [pid, oqtal] =
            [ControllerName::Pid, ControllerName::Oqtal].map(|name| first_command(law(name, &options, sticks()), &state, &reference));
        assert!((pid - oqtal).amax() < 1e-9);

        let mut options = without_integral_action(with_rate_error(ControlOptions::spacecraft()));
        // 2 k J = K_eps, c J = K_omega; an isotropic body has no gyroscopic torque
        (options.pid.gain, options.pid.rate_gain_per_s) = (16.0, 264.0_f64.sqrt() / 0.5);
        let [pid, oqtal] =
            [ControllerName::Pid, ControllerName::Oqtal].map(|name| first_command(law(name, &options, spacecraft()), &state, &reference));
        assert!((pid - oqtal).amax() < 1e-9);
    }
}

/// As printed, Eqs. (17) and (24) brake a body that follows a turning reference without error;
/// OQTAL does not.
#[test]
fn as_printed_the_rivals_brake_a_body_that_turns_with_its_reference() {
    let omega = BodyRate(Vector3::new(0.1, 0.0, 0.0));
    let state = AttitudeState { rate: omega, ..AttitudeState::default() };
    let reference = AttitudeReference { rate: omega, ..AttitudeReference::default() };
    let options = ControlOptions::spacecraft();
    let [pid, lqr, oqtal, _] = INTEGRATING
        .map(|name| first_command(law(name, &options, spacecraft()), &state, &reference).x);
    assert!((pid + 0.5 * options.pid.rate_gain_per_s * 0.1).abs() < 1e-12);
    let gain = ClassicLqr::gain_at(&options.lqr, &spacecraft(), &Point::zeros()).unwrap();
    assert!((lqr + block(&gain, 0)[(0, 0)] * 0.1).abs() < 1e-12);
    assert_eq!(oqtal, 0.0);
}

/// Centred cells of 0.2 rad put a pitch of 90 degrees in the cell of 1.6 rad, where the yaw of the
/// model turns the wrong way.
#[test]
fn the_pitch_limit_keeps_the_classic_model_from_turning_the_wrong_way() {
    let at = point(Vector3::zeros(), Vector3::new(0.0, 1.6, 0.0));
    let yaw_of_r = |limit| {
        let options = LqrOptions { operating_pitch_limit_rad: limit, ..LqrOptions::spacecraft() };
        ClassicLqr::state_matrix(&options, &spacecraft(), &at)[(5, 2)]
    };
    assert!(yaw_of_r(3.0) < 0.0 && yaw_of_r(LqrOptions::default().operating_pitch_limit_rad) > 0.0);
}

proptest! {
    /// E-25: a body at rest at any set-point stays there without input, so `N_x = [0; I]` and
    /// `N_u = 0`.
    #[test]
    fn every_set_point_is_an_equilibrium_of_the_classic_model(
        rate in vector(3.0),
        theta in prop::array::uniform3(-1.4..1.4),
    ) {
        let a = ClassicLqr::state_matrix(
            &LqrOptions::spacecraft(),
            &spacecraft(),
            &point(rate, Vector3::from(theta)),
        );
        let at_set_point = SMatrix::<f64, 6, 3>::from_fn(|i, j| f64::from(i == j + 3));
        assert_eq!(a * at_set_point, SMatrix::<f64, 6, 3>::zeros());
    }
}
