//! Time of the quadratic programs of `mpc` at the longest horizon: typical, and in the worst of many states.
//!
//! The time is bounded by the maximum number of iterations, [`MOST_ITERATIONS`], times the time of one iteration.

#![allow(clippy::disallowed_methods, reason = "a benchmark reads the clock")]

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, Matrix6, SVector, Vector3};
use oqtal_control::controller::{InputForm, OqtalDt, RateInput, TorqueInput};
use oqtal_control::horizon::{HorizonProgram, MOST_ITERATIONS, MOST_STEPS, MoveBounds};
use oqtal_control::riccati::dare;
use oqtal_control::rigid_body::Inertia;

const PERIOD_S: f64 = 1.0 / 60.0;
/// Number of states for which a program is solved.
const STATES: usize = 2_000;
/// Number of repetitions, of which the fastest counts, since interruptions slow down the others.
const REPETITIONS: usize = 5;

/// The program of all axes of a vehicle commanded through `input`.
fn program(input: &impl InputForm, weights: [f64; 2]) -> HorizonProgram<6, 3> {
    let (a, b) = OqtalDt::plant(input, PERIOD_S);
    let q = Matrix6::from_diagonal(&SVector::from_fn(|row, _| weights[row / 3]));
    let r = Matrix3::identity();
    let p = dare(&a, &b, &q, &r).expect("the plant can be controlled").p;
    HorizonProgram { a, b, q, r, p, steps: MOST_STEPS }
}

fn bounds(input: f64, rate: f64) -> MoveBounds<3> {
    let [input, rate] = [input, rate].map(Vector3::repeat);
    MoveBounds { input_low: -input, input_high: input, rate_low: -rate, rate_high: rate }
}

/// State number `index` of a sequence that covers rates and errors uniformly.
fn state(index: usize) -> SVector<f64, 6> {
    const STRIDES: [f64; 6] = [0.7548, 0.5698, 0.4302, 0.3247, 0.2451, 0.1851];
    SVector::from_fn(|row, _| {
        let share = (STRIDES[row] * index as f64).fract() * 2.0 - 1.0;
        if row < 3 { 4.0 * share } else { 0.9 * share }
    })
}

/// Prints iterations and time of the slowest program, and times that of half the states.
fn slowest(
    criterion: &mut Criterion,
    name: &str,
    of: &HorizonProgram<6, 3>,
    limits: &MoveBounds<3>,
) {
    let time = |index| {
        let solve = || {
            let start = Instant::now();
            let solution = black_box(of.solve(&black_box(state(index)), limits));
            (start.elapsed(), solution)
        };
        let fastest = (0..REPETITIONS).map(|_| solve()).min_by_key(|solved| solved.0);
        fastest.expect("it is solved more than once")
    };
    let solved: Vec<_> = (0..STATES).map(time).collect();
    let longest = solved.iter().map(|(time, _)| *time).max().unwrap_or_default();
    let iterations = |solved: &(Duration, _)| {
        let (_, solution): &(_, Option<oqtal_control::horizon::HorizonSolution<3>>) = solved;
        solution.map_or(MOST_ITERATIONS, |solution| solution.iterations)
    };
    let most = solved.iter().map(iterations).max().unwrap_or_default();
    let unsolved = solved.iter().filter(|(_, solution)| solution.is_none()).count();
    println!(
        "{name}, {MOST_STEPS} moves, {STATES} states: at most {most} of {MOST_ITERATIONS} iterations, {longest:?}; {unsolved} unsolved"
    );
    criterion.bench_function(name, |bench| bench.iter(|| of.solve(&black_box(state(7)), limits)));
}

fn horizon(criterion: &mut Criterion) {
    let sticks =
        RateInput::new(Vector3::repeat(2.0)).and_then(|input| input.with_lag(0.05, PERIOD_S));
    let sticks = sticks.expect("the authority is positive");
    slowest(criterion, "sticks", &program(&sticks, [0.0125, 1250.0]), &bounds(1.0, 2.0));
    let inertia = Matrix3::new(0.6, 0.05, -0.02, 0.05, 0.5, 0.03, -0.02, 0.03, 0.7);
    let inertia = Inertia::new(inertia).expect("the inertia is positive definite");
    let torque = TorqueInput::new(inertia, 5.0).expect("the torque is positive");
    slowest(criterion, "torque", &program(&torque, [64.0, 16384.0]), &bounds(5.0, 2.0));
}

criterion_group!(benches, horizon);
criterion_main!(benches);
