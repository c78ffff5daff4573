//! Data of a program: model, weights, horizon and limits.

use nalgebra::{SMatrix, SVector};

/// Longest horizon \[-\].
pub const MOST_STEPS: usize = 40;

/// A program for `S` states and `M` inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HorizonProgram<const S: usize, const M: usize> {
    /// `A` \[units of the states\].
    pub a: SMatrix<f64, S, S>,
    /// `B` \[units of the states per unit of the input\].
    pub b: SMatrix<f64, S, M>,
    /// `Q`, the weight of the state \[per square of its unit\].
    pub q: SMatrix<f64, S, S>,
    /// `R`, the weight of the input, positive definite \[per square of its unit\].
    pub r: SMatrix<f64, M, M>,
    /// `P`, the weight of the last state \[per square of its unit\].
    pub p: SMatrix<f64, S, S>,
    /// `N`, the number of moves \[-\], 1 to [`MOST_STEPS`].
    pub steps: usize,
}

/// Limits of the moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoveBounds<const M: usize> {
    /// Lower limit of the input \[unit of the input\].
    pub input_low: SVector<f64, M>,
    /// Upper limit of the input \[unit of the input\].
    pub input_high: SVector<f64, M>,
    /// Lower limit of `w` \[unit of the state\].
    pub rate_low: SVector<f64, M>,
    /// Upper limit of `w` \[unit of the state\].
    pub rate_high: SVector<f64, M>,
}

impl<const M: usize> MoveBounds<M> {
    /// The limits of the input `index` alone.
    pub fn of(&self, index: usize) -> MoveBounds<1> {
        let part = |limit: &SVector<f64, M>| SVector::from([limit[index]]);
        MoveBounds {
            input_low: part(&self.input_low),
            input_high: part(&self.input_high),
            rate_low: part(&self.rate_low),
            rate_high: part(&self.rate_high),
        }
    }
}

impl<const S: usize, const M: usize> HorizonProgram<S, M> {
    /// Weight of the state after the move `step`.
    pub(super) fn weight(&self, step: usize) -> &SMatrix<f64, S, S> {
        if step + 1 == self.steps { &self.p } else { &self.q }
    }
}
