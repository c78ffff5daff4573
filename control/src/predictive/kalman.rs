//! Kalman filter of the error of three identical axes, each with three states: the measured quantity, its rate and a bias that
//! drives the rate. One 3 by 3 covariance serves all axes.

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
    /// The transition `f`, and the covariance added in `dt_s` \[s\] by white noise in the derivatives of the second and the third
    /// state, of the densities `second` and `third` \[unit of the state per root second\]. The effect of the third state on the
    /// others is computed as if it were constant.
    pub fn new(f: Matrix3<f64>, [second, third]: [f64; 2], dt_s: f64) -> Self {
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

/// Covariance and bias of the error of three axes, with the noise that they are filtered with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisFilter {
    /// Standard deviation of a measurement of the first state \[unit of the first state\].
    noise: f64,
    /// Walk of the second and of the third state \[unit of the state per root second\].
    walks: [f64; 2],
    /// Limits of the components of the bias \[unit of the third state\].
    bias_limit: Vector3<f64>,
    covariance: Covariance,
    bias: Vector3<f64>,
}

impl AxisFilter {
    /// A filter with zero bias, of measurements with the standard deviation `noise`, whose other states have the standard deviations
    /// `initial` and the walks `walks` \[units of the states\].
    pub fn new(noise: f64, initial: [f64; 2], walks: [f64; 2], bias_limit: Vector3<f64>) -> Self {
        let covariance = Covariance::of([noise, initial[0], initial[1]]);
        Self { noise, walks, bias_limit, covariance, bias: Vector3::zeros() }
    }

    /// Standard deviation of a measurement \[unit of the first state\].
    pub fn noise(&self) -> f64 {
        self.noise
    }

    /// Sets the standard deviation of a measurement \[unit of the first state\].
    pub fn set_noise(&mut self, noise: f64) {
        self.noise = noise;
    }

    /// Walk of the second and of the third state \[unit of the state per root second\].
    pub fn walks(&self) -> [f64; 2] {
        self.walks
    }

    /// The third state \[its unit\].
    pub fn bias(&self) -> &Vector3<f64> {
        &self.bias
    }

    /// The covariance along each axis.
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }

    /// Standard deviation of the first state along each axis \[its unit\].
    pub fn sd(&self) -> f64 {
        self.covariance.0[(0, 0)].sqrt()
    }

    /// Variance of the next innovation along each axis \[square of the unit of the first state\].
    pub fn innovation_variance(&self) -> f64 {
        self.covariance.0[(0, 0)] + self.noise * self.noise
    }

    /// Propagates the covariance by a transition.
    pub fn predict(&mut self, transition: &StateTransition) {
        self.covariance.predict(transition);
    }

    /// Adds the standard deviation `sd` \[unit of the second state\] of a change of the second state in the last `dt_s` \[s\].
    pub fn add_change(&mut self, sd: f64, dt_s: f64) {
        let deviation = Vector3::new(dt_s / 2.0, 1.0, 0.0) * sd;
        self.covariance.0 += deviation * deviation.transpose();
    }

    /// Corrects covariance and bias by an innovation of a measurement with standard deviation `noise` \[unit of the first state\].
    /// Returns the gain from the innovation to the three states.
    pub fn correct(&mut self, innovation: &Vector3<f64>, noise: f64) -> Vector3<f64> {
        let gain = self.covariance.correct(noise);
        self.shift_bias(&(innovation * gain.z));
        gain
    }

    /// Corrects the covariance alone, by a measurement with standard deviation `noise` \[unit of the first state\].
    pub fn correct_covariance(&mut self, noise: f64) {
        self.covariance.correct(noise);
    }

    /// Replaces the covariance by that of `other`.
    pub fn set_covariance_of(&mut self, other: &Self) {
        self.covariance = other.covariance;
    }

    /// Adds to the bias, within its limit \[unit of the third state\].
    pub fn shift_bias(&mut self, shift: &Vector3<f64>) {
        let limited = |bias: f64, limit: f64| bias.clamp(-limit, limit);
        self.bias = (self.bias + shift).zip_map(&self.bias_limit, limited);
    }

    /// Sets the bias to zero.
    pub fn reset_bias(&mut self) {
        self.bias = Vector3::zeros();
    }
}
