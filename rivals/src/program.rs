//! Quadratic programs over a horizon with a linear model that changes from step to step, and limits of the moves.
//!
//! ```text
//! min  sum_{i<N} (x_{i+1}' Q_i x_{i+1} / 2 + q_i' x_{i+1} + u_i' R_i u_i / 2 + r_i' u_i)
//! with x_0 = 0,   x_{i+1} = A_i x_i + B_i u_i,   low_i <= u_i <= high_i
//! ```
//!
//! Source: C. V. Rao, S. J. Wright and J. B. Rawlings, *Application of Interior-Point Methods to Model Predictive Control*, JOTA
//! 99(3), 1998, with the predictor and corrector of S. Mehrotra, *SIAM J. Optim.* 2(4), 1992. Every Newton step is a Riccati
//! recursion. Without an active limit, one recursion is the solution. Iterates satisfy the limits, so that the last one can be used
//! whatever the number of iterations.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

/// Greatest number of iterations \[-\].
pub const MOST_ITERATIONS: u32 = 30;

/// Change of every move in the last Newton step \[unit of the move\].
const LAST_CHANGE: f64 = 1e-7;
/// Complementarity after the last Newton step, over the greatest curvature of a move \[square of the unit of the move\].
const LAST_COMPLEMENTARITY: f64 = 1e-14;
/// Fraction of the distance to the nearest limit that an iteration advances \[-\].
const BOUNDARY_SHARE: f64 = 0.995;
/// Least distance of a first move from its limits, over their distance \[-\].
const FIRST_MARGIN: f64 = 0.25;
/// First complementarity, over the cost of a move across its whole range, or of a move without limits \[-\].
const FIRST_SHARE: f64 = 0.1;

/// A step of a program with `S` states and `M` inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxStage<const S: usize, const M: usize> {
    /// `A` \[units of the states\].
    pub a: SMatrix<f64, S, S>,
    /// `B` \[units of the states per unit of the move\].
    pub b: SMatrix<f64, S, M>,
    /// `Q` of the state after the step, positive semidefinite \[per square of its unit\].
    pub q: SMatrix<f64, S, S>,
    /// `q`, gradient of the cost of the state after the step \[per unit\].
    pub q_gradient: SVector<f64, S>,
    /// Diagonal of `R`, positive \[per square of the unit of the move\].
    pub r: SVector<f64, M>,
    /// `r`, gradient of the cost of the move \[per unit\].
    pub r_gradient: SVector<f64, M>,
    /// Lower limits of the move \[unit of the move\].
    pub low: SVector<f64, M>,
    /// Upper limits of the move, greater than the lower ones \[unit of the move\].
    pub high: SVector<f64, M>,
}

impl<const S: usize, const M: usize> Default for BoxStage<S, M> {
    fn default() -> Self {
        Self {
            a: SMatrix::identity(),
            b: SMatrix::zeros(),
            q: SMatrix::zeros(),
            q_gradient: SVector::zeros(),
            r: SVector::repeat(1.0),
            r_gradient: SVector::zeros(),
            low: SVector::repeat(-1.0),
            high: SVector::repeat(1.0),
        }
    }
}

/// Values for the upper and the lower limit of each move.
type PerBound<const M: usize> = SMatrix<f64, M, 2>;

/// Iterate of a step, its Newton step and the factors of the recursion.
#[derive(Clone, Copy)]
struct Work<const S: usize, const M: usize> {
    u: SVector<f64, M>,
    x: SVector<f64, S>,
    margin: PerBound<M>,
    dual: PerBound<M>,
    u_change: SVector<f64, M>,
    x_change: SVector<f64, S>,
    margin_change: PerBound<M>,
    dual_change: PerBound<M>,
    curvature: Cholesky<f64, Const<M>>,
    gain: SMatrix<f64, M, S>,
}

/// A program of `N` steps with its work space. No method but the constructor allocates.
#[derive(Clone)]
pub struct BoxProgram<const S: usize, const M: usize, const N: usize> {
    /// The steps.
    pub stages: Box<[BoxStage<S, M>; N]>,
    work: Box<[Work<S, M>; N]>,
}

impl<const S: usize, const M: usize, const N: usize> Default for BoxProgram<S, M, N> {
    fn default() -> Self {
        let work = Work {
            u: SVector::zeros(),
            x: SVector::zeros(),
            margin: PerBound::zeros(),
            dual: PerBound::zeros(),
            u_change: SVector::zeros(),
            x_change: SVector::zeros(),
            margin_change: PerBound::zeros(),
            dual_change: PerBound::zeros(),
            curvature: Cholesky::pack_dirty(SMatrix::identity()),
            gain: SMatrix::zeros(),
        };
        Self { stages: Box::new([BoxStage::default(); N]), work: Box::new([work; N]) }
    }
}

impl<const S: usize, const M: usize, const N: usize> BoxProgram<S, M, N> {
    /// Solves the program and returns the number of iterations, 0 if no limit is active; the moves are then those of
    /// [`Self::moves`]. `None` if a number is not finite.
    pub fn solve(&mut self) -> Option<u32> {
        self.work.iter_mut().for_each(Work::clear);
        let greatest_curvature = self.factorise()?;
        self.find_change(0.0, 0.0);
        let is_free = |(stage, work): (&BoxStage<S, M>, &Work<S, M>)| {
            (0..M).all(|i| (stage.low[i]..=stage.high[i]).contains(&work.u_change[i]))
        };
        if self.stages.iter().zip(self.work.iter()).all(is_free) {
            self.work.iter_mut().for_each(|work| work.u = work.u_change);
            return self.is_finite().then_some(0);
        }
        self.start(greatest_curvature);
        let mut iterations = 0;
        while iterations < MOST_ITERATIONS {
            let before = self.complementarity(0.0);
            self.factorise()?;
            self.find_change(0.0, 0.0);
            let share = self.step_length();
            // Mehrotra's choice: the more the predictor achieves, the less the corrector returns to the centre.
            let centring = (self.complementarity(share) / before).powi(3);
            self.find_change(centring * before, share * share);
            let share = (BOUNDARY_SHARE * self.step_length()).min(1.0);
            self.work.iter_mut().for_each(|work| work.advance(share));
            iterations += 1;
            let change = self.work.iter().map(|work| work.u_change.amax()).fold(0.0, f64::max);
            let left = self.complementarity(0.0);
            if !change.is_finite() {
                return None;
            }
            if change < LAST_CHANGE && left < LAST_COMPLEMENTARITY * greatest_curvature {
                break;
            }
        }
        Some(iterations)
    }

    /// The moves of the last solution \[unit of the move\].
    pub fn moves(&self) -> impl Iterator<Item = &SVector<f64, M>> {
        self.work.iter().map(|work| &work.u)
    }

    fn is_finite(&self) -> bool {
        self.work.iter().flat_map(|work| work.u.iter()).all(|number| number.is_finite())
    }

    /// Begins inside the limits with multipliers of equal complementarity, of the order of the cost of a move.
    fn start(&mut self, curvature: f64) {
        let mut x = SVector::<f64, S>::zeros();
        let range =
            self.stages.iter().map(|stage| (stage.high - stage.low).amax()).fold(0.0, f64::max);
        // Multipliers are of the order of the cost of the moves that the limits forbid.
        let free = self.work.iter().map(|work| work.u_change.amax()).fold(range, f64::max);
        let complementarity = FIRST_SHARE * curvature * range * free;
        for (stage, work) in self.stages.iter().zip(self.work.iter_mut()) {
            let inset = (stage.high - stage.low) * FIRST_MARGIN;
            work.u = work.u_change.zip_zip_map(
                &(stage.low + inset),
                &(stage.high - inset),
                |u, low, high| u.max(low).min(high),
            );
            x = stage.a * x + stage.b * work.u;
            work.x = x;
            work.margin = PerBound::from_columns(&[stage.high - work.u, work.u - stage.low]);
            work.dual = work.margin.map(|margin| complementarity / margin);
        }
    }

    /// Mean product of margin and multiplier after the fraction `share` of the Newton step.
    fn complementarity(&self, share: f64) -> f64 {
        let product = |work: &Work<S, M>| {
            let margin = work.margin + work.margin_change * share;
            margin.dot(&(work.dual + work.dual_change * share))
        };
        self.work.iter().map(product).sum::<f64>() / (2 * M * N) as f64
    }

    /// Factorises the Newton equations of the iterate, and returns the greatest curvature of the cost of a move; `None` if a number is
    /// not finite.
    fn factorise(&mut self) -> Option<f64> {
        let mut value = SMatrix::<f64, S, S>::zeros();
        let mut greatest = 0.0_f64;
        for (stage, work) in self.stages.iter().zip(self.work.iter_mut()).rev() {
            value += stage.q;
            let r = stage.r + work.barrier().column_sum();
            let by_value = stage.b.tr_mul(&value);
            let hessian = by_value * stage.b + SMatrix::from_diagonal(&r);
            greatest = greatest.max(hessian.diagonal().amax());
            work.curvature = Cholesky::new(hessian)?;
            work.gain = work.curvature.solve(&(by_value * stage.a));
            // The symmetric form: it loses no digits where a barrier is strong.
            let closed = stage.a - stage.b * work.gain;
            let weighted =
                SMatrix::<f64, M, S>::from_fn(|row, column| r[row] * work.gain[(row, column)]);
            value = closed.tr_mul(&(value * closed)) + work.gain.tr_mul(&weighted);
        }
        greatest.is_finite().then_some(greatest)
    }

    /// Computes the Newton step towards the complementarity `target`, with the fraction `second_order` of the products of the changes in
    /// the last step.
    fn find_change(&mut self, target: f64, second_order: f64) {
        let mut y = SVector::<f64, S>::zeros();
        for (stage, work) in self.stages.iter().zip(self.work.iter_mut()).rev() {
            let wanted = work.wanted(target, second_order);
            y += stage.q * work.x + stage.q_gradient;
            let u = stage.r.component_mul(&work.u) + stage.r_gradient + wanted.column(0)
                - wanted.column(1)
                + stage.b.tr_mul(&y);
            work.u_change = -work.curvature.solve(&u);
            y = stage.a.tr_mul(&y) - work.gain.tr_mul(&u);
        }
        let mut x = SVector::<f64, S>::zeros();
        for (stage, work) in self.stages.iter().zip(self.work.iter_mut()) {
            work.u_change -= work.gain * x;
            x = stage.a * x + stage.b * work.u_change;
            work.x_change = x;
            let wanted = work.wanted(target, second_order);
            work.margin_change = PerBound::from_columns(&[-work.u_change, work.u_change]);
            work.dual_change =
                wanted - work.dual - work.barrier().component_mul(&work.margin_change);
        }
    }

    /// Greatest fraction of the Newton step, up to one, with which margins and multipliers stay positive \[-\].
    fn step_length(&self) -> f64 {
        let share = |value: &f64, change: &f64| if *change < 0.0 { -value / change } else { 1.0 };
        let of_work = |work: &Work<S, M>| {
            let margins = work.margin.iter().zip(work.margin_change.iter());
            let duals = work.dual.iter().zip(work.dual_change.iter());
            margins.chain(duals).map(|(value, change)| share(value, change)).fold(1.0, f64::min)
        };
        self.work.iter().map(of_work).fold(1.0, f64::min)
    }
}

impl<const S: usize, const M: usize> Work<S, M> {
    /// Zero moves without limits.
    fn clear(&mut self) {
        (self.u, self.x) = (SVector::zeros(), SVector::zeros());
        (self.margin, self.dual) = (PerBound::repeat(1.0), PerBound::zeros());
        (self.margin_change, self.dual_change) = (PerBound::zeros(), PerBound::zeros());
    }

    /// Curvature of the barrier of each limit.
    fn barrier(&self) -> PerBound<M> {
        self.dual.component_div(&self.margin)
    }

    /// Multipliers of the complementarity `target` for unchanged margins.
    fn wanted(&self, target: f64, second_order: f64) -> PerBound<M> {
        let products = self.margin_change.component_mul(&self.dual_change) * second_order;
        products.zip_map(&self.margin, |product, margin| (target - product) / margin)
    }

    /// Advances by the fraction `share` of the Newton step.
    fn advance(&mut self, share: f64) {
        self.u += self.u_change * share;
        self.x += self.x_change * share;
        self.margin += self.margin_change * share;
        self.dual += self.dual_change * share;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    type Small = BoxProgram<3, 2, 6>;

    /// A program of numbers in -1..1; limits are narrow, so that some are active.
    fn program(numbers: &[f64]) -> Small {
        let mut numbers = numbers.iter().copied().cycle();
        let mut next = || numbers.next().unwrap();
        let mut program = Small::default();
        for stage in program.stages.iter_mut() {
            stage.a = SMatrix::identity() + SMatrix::from_fn(|_, _| 0.3 * next());
            stage.b = SMatrix::from_fn(|_, _| next());
            let root = SMatrix::<f64, 3, 3>::from_fn(|_, _| next());
            stage.q = root.tr_mul(&root);
            stage.q_gradient = SVector::from_fn(|_, _| 5.0 * next());
            stage.r = SVector::from_fn(|_, _| 0.05 + next().abs());
            stage.r_gradient = SVector::from_fn(|_, _| next());
            let middle = SVector::<f64, 2>::from_fn(|_, _| next());
            let half = SVector::<f64, 2>::from_fn(|_, _| 0.1 + next().abs());
            (stage.low, stage.high) = (middle - half, middle + half);
        }
        program
    }

    /// Gradient of the cost by every move, by the adjoint of the model.
    fn gradients(program: &Small) -> [SVector<f64, 2>; 6] {
        let moves: Vec<_> = program.moves().copied().collect();
        let mut x = SVector::<f64, 3>::zeros();
        let states: Vec<_> = program
            .stages
            .iter()
            .zip(&moves)
            .map(|(stage, u)| {
                x = stage.a * x + stage.b * u;
                x
            })
            .collect();
        let (mut y, mut gradients) = (SVector::<f64, 3>::zeros(), [SVector::zeros(); 6]);
        for (index, stage) in program.stages.iter().enumerate().rev() {
            y += stage.q * states[index] + stage.q_gradient;
            let own = stage.r.component_mul(&moves[index]) + stage.r_gradient;
            gradients[index] = own + stage.b.tr_mul(&y);
            y = stage.a.tr_mul(&y);
        }
        gradients
    }

    proptest! {
        /// The conditions of Karush, Kuhn and Tucker, which a convex program has at its solution alone.
        #[test]
        fn at_a_solution_no_move_within_its_limits_has_a_gradient(
            numbers in proptest::collection::vec(-1.0..1.0_f64, 229),
        ) {
            let mut program = program(&numbers);
            let iterations = program.solve().unwrap();
            prop_assert!(iterations < MOST_ITERATIONS, "{iterations}");
            let gradients = gradients(&program);
            for ((stage, u), gradient) in program.stages.iter().zip(program.moves()).zip(gradients) {
                for i in 0..2 {
                    prop_assert!(stage.low[i] - 1e-9 <= u[i] && u[i] <= stage.high[i] + 1e-9);
                    // Against a limit the gradient points out of the range.
                    let inner = (u[i] - gradient[i]).clamp(stage.low[i], stage.high[i]);
                    prop_assert!((inner - u[i]).abs() < 2e-6, "{} {} {}", inner, u[i], gradient[i]);
                }
            }
        }
    }

    #[test]
    fn without_an_active_limit_one_recursion_is_the_solution() {
        let mut program = program(&[0.3, -0.2, 0.7, 0.1, -0.5]);
        for stage in program.stages.iter_mut() {
            (stage.low, stage.high) = (SVector::repeat(-1e3), SVector::repeat(1e3));
        }
        assert_eq!(program.solve(), Some(0));
        assert!(gradients(&program).iter().all(|gradient| gradient.amax() < 1e-9));
    }

    #[test]
    fn a_program_with_a_number_that_is_not_finite_has_no_solution() {
        let mut program = program(&[0.3, -0.2, 0.7]);
        program.stages[3].q_gradient.x = f64::NAN;
        assert_eq!(program.solve(), None);
    }
}
