//! The quadratic program of a horizon, condensed to its moves, and its solution by Clarabel.
//!
//! ```text
//! min 1/2 z' H z + f' z,  z = [u_0 .. u_{N-1}; s]:  x_i = A^i x_0 + sum_{j<i} A^{i-1-j} B u_j
//! ```
//!
//! `s` is a slack of the limits of the rate, with a linear penalty beyond every multiplier that occurs, so that it is zero
//! wherever it can be.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT,
    SolverStatus,
};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Matrix6x3, Vector3, Vector6};

/// Most iterations of the solver \[-\].
const MOST_ITERATIONS: u32 = 40;
/// Penalty of the slack, linear and quadratic \[1/(rad/s), 1/(rad/s)^2\].
const PENALTY: [f64; 2] = [1e4, 1e3];

/// Part of the greatest element of a matrix below which another one is a rounding error \[-\].
const ROUNDING: f64 = 1e-9;
/// Greatest number in a program \[-\].
const GREATEST: f64 = 1e9;

/// The limits of the moves, lower and upper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MoveBounds {
    /// Of the input \[N m, body axes, in rate form -1..1\].
    pub(super) input: [Vector3<f64>; 2],
    /// Of `omega_e` \[rad/s, body axes\].
    pub(super) rate: [Vector3<f64>; 2],
}

impl MoveBounds {
    /// Whether the move of an axis and the rate after it are within the limits.
    pub(super) fn allow(&self, u: &Vector3<f64>, omega_e: f64, axis: usize) -> bool {
        let within =
            |value: f64, [low, high]: &[Vector3<f64>; 2]| (low[axis]..=high[axis]).contains(&value);
        within(u[axis], &self.input) && within(omega_e, &self.rate)
    }
}

/// The data of the program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct QuadraticProgram {
    /// `A` of the state `[omega_e; eps]` \[rad/s and -, body\].
    pub(super) a: Matrix6<f64>,
    /// `B`, from the input to the state \[per unit of the input\].
    pub(super) b: Matrix6x3<f64>,
    /// `Q`, the weight of the state \[per square of its unit\].
    pub(super) q: Matrix6<f64>,
    /// `R`, the weight of the input \[per square of its unit\].
    pub(super) r: Matrix3<f64>,
    /// `P`, the weight of the last state \[per square of its unit\].
    pub(super) p: Matrix6<f64>,
    /// Number of moves \[-\].
    pub(super) steps: usize,
}

/// The program of some axes with their states `[omega_e; eps]`, and the error it starts from.
struct AxesProgram {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    q: DMatrix<f64>,
    r: DMatrix<f64>,
    p: DMatrix<f64>,
    x_0: DVector<f64>,
    steps: usize,
}

/// `minimise 1/2 z' h z + f' z` with `g z <= k`.
struct Condensed {
    h: DMatrix<f64>,
    f: DVector<f64>,
    g: DMatrix<f64>,
    k: DVector<f64>,
}

impl QuadraticProgram {
    /// Whether no axis affects another.
    fn is_decoupled(&self) -> bool {
        let apart = |row: usize, column: usize, element: f64, greatest: f64| {
            row % 3 == column % 3 || element.abs() <= ROUNDING * greatest
        };
        let square = |m: &Matrix6<f64>| {
            let greatest = m.amax();
            (0..36).all(|i| apart(i % 6, i / 6, m[i], greatest))
        };
        let greatest = self.b.amax();
        square(&self.a)
            && square(&self.p)
            && (0..18).all(|i| apart(i % 6, i / 6, self.b[i], greatest))
    }

    /// The first moves of the axes that are `broken`, of all if axes affect each other, from the error `x_0`; `None` for an axis for
    /// which the solver has none.
    pub(super) fn first_moves(
        &self,
        x_0: &Vector6<f64>,
        bounds: &MoveBounds,
        broken: [bool; 3],
    ) -> [Option<f64>; 3] {
        let mut moves = [None; 3];
        if self.is_decoupled() {
            for axis in (0..3).filter(|axis| broken[*axis]) {
                let found = self.of(&[axis], x_0).solve(bounds, &[axis]);
                moves[axis] = found.and_then(|moves| moves.first().copied());
            }
        } else if broken.contains(&true)
            && let Some(found) = self.of(&[0, 1, 2], x_0).solve(bounds, &[0, 1, 2])
        {
            moves.iter_mut().zip(found).for_each(|(place, found)| *place = Some(found));
        }
        moves
    }

    /// The program of `axes` alone.
    fn of(&self, axes: &[usize], x_0: &Vector6<f64>) -> AxesProgram {
        let states: Vec<usize> =
            axes.iter().copied().chain(axes.iter().map(|axis| axis + 3)).collect();
        let count = states.len();
        let part =
            |m: &Matrix6<f64>| DMatrix::from_fn(count, count, |i, j| m[(states[i], states[j])]);
        AxesProgram {
            a: part(&self.a),
            b: DMatrix::from_fn(count, axes.len(), |i, j| self.b[(states[i], axes[j])]),
            q: part(&self.q),
            r: DMatrix::from_fn(axes.len(), axes.len(), |i, j| self.r[(axes[i], axes[j])]),
            p: part(&self.p),
            x_0: DVector::from_fn(count, |i, _| x_0[states[i]]),
            steps: self.steps,
        }
    }
}

impl AxesProgram {
    /// Number of inputs \[-\].
    fn inputs(&self) -> usize {
        self.b.ncols()
    }

    /// The first move of each of `axes`; `None` if the solver finds none.
    fn solve(&self, bounds: &MoveBounds, axes: &[usize]) -> Option<Vec<f64>> {
        let Condensed { h, f, g, k } = self.condensed(bounds, axes);
        // What no motion of a vehicle leads to is not given to the solver.
        if !f.iter().chain(&k).all(|number| number.abs() < GREATEST) {
            return None;
        }
        let cones = [NonnegativeConeT(g.nrows())];
        let (h, g) = (sparse(&h.upper_triangle()), sparse(&g));
        let mut solver =
            DefaultSolver::new(&h, f.as_slice(), &g, k.as_slice(), &cones, settings()?).ok()?;
        solver.solve();
        let solution = &solver.solution;
        let is_solved =
            matches!(solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
        let first = solution.x.get(..self.inputs())?.to_vec();
        (is_solved && first.iter().all(|u| u.is_finite())).then_some(first)
    }

    /// States after the moves: `x_1 .. x_N` without a move, and per move.
    fn prediction(&self) -> (DVector<f64>, DMatrix<f64>) {
        let (steps, states, inputs) = (self.steps, self.a.nrows(), self.inputs());
        let mut free = DVector::zeros(states * steps);
        let mut by_moves = DMatrix::zeros(states * steps, inputs * steps + 1);
        let (mut x, mut effect) = (self.x_0.clone(), self.b.clone());
        for step in 0..steps {
            x = &self.a * x;
            free.rows_mut(states * step, states).copy_from(&x);
            for later in step..steps {
                let corner = (states * later, inputs * (later - step));
                by_moves.view_mut(corner, (states, inputs)).copy_from(&effect);
            }
            effect = &self.a * effect;
        }
        (free, by_moves)
    }

    fn condensed(&self, bounds: &MoveBounds, axes: &[usize]) -> Condensed {
        let (steps, states, inputs) = (self.steps, self.a.nrows(), self.inputs());
        let slack = inputs * steps;
        let (free, by_moves) = self.prediction();
        let mut weighted = by_moves.clone();
        for step in 0..steps {
            let weight = if step + 1 == steps { &self.p } else { &self.q };
            let mut rows = weighted.rows_mut(states * step, states);
            let product = weight * &rows;
            rows.copy_from(&product);
        }
        let mut h = 2.0 * by_moves.tr_mul(&weighted);
        let mut f = 2.0 * weighted.tr_mul(&free);
        for step in 0..steps {
            let mut block = h.view_mut((inputs * step, inputs * step), (inputs, inputs));
            block += 2.0 * &self.r;
        }
        f[slack] = PENALTY[0];
        h[(slack, slack)] = PENALTY[1];
        let (g, k) = self.limits((&free, &by_moves), (bounds, axes));
        Condensed { h, f, g, k }
    }

    /// The limits as `g z <= k`: of inputs, of rates with the slack, and that the slack is not negative.
    fn limits(
        &self,
        (free, by_moves): (&DVector<f64>, &DMatrix<f64>),
        (bounds, axes): (&MoveBounds, &[usize]),
    ) -> (DMatrix<f64>, DVector<f64>) {
        let inputs = self.inputs();
        let (count, slack) = (inputs * self.steps, inputs * self.steps);
        let (mut g, mut k) =
            (DMatrix::zeros(4 * count + 1, slack + 1), DVector::zeros(4 * count + 1));
        for index in 0..count {
            let (step, input) = (index / inputs, index % inputs);
            let (state, axis) = (self.a.nrows() * step + input, axes[input]);
            for (side, sign) in [-1.0, 1.0].into_iter().enumerate() {
                let of_input = 2 * index + side;
                g[(of_input, index)] = sign;
                k[of_input] = sign * bounds.input[side][axis];
                let of_rate = 2 * count + of_input;
                g.row_mut(of_rate).copy_from(&(sign * by_moves.row(state)));
                g[(of_rate, slack)] = -1.0;
                k[of_rate] = sign * (bounds.rate[side][axis] - free[state]);
            }
        }
        g[(4 * count, slack)] = -1.0;
        (g, k)
    }
}

fn settings() -> Option<DefaultSettings<f64>> {
    DefaultSettingsBuilder::default()
        .verbose(false)
        .max_iter(MOST_ITERATIONS)
        .max_threads(1)
        .build()
        .ok()
}

/// The non-zero elements of a matrix, column by column.
fn sparse(matrix: &DMatrix<f64>) -> CscMatrix<f64> {
    let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for column in matrix.column_iter() {
        for (row, value) in column.iter().enumerate().filter(|(_, value)| **value != 0.0) {
            rows.push(row);
            values.push(*value);
        }
        starts.push(rows.len());
    }
    CscMatrix::new(matrix.nrows(), matrix.ncols(), starts, rows, values)
}
