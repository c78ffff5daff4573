//! The solvers of both equations.

use nalgebra::SMatrix;

use super::doubling::Doubling;
use super::error::RiccatiError;
use super::newton::{RiccatiEquation, TimeDomain};
use super::problem::{Problem, is_finite};

/// The stabilising solution of a Riccati equation with `N` states and `M` inputs.
///
/// Units: those of the data. `x'Px` has the unit of the cost, `Kx` that of the input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution<const N: usize, const M: usize> {
    /// Symmetric positive semidefinite `P`: the cost from `x` onwards is `x'Px` \[cost per squared state\].
    pub p: SMatrix<f64, N, N>,
    /// The gain of `u = -Kx` \[input per state\].
    pub k: SMatrix<f64, M, N>,
}

/// Solves the continuous-time equation `A'P + PA - PBR^-1B'P + Q = 0`; the gain is `K = R^-1B'P`.
///
/// Under `u = -Kx` the loop `dx/dt = Ax + Bu` is stable and minimises the integral of `x'Qx +
/// u'Ru`.
///
/// # Errors
/// [`RiccatiError`] says which condition fails. `Q` must be symmetric positive semidefinite, `R`
/// symmetric positive definite, `(A, B)` stabilisable and `(Q, A)` detectable.
pub fn care<const N: usize, const M: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, M>,
    q: &SMatrix<f64, N, N>,
    r: &SMatrix<f64, M, M>,
) -> Result<Solution<N, M>, RiccatiError> {
    let problem = Problem::new(a, b, q, r)?;
    let (start, centre) =
        Doubling::of_continuous(&problem).ok_or(RiccatiError::NoStabilisingSolution)?;
    solve(&problem, start, TimeDomain::Continuous { centre })
}

/// Solves the discrete-time equation `P = A'PA - A'PB (R + B'PB)^-1 B'PA + Q`; the gain is `K = (R
/// + B'PB)^-1 B'PA`.
///
/// Under `u = -Kx` the loop `x+ = Ax + Bu` is stable and minimises the sum of `x'Qx + u'Ru`.
///
/// # Errors
/// As for [`care`].
pub fn dare<const N: usize, const M: usize>(
    a: &SMatrix<f64, N, N>,
    b: &SMatrix<f64, N, M>,
    q: &SMatrix<f64, N, N>,
    r: &SMatrix<f64, M, M>,
) -> Result<Solution<N, M>, RiccatiError> {
    let problem = Problem::new(a, b, q, r)?;
    solve(&problem, Doubling::of_discrete(&problem), TimeDomain::Discrete)
}

/// Doubles `start`, refines the result, and converts it to the units of the caller.
fn solve<const N: usize, const M: usize>(
    problem: &Problem<N, M>,
    start: Doubling<N>,
    time: TimeDomain,
) -> Result<Solution<N, M>, RiccatiError> {
    let start = start.cost_to_go().ok_or(RiccatiError::NoStabilisingSolution)?;
    let (p, k) = RiccatiEquation::new(problem, time).refine(start)?;
    let (p, k) = (problem.balance.input_form(&p), problem.balance.gain(&k));
    if is_finite(&p) && is_finite(&k) {
        Ok(Solution { p, k })
    } else {
        Err(RiccatiError::IllConditioned)
    }
}
