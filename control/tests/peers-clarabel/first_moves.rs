//! First moves of random programs, found by [`HorizonProgram::solve`] and by Clarabel.
#![cfg(test)]

mod box_moves;

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::{NonnegativeConeT, ZeroConeT};
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use oqtal_control::horizon::{HorizonProgram, MOST_STEPS, MoveBounds};
use oqtal_control::linear::discretise;
use oqtal_control::riccati::dare;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Number of programs of an axis, and as many of three axes that affect each other \[-\].
const PROGRAMS: usize = 5_000;
/// Greatest difference of a first move \[unit of the input\].
const GREATEST_DIFFERENCE: f64 = 1e-6;
/// Penalties of the slack, as in [`HorizonProgram`] \[1/(rad/s), 1/(rad/s)^2\].
const PENALTIES: [f64; 2] = [1e4, 1e3];
/// Tolerance of Clarabel \[-\].
const TOLERANCE: f64 = 1e-12;

/// A program, its start and its limits.
struct Case<const S: usize, const M: usize> {
    program: HorizonProgram<S, M>,
    x_0: SVector<f64, S>,
    bounds: MoveBounds<M>,
    /// The first move without limits.
    free: SVector<f64, M>,
}

/// A number between the bounds, evenly in its logarithm.
fn log(random: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    random.random_range(low.ln()..high.ln()).exp()
}

impl<const S: usize, const M: usize> Case<S, M> {
    /// A vehicle of `M` axes with the states `[omega_e; eps]`: any lag, authority, coupling, weights, horizon, limits and error.
    fn random(random: &mut ChaCha8Rng) -> Self {
        let (lag_s, authority) = (log(random, 0.01, 1.0), log(random, 0.5, 8.0));
        let (mut a, mut b) = (SMatrix::<f64, S, S>::zeros(), SMatrix::<f64, S, M>::zeros());
        for axis in 0..M {
            a[(axis, axis)] = -1.0 / lag_s;
            a[(axis + M, axis)] = 0.5;
            for input in 0..M {
                let coupling = if axis == input { 1.0 } else { random.random_range(-0.1..0.1) };
                b[(axis, input)] = coupling * authority / lag_s;
            }
        }
        let (a, b) = discretise(&a, &b, 1.0 / 60.0);
        let [rate, attitude] = [log(random, 1e-3, 100.0), log(random, 1.0, 1e6)];
        let q = SMatrix::from_diagonal(&SVector::from_fn(
            |row, _| if row < M { rate } else { attitude },
        ));
        let r = SMatrix::identity() * log(random, 0.1, 10.0);
        let regulator = dare(&a, &b, &q, &r).expect("the vehicle can be controlled");
        let steps = random.random_range(1..=MOST_STEPS);
        let program = HorizonProgram { a, b, q, r, p: regulator.p, steps };
        let x_0 = SVector::from_fn(|row, _| {
            let greatest = if row < M { 3.0 } else { 0.7 };
            random.random_range(-greatest..greatest)
        });
        let (input, fastest) = (log(random, 0.1, 20.0), log(random, 0.1, 5.0));
        let u_ref = SVector::<f64, M>::from_fn(|_, _| input * random.random_range(-0.9..0.9));
        let omega_ref = SVector::<f64, M>::from_fn(|_, _| fastest * random.random_range(-1.5..1.5));
        let bounds = MoveBounds {
            input_low: u_ref.add_scalar(-input),
            input_high: u_ref.add_scalar(input),
            rate_low: omega_ref.add_scalar(-fastest),
            rate_high: omega_ref.add_scalar(fastest),
        };
        Self { program, x_0, bounds, free: -regulator.k * x_0 }
    }

    /// The first move by Clarabel, whose variables are `[u_0; x_1; u_1; x_2; ..; s]`; `None` if it does not reach its tolerance.
    fn by_clarabel(&self) -> Option<Vec<f64>> {
        let (width, steps) = (S + M, self.program.steps);
        let (dynamics, variables) = (steps * S, steps * width + 1);
        let mut h = DMatrix::zeros(variables, variables);
        let mut f = DVector::zeros(variables);
        let mut g = DMatrix::zeros(dynamics + 4 * M * steps + 1, variables);
        let mut k = DVector::zeros(g.nrows());
        for step in 0..steps {
            self.add_cost(&mut h, step);
            self.add_dynamics(&mut g, &mut k, step);
            self.add_limits(&mut g, &mut k, step);
        }
        let slack = variables - 1;
        (f[slack], h[(slack, slack)]) = (PENALTIES[0], PENALTIES[1]);
        let last = g.nrows() - 1;
        g[(last, slack)] = -1.0;
        let cones = [ZeroConeT(dynamics), NonnegativeConeT(4 * M * steps + 1)];
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .tol_gap_abs(TOLERANCE)
            .tol_gap_rel(TOLERANCE)
            .tol_feas(TOLERANCE)
            .build()
            .expect("the settings are valid");
        let (h, g) = (sparse(&h.upper_triangle()), sparse(&g));
        let solver = DefaultSolver::new(&h, f.as_slice(), &g, k.as_slice(), &cones, settings);
        let mut solver = solver.expect("the program is well formed");
        solver.solve();
        let is_solved = solver.solution.status == SolverStatus::Solved;
        is_solved.then(|| solver.solution.x[..M].to_vec())
    }

    fn add_cost(&self, h: &mut DMatrix<f64>, step: usize) {
        let HorizonProgram { q, r, p, steps, .. } = &self.program;
        let u = step * (S + M);
        let weight = if step + 1 == *steps { p } else { q };
        h.view_mut((u, u), (M, M)).copy_from(&(2.0 * r));
        h.view_mut((u + M, u + M), (S, S)).copy_from(&(2.0 * weight));
    }

    /// `x_{i+1} - A x_i - B u_i = 0`.
    fn add_dynamics(&self, g: &mut DMatrix<f64>, k: &mut DVector<f64>, step: usize) {
        let HorizonProgram { a, b, .. } = &self.program;
        let (row, u) = (step * S, step * (S + M));
        g.view_mut((row, u), (S, M)).copy_from(&-b);
        g.view_mut((row, u + M), (S, S)).fill_with_identity();
        match step {
            0 => k.rows_mut(0, S).copy_from(&(a * self.x_0)),
            _ => g.view_mut((row, u - S), (S, S)).copy_from(&-a),
        }
    }

    /// The limits of input and rate, those of the rate with the slack.
    fn add_limits(&self, g: &mut DMatrix<f64>, k: &mut DVector<f64>, step: usize) {
        let MoveBounds { input_low, input_high, rate_low, rate_high } = &self.bounds;
        let slack = g.ncols() - 1;
        for axis in 0..M {
            let row = self.program.steps * S + 4 * (step * M + axis);
            let u = step * (S + M) + axis;
            (g[(row, u)], k[row]) = (1.0, input_high[axis]);
            (g[(row + 1, u)], k[row + 1]) = (-1.0, -input_low[axis]);
            (g[(row + 2, u + M)], k[row + 2]) = (1.0, rate_high[axis]);
            (g[(row + 3, u + M)], k[row + 3]) = (-1.0, -rate_low[axis]);
            (g[(row + 2, slack)], g[(row + 3, slack)]) = (-1.0, -1.0);
        }
    }
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

fn compare<const S: usize, const M: usize>(name: &str, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut worst, mut iterations, mut without, mut limited) = (0.0_f64, 0, 0, 0);
    let (mut compared, mut unsolved) = (0, 0);
    while compared < PROGRAMS {
        let case = Case::<S, M>::random(&mut random);
        let Case { program, x_0, bounds, free } = &case;
        let Some(ours) = program.solve(x_0, bounds) else {
            unsolved += 1;
            continue;
        };
        let Some(theirs) = case.by_clarabel() else {
            without += 1;
            continue;
        };
        limited += usize::from((free - ours.first).amax() > 1e-3);
        let difference = (ours.first - SVector::from_column_slice(&theirs)).amax();
        assert!(difference < GREATEST_DIFFERENCE, "program {compared}: {difference:e} apart");
        worst = worst.max(difference);
        iterations = iterations.max(ours.iterations);
        compared += 1;
    }
    println!(
        "{name}: {compared} programs, {limited} of them limited, at most {worst:.1e} apart and {iterations} iterations; \
         {without} further ones left out, for which Clarabel does not reach {TOLERANCE:e}"
    );
    println!(
        "{name}: {unsolved} without a solution within the bound of iterations; the law then clips its plan"
    );
    assert!(unsolved <= PROGRAMS / 1000 && without < PROGRAMS / 20 && limited > PROGRAMS / 2);
}

#[test]
fn an_axis_has_the_first_move_of_clarabel() {
    compare::<2, 1>("one axis", 1);
}

#[test]
fn three_axes_have_the_first_moves_of_clarabel() {
    compare::<6, 3>("three axes", 2);
}
