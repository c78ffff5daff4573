//! The covariance of a Kalman filter for three axes that are alike: the same three states for each
//! axis, the first of them measured, the same noise. One 3 by 3 matrix then stands for all.

use nalgebra::{Matrix3, Vector3};

/// How the states of an axis go on, and how uncertain they become meanwhile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StateTransition {
    /// `F`: the states after, from the states before.
    pub f: Matrix3<f64>,
    /// `Q`: the covariance that is added.
    pub q: Matrix3<f64>,
}

impl StateTransition {
    /// `F` with the covariance that white noise of density `second` in the derivative of the
    /// second state and `third` in that of the third leave after `dt_s` \[s\], each in its unit per
    /// root second. The third state is as good as constant for what it does to the others.
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

/// `P`: the covariance of the error of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance(pub Matrix3<f64>);

impl Covariance {
    /// Independent errors of these standard deviations.
    #[must_use]
    pub fn of(deviations: [f64; 3]) -> Self {
        let deviations = Vector3::from(deviations);
        Self(Matrix3::from_diagonal(&deviations.component_mul(&deviations)))
    }

    /// Goes on by a transition.
    pub fn predict(&mut self, transition: &StateTransition) {
        let StateTransition { f, q } = transition;
        self.0 = f * self.0 * f.transpose() + q;
    }

    /// Takes a measurement of the first state with standard deviation `sd`, above 0; the gain by
    /// which its innovation enters the three states.
    pub fn correct(&mut self, sd: f64) -> Vector3<f64> {
        let r = sd * sd;
        let gain: Vector3<f64> = self.0.column(0) / (self.0[(0, 0)] + r);
        let keep = Matrix3::identity() - gain * Vector3::x().transpose();
        // Joseph's form: symmetric and positive semidefinite whatever the rounding.
        self.0 = keep * self.0 * keep.transpose() + gain * gain.transpose() * r;
        gain
    }
}
