//! Covariance of a Kalman filter for three identical axes, each with three states, the first of them measured. One 3
//! by 3 matrix serves all axes.

use nalgebra::{Matrix3, Vector3};

/// Transition of the three states of an axis and the covariance added by it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StateTransition {
    /// `F`: the state transition matrix \[units of the states\].
    pub f: Matrix3<f64>,
    /// `Q`: the covariance added by process noise \[units of the states\].
    pub q: Matrix3<f64>,
}

impl StateTransition {
    /// `F` with the covariance that white noise of density `second` in the derivative of the
    /// second state and `third` in that of the third leave after `dt_s` \[s\], each in its unit per
    /// root second. The third state counts as constant in its effect on the others.
    #[must_use]
    pub fn new(f: Matrix3<f64>, second: f64, third: f64, dt_s: f64) -> Self {
        let (s, t) = (second * second * dt_s, third * third * dt_s);
        #[rustfmt::skip]
        let q = Matrix3::new(
            s * dt_s * dt_s / 3.0, s * dt_s / 2.0, 0.0,
            s * dt_s / 2.0, s, 0.0,
            0.0, 0.0, t,
        );
        Self { f, q }
    }
}

/// `P`: the covariance of the error of an axis \[products of the units of its state\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance(pub Matrix3<f64>);

impl Covariance {
    /// Covariance of independent errors with these standard deviations.
    #[must_use]
    pub fn of(deviations: [f64; 3]) -> Self {
        let deviations = Vector3::from(deviations);
        Self(Matrix3::from_diagonal(&deviations.component_mul(&deviations)))
    }

    /// Propagates the covariance by a transition.
    pub fn predict(&mut self, transition: &StateTransition) {
        let StateTransition { f, q } = transition;
        self.0 = f * self.0 * f.transpose() + q;
    }

    /// Corrects by a measurement of the first state with standard deviation `sd`, above 0. Returns the gain from the
    /// innovation to the three states.
    pub fn correct(&mut self, sd: f64) -> Vector3<f64> {
        let r = sd * sd;
        let gain: Vector3<f64> = self.0.column(0) / (self.0[(0, 0)] + r);
        let keep = Matrix3::identity() - gain * Vector3::x().transpose();
        // Joseph's form: stays symmetric and positive semidefinite under rounding.
        self.0 = keep * self.0 * keep.transpose() + gain * gain.transpose() * r;
        gain
    }
}
