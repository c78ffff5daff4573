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
    /// Whether a move and the rate after it are within the limits.
    pub(super) fn allow(&self, u: &Vector3<f64>, omega_e: &Vector3<f64>) -> bool {
        let within = |value: &Vector3<f64>, [low, high]: &[Vector3<f64>; 2]| {
            (0..3).all(|axis| (low[axis]..=high[axis]).contains(&value[axis]))
        };
        within(u, &self.input) && within(omega_e, &self.rate)
    }
}

/// The data of the program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct QuadraticProgram {
    pub(super) a: Matrix6<f64>,
    pub(super) b: Matrix6x3<f64>,
    pub(super) q: Matrix6<f64>,
    pub(super) r: Matrix3<f64>,
    pub(super) p: Matrix6<f64>,
    /// Number of moves \[-\].
    pub(super) steps: usize,
}

/// `minimise 1/2 z' h z + f' z` with `g z <= k`.
struct Condensed {
    h: DMatrix<f64>,
    f: DVector<f64>,
    g: DMatrix<f64>,
    k: DVector<f64>,
}

impl QuadraticProgram {
    /// The first move from the error `x_0`; `None` if the solver finds none.
    pub(super) fn first_move(
        &self,
        x_0: &Vector6<f64>,
        bounds: &MoveBounds,
    ) -> Option<Vector3<f64>> {
        let Condensed { h, f, g, k } = self.condensed(x_0, bounds);
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
        let first = Vector3::from_iterator(solution.x.iter().take(3).copied());
        (is_solved && first.iter().all(|u| u.is_finite())).then_some(first)
    }

    /// States after the moves: `x_1 .. x_N` without a move, and per move.
    fn prediction(&self, x_0: &Vector6<f64>) -> (DVector<f64>, DMatrix<f64>) {
        let steps = self.steps;
        let (mut free, mut by_moves) =
            (DVector::zeros(6 * steps), DMatrix::zeros(6 * steps, 3 * steps + 1));
        let (mut x, mut effect) = (*x_0, self.b);
        for step in 0..steps {
            x = self.a * x;
            free.fixed_rows_mut::<6>(6 * step).copy_from(&x);
            for later in step..steps {
                let mut block = by_moves.fixed_view_mut::<6, 3>(6 * later, 3 * (later - step));
                block.copy_from(&effect);
            }
            effect = self.a * effect;
        }
        (free, by_moves)
    }

    fn condensed(&self, x_0: &Vector6<f64>, bounds: &MoveBounds) -> Condensed {
        let (steps, slack) = (self.steps, 3 * self.steps);
        let (free, by_moves) = self.prediction(x_0);
        let mut weighted = by_moves.clone();
        for step in 0..steps {
            let weight = if step + 1 == steps { self.p } else { self.q };
            let mut rows = weighted.fixed_rows_mut::<6>(6 * step);
            let product = weight * &rows;
            rows.copy_from(&product);
        }
        let mut h = 2.0 * by_moves.tr_mul(&weighted);
        let mut f = 2.0 * weighted.tr_mul(&free);
        for step in 0..steps {
            let mut block = h.fixed_view_mut::<3, 3>(3 * step, 3 * step);
            block += 2.0 * self.r;
        }
        f[slack] = PENALTY[0];
        h[(slack, slack)] = PENALTY[1];
        let (g, k) = self.limits((&free, &by_moves), bounds);
        Condensed { h, f, g, k }
    }

    /// The limits as `g z <= k`: of inputs, of rates with the slack, and that the slack is not negative.
    fn limits(
        &self,
        (free, by_moves): (&DVector<f64>, &DMatrix<f64>),
        bounds: &MoveBounds,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let (count, slack) = (3 * self.steps, 3 * self.steps);
        let (mut g, mut k) =
            (DMatrix::zeros(4 * count + 1, slack + 1), DVector::zeros(4 * count + 1));
        for index in 0..count {
            let (step, axis) = (index / 3, index % 3);
            let state = 6 * step + axis;
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
