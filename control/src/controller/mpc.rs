//! Linear model predictive control of the attitude error, with the limits of input and rate. Not in the paper.
//!
//! ```text
//! min  sum_{i<N} (x_i' Q x_i + u_i' R u_i) + x_N' P x_N,   x_{i+1} = A x_i + B u_i,   x = [omega_e; eps]
//! with |u_i + u_ref| <= u_max  and  |omega_ref + omega_e,i| <= omega_max
//! ```
//!
//! `A`, `B`, weights and feed-forward are those of [`OqtalDt`]; `P` is the solution of its Riccati equation, so that without an
//! active limit the plan is that of its gain for any `N` (P. O. M. Scokaert and J. B. Rawlings, *IEEE TAC* 43(8), 1998).
//! Feed-forward and reference rate are held over the horizon. The quadratic program is solved only if that plan breaks a limit,
//! separately for each axis if the axes are decoupled ([`crate::horizon`]). If the solver does not converge within its maximum
//! number of iterations, the first move of the plan is clipped.

use nalgebra::{Matrix2, Matrix3, Matrix6, Matrix6x3, SMatrix, SVector, Vector2, Vector3, Vector6};
use serde::{Deserialize, Serialize};

use super::input::InputForm;
use super::law::{AttitudeLaw, LawTerms, SearchRange};
use super::oqtal_dt::{DiscreteGain, OqtalDt, OqtalDtOptions};
use crate::horizon::{HorizonProgram, MOST_STEPS, MoveBounds};
use crate::options::{OptionError, Rule, check_options};
use crate::riccati::dare;
use crate::tracking_error::{AttitudeError, AttitudeReference, AttitudeState};

/// Fraction of the greatest element of a matrix below which another element is a rounding error \[-\].
const ROUNDING: f64 = 1e-9;

/// Options of [`Mpc`]. The default is for the Hummingbird in rate form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct MpcOptions {
    /// Weight on `eps` \[-\].
    pub attitude_weight: f64,
    /// Weight on `omega_e` \[s^2/rad^2\].
    pub rate_weight: f64,
    /// Weight on the input \[-\].
    pub input_weight: f64,
    /// `N`, number of planned moves \[-\].
    pub horizon: usize,
    /// `omega_max`, greatest rate about each axis \[rad/s\]; a soft limit.
    pub max_rate_rad_s: f64,
}

impl Default for MpcOptions {
    fn default() -> Self {
        let OqtalDtOptions { attitude_weight, rate_weight, input_weight } = Default::default();
        Self { attitude_weight, rate_weight, input_weight, horizon: 12, max_rate_rad_s: 2.0 }
    }
}

impl MpcOptions {
    fn weights(&self) -> OqtalDtOptions {
        let Self { attitude_weight, rate_weight, input_weight, .. } = *self;
        OqtalDtOptions { attitude_weight, rate_weight, input_weight }
    }
}

impl MpcOptions {
    /// Gains that are tuned.
    pub(super) const TUNED: &'static [SearchRange] = &[
        SearchRange::new("attitude-weight", 100.0, 1e5),
        SearchRange::new("rate-weight", 1e-3, 10.0),
    ];

    /// Gains for the paper's spacecraft in torque form.
    pub fn spacecraft() -> Self {
        let OqtalDtOptions { attitude_weight, rate_weight, input_weight } =
            OqtalDtOptions::spacecraft();
        Self { attitude_weight, rate_weight, input_weight, ..Self::default() }
    }

    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        self.weights().check()?;
        check_options([
            ("horizon", self.horizon as f64, Rule::Between(1.0, MOST_STEPS as f64)),
            ("max-rate-rad-s", self.max_rate_rad_s, Rule::Positive),
        ])
    }
}

/// Programs of the law: one per axis, or one for all axes if they are coupled.
// Not boxed: the cache warm-up copies the law, and a copy must not allocate.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)]
enum Program {
    Axes([HorizonProgram<2, 1>; 3]),
    Coupled(HorizonProgram<6, 3>),
}

impl Program {
    fn of(program: HorizonProgram<6, 3>) -> Self {
        let HorizonProgram { a, b, q, r, p, steps } = &program;
        if ![a, p].into_iter().all(is_decoupled) || !is_decoupled(b) {
            return Self::Coupled(program);
        }
        let part = |m: &Matrix6<f64>, axis: usize| {
            Matrix2::from_fn(|row, column| m[(axis + 3 * row, axis + 3 * column)])
        };
        Self::Axes([0, 1, 2].map(|axis| HorizonProgram {
            a: part(a, axis),
            b: Vector2::new(b[(axis, axis)], b[(axis + 3, axis)]),
            q: part(q, axis),
            r: r.fixed_view::<1, 1>(axis, axis).into_owned(),
            p: part(p, axis),
            steps: *steps,
        }))
    }

    /// First moves of the axes that are `broken`, or of all axes if they are coupled, from the error `x`; `None` for an axis
    /// without a solution.
    fn first_moves(
        &self,
        x: &Vector6<f64>,
        bounds: &MoveBounds<3>,
        broken: [bool; 3],
    ) -> [Option<f64>; 3] {
        match self {
            Self::Axes(programs) => [0, 1, 2].map(|axis| {
                let x = SVector::from([x[axis], x[axis + 3]]);
                let solution = broken[axis].then(|| programs[axis].solve(&x, &bounds.of(axis)));
                solution.flatten().map(|solution| solution.first[0])
            }),
            Self::Coupled(program) if broken.contains(&true) => {
                let solution = program.solve(x, bounds);
                [0, 1, 2].map(|axis| solution.map(|solution| solution.first[axis]))
            }
            Self::Coupled(_) => [None; 3],
        }
    }
}

/// Whether the axes are decoupled in a matrix from or to `[omega_e; eps]`.
fn is_decoupled<const C: usize>(m: &SMatrix<f64, 6, C>) -> bool {
    let greatest = m.amax();
    let is_apart = |(index, element): (usize, &f64)| {
        index % 3 == index / 6 % 3 || element.abs() <= ROUNDING * greatest
    };
    m.iter().enumerate().all(is_apart)
}

/// The sampled plant of the state `[omega_e; eps]` at zero error.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Plant {
    a: Matrix6<f64>,
    b: Matrix6x3<f64>,
}

/// The law for a vehicle commanded through `I`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mpc<I> {
    options: MpcOptions,
    input: I,
    gain: DiscreteGain,
    plant: Plant,
    program: Option<Program>,
    terms: LawTerms,
}

impl<I: InputForm> Mpc<I> {
    /// The law with these options for a loop that runs every `period_s` \[s\]. Its only Riccati equation is solved here.
    ///
    /// # Errors
    /// An option whose value is not allowed, or weights so different that there is no gain.
    pub fn new(options: MpcOptions, input: I, period_s: f64) -> Result<Self, OptionError> {
        options.check()?;
        let (a, b) = OqtalDt::plant(&input, period_s);
        let weights = [options.rate_weight, options.attitude_weight];
        let q = Matrix6::from_diagonal(&SVector::from_fn(|i, _| weights[i / 3]));
        let r = Matrix3::from_diagonal_element(options.input_weight);
        // If the rate follows the input at once, each axis is an integrator, for which clipping solves the program.
        let program = match input.rate_model() {
            Some(_) => dare(&a, &b, &q, &r).ok().map(|terminal| {
                Program::of(HorizonProgram { a, b, q, r, p: terminal.p, steps: options.horizon })
            }),
            None => None,
        };
        let law = OqtalDt::new(options.weights(), input, period_s)?;
        let gain = *law.gain();
        Ok(Self {
            options,
            input: law.into_input(),
            gain,
            plant: Plant { a, b },
            program,
            terms: LawTerms::default(),
        })
    }

    /// Limits of the moves of a body with the reference input `u_ref` and the reference rate `omega_ref`.
    fn bounds(&self, u_ref: Vector3<f64>, omega_ref: Vector3<f64>) -> MoveBounds<3> {
        let most = self.input.saturate(&Vector3::repeat(f64::MAX));
        let fastest = Vector3::repeat(self.options.max_rate_rad_s);
        // A feed-forward beyond the limits would leave no range on one side; the first move is then at the limit.
        let u_ref = self.input.saturate(&u_ref);
        MoveBounds {
            input_low: -most - u_ref,
            input_high: most - u_ref,
            rate_low: -fastest - omega_ref,
            rate_high: fastest - omega_ref,
        }
    }

    /// Axes on which the plan of the gain breaks a limit within the horizon.
    fn broken(&self, mut x: Vector6<f64>, bounds: &MoveBounds<3>) -> [bool; 3] {
        let mut broken = [false; 3];
        for _ in 0..self.options.horizon {
            let u = -self.gain * x;
            x = self.plant.a * x + self.plant.b * u;
            for (axis, broken) in broken.iter_mut().enumerate() {
                let input = bounds.input_low[axis]..=bounds.input_high[axis];
                let rate = bounds.rate_low[axis]..=bounds.rate_high[axis];
                *broken |= !(input.contains(&u[axis]) && rate.contains(&x[axis]));
            }
        }
        broken
    }
}

impl<I: InputForm> AttitudeLaw for Mpc<I> {
    type Command = I::Command;

    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        _: f64,
    ) -> I::Command {
        let error = AttitudeError::between(&reference.attitude, &state.attitude);
        let omega_e = error.rate_error(state.rate, reference.rate);
        let mut x = Vector6::zeros();
        x.fixed_rows_mut::<3>(0).copy_from(&omega_e);
        x.fixed_rows_mut::<3>(3).copy_from(error.eps());
        let u_ref = self.input.feed_forward(&error, &omega_e, reference)
            + self.input.gyroscopic(state.rate);
        let bounds = self.bounds(u_ref, error.rotation() * reference.rate.0);
        let mut u = -self.gain * x;
        if let Some(program) = &self.program {
            let planned = program.first_moves(&x, &bounds, self.broken(x, &bounds));
            u.iter_mut().zip(planned).for_each(|(u, planned)| *u = planned.unwrap_or(*u));
        }
        self.terms = LawTerms::of(&(u_ref + u), Vector3::zeros(), u_ref);
        I::command_from(self.input.saturate(&(u_ref + u)))
    }

    fn reset(&mut self) {}

    fn terms(&self) -> LawTerms {
        self.terms
    }

    fn set_rate_lag(&mut self, lag_s: f64, period_s: f64) {
        self.input.set_rate_lag(lag_s, period_s);
    }

    fn riccati_solves(&self) -> u32 {
        1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controller::RateInput;
    use crate::quantity::BodyRate;
    use crate::quaternion::Attitude;

    const PERIOD_S: f64 = 1.0 / 60.0;

    fn input() -> RateInput {
        RateInput::new(Vector3::repeat(2.0)).unwrap().with_lag(0.05, PERIOD_S).unwrap()
    }

    fn state(angle: f64, rate: f64) -> AttitudeState {
        AttitudeState {
            attitude: Attitude::from_rotation_vector(Vector3::new(angle, 0.0, 0.0)),
            rate: BodyRate(Vector3::new(rate, 0.0, 0.0)),
        }
    }

    #[test]
    fn within_the_limits_the_move_is_that_of_the_riccati_equation() {
        let mut law = Mpc::new(MpcOptions::default(), input(), PERIOD_S).unwrap();
        let mut own = OqtalDt::new(OqtalDtOptions::default(), input(), PERIOD_S).unwrap();
        let rest = AttitudeReference::default();
        let state = state(0.02, -0.1);
        let given = law.update(&state, &rest, PERIOD_S).0;
        assert!((given - own.update(&state, &rest, PERIOD_S).0).amax() < 1e-12);
        // The program has the same solution if no limit is active.
        let mut x = Vector6::zeros();
        (x[0], x[3]) = (-0.1, 0.01);
        let program = law.program.unwrap();
        let bounds = law.bounds(Vector3::zeros(), Vector3::zeros());
        assert_eq!(law.broken(x, &bounds), [false; 3]);
        let moves = program.first_moves(&x, &bounds, [true; 3]);
        let solved = Vector3::from(moves.map(Option::unwrap));
        assert!((solved + law.gain * x).amax() < 1e-6, "{solved}");
    }

    /// Comparison with a search: no sequence of two moves on a grid costs less.
    #[test]
    fn beyond_the_limits_no_other_moves_cost_less() {
        let options = MpcOptions { horizon: 2, max_rate_rad_s: 100.0, ..MpcOptions::default() };
        let law = Mpc::new(options, input(), PERIOD_S).unwrap();
        let Some(Program::Axes(programs)) = law.program else { panic!("axes affect each other") };
        let bounds = law.bounds(Vector3::zeros(), Vector3::zeros());
        let mut x = Vector6::zeros();
        (x[0], x[3]) = (-1.0, 0.09);
        assert_eq!(law.broken(x, &bounds), [true, false, false]);
        let HorizonProgram { a, b, q, r, p, .. } = programs[0];
        let start = Vector2::new(x[0], x[3]);
        let first = programs[0].solve(&start, &bounds.of(0)).unwrap().first[0];
        let cost = |moves: [f64; 2]| {
            let (mut x, mut sum) = (start, 0.0);
            for u in moves {
                sum += (x.transpose() * q * x)[0] + u * r[0] * u;
                x = a * x + b * u;
            }
            sum + (x.transpose() * p * x)[0]
        };
        let grid = || (-100..=100).map(|step| f64::from(step) / 100.0);
        let least = |first: f64| grid().map(|u| cost([first, u])).fold(f64::INFINITY, f64::min);
        let best = grid().map(|u| (least(u), u)).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        assert!((first - best.1).abs() < 0.02, "{first}, {best:?}");
        assert!(first.abs() <= 1.0 + 1e-6);
    }

    /// The coupled program of all axes has the same solution as the separate programs.
    #[test]
    fn axes_together_are_planned_as_each_by_itself() {
        let law = Mpc::new(MpcOptions::default(), input(), PERIOD_S).unwrap();
        let Plant { a, b } = law.plant;
        let q =
            Matrix6::from_diagonal(&Vector6::new(0.0125, 0.0125, 0.0125, 1250.0, 1250.0, 1250.0));
        let (r, steps) = (Matrix3::identity(), law.options.horizon);
        let p = dare(&a, &b, &q, &r).unwrap().p;
        let together = Program::Coupled(HorizonProgram { a, b, q, r, p, steps });
        let bounds = law.bounds(Vector3::new(0.1, -0.2, 0.0), Vector3::new(0.3, 0.0, 0.0));
        let x = Vector6::new(-1.0, 0.5, 0.1, 0.09, -0.12, 0.2);
        let [apart, together] = [law.program.unwrap(), together]
            .map(|program| program.first_moves(&x, &bounds, [true; 3]));
        for (apart, together) in apart.into_iter().zip(together) {
            assert!((apart.unwrap() - together.unwrap()).abs() < 1e-6, "{apart:?} {together:?}");
        }
    }

    /// From nearly half a turn, sampled as in flight: the limits are active for most of the way.
    #[test]
    fn the_law_reaches_its_reference_from_far_away() {
        let mut law = Mpc::new(MpcOptions::default(), input(), PERIOD_S).unwrap();
        let (mut attitude, mut rate) =
            (Attitude::from_rotation_vector(Vector3::new(2.0, -1.5, 1.0)), Vector3::zeros());
        for _ in 0..240 {
            let state = AttitudeState { attitude, rate: BodyRate(rate) };
            let sticks = law.update(&state, &AttitudeReference::default(), PERIOD_S).0;
            for _ in 0..16 {
                rate += (2.0 * sticks - rate) * (PERIOD_S / 16.0 / 0.05);
                attitude = attitude.turned_by(rate * PERIOD_S / 16.0);
            }
            assert!(rate.amax() <= 2.0 + 1e-6, "{rate}");
        }
        assert!(attitude.angle_to(&Attitude::LEVEL) < 1e-3);
    }

    #[test]
    fn the_rate_is_kept_where_it_can_be() {
        let options = MpcOptions { max_rate_rad_s: 0.5, ..MpcOptions::default() };
        let mut law = Mpc::new(options, input(), PERIOD_S).unwrap();
        let sticks = law.update(&state(0.8, -0.5), &AttitudeReference::default(), PERIOD_S).0;
        assert!((2.0 * sticks.x + 0.5).abs() < 1e-3, "{sticks}");
        // Already too fast: the law brakes and does not fail.
        let sticks = law.update(&state(0.8, -1.5), &AttitudeReference::default(), PERIOD_S).0;
        assert!(2.0 * sticks.x > -0.5, "{sticks}");
    }
}
