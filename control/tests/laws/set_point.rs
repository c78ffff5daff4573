//! The linear loop of Eqs. (26) and (27) against the law that flies.

use nalgebra::SVector;
use oqtal_control::controller::{ClassicLqr, LqrOptions, SetPointLoop};
use oqtal_control::euler::EulerAngles;

use super::closed_loop::step;
use super::*;

/// Steps of [`step`] between two comparisons, each of a millisecond.
const SPAN: usize = 10;
const COUNT: usize = 300;

fn options(integral_weight: f64) -> LqrOptions {
    // One cell for all that the body does: one gain, as the linear loop has.
    LqrOptions { integral_weight, ..LqrOptions::spacecraft() }.with_cell_width(10.0)
}

fn linear(options: &LqrOptions) -> SetPointLoop {
    ClassicLqr::set_point_loop(options, &spacecraft(), &SVector::zeros()).unwrap()
}

/// Euler angles \[rad\] every [`SPAN`] of the spacecraft under the law, commanded to turn to `target`.
fn flown(options: LqrOptions, target: &Vector3<f64>) -> Vec<Vector3<f64>> {
    let mut law = ClassicLqr::new(options, spacecraft()).unwrap();
    let attitude = Attitude::from_xyzw(EulerAngles::from_vector(target).xyzw()).unwrap();
    let reference = AttitudeReference { attitude, ..AttitudeReference::default() };
    let mut state = AttitudeState { attitude: Attitude::LEVEL, rate: BodyRate::default() };
    let mut angles = Vec::new();
    for tick in 0..COUNT * SPAN {
        if tick.is_multiple_of(SPAN) {
            angles.push(EulerAngles::from_attitude(&state.attitude).vector());
        }
        let torque = law.update(&state, &reference, 1e-3);
        state = step(&state, |state| isotropic_inertia().acceleration(state.rate, torque).0);
    }
    angles
}

#[test]
fn the_classic_law_answers_a_small_step_as_its_linear_loop_does() {
    let target = Vector3::new(0.01, -0.02, 0.015);
    for integral_weight in [0.0, 0.01] {
        let options = options(integral_weight);
        let flown = flown(options, &target);
        let expected: Vec<_> =
            linear(&options).step_response(&target, SPAN as f64 * 1e-3, COUNT).collect();
        let apart = flown.iter().zip(&expected).map(|(a, b)| (a - b).amax()).fold(0.0, f64::max);
        // The torque is held for a millisecond, and Euler angles couple.
        assert!(apart < 0.01 * target.amax(), "{apart} rad apart");
        let risen = (expected[COUNT - 1] - target).amax() / target.amax();
        assert!(risen < 0.1, "{risen} of the step is left after 3 s");
    }
}

#[test]
fn the_linear_loop_reaches_its_set_point() {
    let target = Vector3::new(0.3, -0.2, 0.1);
    for integral_weight in [0.0, 0.01] {
        let last = linear(&options(integral_weight)).step_response(&target, 0.5, 400).last();
        assert!((last.unwrap() - target).amax() < 1e-6, "{last:?}");
    }
}
