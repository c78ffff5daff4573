//! The error of the solvers.

use std::fmt;

/// Reason why a Riccati equation has no usable solution.
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
    /// A mode that does not decay without control cannot be reached by the input or is not observed by `Q`.
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
                "Riccati equation: a mode that does not decay cannot be reached by the input or is not observed by Q"
            }
            Self::IllConditioned => "Riccati equation: too ill-conditioned for double precision",
        })
    }
}

impl std::error::Error for RiccatiError {}
