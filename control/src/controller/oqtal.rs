//! OQTAL, the paper's law: a linear-quadratic regulator on the attitude error.
//!
//! Terms: `eps`, `lambda` and `omega_e` are the tracking error ([`crate::error`]); `eps_I` is the
//! integral of `-eps`; the model that `K` is optimal for is [`crate::error_model`]; when `K` is
//! computed is up to [`crate::schedule`].
//!
//! ```text
//! u = -K [omega_e; eps; eps_I] + omega x J omega        Eq. (56), corrected
//! ```

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use super::input::InputForm;
use super::options::InvalidOption;
use super::regulator::{AugmentedModel, Gain, INTEGRAL, Weights, law_state};
use super::{AttitudeLaw, AttitudeReference, AttitudeState};
use crate::error::AttitudeError;
use crate::error_model::{ErrorModel, Jacobian, OperatingPoint};
use crate::integral::Integral;
use crate::riccati::RiccatiError;
use crate::schedule::{Cells, GainSchedule, Grid, Resolve};

/// Options of [`Oqtal`]. The default is for the Hummingbird in rate form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct OqtalOptions {
    /// `q`: weight on `eps`.
    pub attitude_weight: f64,
    /// Weight on `omega_e` \[s^2/rad^2\]; without effect in rate form.
    pub rate_weight: f64,
    /// Weight on `eps_I` as a fraction of `attitude-weight` \[1/s^2\]; 0 is no integral action.
    pub integral_weight: f64,
    /// `r`: weight on the input.
    pub input_weight: f64,
    /// Limit of each component of `eps_I` \[s\].
    pub integral_limit_s: f64,
    /// Which linear model; without effect in rate form, where all are the same.
    pub jacobian: Jacobian,
    /// Which cells of `[omega_e; eps]`, in rate form of `eps`, share a gain.
    pub cells: Cells,
    /// `delta`: width of a cell \[rad/s for `omega_e`, none for `eps`\].
    pub delta_rad: f64,
    /// When the gain is computed.
    pub resolve: Resolve,
    /// Whether the reference's own motion is fed forward. Not in the paper.
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
            // Not in the paper, which prints `floor` and reports a count that only this rule or a
            // like one can give.
            cells: Cells::Truncated,
            // In the paper: Section VIII, without a unit.
            delta_rad: 0.5,
            resolve: Resolve::OnCellChange,
            feed_forward: false,
        }
    }
}

impl OqtalOptions {
    /// For the paper's spacecraft in torque form: Table IV, no integral action, `delta` of Section
    /// VI.B.2.
    #[must_use]
    pub fn spacecraft() -> Self {
        Self {
            attitude_weight: 256.0,
            rate_weight: 256.0,
            integral_weight: 0.0,
            delta_rad: 0.2,
            ..Self::default()
        }
    }

    /// Whether a law can be built with these options.
    ///
    /// # Errors
    /// The first option whose value has no meaning.
    pub fn check(&self) -> Result<(), InvalidOption> {
        InvalidOption::unless_positive("attitude-weight", self.attitude_weight)?;
        InvalidOption::unless_not_negative("rate-weight", self.rate_weight)?;
        InvalidOption::unless_not_negative("integral-weight", self.integral_weight)?;
        InvalidOption::unless_positive("input-weight", self.input_weight)?;
        InvalidOption::unless_not_negative("integral-limit-s", self.integral_limit_s)?;
        InvalidOption::unless_positive("delta-rad", self.delta_rad)
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
    schedule: GainSchedule<6, Gain>,
    eps_i: Integral,
}

impl<I: InputForm> Oqtal<I> {
    /// The law with these options. Solves nothing yet.
    ///
    /// # Errors
    /// The first option whose value has no meaning.
    pub fn new(options: OqtalOptions, input: I) -> Result<Self, InvalidOption> {
        options.check()?;
        let grid =
            Grid { cells: options.cells, delta: options.delta_rad, resolve: options.resolve };
        let eps_i = Integral::new(options.integral_limit_s);
        Ok(Self { options, input, schedule: GainSchedule::new(grid), eps_i })
    }

    /// The gain at the operating point `[omega_e; eps]`.
    ///
    /// # Errors
    /// If the Riccati equation has no usable solution.
    pub fn gain_at(
        options: &OqtalOptions,
        input: &I,
        point: &SVector<f64, 6>,
    ) -> Result<Gain, RiccatiError> {
        let (omega_e, eps) = (point.fixed_rows::<3>(0).into(), point.fixed_rows::<3>(3).into());
        let model = ErrorModel::at(options.jacobian, &OperatingPoint::new(eps, omega_e));
        AugmentedModel::new(&model.state_matrix(), input).gain(&options.weights())
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

        // In rate form omega_e is no state of the model and has no say in its operating point.
        let mut point = x.fixed_rows::<6>(0).into_owned();
        if self.input.inertia().is_none() {
            point.fixed_rows_mut::<3>(0).fill(0.0);
        }
        let k =
            self.schedule.gain(&point, |point| Self::gain_at(&self.options, &self.input, point));

        // Eq. (56), erratum E-56
        let mut u = -(k * x) + self.input.gyroscopic(state.rate);
        if self.options.feed_forward {
            u += self.input.feed_forward(&error, &omega_e, reference);
        }

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
    }

    fn riccati_solves(&self) -> u32 {
        self.schedule.solves()
    }

    fn failed_solves(&self) -> u32 {
        self.schedule.failed_solves()
    }
}
