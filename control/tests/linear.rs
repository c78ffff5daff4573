//! Zero-order-hold discretisation against its defining properties.

use nalgebra::{Matrix2, SMatrix, Vector2};
use oqtal_control::linear::discretise;
use proptest::prelude::*;

fn any_matrix<const R: usize, const C: usize>() -> impl Strategy<Value = SMatrix<f64, R, C>> {
    prop::collection::vec(-1.0..1.0_f64, R * C).prop_map(SMatrix::from_vec)
}

fn close<const R: usize, const C: usize>(
    found: &SMatrix<f64, R, C>,
    expected: &SMatrix<f64, R, C>,
    tolerance: f64,
) -> bool {
    (found - expected).norm() <= tolerance * expected.norm()
}

#[test]
fn a_double_integrator_has_the_closed_form() {
    let (a, b) = (Matrix2::new(0.0, 1.0, 0.0, 0.0), Vector2::new(0.0, 1.0));
    for h in [1e-6, 1.0 / 60.0, 0.4, 7.0, 1e6] {
        let (ad, bd) = discretise(&a, &b, h);
        assert!(close(&ad, &Matrix2::new(1.0, h, 0.0, 1.0), 1e-15));
        assert!(close(&bd, &Vector2::new(h * h / 2.0, h), 1e-15));
    }
}

#[test]
fn an_oscillator_turns() {
    let (a, b) = (Matrix2::new(0.0, 1.0, -1.0, 0.0), Vector2::new(0.0, 1.0));
    for h in [1e-3_f64, 0.5, 2.0, 100.0] {
        let (sin, cos) = h.sin_cos();
        let (ad, bd) = discretise(&a, &b, h);
        assert!(close(&ad, &Matrix2::new(cos, sin, -sin, cos), 1e-13));
        assert!(close(&bd, &Vector2::new(2.0 * (0.5 * h).sin().powi(2), sin), 1e-13));
    }
}

#[test]
fn a_number_small_beside_one_keeps_its_digits() {
    let slow = Matrix2::new(-1e-12, 0.0, 0.0, -1e3);
    let (_, bd) = discretise(&slow, &Vector2::new(1.0, 1.0), 1.0);
    assert!(close(&bd, &Vector2::new(1.0, 1e-3), 1e-12));
}

#[test]
fn data_that_are_not_finite_do_not_hang() {
    for wrong in [f64::NAN, f64::INFINITY, f64::MAX] {
        let (ad, _) = discretise(&Matrix2::repeat(wrong), &Vector2::zeros(), 2.0);
        assert!(ad.iter().any(|x| !x.is_finite()));
    }
}

proptest! {
    #[test]
    fn two_steps_are_one_step_of_twice_the_length(
        a in any_matrix::<6, 6>(),
        b in any_matrix::<6, 3>(),
        h in 1e-3..2.0_f64,
    ) {
        let (ad, bd) = discretise(&a, &b, h);
        let (twice_ad, twice_bd) = discretise(&a, &b, 2.0 * h);
        prop_assert!(close(&twice_ad, &(ad * ad), 1e-12));
        prop_assert!(close(&twice_bd, &(ad * bd + bd), 1e-12));
    }

    /// Under a constant input the states move by `A Bd + B = Ad B`: the derivative of `Bd` in time.
    #[test]
    fn the_input_acts_through_the_same_dynamics(
        a in any_matrix::<6, 6>(),
        b in any_matrix::<6, 3>(),
        h in 1e-3..5.0_f64,
    ) {
        let (ad, bd) = discretise(&a, &b, h);
        prop_assert!(close(&(a * bd + b), &(ad * b), 1e-12));
    }

    #[test]
    fn time_runs_backwards_too(a in any_matrix::<4, 4>(), h in 1e-3..2.0_f64) {
        let (forward, _) = discretise(&a, &a, h);
        let (backward, _) = discretise(&a, &a, -h);
        prop_assert!(close(&(forward * backward), &SMatrix::identity(), 1e-11));
    }
}
