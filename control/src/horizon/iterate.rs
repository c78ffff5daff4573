//! Iterates of the interior-point method, and their Newton steps.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

use super::program::{HorizonProgram, MOST_STEPS, MoveBounds};

/// Penalty `c` of the slack \[1/(rad/s)\].
const PENALTY: f64 = 1e4;
/// Penalty `d` of the square of the slack \[1/(rad/s)^2\].
const SQUARE_PENALTY: f64 = 1e3;
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
    /// Change of move and state per unit of the slack.
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

/// Target of a Newton step.
#[derive(Clone, Copy)]
pub(super) struct Centre {
    /// Complementarity \[cost\].
    pub(super) target: f64,
    /// Fraction of the products of the changes in the previously computed step that the step corrects \[-\]. The full fraction
    /// makes the method cycle if the predictor step is short (M. Colombo and J. Gondzio, *Comput. Optim. Appl.* 41(3), 2008).
    pub(super) product: f64,
}

/// All steps of a horizon.
pub(super) struct Iterate<const S: usize, const M: usize> {
    steps: [Step<S, M>; MOST_STEPS],
    factors: [Factor<S, M>; MOST_STEPS],
    slack: Slack,
    count: usize,
}

impl<const S: usize, const M: usize> Iterate<S, M> {
    /// Moves in the middle of their range, a slack above every rate, and multipliers with equal complementarity.
    pub(super) fn start(
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

    /// Mean product of margin and multiplier after the fraction `share` of the Newton step.
    pub(super) fn complementarity(&self, share: f64) -> f64 {
        let steps = &self.steps[..self.count];
        let product = |step: &Step<S, M>| {
            let margin = step.margin + step.margin_change * share;
            margin.dot(&(step.dual + step.dual_change * share))
        };
        let Slack { value, dual, change, dual_change } = self.slack;
        let slack = (value + change * share) * (dual + dual_change * share);
        (steps.iter().map(product).sum::<f64>() + slack) / (4 * M * self.count + 1) as f64
    }

    /// Factorises the Newton equations of this iterate; `None` if rounding errors make them unusable.
    pub(super) fn factorise(&mut self, program: &HorizonProgram<S, M>) -> Option<()> {
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

    /// Moves and states that minimise the cost with this gradient in each step.
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

    /// Computes the Newton step to `centre`.
    pub(super) fn find_step(&mut self, program: &HorizonProgram<S, M>, centre: Centre) {
        let mut found = [Move { u: SVector::zeros(), x: SVector::zeros() }; MOST_STEPS];
        self.solve_linear(program, &mut found, |step, index| {
            let dual = step.wanted(centre);
            let u = 2.0 * (program.r * step.at.u) + dual.column(0) - dual.column(1);
            let x = 2.0 * (program.weight(index) * step.at.x);
            Move { u, x: x + on_rates(&(dual.column(2) - dual.column(3))) }
        });
        self.find_slack_step(&found, centre);
        let change = self.slack.change;
        for ((step, factor), found) in
            self.steps.iter_mut().zip(&self.factors).zip(&found).take(self.count)
        {
            let wanted = step.wanted(centre);
            step.change.u = found.u + factor.by_slack.u * change;
            step.change.x = found.x + factor.by_slack.x * change;
            step.set_margin_change(change);
            step.dual_change =
                wanted - step.dual - step.barrier().component_mul(&step.margin_change);
        }
    }

    /// Computes the Newton step of the slack; `found` is the step of the moves with constant slack.
    fn find_slack_step(&mut self, found: &[Move<S, M>; MOST_STEPS], centre: Centre) {
        let Slack { value, dual, change, dual_change } = self.slack;
        let wanted_slack = (centre.target - centre.product * change * dual_change) / value;
        let mut gradient = PENALTY + SQUARE_PENALTY * value - wanted_slack;
        let mut curvature = SQUARE_PENALTY + dual / value;
        for ((step, factor), found) in
            self.steps.iter().zip(&self.factors).zip(found).take(self.count)
        {
            let (wanted, barrier) = (step.wanted(centre), step.barrier());
            let (above, below) = (barrier.column(2), barrier.column(3));
            let coupling = below - above;
            gradient +=
                coupling.dot(&found.x.fixed_rows::<M>(0)) - wanted.fixed_columns::<2>(2).sum();
            curvature +=
                above.sum() + below.sum() + coupling.dot(&factor.by_slack.x.fixed_rows::<M>(0));
        }
        self.slack.change = -gradient / curvature;
        self.slack.dual_change = wanted_slack - dual - dual / value * self.slack.change;
    }

    /// Greatest fraction of the Newton step, up to one, with which margins and multipliers stay positive \[-\].
    pub(super) fn step_length(&self) -> f64 {
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

    /// The first move \[unit of the input\].
    pub(super) fn first(&self) -> SVector<f64, M> {
        self.steps[0].at.u
    }

    /// Greatest change of a move in the Newton step \[unit of the input\].
    pub(super) fn change(&self) -> f64 {
        self.steps[..self.count].iter().map(|step| step.change.u.amax()).fold(0.0, f64::max)
    }

    /// Advances by the fraction `share` of the Newton step.
    pub(super) fn advance(&mut self, share: f64) {
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

    /// Multipliers of `centre` for unchanged margins.
    fn wanted(&self, centre: Centre) -> PerLimit<M> {
        let second_order = self.margin_change.component_mul(&self.dual_change) * centre.product;
        second_order.zip_map(&self.margin, |second, margin| (centre.target - second) / margin)
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

/// Converts a gradient in the rates to one in the state.
fn on_rates<const S: usize, const M: usize>(rates: &SVector<f64, M>) -> SVector<f64, S> {
    let mut x = SVector::<f64, S>::zeros();
    x.fixed_rows_mut::<M>(0).copy_from(rates);
    x
}
