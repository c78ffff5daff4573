//! The filters are optimal for their model.

use nalgebra::{Matrix1, Matrix3};
use oqtal_control::predictive::{
    AttitudeFilter, Covariance, FilterOptions, Motion, PositionFilter, StateTransition,
};
use oqtal_control::quaternion::Attitude;
use oqtal_control::riccati::dare;

use super::noise::Noise;
use super::*;

/// Limit of the external acceleration \[m/s^2\].
const BIAS_LIMIT: Vector3<f64> = Vector3::new(3.0, 3.0, 3.0);

/// Options with walks so small that no bias reaches its limit in a test.
fn options() -> FilterOptions {
    FilterOptions { acceleration_walk_m_s2: 0.1, ..FilterOptions::default() }
}

/// The covariance before a measurement, after many of them.
fn settled(transition: &StateTransition, sd: f64) -> Matrix3<f64> {
    let mut covariance = Covariance::of([sd, 1.0, 1.0]);
    for _ in 0..20_000 {
        covariance.correct(sd);
        covariance.predict(transition);
    }
    covariance.0
}

/// Estimation is the dual of control: the filter's covariance settles at the solution of the Riccati
/// equation of the transposed system.
fn check_dual(transition: &StateTransition, sd: f64) {
    let StateTransition { f, q } = transition;
    let r = Matrix1::new(sd * sd);
    // In units in which the noise of the measurement is one, for the sake of conditioning.
    let dual = dare(&f.transpose(), &Vector3::x(), &(q / r[0]), &Matrix1::new(1.0)).unwrap();
    let settled = settled(transition, sd) / r[0];
    let error = (settled - dual.p).amax() / dual.p.amax();
    assert!(error < 1e-8, "{settled} instead of {}", dual.p);
}

#[test]
fn the_covariances_converge_to_the_solution_of_our_riccati_solver() {
    let options = options();
    let (gain_per_s, greatest_rate) = (5.0, Vector3::repeat(AUTHORITY));
    let attitude_loop = Rotation::AttitudeLoop { gain_per_s, greatest_rate, lag_s: LAG_S };
    for rotation in [quadrotor().rotation, attitude_loop] {
        let attitude = AttitudeFilter::new(&options).transition(&rotation, PERIOD_S);
        check_dual(&attitude, options.attitude_noise_deg.to_radians());
    }
    let position = PositionFilter::new(&options, BIAS_LIMIT).transition(0.25, PERIOD_S);
    check_dual(&position, options.position_noise_mm * 1e-3);
}

/// Mean square of the innovations over their expected variance, and their correlation from one to
/// the next: 1 and 0 for an optimal filter.
fn statistics(innovations: &[Vector3<f64>], variance: f64) -> (f64, f64) {
    let n = 3.0 * innovations.len() as f64;
    let square = innovations.iter().map(Vector3::norm_squared).sum::<f64>() / n;
    let product = innovations.windows(2).map(|pair| pair[0].dot(&pair[1])).sum::<f64>() / n;
    (square / variance, product / square)
}

fn assert_white(innovations: &[Vector3<f64>], variance: f64) {
    let (size, correlation) = statistics(&innovations[200..], variance);
    assert!((size - 1.0).abs() < 0.05, "the innovations are {size} times what is expected");
    assert!(correlation.abs() < 0.03, "they are correlated by {correlation}");
}

#[test]
fn innovations_of_the_position_filter_are_white_and_of_the_size_it_expects() {
    let options = options();
    let mut filter = PositionFilter::new(&options, BIAS_LIMIT);
    let mut noise = Noise(1);
    let (h, sd) = (PERIOD_S, options.position_noise_mm * 1e-3);
    let (mut truth, mut bias) = (Motion::default(), Vector3::zeros());
    let mut estimate = Motion::default();
    let (mut innovations, mut errors) = (Vec::new(), Vec::new());
    for _ in 0..3000 {
        for (motion, bias) in [(&mut truth, &bias), (&mut estimate, filter.axis.bias())] {
            motion.position += motion.velocity * h + bias * (h * h / 2.0);
            motion.velocity += bias * h - motion.velocity * (0.25 * h);
        }
        // Noise of the velocity within the step also moves the position: correlated by 3/4.
        let kick = noise.vector() * (options.velocity_walk_m_s * h.sqrt());
        let more = noise.vector() * (options.velocity_walk_m_s * h.sqrt() / 12.0_f64.sqrt());
        truth.velocity += kick;
        truth.position += (kick / 2.0 + more) * h;
        bias += noise.vector() * (options.acceleration_walk_m_s2 * h.sqrt());
        filter.axis.predict(&filter.transition(0.25, h));
        let measured = truth.position + noise.vector() * sd;
        let innovation = measured - estimate.position;
        filter.correct(&mut estimate, &innovation, sd);
        innovations.push(innovation);
        let off = [truth.position - estimate.position, truth.velocity - estimate.velocity];
        errors.push(squares(
            &filter.axis.covariance().0,
            &[off[0], off[1], bias - filter.axis.bias()],
        ));
    }
    let transition = PositionFilter::new(&options, BIAS_LIMIT).transition(0.25, h);
    assert_white(&innovations, settled(&transition, sd)[(0, 0)] + sd * sd);
    assert_consistent(&errors);
}

/// Squares of the error of an axis over its covariance (normalised estimation error squared), mean of the axes: 3 in the mean.
fn squares(covariance: &Matrix3<f64>, errors: &[Vector3<f64>; 3]) -> f64 {
    let inverse = covariance.try_inverse().expect("a covariance");
    let of_axis = |axis: usize| {
        let error = Vector3::from_fn(|state, _| errors[state][axis]);
        error.dot(&(inverse * error))
    };
    (0..3).map(of_axis).sum::<f64>() / 3.0
}

/// The errors are as large as the filter says. They are correlated over some tenths of a second, which leaves some hundred
/// independent ones.
fn assert_consistent(squares: &[f64]) {
    let mean = squares[200..].iter().sum::<f64>() / (squares.len() - 200) as f64;
    assert!((2.5..3.5).contains(&mean), "squares of the errors over their variance: {mean}");
}

#[test]
fn innovations_of_the_attitude_filter_are_white_and_of_the_size_it_expects() {
    let options = options();
    let model = quadrotor();
    let mut filter = AttitudeFilter::new(&options);
    let mut noise = Noise(2);
    let (h, sd) = (PERIOD_S, options.attitude_noise_deg.to_radians());
    let decay = (-h / LAG_S).exp();
    let turn = LAG_S * (1.0 - decay);
    let (mut truth, mut drift) = (Motion::default(), Vector3::zeros());
    let mut estimate = Motion::default();
    let (mut innovations, mut errors) = (Vec::new(), Vec::new());
    for _ in 0..3000 {
        for (motion, drift) in [(&mut truth, &drift), (&mut estimate, filter.axis.bias())] {
            let angle = motion.rate * turn + drift * (h - turn);
            motion.attitude = motion.attitude.turned_by(angle);
            motion.rate = motion.rate * decay + drift * (1.0 - decay);
        }
        let kick = noise.vector() * (options.rate_walk_rad_s * h.sqrt());
        let more = noise.vector() * (options.rate_walk_rad_s * h.sqrt() / 12.0_f64.sqrt());
        truth.rate += kick;
        truth.attitude = truth.attitude.turned_by((kick / 2.0 + more) * h);
        drift += noise.vector() * (options.demand_bias_walk * h.sqrt());
        filter.axis.predict(&filter.transition(&model.rotation, h));
        let measured = truth.attitude.turned_by(noise.vector() * sd);
        let innovation = estimate.attitude.rotation_to(&measured);
        filter.correct(&mut estimate, &innovation, sd);
        innovations.push(innovation);
        let turn = estimate.attitude.rotation_to(&truth.attitude);
        let off = [turn, truth.rate - estimate.rate, drift - filter.axis.bias()];
        errors.push(squares(&filter.axis.covariance().0, &off));
    }
    let transition = AttitudeFilter::new(&options).transition(&model.rotation, h);
    assert_white(&innovations, settled(&transition, sd)[(0, 0)] + sd * sd);
    assert_consistent(&errors);
}

proptest! {
    #[test]
    fn a_covariance_stays_symmetric_and_positive_for_any_spacing_of_the_poses(
        spacing_s in prop::collection::vec(1e-4..0.5_f64, 1..200),
    ) {
        let options = options();
        let mut filter = AttitudeFilter::new(&options);
        let mut motion = Motion::default();
        for dt_s in spacing_s {
            filter.axis.predict(&filter.transition(&quadrotor().rotation, dt_s));
            let innovation = motion.attitude.rotation_to(&Attitude::LEVEL);
            filter.correct(&mut motion, &innovation, filter.axis.noise());
            let p = filter.axis.covariance().0;
            prop_assert!((p - p.transpose()).amax() <= 1e-12 * p.amax());
            prop_assert!(p.symmetric_eigenvalues().min() > -1e-12 * p.amax());
        }
    }

    /// The sign of the measured quaternion has no effect.
    #[test]
    fn the_sign_of_a_measured_quaternion_does_not_matter(turn in vector(0.5), estimate in vector(3.0)) {
        let measured = Attitude::from_rotation_vector(turn);
        let q = measured.unit_quaternion().quaternion();
        let opposite = Attitude::from_unit_quaternion(nalgebra::UnitQuaternion::new_unchecked(-*q));
        let correct = |measured: &Attitude| {
            let mut filter = AttitudeFilter::new(&options());
            let attitude = Attitude::from_rotation_vector(estimate);
            let mut motion = Motion { attitude, ..Motion::default() };
            let innovation = motion.attitude.rotation_to(measured);
            filter.correct(&mut motion, &innovation, filter.axis.noise());
            (motion, *filter.axis.bias())
        };
        prop_assert_eq!(correct(&measured), correct(&opposite));
    }
}
