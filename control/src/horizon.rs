//! Linear-quadratic programs over a horizon, with limits of the input and soft limits of the rate, solved by an interior-point
//! method. Not in the paper.
//!
//! ```text
//! min  sum_{i<N} (x_i' Q x_i + u_i' R u_i) + x_N' P x_N + c s + d s^2 / 2,   x_{i+1} = A x_i + B u_i
//! with  low_u <= u_i <= high_u,   low_w - s <= w_{i+1} <= high_w + s,   s >= 0
//! ```
//!
//! `w` is the first part of the state `x`, one component for each input. The slack `s` has a linear penalty beyond every
//! multiplier that occurs, so that it is zero wherever it can be: the program always has a solution.
//!
//! Source: C. V. Rao, S. J. Wright and J. B. Rawlings, *Application of Interior-Point Methods to Model Predictive Control*, JOTA
//! 99(3), 1998, with the predictor and corrector of S. Mehrotra, *SIAM J. Optim.* 2(4), 1992. Every Newton step is a Riccati
//! recursion, so that its cost is proportional to the horizon; the slack, which couples all moves, is eliminated last, by a
//! second solution with the same factors. Iterates keep the limits. The work space is on the stack.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

/// Longest horizon \[-\].
pub const MOST_STEPS: usize = 40;
/// Most iterations of the method \[-\].
pub const MOST_ITERATIONS: u32 = 40;

/// Penalty `c` of the slack \[1/(rad/s)\].
const PENALTY: f64 = 1e4;
/// Penalty `d` of the square of the slack \[1/(rad/s)^2\].
const SQUARE_PENALTY: f64 = 1e3;
/// Greatest number in a program \[-\].
const GREATEST: f64 = 1e9;
/// Change of any move in the last Newton step: each step leaves a small part of it \[unit of the input\].
const LAST_CHANGE: f64 = 1e-7;
/// Complementarity after the last Newton step, over the curvature of the cost of a move \[square of the unit of the input\].
const LAST_COMPLEMENTARITY: f64 = 1e-14;
/// Change of any move in the last Newton step, where rounding ends the method \[unit of the input\].
const GREATEST_CHANGE: f64 = 1e-4;
/// Share of the way to the nearest limit that an iteration goes \[-\].
const BOUNDARY_SHARE: f64 = 0.999;

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
    #[must_use]
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

/// Solution of a program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HorizonSolution<const M: usize> {
    /// First move \[unit of the input\].
    pub first: SVector<f64, M>,
    /// Number of iterations \[-\].
    pub iterations: u32,
}

/// A move and the state after it.
#[derive(Clone, Copy)]
struct Move<const S: usize, const M: usize> {
    u: SVector<f64, M>,
    x: SVector<f64, S>,
}

/// A value for each limit of a step: of the input above and below, of the rate above and below.
type PerLimit<const M: usize> = SMatrix<f64, M, 4>;

/// Iterate of one step, and its Newton step.
#[derive(Clone, Copy)]
struct Step<const S: usize, const M: usize> {
    at: Move<S, M>,
    /// Distance to each limit, positive.
    margin: PerLimit<M>,
    /// Multiplier of each limit, positive.
    dual: PerLimit<M>,
    change: Move<S, M>,
    margin_change: PerLimit<M>,
    dual_change: PerLimit<M>,
}

/// Factors of one step of the Riccati recursion.
#[derive(Clone, Copy)]
struct Factor<const S: usize, const M: usize> {
    /// Factor of the curvature of the cost in the move.
    curvature: Cholesky<f64, Const<M>>,
    /// Gain from the state before the move.
    gain: SMatrix<f64, M, S>,
    /// Move and state for a slack that grows by one.
    by_slack: Move<S, M>,
}

/// A positive variable with its multiplier and its Newton step: the slack.
#[derive(Clone, Copy)]
struct Slack {
    value: f64,
    dual: f64,
    change: f64,
    dual_change: f64,
}

/// Aim of a Newton step.
#[derive(Clone, Copy)]
struct Centre {
    /// Complementarity \[cost\].
    target: f64,
    /// Share of the products of the changes in the step that was found before, which the step corrects \[-\]. The full share makes
    /// the method cycle where the predictor is short (M. Colombo and J. Gondzio, *Comput. Optim. Appl.* 41(3), 2008).
    product: f64,
}

/// All steps of a horizon.
struct Iterate<const S: usize, const M: usize> {
    steps: [Step<S, M>; MOST_STEPS],
    factors: [Factor<S, M>; MOST_STEPS],
    slack: Slack,
    count: usize,
}

impl<const S: usize, const M: usize> HorizonProgram<S, M> {
    /// Solves the program from the state `x_0`. `None` if a number is not finite or beyond those of any motion of a vehicle, or if
    /// the method does not converge.
    #[must_use]
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
                (least, first) = (change, iterate.steps[0].at.u);
            }
            iterations += 1;
        }
        (least < GREATEST_CHANGE).then_some(HorizonSolution { first, iterations })
    }

    /// Weight of the state after the move `step`.
    fn weight(&self, step: usize) -> &SMatrix<f64, S, S> {
        if step + 1 == self.steps { &self.p } else { &self.q }
    }
}

impl<const S: usize, const M: usize> Iterate<S, M> {
    /// Moves in the middle of their range, a slack beyond every rate, and multipliers of one complementarity.
    fn start(
        program: &HorizonProgram<S, M>,
        x_0: &SVector<f64, S>,
        bounds: &MoveBounds<M>,
        curvature: f64,
    ) -> Self {
        let still = Move { u: SVector::zeros(), x: SVector::zeros() };
        let zeros = PerLimit::zeros();
        let step = Step {
            at: still,
            margin: zeros,
            dual: zeros,
            change: still,
            margin_change: zeros,
            dual_change: zeros,
        };
        let factor = Factor {
            curvature: Cholesky::pack_dirty(SMatrix::identity()),
            gain: SMatrix::zeros(),
            by_slack: still,
        };
        let slack = Slack { value: 0.0, dual: 0.0, change: 0.0, dual_change: 0.0 };
        let (steps, factors) = ([step; MOST_STEPS], [factor; MOST_STEPS]);
        let mut start = Self { steps, factors, slack, count: program.steps };
        let u = (bounds.input_low + bounds.input_high) / 2.0;
        let mut x = *x_0;
        for step in &mut start.steps[..program.steps] {
            x = program.a * x + program.b * u;
            step.at = Move { u, x };
            let rate = x.fixed_rows::<M>(0);
            step.margin.set_column(0, &(bounds.input_high - u));
            step.margin.set_column(1, &(u - bounds.input_low));
            step.margin.set_column(2, &(bounds.rate_high - rate));
            step.margin.set_column(3, &(rate - bounds.rate_low));
        }
        start.centre(curvature);
        start
    }

    /// Sets the slack so that every margin is positive, and the multipliers.
    fn centre(&mut self, curvature: f64) {
        let steps = &mut self.steps[..self.count];
        let rates = |step: &Step<S, M>| step.margin.fixed_columns::<2>(2).into_owned();
        let least = steps.iter().map(|step| rates(step).min()).fold(f64::INFINITY, f64::min);
        let width = steps.iter().map(|step| rates(step).column_sum().max()).fold(0.0, f64::max);
        let value = (-least).max(0.0) + width / 2.0;
        let range = steps[0].margin.fixed_columns::<2>(0).max();
        let complementarity = 10.0 * curvature * range * range + PENALTY * value;
        for step in steps {
            step.margin.fixed_columns_mut::<2>(2).add_scalar_mut(value);
            step.dual = step.margin.map(|margin| complementarity / margin);
        }
        self.slack = Slack { value, dual: complementarity / value, change: 0.0, dual_change: 0.0 };
    }

    /// Mean product of margin and multiplier after the share `share` of the Newton step.
    fn complementarity(&self, share: f64) -> f64 {
        let steps = &self.steps[..self.count];
        let product = |step: &Step<S, M>| {
            let margin = step.margin + step.margin_change * share;
            margin.dot(&(step.dual + step.dual_change * share))
        };
        let Slack { value, dual, change, dual_change } = self.slack;
        let slack = (value + change * share) * (dual + dual_change * share);
        (steps.iter().map(product).sum::<f64>() + slack) / (4 * M * self.count + 1) as f64
    }

    /// Factors the Newton equations of this iterate; `None` if rounding spoils them.
    fn factorise(&mut self, program: &HorizonProgram<S, M>) -> Option<()> {
        let (a, b) = (&program.a, &program.b);
        let mut value = SMatrix::<f64, S, S>::zeros();
        for index in (0..self.count).rev() {
            let barrier = self.steps[index].barrier();
            value += 2.0 * program.weight(index);
            let mut r = 2.0 * program.r;
            for row in 0..M {
                r[(row, row)] += barrier[(row, 0)] + barrier[(row, 1)];
                value[(row, row)] += barrier[(row, 2)] + barrier[(row, 3)];
            }
            let by_value = b.tr_mul(&value);
            let curvature = Cholesky::new(r + by_value * b)?;
            let gain = curvature.solve(&(by_value * a));
            // The symmetric form: it loses no digits where a barrier is strong.
            let closed = a - b * gain;
            value = closed.tr_mul(&(value * closed)) + gain.tr_mul(&(r * gain));
            let factor = &mut self.factors[index];
            (factor.curvature, factor.gain) = (curvature, gain);
        }
        let mut by_slack = [Move { u: SVector::zeros(), x: SVector::zeros() }; MOST_STEPS];
        self.solve_linear(program, &mut by_slack, |step, _| {
            let barrier = step.barrier();
            let x = on_rates(&(barrier.column(3) - barrier.column(2)));
            Move { u: SVector::zeros(), x }
        });
        for (factor, by_slack) in self.factors.iter_mut().zip(by_slack) {
            factor.by_slack = by_slack;
        }
        Some(())
    }

    /// The moves and states that minimise the cost with this gradient in each step.
    fn solve_linear(
        &self,
        program: &HorizonProgram<S, M>,
        found: &mut [Move<S, M>; MOST_STEPS],
        gradient: impl Fn(&Step<S, M>, usize) -> Move<S, M>,
    ) {
        let (a, b) = (&program.a, &program.b);
        let mut y = SVector::<f64, S>::zeros();
        for index in (0..self.count).rev() {
            let factor = &self.factors[index];
            let Move { mut u, x } = gradient(&self.steps[index], index);
            y += x;
            u += b.tr_mul(&y);
            found[index].u = -factor.curvature.solve(&u);
            y = a.tr_mul(&y) - factor.gain.tr_mul(&u);
        }
        let mut x = SVector::<f64, S>::zeros();
        for (found, factor) in found.iter_mut().zip(&self.factors).take(self.count) {
            found.u -= factor.gain * x;
            x = a * x + b * found.u;
            found.x = x;
        }
    }

    /// Finds the Newton step to `centre`.
    fn find_step(&mut self, program: &HorizonProgram<S, M>, centre: Centre) {
        let Centre { target, product } = centre;
        let wanted = |step: &Step<S, M>| -> PerLimit<M> {
            let second_order = step.margin_change.component_mul(&step.dual_change) * product;
            second_order.zip_map(&step.margin, |second, margin| (target - second) / margin)
        };
        let mut found = [Move { u: SVector::zeros(), x: SVector::zeros() }; MOST_STEPS];
        self.solve_linear(program, &mut found, |step, index| {
            let dual = wanted(step);
            let u = 2.0 * (program.r * step.at.u) + dual.column(0) - dual.column(1);
            let x = 2.0 * (program.weight(index) * step.at.x);
            Move { u, x: x + on_rates(&(dual.column(2) - dual.column(3))) }
        });
        let Slack { value, dual, change, dual_change } = self.slack;
        let wanted_slack = (target - product * change * dual_change) / value;
        let mut gradient = PENALTY + SQUARE_PENALTY * value - wanted_slack;
        let mut curvature = SQUARE_PENALTY + dual / value;
        for ((step, factor), found) in
            self.steps.iter().zip(&self.factors).zip(&found).take(self.count)
        {
            let (wanted, barrier) = (wanted(step), step.barrier());
            let (above, below) = (barrier.column(2), barrier.column(3));
            let coupling = below - above;
            gradient +=
                coupling.dot(&found.x.fixed_rows::<M>(0)) - wanted.fixed_columns::<2>(2).sum();
            curvature +=
                above.sum() + below.sum() + coupling.dot(&factor.by_slack.x.fixed_rows::<M>(0));
        }
        let change = -gradient / curvature;
        self.slack.dual_change = wanted_slack - dual - dual / value * change;
        self.slack.change = change;
        for ((step, factor), found) in
            self.steps.iter_mut().zip(&self.factors).zip(&found).take(self.count)
        {
            let wanted = wanted(step);
            step.change.u = found.u + factor.by_slack.u * change;
            step.change.x = found.x + factor.by_slack.x * change;
            step.set_margin_change(change);
            step.dual_change =
                wanted - step.dual - step.barrier().component_mul(&step.margin_change);
        }
    }

    /// Greatest share of the Newton step, up to one, with which margins and multipliers stay positive \[-\].
    fn step_length(&self) -> f64 {
        let share = |value: f64, change: f64| if change < 0.0 { -value / change } else { 1.0 };
        let Slack { value, dual, change, dual_change } = self.slack;
        let mut least = share(value, change).min(share(dual, dual_change)).min(1.0);
        for step in &self.steps[..self.count] {
            for (values, changes) in
                [(&step.margin, &step.margin_change), (&step.dual, &step.dual_change)]
            {
                least =
                    values.iter().zip(changes).map(|(v, c)| share(*v, *c)).fold(least, f64::min);
            }
        }
        least
    }

    /// Greatest change of a move in the Newton step \[unit of the input\].
    fn change(&self) -> f64 {
        self.steps[..self.count].iter().map(|step| step.change.u.amax()).fold(0.0, f64::max)
    }

    /// Goes the share `share` of the Newton step.
    fn advance(&mut self, share: f64) {
        self.slack.value += share * self.slack.change;
        self.slack.dual += share * self.slack.dual_change;
        for step in &mut self.steps[..self.count] {
            step.at.u += share * step.change.u;
            step.at.x += share * step.change.x;
            step.margin += share * step.margin_change;
            step.dual += share * step.dual_change;
        }
    }
}

impl<const S: usize, const M: usize> Step<S, M> {
    /// Curvature of the barrier of each limit.
    fn barrier(&self) -> PerLimit<M> {
        self.dual.component_div(&self.margin)
    }

    /// Sets the change of the margins for a slack that changes by `slack`.
    fn set_margin_change(&mut self, slack: f64) {
        let Move { u, x } = &self.change;
        let rate = x.fixed_rows::<M>(0).into_owned();
        self.margin_change.set_column(0, &-u);
        self.margin_change.set_column(1, u);
        self.margin_change.set_column(2, &(-rate).add_scalar(slack));
        self.margin_change.set_column(3, &rate.add_scalar(slack));
    }
}

/// A gradient in the rates as one in the state.
fn on_rates<const S: usize, const M: usize>(rates: &SVector<f64, M>) -> SVector<f64, S> {
    let mut x = SVector::<f64, S>::zeros();
    x.fixed_rows_mut::<M>(0).copy_from(rates);
    x
}
