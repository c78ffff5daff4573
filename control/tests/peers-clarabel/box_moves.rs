//! Moves of random programs of `oqtal-rivals`, found by [`BoxProgram::solve`] and by Clarabel.

use clarabel::solver::SupportedConeT::NonnegativeConeT;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus};
use nalgebra::{Const, DMatrix, DVector, Dyn, OMatrix, SMatrix, SVector};
use oqtal_rivals::program::{BoxProgram, MOST_ITERATIONS};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{TOLERANCE, log, sparse};

/// Number of programs \[-\].
const PROGRAMS: usize = 1_000;
/// Greatest difference of a move \[unit of the move\].
const GREATEST_DIFFERENCE: f64 = 1e-6;
/// States, inputs and steps: those of the law.
const S: usize = 13;
const M: usize = 4;
const N: usize = 20;

/// A program with any weights and limits, whose model changes from step to step.
fn fill(program: &mut BoxProgram<S, M, N>, random: &mut ChaCha8Rng) {
    let (weight, range) = (log(random, 0.01, 100.0), log(random, 0.05, 5.0));
    for stage in program.stages.iter_mut() {
        let mut even = || random.random_range(-1.0..1.0);
        stage.a = SMatrix::identity() * 0.98 + SMatrix::from_fn(|_, _| 0.05 * even());
        stage.b = SMatrix::from_fn(|_, _| 0.3 * even());
        stage.q = SMatrix::from_diagonal(&SVector::from_fn(|_, _| weight * even().powi(2)));
        stage.q_gradient = SVector::from_fn(|_, _| weight * even());
        stage.r = SVector::from_fn(|_, _| 0.1 + even().abs());
        stage.r_gradient = SVector::from_fn(|_, _| even());
        let middle = SVector::<f64, M>::from_fn(|_, _| 0.9 * range * even());
        (stage.low, stage.high) = (middle.add_scalar(-range), middle.add_scalar(range));
    }
}

/// The moves by Clarabel, in the moves alone; `None` if it does not reach its tolerance.
fn by_clarabel(program: &BoxProgram<S, M, N>) -> Option<Vec<f64>> {
    let variables = N * M;
    let (mut h, mut f) = (DMatrix::zeros(variables, variables), DVector::zeros(variables));
    // State after each step, as a product with all moves.
    let mut by_moves = OMatrix::<f64, Const<S>, Dyn>::zeros(variables);
    let mut limits = DVector::zeros(2 * variables);
    for (index, stage) in program.stages.iter().enumerate() {
        by_moves = stage.a * by_moves;
        let mut own = by_moves.fixed_columns_mut::<M>(index * M);
        own += stage.b;
        h += by_moves.tr_mul(&(stage.q * &by_moves));
        f += by_moves.tr_mul(&stage.q_gradient);
        for axis in 0..M {
            let row = index * M + axis;
            h[(row, row)] += stage.r[axis];
            f[row] += stage.r_gradient[axis];
            (limits[row], limits[variables + row]) = (stage.high[axis], -stage.low[axis]);
        }
    }
    let identity = DMatrix::<f64>::identity(variables, variables);
    let mut g = DMatrix::zeros(2 * variables, variables);
    g.rows_mut(0, variables).copy_from(&identity);
    g.rows_mut(variables, variables).copy_from(&-identity);
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .tol_gap_abs(TOLERANCE)
        .tol_gap_rel(TOLERANCE)
        .tol_feas(TOLERANCE)
        .build()
        .expect("the settings are valid");
    let cones = [NonnegativeConeT(2 * variables)];
    let (h, g) = (sparse(&h.upper_triangle()), sparse(&g));
    let solver = DefaultSolver::new(&h, f.as_slice(), &g, limits.as_slice(), &cones, settings);
    let mut solver = solver.expect("the program is well formed");
    solver.solve();
    (solver.solution.status == SolverStatus::Solved).then(|| solver.solution.x.clone())
}

#[test]
fn a_program_of_the_nonlinear_law_has_the_moves_of_clarabel() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut program = BoxProgram::<S, M, N>::default();
    let (mut worst, mut most, mut limited, mut without) = (0.0_f64, 0, 0, 0);
    for number in 0..PROGRAMS {
        fill(&mut program, &mut random);
        let iterations = program.solve().expect("the numbers are finite");
        let Some(theirs) = by_clarabel(&program) else {
            without += 1;
            continue;
        };
        let ours = program.moves().flat_map(|u| u.iter().copied());
        let difference = ours.zip(theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(difference < GREATEST_DIFFERENCE, "program {number}: {difference:e} apart");
        (worst, most) = (worst.max(difference), most.max(iterations));
        limited += usize::from(iterations > 0);
    }
    println!(
        "box programs: {limited} of {PROGRAMS} limited, at most {worst:.1e} apart and {most} iterations; {without} left out, for which \
         Clarabel does not reach {TOLERANCE:e}"
    );
    assert!(most < MOST_ITERATIONS && limited > PROGRAMS / 2 && without < PROGRAMS / 20);
}
