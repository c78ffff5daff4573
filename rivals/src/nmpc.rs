//! Nonlinear model predictive control of the position.
//!
//! ```text
//! min  sum_k |x_k - x_r,k|^2_Q + |u_k - u_r,k|^2_R,   x_{k+1} = f(x_k, u_k),   |rate command| and thrust within their range
//! ```
//!
//! Source: S. Sun, A. Romero, P. Foehn, E. Kaufmann and D. Scaramuzza, *A Comparative Study of Nonlinear MPC and
//! Differential-Flatness-Based Control for Quadrotor Agile Flight*, IEEE T-RO 38(6), 2022 (arXiv 2109.01365). Differences: the
//! vehicle takes body rates and thrust, so these are the inputs, and their lags are states; the first step of the horizon lasts one
//! tick; states are those of a simulation with the planned inputs (single shooting). As in the source, an inner loop of INDI around the
//! first input is optional, and each tick has one iteration of sequential quadratic programming (M. Diehl et al., *SIAM J. Control
//! Optim.* 43(5), 2005), linearised along the inputs planned in the last tick.

mod stage;

use nalgebra::{SVector, Vector3, Vector4};
use oqtal_control::predictive::{Bias, ModelInput, Motion};

use crate::flat::FlatPoint;
use crate::increment::RateIncrement;
use crate::law::{RateVehicle, Rival, RivalTick};
use crate::program::BoxProgram;
use stage::{INPUTS, STATES, StageModel};

/// Number of steps of the horizon.
pub const STEPS: usize = 20;

/// Weights, horizon and inner loop of [`Nmpc`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NmpcOptions {
    /// Weight of the position, horizontal and vertical \[1/m^2\].
    pub position: [f64; 2],
    /// Weight of the velocity \[1/(m/s)^2\].
    pub velocity: f64,
    /// Weight of the attitude, of tilt and heading \[1/rad^2\].
    pub attitude: [f64; 2],
    /// Weight of the body rate \[1/(rad/s)^2\].
    pub rate: f64,
    /// Weight of the rate command, over its range \[-\].
    pub rate_input: f64,
    /// Weight of the thrust command, over half of its range \[-\].
    pub thrust_input: f64,
    /// Duration of a step, except the first \[s\].
    pub step_s: f64,
    /// Cut-off frequency of the inner loop of INDI \[Hz\]; 0 for none.
    pub indi_cutoff_hz: f64,
}

impl Default for NmpcOptions {
    fn default() -> Self {
        Self {
            position: [200.0, 500.0],
            velocity: 1.0,
            attitude: [5.0, 200.0],
            rate: 1.0,
            rate_input: 6.0,
            thrust_input: 6.0,
            step_s: 0.05,
            indi_cutoff_hz: 12.0,
        }
    }
}

impl NmpcOptions {
    /// Ranges of the gains of [`Self::of`] in a search.
    pub const RANGES: [[f64; 2]; 8] = [
        [20.0, 2000.0],
        [0.1, 100.0],
        [0.5, 200.0],
        [5.0, 500.0],
        [0.01, 10.0],
        [0.1, 100.0],
        [0.1, 100.0],
        [0.1, 12.0],
    ];

    /// Options with these gains: weights of vertical position, velocity, tilt, heading, rate, rate command and thrust command, relative
    /// to 200 of the horizontal position \[units of the fields\], and the cut-off frequency \[Hz\].
    pub fn of(gains: &[f64; 8]) -> Self {
        let [vertical, velocity, tilt, heading, rate, rate_input, thrust_input, indi_cutoff_hz] =
            *gains;
        let position = [Self::default().position[0], vertical];
        let attitude = [tilt, heading];
        let step_s = Self::default().step_s;
        Self {
            position,
            velocity,
            attitude,
            rate,
            rate_input,
            thrust_input,
            step_s,
            indi_cutoff_hz,
        }
    }
}

/// The law.
#[derive(Clone)]
pub struct Nmpc {
    options: NmpcOptions,
    program: BoxProgram<STATES, INPUTS, STEPS>,
    /// Planned inputs over their range, -1 to 1, each held for a step.
    plan: Option<[Vector4<f64>; STEPS]>,
    increment: RateIncrement,
    iterations: u32,
}

impl Nmpc {
    /// The law with these options.
    pub fn new(options: NmpcOptions) -> Self {
        Self {
            options,
            program: BoxProgram::default(),
            plan: None,
            increment: RateIncrement::new(options.indi_cutoff_hz),
            iterations: 0,
        }
    }

    /// Iterations of the interior-point method in the last tick \[-\]; 0 if no limit was active.
    pub fn iterations(&self) -> u32 {
        self.iterations
    }

    /// Start and duration of the step `index` \[s\]; the first lasts one tick of `dt_s` \[s\].
    fn step_times(&self, index: usize, dt_s: f64) -> [f64; 2] {
        match index {
            0 => [0.0, dt_s],
            _ => [dt_s + (index - 1) as f64 * self.options.step_s, self.options.step_s],
        }
    }

    /// The plan of the last tick, moved on by `dt_s` \[s\]: the inputs at the middle of the new steps, between those of the old ones.
    fn shifted(&self, plan: &[Vector4<f64>; STEPS], dt_s: f64) -> [Vector4<f64>; STEPS] {
        let middle = |index: usize| {
            let [start_s, duration_s] = self.step_times(index, dt_s);
            start_s + duration_s / 2.0
        };
        std::array::from_fn(|index| {
            let at_s = middle(index) + dt_s;
            let next = (1..STEPS).find(|next| middle(*next) >= at_s).unwrap_or(STEPS - 1);
            let [from_s, to_s] = [middle(next - 1), middle(next)];
            let share = ((at_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0);
            plan[next - 1].lerp(&plan[next], share)
        })
    }

    /// Fills in the program along `plan`: model, cost and limits of each step.
    fn linearise(&mut self, tick: &RivalTick, plan: &[Vector4<f64>; STEPS]) {
        let RivalTick { vehicle, bias, reference, dt_s, .. } = *tick;
        let model = StageModel { vehicle, bias: &tick.bias };
        let range = input_range(vehicle);
        let mut motion = *tick.motion;
        for (index, planned) in plan.iter().enumerate() {
            let [start_s, duration_s] = self.step_times(index, dt_s);
            let step = model.linearised(&motion, &input_of(planned, vehicle), duration_s);
            motion = step.motion;
            let target = FlatPoint::of(&reference(start_s + duration_s), vehicle, &bias);
            let middle = FlatPoint::of(&reference(start_s + duration_s / 2.0), vehicle, &bias);
            let share = duration_s / self.options.step_s;
            let weights = self.options.input_weights() * share;
            let stage = &mut self.program.stages[index];
            stage.a = step.by_state;
            stage.b = step.by_input;
            for (mut column, range) in stage.b.column_iter_mut().zip(&range) {
                column *= *range;
            }
            stage.r = weights;
            let wanted = vehicle.limited(&middle.input);
            stage.r_gradient = weights.component_mul(&(planned - over_range(&wanted, vehicle)));
            (stage.low, stage.high) = (-planned.add_scalar(1.0), -planned.add_scalar(-1.0));
            self.options.add_cost(stage, (&motion, &target.motion), share);
        }
    }
}

impl NmpcOptions {
    fn input_weights(&self) -> Vector4<f64> {
        Vector3::repeat(self.rate_input).push(self.thrust_input)
    }

    /// Sets the cost of the state after a step: `motion` relative to `wanted`.
    fn add_cost(
        &self,
        stage: &mut crate::program::BoxStage<STATES, INPUTS>,
        (motion, wanted): (&Motion, &Motion),
        share: f64,
    ) {
        let axes =
            |[horizontal, vertical]: [f64; 2]| Vector3::new(horizontal, horizontal, vertical);
        let turn = wanted.attitude.rotation_to(&motion.attitude);
        // Derivative of the error by a turn of the body, to the first order.
        let by_turn = nalgebra::Matrix3::identity() + turn.cross_matrix() / 2.0;
        let weight = nalgebra::Matrix3::from_diagonal(&(axes(self.attitude) * share));
        stage.q.fill(0.0);
        stage.q_gradient.fill(0.0);
        for (row, weights, error) in [
            (0, axes(self.position), motion.position - wanted.position),
            (6, Vector3::repeat(self.velocity), motion.velocity - wanted.velocity),
            (9, Vector3::repeat(self.rate), motion.rate - wanted.rate),
        ] {
            let weights = weights * share;
            stage.q.fixed_view_mut::<3, 3>(row, row).set_diagonal(&weights);
            stage.q_gradient.fixed_rows_mut::<3>(row).copy_from(&weights.component_mul(&error));
        }
        let weighted = by_turn.tr_mul(&weight);
        stage.q.fixed_view_mut::<3, 3>(3, 3).copy_from(&(weighted * by_turn));
        stage.q_gradient.fixed_rows_mut::<3>(3).copy_from(&(weighted * turn));
    }
}

impl Rival for Nmpc {
    fn reset(&mut self) {
        self.plan = None;
        self.increment.reset();
    }

    fn command(&mut self, tick: &RivalTick) -> ModelInput {
        let demand_error = self.increment.demand_error(tick);
        let tick = &match demand_error {
            // The inner loop measures the error of the rate command itself.
            Some(_) => RivalTick { bias: Bias { demand: Vector3::zeros(), ..tick.bias }, ..*tick },
            None => *tick,
        };
        let RivalTick { vehicle, bias, reference, dt_s, .. } = *tick;
        let mut plan = match &self.plan {
            Some(plan) => self.shifted(plan, dt_s),
            None => std::array::from_fn(|index| {
                let [start_s, duration_s] = self.step_times(index, dt_s);
                let point = FlatPoint::of(&reference(start_s + duration_s / 2.0), vehicle, &bias);
                over_range(&vehicle.limited(&point.input), vehicle)
            }),
        };
        self.linearise(tick, &plan);
        // Sun et al., Eqs. (4) to (12)
        match self.program.solve() {
            Some(iterations) => {
                self.iterations = iterations;
                for (planned, change) in plan.iter_mut().zip(self.program.moves()) {
                    *planned = (*planned + change).map(|share| share.clamp(-1.0, 1.0));
                }
                self.plan = Some(plan);
            }
            None => self.plan = None,
        }
        let mut command = input_of(&plan[0], vehicle);
        command.demand -= demand_error.unwrap_or_default();
        vehicle.limited(&command)
    }
}

/// Half of the range of each input: rates \[rad/s\] and thrust \[N\].
fn input_range(vehicle: &RateVehicle) -> Vector4<f64> {
    vehicle.greatest_rate.push(vehicle.greatest_thrust_n / 2.0)
}

/// The input of which `planned` is the share of the range.
fn input_of(planned: &Vector4<f64>, vehicle: &RateVehicle) -> ModelInput {
    let input: SVector<f64, 4> = planned.component_mul(&input_range(vehicle));
    ModelInput {
        demand: input.xyz(),
        thrust_n: input.w + vehicle.greatest_thrust_n / 2.0,
        ..ModelInput::default()
    }
}

/// `input` over its range.
fn over_range(input: &ModelInput, vehicle: &RateVehicle) -> Vector4<f64> {
    let middle_n = vehicle.greatest_thrust_n / 2.0;
    input.demand.push(input.thrust_n - middle_n).component_div(&input_range(vehicle))
}
