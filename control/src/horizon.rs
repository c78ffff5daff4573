//! Linear-quadratic programs over a horizon, with limits of the input and soft limits of the rate, solved by an interior-point
//! method. Not in the paper.
//!
//! ```text
//! min  sum_{i<N} (x_i' Q x_i + u_i' R u_i) + x_N' P x_N + c s + d s^2 / 2,   x_{i+1} = A x_i + B u_i
//! with  low_u <= u_i <= high_u,   low_w - s <= w_{i+1} <= high_w + s,   s >= 0
//! ```
//!
//! `w` is the first part of the state `x`, one component for each input. The linear penalty of the slack `s` exceeds every
//! multiplier that occurs, so that the slack is zero whenever possible and the program always has a solution.
//!
//! Source: C. V. Rao, S. J. Wright and J. B. Rawlings, *Application of Interior-Point Methods to Model Predictive Control*, JOTA
//! 99(3), 1998, with the predictor and corrector of S. Mehrotra, *SIAM J. Optim.* 2(4), 1992. Every Newton step is a Riccati
//! recursion, so that its cost is proportional to the horizon; the slack, which couples all moves, is eliminated last, by a
//! second solution with the same factors. Iterates satisfy the limits. The work space is on the stack.

mod iterate;
mod program;

use nalgebra::SVector;

use iterate::{Centre, Iterate};
pub use program::{HorizonProgram, MOST_STEPS, MoveBounds};

/// Maximum number of iterations \[-\].
pub const MOST_ITERATIONS: u32 = 40;

/// Greatest number allowed in a program \[-\].
const GREATEST: f64 = 1e9;
/// Change of any move in the last Newton step \[unit of the input\]; each step leaves a small fraction of it.
const LAST_CHANGE: f64 = 1e-7;
/// Complementarity after the last Newton step, over the curvature of the cost of a move \[square of the unit of the input\].
const LAST_COMPLEMENTARITY: f64 = 1e-14;
/// Change of any move in the last Newton step if rounding ends the method \[unit of the input\].
const GREATEST_CHANGE: f64 = 1e-4;
/// Fraction of the distance to the nearest limit that an iteration advances \[-\].
const BOUNDARY_SHARE: f64 = 0.999;

/// Solution of a program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HorizonSolution<const M: usize> {
    /// First move \[unit of the input\].
    pub first: SVector<f64, M>,
    /// Number of iterations \[-\].
    pub iterations: u32,
}

impl<const S: usize, const M: usize> HorizonProgram<S, M> {
    /// Solves the program from the state `x_0`. `None` if a number is not finite or exceeds every vehicle motion, or if the
    /// method does not converge.
    pub fn solve(
        &self,
        x_0: &SVector<f64, S>,
        bounds: &MoveBounds<M>,
    ) -> Option<HorizonSolution<M>> {
        let MoveBounds { input_low, input_high, rate_low, rate_high } = bounds;
        let limits = [input_low, input_high, rate_low, rate_high];
        let numbers = x_0.iter().chain(limits.into_iter().flatten());
        if !numbers.into_iter().all(|number| number.abs() < GREATEST) {
            return None;
        }
        let curvature = 2.0 * (self.r + self.b.tr_mul(&(self.p * self.b))).amax();
        let mut iterate = Iterate::start(self, x_0, bounds, curvature);
        let (mut iterations, mut least) = (0, f64::INFINITY);
        let mut first = SVector::zeros();
        while iterations < MOST_ITERATIONS {
            let before = iterate.complementarity(0.0);
            let is_solved = least < LAST_CHANGE && before < LAST_COMPLEMENTARITY * curvature;
            if is_solved || iterate.factorise(self).is_none() {
                break;
            }
            iterate.find_step(self, Centre { target: 0.0, product: 0.0 });
            let share = iterate.step_length();
            // Mehrotra's choice: the more the predictor achieves, the less the corrector returns to the centre.
            let centring = (iterate.complementarity(share) / before).powi(3);
            iterate.find_step(self, Centre { target: centring * before, product: share * share });
            let share = (BOUNDARY_SHARE * iterate.step_length()).min(1.0);
            iterate.advance(share);
            let change = iterate.change() / share;
            // Near the solution rounding may make a later step worse.
            if change < least {
                (least, first) = (change, iterate.first());
            }
            iterations += 1;
        }
        (least < GREATEST_CHANGE).then_some(HorizonSolution { first, iterations })
    }
}
