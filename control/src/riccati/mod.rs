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
//!    step estimates the error. It is computed by squaring the closed loop (Smith, *SIAM J. Appl.
//!    Math.* 16, 1968), which converges only if the loop is stable. A solution is returned only if
//!    the step is small and the loop stable. One step is usual; where rounding would spoil a second
//!    one, the residual is computed in twice the working precision.
//!
//! Why doubling: it needs only products and inverses of `N x N` blocks, and it is the fastest of
//! the known methods at these sizes. The Schur and sign-function methods work on the Hamiltonian of
//! size `2N`, a type that stable Rust cannot name in a function generic in `N`. Steps 1 and 3
//! compensate the known weakness of doubling: digits are lost where data or poles are widely spread.
//!
//! Nothing here allocates, and every loop is bounded.

mod balance;
mod doubling;
mod error;
mod inverse;
mod newton;
mod problem;
mod solvers;
mod twofold;

pub use error::RiccatiError;
pub use solvers::{Solution, care, dare};
