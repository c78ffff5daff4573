//! A step of the model of `nmpc`: the motion under a constant input, with its derivatives.
//!
//! Rate and thrust follow their commands with first-order lags, so that their course is exact. The attitude is turned by the integral
//! of the rate; the translation has the force at the middle of the step. State: position, rotation vector in body axes, velocity,
//! rate, thrust.

use nalgebra::{Matrix3, SMatrix, Vector3};
use oqtal_control::predictive::{Bias, ModelInput, Motion};

use crate::law::RateVehicle;

/// Number of states.
pub(super) const STATES: usize = 13;
/// Number of inputs: rates and thrust.
pub(super) const INPUTS: usize = 4;
/// Longest step of the integration \[s\].
const LONGEST_S: f64 = 25e-3;
/// Product of drag and time below which the velocity counts as undamped \[-\].
const UNDAMPED: f64 = 1e-6;

/// Derivative by the state.
pub(super) type StateDerivative = SMatrix<f64, STATES, STATES>;
/// Derivative by the input.
pub(super) type InputDerivative = SMatrix<f64, STATES, INPUTS>;

/// The motion after a step with its derivatives.
pub(super) struct Linearised {
    pub(super) motion: Motion,
    pub(super) by_state: StateDerivative,
    pub(super) by_input: InputDerivative,
}

/// The model under constant disturbances.
pub(super) struct StageModel<'a> {
    pub(super) vehicle: &'a RateVehicle,
    pub(super) bias: &'a Bias,
}

/// Weights of a first-order lag over a time: of the initial value and of the command, at the end and in the integral.
struct LagWeights {
    kept: f64,
    integral: f64,
    commanded_integral: f64,
}

impl LagWeights {
    fn over(t_s: f64, lag_s: f64) -> Self {
        let kept = (-t_s / lag_s).exp();
        let integral = lag_s * (1.0 - kept);
        Self { kept, integral, commanded_integral: t_s - integral }
    }
}

impl StageModel<'_> {
    /// The motion `t_s` \[s\] after `motion` under `input`.
    pub(super) fn linearised(&self, motion: &Motion, input: &ModelInput, t_s: f64) -> Linearised {
        let steps = (t_s / LONGEST_S - 1e-9).ceil().max(1.0);
        let mut whole = Linearised {
            motion: *motion,
            by_state: StateDerivative::identity(),
            by_input: InputDerivative::zeros(),
        };
        for _ in 0..steps as u32 {
            let step = self.step(&whole.motion, input, t_s / steps);
            whole.motion = step.motion;
            whole.by_input = step.by_state * whole.by_input + step.by_input;
            whole.by_state = step.by_state * whole.by_state;
        }
        whole
    }

    fn step(&self, motion: &Motion, input: &ModelInput, h: f64) -> Linearised {
        let RateVehicle { rate_lag_s, thrust_lag_s, mass_kg, gravity_m_s2, drag_per_s, .. } =
            *self.vehicle;
        // Eq. (61) of the paper of oqtal, erratum E-61, with the lag of the on-board loop
        let commanded = input.demand + self.bias.demand;
        let [half, full] = [h / 2.0, h].map(|t_s| LagWeights::over(t_s, rate_lag_s));
        let turn =
            |lag: &LagWeights| motion.rate * lag.integral + commanded * lag.commanded_integral;
        let (half_turn, full_turn) = (turn(&half), turn(&full));
        let middle = motion.attitude.turned_by(half_turn);
        let lift = LagWeights::over(h, thrust_lag_s);
        let mean_n =
            (motion.thrust_n * lift.integral + input.thrust_n * lift.commanded_integral) / h;
        // Newton's law, in the world frame, with linear drag
        let up = middle.to_world(&Vector3::z());
        let acceleration =
            up * (mean_n / mass_kg) - Vector3::z() * gravity_m_s2 + self.bias.acceleration;
        let damping = Damping::over(h, drag_per_s);
        let next = Motion {
            position: motion.position
                + motion.velocity * damping.first_integral
                + acceleration * damping.second_integral,
            velocity: motion.velocity * damping.kept + acceleration * damping.first_integral,
            attitude: motion.attitude.turned_by(full_turn),
            rate: motion.rate * full.kept + commanded * (1.0 - full.kept),
            thrust_n: motion.thrust_n * lift.kept + input.thrust_n * (1.0 - lift.kept),
        };
        let mut step = Linearised {
            motion: next,
            by_state: StateDerivative::identity(),
            by_input: InputDerivative::zeros(),
        };
        step.fill_rotation(&full_turn, &full);
        let tilted = -(middle.unit_quaternion().to_rotation_matrix().matrix()
            * Vector3::z().cross_matrix())
            * (mean_n / mass_kg);
        step.fill_translation(&damping, (&tilted, &half_turn, &half));
        step.fill_thrust(&damping, (&(up / (mass_kg * h)), &lift));
        step
    }
}

/// Weights of a damped velocity over a time: that kept, and its integrals.
struct Damping {
    kept: f64,
    first_integral: f64,
    second_integral: f64,
}

impl Damping {
    fn over(t_s: f64, drag_per_s: f64) -> Self {
        let share = drag_per_s * t_s;
        if share.abs() < UNDAMPED {
            return Self {
                kept: 1.0 - share,
                first_integral: t_s,
                second_integral: t_s * t_s / 2.0,
            };
        }
        let kept = (-share).exp();
        let first_integral = (1.0 - kept) / drag_per_s;
        Self { kept, first_integral, second_integral: (t_s - first_integral) / drag_per_s }
    }
}

/// Derivative of the rotation vector of a product of turns by that of its last factor `turn` \[rad\], to the second order.
fn right_jacobian(turn: &Vector3<f64>) -> Matrix3<f64> {
    let cross = turn.cross_matrix();
    Matrix3::identity() - cross / 2.0 + cross * cross / 6.0
}

/// The rotation back by `turn` \[rad\].
fn turned_back(turn: &Vector3<f64>) -> Matrix3<f64> {
    nalgebra::Rotation3::from_scaled_axis(-turn).into_inner()
}

impl Linearised {
    fn fill_rotation(&mut self, turn: &Vector3<f64>, lag: &LagWeights) {
        let jacobian = right_jacobian(turn);
        self.by_state.fixed_view_mut::<3, 3>(3, 3).copy_from(&turned_back(turn));
        self.by_state.fixed_view_mut::<3, 3>(3, 9).copy_from(&(jacobian * lag.integral));
        self.by_input.fixed_view_mut::<3, 3>(3, 0).copy_from(&(jacobian * lag.commanded_integral));
        self.by_state.fixed_view_mut::<3, 3>(9, 9).fill_diagonal(lag.kept);
        self.by_input.fixed_view_mut::<3, 3>(9, 0).fill_diagonal(1.0 - lag.kept);
    }

    /// `tilted` is the derivative of the acceleration by the attitude at the middle of the step, after the turn `half_turn` \[rad\].
    fn fill_translation(
        &mut self,
        damping: &Damping,
        (tilted, half_turn, half): (&Matrix3<f64>, &Vector3<f64>, &LagWeights),
    ) {
        self.by_state.fixed_view_mut::<3, 3>(0, 6).fill_diagonal(damping.first_integral);
        self.by_state.fixed_view_mut::<3, 3>(6, 6).fill_diagonal(damping.kept);
        let by_turn = tilted * right_jacobian(half_turn);
        let by_attitude = tilted * turned_back(half_turn);
        for (row, weight) in [(0, damping.second_integral), (6, damping.first_integral)] {
            self.by_state.fixed_view_mut::<3, 3>(row, 3).copy_from(&(by_attitude * weight));
            let by_rate = by_turn * (weight * half.integral);
            self.by_state.fixed_view_mut::<3, 3>(row, 9).copy_from(&by_rate);
            let by_demand = by_turn * (weight * half.commanded_integral);
            self.by_input.fixed_view_mut::<3, 3>(row, 0).copy_from(&by_demand);
        }
    }

    /// `up` is the derivative of the acceleration by the integral of the thrust.
    fn fill_thrust(&mut self, damping: &Damping, (up, lift): (&Vector3<f64>, &LagWeights)) {
        for (row, weight) in [(0, damping.second_integral), (6, damping.first_integral)] {
            self.by_state
                .fixed_view_mut::<3, 1>(row, 12)
                .copy_from(&(up * (weight * lift.integral)));
            let by_thrust = up * (weight * lift.commanded_integral);
            self.by_input.fixed_view_mut::<3, 1>(row, 3).copy_from(&by_thrust);
        }
        self.by_state[(12, 12)] = lift.kept;
        self.by_input[(12, 3)] = 1.0 - lift.kept;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::SVector;
    use oqtal_control::predictive::{Integration, Rotation, VehicleModel};
    use oqtal_control::quaternion::Attitude;

    use super::*;

    fn model() -> VehicleModel {
        VehicleModel {
            rotation: Rotation::RateLoop { lag_s: 0.05 },
            mass_kg: 0.5,
            gravity_m_s2: 9.81,
            drag_per_s: 0.25,
            thrust_lag_s: 0.05,
            integration: Integration::Fine,
        }
    }

    fn start() -> (Motion, ModelInput, Bias) {
        let motion = Motion {
            position: Vector3::new(1.0, -2.0, 0.5),
            velocity: Vector3::new(2.0, 1.0, -0.5),
            attitude: Attitude::from_rotation_vector(Vector3::new(0.5, -0.4, 1.0)),
            rate: Vector3::new(1.5, -1.0, 0.5),
            thrust_n: 6.0,
        };
        let demand = Vector3::new(-1.5, 1.8, 0.2);
        let input = ModelInput { demand, thrust_n: 8.0, ..ModelInput::default() };
        let (demand, acceleration) =
            (Vector3::new(0.03, -0.02, 0.01), Vector3::new(0.1, -0.2, 0.3));
        (motion, input, Bias { demand, acceleration })
    }

    /// The difference of two motions in the order of the states.
    fn difference(from: &Motion, to: &Motion) -> SVector<f64, STATES> {
        let mut x = SVector::<f64, STATES>::zeros();
        x.fixed_rows_mut::<3>(0).copy_from(&(to.position - from.position));
        x.fixed_rows_mut::<3>(3).copy_from(&from.attitude.rotation_to(&to.attitude));
        x.fixed_rows_mut::<3>(6).copy_from(&(to.velocity - from.velocity));
        x.fixed_rows_mut::<3>(9).copy_from(&(to.rate - from.rate));
        x[12] = to.thrust_n - from.thrust_n;
        x
    }

    /// `motion` with one state changed by `change`.
    fn changed(motion: &Motion, state: usize, change: f64) -> Motion {
        let mut next = *motion;
        let axis = Vector3::ith(state % 3, change);
        match state / 3 {
            0 => next.position += axis,
            1 => next.attitude = next.attitude.turned_by(axis),
            2 => next.velocity += axis,
            3 => next.rate += axis,
            _ => next.thrust_n += change,
        }
        next
    }

    #[test]
    fn a_step_has_the_motion_of_the_model_of_the_prediction() {
        let (motion, input, bias) = start();
        let vehicle = RateVehicle::new(&model(), Vector3::repeat(2.0), 20.0).unwrap();
        let own = StageModel { vehicle: &vehicle, bias: &bias };
        let stepped = own.linearised(&motion, &input, 0.05).motion;
        let expected = model().advance(&motion, &input, &bias, 0.05);
        let error = difference(&expected, &stepped);
        // The force is that of the middle of a step.
        assert!(error.fixed_rows::<3>(0).amax() < 1e-4, "{error}");
        assert!(error.fixed_rows::<3>(3).amax() < 2e-4, "{error}");
        assert!(error.fixed_rows::<3>(6).amax() < 4e-3, "{error}");
        assert!(error.fixed_rows::<4>(9).amax() < 1e-5, "{error}");
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let (motion, input, bias) = start();
        let vehicle = RateVehicle::new(&model(), Vector3::repeat(2.0), 20.0).unwrap();
        let own = StageModel { vehicle: &vehicle, bias: &bias };
        let stepped = own.linearised(&motion, &input, 0.05);
        let h = 1e-4;
        let sides =
            |from: &Linearised, to: &Linearised| difference(&from.motion, &to.motion) / (2.0 * h);
        for state in 0..STATES {
            let [back, forth] = [-h, h]
                .map(|change| own.linearised(&changed(&motion, state, change), &input, 0.05));
            let error = sides(&back, &forth) - stepped.by_state.column(state);
            assert!(error.amax() < 1e-4, "{state}: {error}");
        }
        for number in 0..INPUTS {
            let [back, forth] = [-h, h].map(|change| {
                let mut next = input;
                match number {
                    3 => next.thrust_n += change,
                    axis => next.demand[axis] += change,
                }
                own.linearised(&motion, &next, 0.05)
            });
            let error = sides(&back, &forth) - stepped.by_input.column(number);
            assert!(error.amax() < 1e-4, "{number}: {error}");
        }
    }
}
