//! OQTAL, the paper's law: a linear-quadratic regulator on the attitude error.
//!
//! Terms: `eps`, `lambda` and `omega_e` are the tracking error ([`crate::tracking_error`]); `eps_I` is the
//! integral of `-eps`; `K` is optimal for a model of [`crate::error_model`] and computed as [`crate::schedule`]
//! decides.
//!
//! ```text
//! u = -K [omega_e; eps; eps_I] + omega x J omega        Eq. (56), corrected
//! ```

use nalgebra::{SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::input::InputForm;
use super::law::{AttitudeLaw, LawTerms, SearchRange};
use super::regulator::{AugmentedModel, Gain, INTEGRAL, Weights, law_state};
use crate::error_model::{ErrorModel, Jacobian, OperatingPoint};
use crate::integral::Integral;
use crate::options::{OptionError, Rule, check_options};
use crate::riccati::RiccatiError;
use crate::scalar_pid::low_pass_weight;
use crate::schedule::{CellGrid, Cells, GainSchedule, Resolve};
use crate::tracking_error::{AttitudeError, AttitudeReference, AttitudeState};

/// Treatment of the second time derivative of `eps` in the model, Section VII.C: the difference of Eq. (38) between
/// two steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EpsDdot {
    /// Neglected: the paper's choice for its quadrotor.
    #[default]
    Dropped,
    /// Finite difference, unfiltered.
    Differenced,
    /// Finite difference through a first-order low-pass: the paper's "some kind of noise cancellation".
    Filtered,
}

/// Options of [`Oqtal`]. The default is for the Hummingbird in rate form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct OqtalOptions {
    /// `q`: weight on `eps` \[-\].
    pub attitude_weight: f64,
    /// Weight on `omega_e` \[s^2/rad^2\]; without effect in rate form.
    pub rate_weight: f64,
    /// Weight on `eps_I` as a fraction of `attitude-weight` \[1/s^2\]; 0 for no integral action.
    pub integral_weight: f64,
    /// `r`: weight on the input \[-\].
    pub input_weight: f64,
    /// Limit of each component of `eps_I` \[s\].
    pub integral_limit_s: f64,
    /// Linear model of the error; without effect in rate form, where all models are equal.
    pub jacobian: Jacobian,
    /// Second derivative of `eps` in that model; without effect in rate form and in the decoupled model, which do not contain it.
    pub eps_ddot: EpsDdot,
    /// Cut-off of the low-pass on the second derivative of `eps` \[Hz\].
    pub eps_ddot_cutoff_hz: f64,
    /// Rule that divides `[omega_e; eps; eps_ddot]` (in rate form `eps`) into cells, with one gain per cell.
    pub cells: Cells,
    /// Width of a cell in each component of `omega_e` \[rad/s\]; without effect in rate form.
    pub cell_rate_rad_s: f64,
    /// Width of a cell in each component of `eps` \[-\].
    pub cell_eps: f64,
    /// Width of a cell in each component of `eps_ddot` \[1/s^2\]; without effect in rate form.
    pub cell_eps_ddot_per_s2: f64,
    /// Condition for recomputing the gain.
    pub resolve: Resolve,
    /// Whether the motion of the reference is fed forward. Not in the paper.
    pub feed_forward: bool,
}

impl Default for OqtalOptions {
    fn default() -> Self {
        Self {
            // Not in the paper: Table V says only that flight is stable up to 200.
            attitude_weight: 80.0,
            // In the paper: Eq. (62) weights it as the attitude.
            rate_weight: 80.0,
            // In the paper: Eq. (62).
            integral_weight: 0.01,
            // In the paper: Section VIII.
            input_weight: 1.0,
            // Not in the paper.
            integral_limit_s: 0.5,
            // Not in the paper.
            jacobian: Jacobian::Decoupled,
            eps_ddot: EpsDdot::Dropped,
            // Not in the paper.
            eps_ddot_cutoff_hz: 2.0,
            // Not in the paper, which prints `floor` but reports a number of solutions that only a rule like this one
            // gives.
            cells: Cells::Truncated,
            // In the paper: `delta` of Section VIII, one number without a unit.
            cell_rate_rad_s: 0.5,
            cell_eps: 0.5,
            cell_eps_ddot_per_s2: 0.5,
            resolve: Resolve::OnCellChange,
            feed_forward: false,
        }
    }
}

impl OqtalOptions {
    /// Gains that are tuned.
    pub(super) const TUNED: &'static [SearchRange] = &[
        SearchRange::new("attitude-weight", 4.0, 1600.0),
        SearchRange::new("integral-weight", 1e-4, 1.0),
    ];

    /// Gains for the paper's spacecraft in torque form: Table IV, no integral action, `delta` of Section VI.B.2.
    pub fn spacecraft() -> Self {
        Self { attitude_weight: 256.0, rate_weight: 256.0, integral_weight: 0.0, ..Self::default() }
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
            ("integral-limit-s", self.integral_limit_s, Rule::NotNegative),
            ("eps-ddot-cutoff-hz", self.eps_ddot_cutoff_hz, Rule::Positive),
            ("cell-rate-rad-s", self.cell_rate_rad_s, Rule::Positive),
            ("cell-eps", self.cell_eps, Rule::Positive),
            ("cell-eps-ddot-per-s2", self.cell_eps_ddot_per_s2, Rule::Positive),
        ])
    }

    /// The same options with cells of the width `delta` in every unit, as in the paper \[rad/s, -, 1/s^2\].
    pub fn with_cell_width(self, delta: f64) -> Self {
        Self { cell_rate_rad_s: delta, cell_eps: delta, cell_eps_ddot_per_s2: delta, ..self }
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

/// The law of Eq. (56) for a vehicle commanded through `I`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Oqtal<I> {
    options: OqtalOptions,
    input: I,
    schedule: GainSchedule<9, Gain>,
    eps_i: Integral,
    /// `eps_dot` of the last step.
    eps_dot: Option<Vector3<f64>>,
    eps_ddot: Vector3<f64>,
    terms: LawTerms,
}

impl<I: InputForm> Oqtal<I> {
    /// Takes over the integral action of `old`, which flew until now.
    pub(super) fn adopt(&mut self, old: &Self) {
        self.eps_i.adopt(&old.eps_i);
    }

    /// The law with these options. The first Riccati equation is solved in the first step.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn new(options: OqtalOptions, input: I) -> Result<Self, OptionError> {
        options.check()?;
        let OqtalOptions { cell_rate_rad_s, cell_eps, cell_eps_ddot_per_s2, .. } = options;
        let widths = [cell_rate_rad_s, cell_eps, cell_eps_ddot_per_s2];
        let widths = SVector::from_fn(|row, _| widths[row / 3]);
        let grid = CellGrid { cells: options.cells, widths, resolve: options.resolve };
        Ok(Self {
            schedule: GainSchedule::new(grid),
            eps_i: Integral::new(options.integral_limit_s),
            eps_dot: None,
            eps_ddot: Vector3::zeros(),
            terms: LawTerms::default(),
            options,
            input,
        })
    }

    /// The gain at the operating point `[omega_e; eps]` without acceleration.
    ///
    /// # Errors
    /// If the Riccati equation has no usable solution.
    pub fn gain_at(
        options: &OqtalOptions,
        input: &I,
        point: &SVector<f64, 6>,
    ) -> Result<Gain, RiccatiError> {
        Self::gain_accelerating(options, input, &point.fixed_resize(0.0))
    }

    /// The gain at the operating point `[omega_e; eps; eps_ddot]`.
    fn gain_accelerating(
        options: &OqtalOptions,
        input: &I,
        point: &SVector<f64, 9>,
    ) -> Result<Gain, RiccatiError> {
        let part = |row| Vector3::from(point.fixed_rows::<3>(row));
        let still = OperatingPoint::new(part(3), part(0));
        let model =
            ErrorModel::at(options.jacobian, &OperatingPoint { eps_ddot: part(6), ..still });
        AugmentedModel::new(&model.state_matrix(), input).gain(&options.weights())
    }

    /// Second derivative of `eps` according to the options \[1/s^2\].
    fn differentiate(&mut self, eps_dot: Vector3<f64>, dt_s: f64) -> Vector3<f64> {
        let weight = match self.options.eps_ddot {
            EpsDdot::Dropped => return Vector3::zeros(),
            EpsDdot::Differenced => 1.0,
            EpsDdot::Filtered => low_pass_weight(self.options.eps_ddot_cutoff_hz, dt_s),
        };
        let raw = self.eps_dot.map_or_else(Vector3::zeros, |last| (eps_dot - last) / dt_s);
        let next = self.eps_ddot + (raw - self.eps_ddot) * weight;
        if next.iter().all(|number| number.is_finite()) {
            (self.eps_dot, self.eps_ddot) = (Some(eps_dot), next);
        }
        self.eps_ddot
    }
}

impl<I: InputForm> AttitudeLaw for Oqtal<I> {
    type Command = I::Command;

    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> I::Command {
        let error = AttitudeError::between(&reference.attitude, &state.attitude);
        let (eps, omega_e) = (error.eps(), error.rate_error(state.rate, reference.rate));
        let x = law_state(&omega_e, eps, self.eps_i.value());

        // In rate form omega_e is not a state of the model, so the operating point does not depend on it.
        let point = match self.input.inertia() {
            Some(_) => law_state(&omega_e, eps, &self.differentiate(error.eps_dot(&omega_e), dt_s)),
            None => law_state(&Vector3::zeros(), eps, &Vector3::zeros()),
        };
        let k = self
            .schedule
            .gain(&point, |point| Self::gain_accelerating(&self.options, &self.input, point));

        // Eq. (56), erratum E-56
        let mut u = -(k * x) + self.input.gyroscopic(state.rate);
        let mut feed_forward = self.input.gyroscopic(state.rate);
        if self.options.feed_forward {
            let of_reference = self.input.feed_forward(&error, &omega_e, reference);
            u += of_reference;
            feed_forward += of_reference;
        }
        let integral = -(k.fixed_columns::<3>(INTEGRAL) * self.eps_i.value());
        self.terms = LawTerms::of(&u, integral, feed_forward);

        let given = self.input.saturate(&u);
        // Eq. (57), erratum E-57
        let eps_i_dot = -eps;
        let push = -(k.fixed_columns::<3>(INTEGRAL) * eps_i_dot);
        self.eps_i.step(&eps_i_dot, &push, &(u - given), dt_s);
        I::command_from(given)
    }

    fn reset(&mut self) {
        self.schedule.reset();
        self.eps_i.reset();
        (self.eps_dot, self.eps_ddot) = (None, Vector3::zeros());
    }

    fn yield_to(&mut self, _u: &Vector3<f64>) {
        self.eps_i.undo();
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
