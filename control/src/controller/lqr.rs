//! Classic LQR: a linear-quadratic regulator on Euler angles that tracks a set-point. Paper, Sections II.F and II.G.
//!
//! ```text
//! u = -K [omega; Theta - Theta_d; Theta_I],  Theta_I = integral of Theta_d - Theta        Eqs. (24), (34), corrected
//! ```

use std::f64::consts::TAU;

use nalgebra::{Matrix6, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::feedback::RateFeedback;
use super::input::InputForm;
use super::law::{AttitudeLaw, LawTerms, SearchRange};
use super::regulator::{AugmentedModel, Gain, INTEGRAL, Weights, law_state};
use super::set_point::SetPointLoop;
use crate::euler::EulerAngles;
use crate::integral::Integral;
use crate::options::{OptionError, Rule, check_options};
use crate::riccati::RiccatiError;
use crate::schedule::{CellGrid, Cells, GainSchedule, Resolve};
use crate::tracking_error::{AttitudeError, AttitudeReference, AttitudeState};

/// Options of [`ClassicLqr`]. The default is for the Hummingbird in rate form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct LqrOptions {
    /// `q`: weight on `Theta` \[1/rad^2\].
    pub attitude_weight: f64,
    /// Weight on `omega` \[s^2/rad^2\]; without effect in rate form.
    pub rate_weight: f64,
    /// Weight on `Theta_I` as a fraction of `attitude-weight` \[1/s^2\]; 0 for no integral action.
    pub integral_weight: f64,
    /// `r`: weight on the input \[-\].
    pub input_weight: f64,
    /// Limit of each component of `Theta_I` \[rad s\].
    pub integral_limit_rad_s: f64,
    /// Rule that divides `[omega; Theta]` into cells, with one gain per cell.
    pub cells: Cells,
    /// Width of a cell in each component of `omega` \[rad/s\].
    pub cell_rate_rad_s: f64,
    /// Width of a cell in each angle of `Theta` \[rad\].
    pub cell_angle_rad: f64,
    /// Condition for recomputing the gain.
    pub resolve: Resolve,
    /// Greatest pitch of an operating point \[rad\]. The model diverges towards 90 degrees and has the wrong sign beyond.
    pub operating_pitch_limit_rad: f64,
    /// Rate fed back; without effect in rate form.
    pub rate: RateFeedback,
    /// Whether the motion of the reference is fed forward. Not in the paper.
    pub feed_forward: bool,
}

impl Default for LqrOptions {
    fn default() -> Self {
        Self {
            // In the paper: Table V, the largest weight with stable flight.
            attitude_weight: 20.0,
            // In the paper: Eq. (62) weights it as the attitude.
            rate_weight: 20.0,
            // In the paper: Eq. (62).
            integral_weight: 0.01,
            // In the paper: Section VIII.
            input_weight: 1.0,
            // Not in the paper. The same angle as the limit of OQTAL, whose eps is half an angle.
            integral_limit_rad_s: 1.0,
            // Not in the paper, which prints `floor` but reports a number of solutions that only a rule like this one gives.
            cells: Cells::Truncated,
            // In the paper: `delta` of Section VIII, one number without a unit.
            cell_rate_rad_s: 0.5,
            cell_angle_rad: 0.5,
            resolve: Resolve::OnCellChange,
            // Not in the paper.
            operating_pitch_limit_rad: 1.4,
            rate: RateFeedback::Omega,
            feed_forward: false,
        }
    }
}

impl LqrOptions {
    /// Gains that are tuned.
    pub(super) const TUNED: &'static [SearchRange] = &[
        SearchRange::new("attitude-weight", 1.0, 400.0),
        SearchRange::new("integral-weight", 1e-4, 1.0),
    ];

    /// Gains for the paper's spacecraft in torque form: Table IV, no integral action, `delta` of Section VI.B.2.
    pub fn spacecraft() -> Self {
        Self { attitude_weight: 128.0, rate_weight: 128.0, integral_weight: 0.0, ..Self::default() }
            .with_cell_width(0.2)
    }

    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("attitude-weight", self.attitude_weight, Rule::Positive),
            ("rate-weight", self.rate_weight, Rule::NotNegative),
            ("integral-weight", self.integral_weight, Rule::NotNegative),
            ("input-weight", self.input_weight, Rule::Positive),
            ("integral-limit-rad-s", self.integral_limit_rad_s, Rule::NotNegative),
            ("cell-rate-rad-s", self.cell_rate_rad_s, Rule::Positive),
            ("cell-angle-rad", self.cell_angle_rad, Rule::Positive),
            ("operating-pitch-limit-rad", self.operating_pitch_limit_rad, Rule::Positive),
        ])
    }

    /// The same options with cells of the width `delta` in both units, as in the paper \[rad/s, rad\].
    pub fn with_cell_width(self, delta: f64) -> Self {
        Self { cell_rate_rad_s: delta, cell_angle_rad: delta, ..self }
    }

    fn weights(&self) -> Weights {
        Weights {
            rate: self.rate_weight,
            attitude: self.attitude_weight,
            integral: self.integral_weight * self.attitude_weight,
            input: self.input_weight,
        }
    }
}

/// The classic law for a vehicle commanded through `I`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassicLqr<I> {
    options: LqrOptions,
    input: I,
    schedule: GainSchedule<6, Gain>,
    theta_i: Integral,
    terms: LawTerms,
}

impl<I: InputForm> ClassicLqr<I> {
    /// Takes over the integral action of `old`, which flew until now.
    pub(super) fn adopt(&mut self, old: &Self) {
        self.theta_i.adopt(&old.theta_i);
    }

    /// The law with these options. The first Riccati equation is solved in the first step.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn new(options: LqrOptions, input: I) -> Result<Self, OptionError> {
        options.check()?;
        let widths = [options.cell_rate_rad_s, options.cell_angle_rad];
        let widths = SVector::from_fn(|row, _| widths[row / 3]);
        let grid = CellGrid { cells: options.cells, widths, resolve: options.resolve };
        let (schedule, theta_i) =
            (GainSchedule::new(grid), Integral::new(options.integral_limit_rad_s));
        Ok(Self { options, input, schedule, theta_i, terms: LawTerms::default() })
    }

    /// `A` of Eq. (31) at the operating point `[omega; Theta]`.
    pub fn state_matrix(options: &LqrOptions, input: &I, point: &SVector<f64, 6>) -> Matrix6<f64> {
        let omega = Vector3::from(point.fixed_rows::<3>(0));
        let mut theta = EulerAngles::from_vector(&point.fixed_rows::<3>(3).into());
        let limit = options.operating_pitch_limit_rad;
        theta.pitch = theta.pitch.clamp(-limit, limit);
        let mut a = Matrix6::zeros();
        // Eqs. (4), (31), erratum E-03
        if let Some(j) = input.inertia() {
            a.fixed_view_mut::<3, 3>(0, 0)
                .copy_from(&-(j.inverse() * omega.cross_matrix() * j.matrix()));
        }
        a.fixed_view_mut::<3, 3>(3, 0).copy_from(&theta.rate_matrix());
        a
    }

    /// The gain at the operating point `[omega; Theta]`.
    ///
    /// # Errors
    /// If the Riccati equation has no usable solution.
    pub fn gain_at(
        options: &LqrOptions,
        input: &I,
        point: &SVector<f64, 6>,
    ) -> Result<Gain, RiccatiError> {
        AugmentedModel::new(&Self::state_matrix(options, input, point), input)
            .gain(&options.weights())
    }

    /// The loop of the law and the linear model at the operating point `[omega; Theta]`, with the set-point as its input.
    ///
    /// # Errors
    /// If the Riccati equation has no usable solution.
    pub fn set_point_loop(
        options: &LqrOptions,
        input: &I,
        point: &SVector<f64, 6>,
    ) -> Result<SetPointLoop, RiccatiError> {
        let model = AugmentedModel::new(&Self::state_matrix(options, input, point), input);
        Ok(SetPointLoop::new(&model, &model.gain(&options.weights())?))
    }
}

impl<I: InputForm> AttitudeLaw for ClassicLqr<I> {
    type Command = I::Command;

    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> I::Command {
        let theta = EulerAngles::from_attitude(&state.attitude).vector();
        let theta_d = EulerAngles::from_attitude(&reference.attitude).vector();
        let theta_error = (theta - theta_d).map(wrap);
        let error = AttitudeError::between(&reference.attitude, &state.attitude);
        let omega_e = error.rate_error(state.rate, reference.rate);
        let rate = match self.options.rate {
            RateFeedback::Omega => state.rate.0,
            RateFeedback::OmegaE => omega_e,
        };
        let x = law_state(&rate, &theta_error, self.theta_i.value());
        let point =
            law_state(&state.rate.0, &theta, &Vector3::zeros()).fixed_rows::<6>(0).into_owned();
        let k =
            self.schedule.gain(&point, |point| Self::gain_at(&self.options, &self.input, point));

        // Eqs. (24), (25), erratum E-25: N_x = [0; I; 0] and N_u = 0, so the set-point is
        // subtracted from Theta
        let mut u = -(k * x);
        let mut feed_forward = Vector3::zeros();
        if self.options.feed_forward {
            feed_forward = self.input.feed_forward(&error, &omega_e, reference);
            u += feed_forward;
        }
        let integral = -(k.fixed_columns::<3>(INTEGRAL) * self.theta_i.value());
        self.terms = LawTerms::of(&u, integral, feed_forward);

        let given = self.input.saturate(&u);
        // Eq. (33), erratum E-28
        let theta_i_dot = -theta_error;
        let push = -(k.fixed_columns::<3>(INTEGRAL) * theta_i_dot);
        self.theta_i.step(&theta_i_dot, &push, &(u - given), dt_s);
        I::command_from(given)
    }

    fn reset(&mut self) {
        self.schedule.reset();
        self.theta_i.reset();
    }

    fn yield_to(&mut self, _u: &Vector3<f64>) {
        self.theta_i.undo();
    }

    fn terms(&self) -> LawTerms {
        self.terms
    }

    fn set_rate_lag(&mut self, lag_s: f64, period_s: f64) {
        self.input.set_rate_lag(lag_s, period_s);
    }

    fn riccati_solves(&self) -> u32 {
        self.schedule.solves()
    }

    fn failed_solves(&self) -> u32 {
        self.schedule.failed_solves()
    }
}

/// The equivalent angle within half a turn of zero \[rad\].
fn wrap(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}
