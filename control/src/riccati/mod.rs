//! Algebraic Riccati equations over matrices of static size: the gain of a linear-quadratic regulator.
//!
//! Both equations end in the same two steps, so the two entry points differ only in how they get there.
//!
//! 1. A structure-preserving doubling algorithm finds the stabilising solution from the cost and the input alone,
//!    quadratically and without a start: [`dare`] doubles its own data, [`care`] first maps the left half plane into the
//!    unit disc (Chu, Fan and Lin, *Linear Algebra Appl.* 396, 2005).
//! 2. Newton's method (Kleinman, *IEEE TAC* 13, 1968; Hewer, *IEEE TAC* 16, 1971) removes what rounding left behind. The
//!    step is an error estimate, and it is found by squaring the closed loop (Smith, *SIAM J. Appl. Math.* 16, 1968), which
//!    ends only if the closed loop is stable. No solution is returned without both.
//!
//! Doubling was chosen because it needs nothing but products and small linear solves of `N x N` blocks. The Hamiltonian of
//! size `2N`, which the Schur and sign-function methods work on, has no type in stable Rust when the caller is generic in
//! `N`; and doubling is also the fastest of the three. Its weakness, badly scaled data, is met by balancing first.

mod balance;
mod care;
mod dare;
mod doubling;
mod lu;
mod newton;
mod weights;

use std::fmt;

use nalgebra::SMatrix;

pub use care::care;
pub use dare::dare;

/// The stabilising solution of a Riccati equation with `N` states and `M` inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution<const N: usize, const M: usize> {
    /// Symmetric positive semidefinite `P`: the cost to go from `x` is `x'Px`.
    pub p: SMatrix<f64, N, N>,
    /// The gain of `u = -Kx`.
    pub k: SMatrix<f64, M, N>,
}

/// Why there is no gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RiccatiError {
    /// An element of the data is NaN or infinite.
    NotFinite,
    /// `Q` is not symmetric.
    QNotSymmetric,
    /// `Q` has a negative eigenvalue.
    QNotPositiveSemidefinite,
    /// `R` is not symmetric.
    RNotSymmetric,
    /// `R` is not positive definite.
    RNotPositiveDefinite,
    /// No solution stabilises the loop: a mode that does not decay is out of reach of the input, or a mode on the
    /// stability boundary is not seen by `Q`.
    NoStabilisingSolution,
    /// A stabilising solution may exist, but the data determine it to too few digits in double precision.
    IllConditioned,
}

impl fmt::Display for RiccatiError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotFinite => "the Riccati data hold a number that is not finite",
            Self::QNotSymmetric => "the state weight Q is not symmetric",
            Self::QNotPositiveSemidefinite => "the state weight Q is not positive semidefinite",
            Self::RNotSymmetric => "the input weight R is not symmetric",
            Self::RNotPositiveDefinite => "the input weight R is not positive definite",
            Self::NoStabilisingSolution => {
                "no stabilising solution: the pair (A, B) is not stabilisable or Q leaves a mode on the stability \
                 boundary unseen"
            }
            Self::IllConditioned => "the Riccati equation is too ill-conditioned for double precision",
        })
    }
}

impl std::error::Error for RiccatiError {}
