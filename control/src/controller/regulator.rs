//! The linear-quadratic regulator shared by the classic law and OQTAL: computes a gain from a model and weights.

use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector3};

use super::input::InputForm;
use crate::riccati::{RiccatiError, care};

/// The gain `K` of `u = -K x`. Columns of states that are not in the model are zero.
pub type Gain = SMatrix<f64, 3, 9>;

/// The state `x`: rate, attitude and integral. `[omega_e; eps; eps_I]` in OQTAL, `[omega; Theta; Theta_I]` in the
/// classic law.
pub type LawState = SVector<f64, 9>;

/// The columns of a [`Gain`], and the rows of a [`LawState`], that hold the integral.
pub(super) const INTEGRAL: usize = 6;

/// Joins the three parts of `x`.
#[inline]
pub(super) fn law_state(
    rate: &Vector3<f64>,
    attitude: &Vector3<f64>,
    integral: &Vector3<f64>,
) -> LawState {
    let mut x = LawState::zeros();
    x.fixed_rows_mut::<3>(0).copy_from(rate);
    x.fixed_rows_mut::<3>(3).copy_from(attitude);
    x.fixed_rows_mut::<3>(INTEGRAL).copy_from(integral);
    x
}

/// The cost of Eq. (23): `Q = diag(rate, attitude, integral)`, each three times, and `R = input I`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Weight on the rate \[s^2/rad^2\], 0 or above; without effect if the input commands the rate.
    pub rate: f64,
    /// Weight on the attitude, above 0 \[-, in the classic law 1/rad^2\].
    pub attitude: f64,
    /// Weight on the integral of the attitude \[1/s^2\]; 0 for no integral action.
    pub integral: f64,
    /// Weight on the input, above 0 \[-\].
    pub input: f64,
}

/// A model of rate and attitude, Eq. (20), with the integral of its output as three further states.
/// The output, Eqs. (21), (32) and (35), is the attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AugmentedModel {
    /// `A` for a [`LawState`] \[units of the states per s\].
    pub a: SMatrix<f64, 9, 9>,
    /// `B` for a [`LawState`] \[units of the states per s and unit of the input\].
    pub b: SMatrix<f64, 9, 3>,
    /// First state of the model: 0, or 3 if the input commands the rate.
    first: usize,
}

impl AugmentedModel {
    /// The model of a vehicle with the state matrix `a` for rate and attitude, commanded through `input`.
    pub fn new(a: &Matrix6<f64>, input: &impl InputForm) -> Self {
        let mut augmented = Self {
            a: SMatrix::zeros(),
            b: SMatrix::zeros(),
            first: if input.inertia().is_some() { 0 } else { 3 },
        };
        // Eqs. (28), (29), (30), (34), (57), errata E-28, E-34, E-57: the integral is of the error
        // with its sign changed
        augmented.a.fixed_view_mut::<6, 6>(0, 0).copy_from(a);
        augmented.a.fixed_view_mut::<3, 3>(INTEGRAL, 3).copy_from(&-Matrix3::identity());
        augmented.b.fixed_view_mut::<6, 3>(0, 0).copy_from(&input.input_matrix(a));
        augmented
    }

    /// The gain that is optimal for `weights`.
    ///
    /// # Errors
    /// If the Riccati equation has no usable solution.
    pub fn gain(&self, weights: &Weights) -> Result<Gain, RiccatiError> {
        match (self.first, weights.integral > 0.0) {
            (0, true) => self.gain_of::<9>(weights),
            (0, false) => self.gain_of::<6>(weights),
            (_, true) => self.gain_of::<6>(weights),
            (_, false) => self.gain_of::<3>(weights),
        }
    }

    /// The gain for the `N` states from `self.first` on.
    fn gain_of<const N: usize>(&self, weights: &Weights) -> Result<Gain, RiccatiError> {
        let a = self.a.fixed_view::<N, N>(self.first, self.first).into_owned();
        let b = self.b.fixed_view::<N, 3>(self.first, 0).into_owned();
        let diagonal = [weights.rate, weights.attitude, weights.integral];
        // Eqs. (22), (23), (62), erratum E-62
        let q = SMatrix::<f64, N, N>::from_diagonal(&SVector::from_fn(|i, _| {
            diagonal[(self.first + i) / 3]
        }));
        let r = Matrix3::from_diagonal_element(weights.input);
        let k = care(&a, &b, &q, &r)?.k;
        let mut gain = Gain::zeros();
        gain.fixed_view_mut::<3, N>(0, self.first).copy_from(&k);
        Ok(gain)
    }
}
