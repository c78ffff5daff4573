//! Algebraic Riccati equations over matrices of static size: the gain of a linear-quadratic
//! regulator.
//!
//! [`care`] and [`dare`] take the same steps.
//!
//! 1. Balance: choose units for the states in which the data are of one size (Osborne, *J. ACM* 7,
//!    1960). Entries of `1e4` beside entries of one, as Euler angles near a pitch of 90 degrees
//!    give, then cost no accuracy.
//! 2. Double: a structure-preserving doubling algorithm finds the stabilising solution
//!    quadratically and without a first guess. `dare` doubles its own data; `care` first maps the
//!    left half plane into the unit disc (Chu, Fan and Lin, *Linear Algebra Appl.* 396, 2005),
//!    about the geometric mean of the closed-loop poles, which is the scaling of Byers (*Linear
//!    Algebra Appl.* 85, 1987) for the sign function.
//! 3. Refine by Newton's method (Kleinman, *IEEE TAC* 13, 1968; Hewer, *IEEE TAC* 16, 1971). Its
//!    step is an estimate of the error, and comes out of squaring the closed loop (Smith, *SIAM J.
//!    Appl. Math.* 16, 1968), which ends only if the loop is stable. No solution is returned
//!    without both. One step is usual; where rounding would spoil a second one, the residual is
//!    taken to twice the working precision.
//!
//! Why doubling: it needs only products and inverses of `N x N` blocks, and it is the fastest of
//! the known methods at these sizes. The Schur and sign-function methods work on the Hamiltonian of
//! size `2N`, a type that stable Rust cannot name in a function generic in `N`. The known weakness
//! of doubling, digits lost where data or poles are widely spread, is what steps 1 and 3 make good.
//!
//! Nothing here allocates, and every loop is bounded.

mod balance;
mod doubling;
mod inverse;
mod newton;
mod problem;
mod twofold;

use std::fmt;

use nalgebra::SMatrix;

use doubling::Doubling;
use newton::Time;
use problem::Problem;

/// The stabilising solution of a Riccati equation with `N` states and `M` inputs.
///
/// Units: those of the data. `x'Px` has the unit of the cost, `Kx` that of the input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution<const N: usize, const M: usize> {
    /// Symmetric positive semidefinite `P`: the cost from `x` onwards is `x'Px`.
    pub p: SMatrix<f64, N, N>,
    /// The gain of `u = -Kx`.
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
    problem.solve(start, Time::Continuous { centre })
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
    problem.solve(Doubling::of_discrete(&problem), Time::Discrete)
}

/// Why there is no gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RiccatiError {
    /// An element of the data is NaN or infinite.
    NotFinite,
    /// `Q` is not symmetric.
    QNotSymmetric,
    /// `Q` is not positive semidefinite.
    QNotPositiveSemidefinite,
    /// `R` is not symmetric.
    RNotSymmetric,
    /// `R` is not positive definite.
    RNotPositiveDefinite,
    /// A mode that does not decay by itself is out of reach of the input, or `Q` does not see it.
    NoStabilisingSolution,
    /// The data determine the solution to fewer than ten digits, or put a closed-loop pole on the
    /// stability boundary to within rounding.
    IllConditioned,
}

impl fmt::Display for RiccatiError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotFinite => "Riccati equation: the data hold a number that is not finite",
            Self::QNotSymmetric => "Riccati equation: the state weight Q is not symmetric",
            Self::QNotPositiveSemidefinite => "Riccati equation: the state weight Q is not positive semidefinite",
            Self::RNotSymmetric => "Riccati equation: the input weight R is not symmetric",
            Self::RNotPositiveDefinite => "Riccati equation: the input weight R is not positive definite",
            Self::NoStabilisingSolution => {
                "Riccati equation: a mode that does not decay is out of reach of the input or unseen by Q"
            }
            Self::IllConditioned => "Riccati equation: too ill-conditioned for double precision",
        })
    }
}

impl std::error::Error for RiccatiError {}
