//! Newton's method on a Riccati equation: it removes the error of the first guess and proves that the loop is stable.
//!
//! Both equations are written in terms of a rate of change: with `A` in continuous time and `A - I`
//! in discrete time, and `D = A - BK`, the residual is `Q + K'RK + PD + D'P`, plus `D'PD` in
//! discrete time. Sampled dynamics are close to the identity, and this form avoids its subtraction. An error of `K`
//! enters the residual only squared.

use nalgebra::{Cholesky, Const, SMatrix};

use super::doubling::MAX_DOUBLINGS;
use super::error::RiccatiError;
use super::inverse::inverse;
use super::problem::{Problem, is_finite, symmetrised};
use super::twofold::Twofold;

/// Relative size of a step below which the iteration ends; the remaining error is smaller still.
const SETTLED: f64 = 1e-10;
/// The same for the first step, whose residual is computed in working precision, so that its error is known from the
/// step alone.
const SETTLED_ROUNDED: f64 = 1e-13;
/// Greatest ratio of a step to the one before, from the third step on. Convergence is quadratic; a greater ratio
/// means rounding, or a pole on the stability boundary.
const CONTRACTION: f64 = 0.1;
/// Greatest number of steps; one is usual.
const MAX_STEPS: usize = 6;
/// Norm of a power of the closed loop at which the squaring ends; the relative error of the step is then the square
/// of this norm.
const AT_REST: f64 = 1e-4;

/// Continuous or discrete time.
pub(super) enum TimeDomain {
    /// Continuous time, with the centre of the Cayley transform.
    Continuous {
        /// Centre of the Cayley transform, which maps the left half plane into the unit disc \[1/s\].
        centre: f64,
    },
    /// Discrete time.
    Discrete,
}

/// A Riccati equation in terms of a rate of change.
pub(super) struct RiccatiEquation<'a, const N: usize, const M: usize> {
    problem: &'a Problem<N, M>,
    /// `A`, or `A - I` in discrete time.
    rate: SMatrix<f64, N, N>,
    time: TimeDomain,
}

impl<'a, const N: usize, const M: usize> RiccatiEquation<'a, N, M> {
    /// The equation of `problem`.
    pub(super) fn new(problem: &'a Problem<N, M>, time: TimeDomain) -> Self {
        let rate = match time {
            TimeDomain::Continuous { .. } => problem.a,
            TimeDomain::Discrete => problem.a - SMatrix::identity(),
        };
        Self { problem, rate, time }
    }

    /// Corrects `p` until the correction is small, and finds the gain.
    pub(super) fn refine(
        &self,
        mut p: SMatrix<f64, N, N>,
    ) -> Result<(SMatrix<f64, N, N>, SMatrix<f64, M, N>), RiccatiError> {
        let mut previous = f64::INFINITY;
        for step in 0..MAX_STEPS {
            let correction =
                self.correction(&p, step > 0).ok_or(RiccatiError::NoStabilisingSolution)?;
            p += correction;
            let size = correction.norm();
            let settled = if step == 0 { SETTLED_ROUNDED } else { SETTLED };
            if size <= settled * p.norm() {
                let k = self.precise_gain(&p).ok_or(RiccatiError::IllConditioned)?;
                return Ok((p, k));
            }
            if step > 1 && size > CONTRACTION * previous {
                break;
            }
            previous = size;
        }
        Err(RiccatiError::IllConditioned)
    }

    /// The Newton step at `p`. `None` if the closed loop with the gain of `p` is not stable.
    fn correction(&self, p: &SMatrix<f64, N, N>, precise: bool) -> Option<SMatrix<f64, N, N>> {
        let k = self.gain(p)?;
        let d = self.rate - self.problem.b * k;
        let residual =
            if precise { self.precise_residual(p, &k) } else { self.residual(p, &k, &d) };
        match self.time {
            TimeDomain::Discrete => stein(SMatrix::identity() + d, residual),
            // X = S'XS + W, with the Cayley transform S of D, has the solution of D'X + XD +
            // residual = 0.
            TimeDomain::Continuous { centre } => {
                let inverse = inverse(d - SMatrix::identity() * centre)?;
                let s = SMatrix::identity() + inverse * (2.0 * centre);
                let w = inverse.transpose() * (residual * inverse) * (2.0 * centre);
                stein(s, w)
            }
        }
    }

    /// The weight of the input that the gain divides by: `R`, or `R + B'PB` in discrete time.
    fn input_weight(&self, bp: &SMatrix<f64, M, N>) -> Option<Cholesky<f64, Const<M>>> {
        match self.time {
            TimeDomain::Continuous { .. } => Cholesky::new(self.problem.r),
            TimeDomain::Discrete => Cholesky::new(self.problem.r + bp * self.problem.b),
        }
    }

    fn gain(&self, p: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, M, N>> {
        let bp = self.problem.b.transpose() * p;
        let right = match self.time {
            TimeDomain::Continuous { .. } => bp,
            TimeDomain::Discrete => bp + bp * self.rate,
        };
        Some(self.input_weight(&bp)?.solve(&right))
    }

    fn residual(
        &self,
        p: &SMatrix<f64, N, N>,
        k: &SMatrix<f64, M, N>,
        d: &SMatrix<f64, N, N>,
    ) -> SMatrix<f64, N, N> {
        let pd = p * d;
        let mut sum = pd * 2.0 + k.transpose() * (self.problem.r * k);
        if let TimeDomain::Discrete = self.time {
            sum += d.transpose() * pd;
        }
        self.problem.q + symmetrised(&sum)
    }

    /// `D`, `PD` and `RK` to twice the working precision.
    fn products(
        &self,
        p: &SMatrix<f64, N, N>,
        k: &Twofold<M, N>,
    ) -> (Twofold<N, N>, Twofold<N, N>, Twofold<M, N>) {
        let d = Twofold::from(self.rate).plus_product(&Twofold::from(-self.problem.b), k);
        let pd = Twofold::product(&Twofold::from(*p), &d);
        let rk = Twofold::product(&Twofold::from(self.problem.r), k);
        (d, pd, rk)
    }

    fn precise_residual(
        &self,
        p: &SMatrix<f64, N, N>,
        k: &SMatrix<f64, M, N>,
    ) -> SMatrix<f64, N, N> {
        let k = Twofold::from(*k);
        let (d, pd, rk) = self.products(p, &k);
        let mut sum = Twofold::from(self.problem.q)
            .plus(&pd)
            .plus(&pd.transpose())
            .plus_product(&k.transpose(), &rk);
        if let TimeDomain::Discrete = self.time {
            sum = sum.plus_product(&d.transpose(), &pd);
        }
        symmetrised(&sum.rounded())
    }

    /// The gain, in discrete time with one step of iterative refinement: `R + B'PB` can be much
    /// worse conditioned than `P`.
    fn precise_gain(&self, p: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, M, N>> {
        let k = self.gain(p)?;
        if let TimeDomain::Continuous { .. } = self.time {
            return Some(k);
        }
        let b = self.problem.b.transpose();
        let (_, pd, rk) = self.products(p, &Twofold::from(k));
        let residual = Twofold::product(&Twofold::from(b), &Twofold::from(*p).plus(&pd)).rounded()
            - rk.rounded();
        Some(k + self.input_weight(&(b * p))?.solve(&residual))
    }
}

/// Solves `X = S'XS + W`: the sum of `S'^i W S^i`, 2^k terms after k squarings. `None` if the
/// powers of `S` do not vanish.
fn stein<const N: usize>(
    mut s: SMatrix<f64, N, N>,
    mut w: SMatrix<f64, N, N>,
) -> Option<SMatrix<f64, N, N>> {
    for _ in 0..MAX_DOUBLINGS {
        w += s.transpose() * (w * s);
        s *= s;
        if s.norm() <= AT_REST {
            return Some(symmetrised(&w)).filter(is_finite);
        }
    }
    None
}
