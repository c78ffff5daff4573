//! Attitude laws behind one interface, in both input forms, and the section `[control]` of a configuration.
//!
//! | law | file | what it is |
//! |---|---|---|
//! | [`Oqtal`] | `oqtal.rs` | the paper's: LQR on the quaternion error model, Eq. (56) |
//! | [`ClassicLqr`] | `lqr.rs` | LQR on Euler angles, Eqs. (24), (34) |
//! | [`QuaternionPid`] | `pid.rs` | PID on the quaternion error, Eqs. (17) to (19) |
//! | [`OqtalDt`] | `oqtal_dt.rs` | ours: discrete time, split weights, feed-forward |
//! | [`Geometric`] | `geometric.rs` | Lee's tracking on SO(3) |
//! | [`Px4Attitude`] | `px4.rs` | PX4's: reduced attitude with a weight on yaw, rate loop |
//! | [`Indi`] | `indi.rs` | incremental nonlinear dynamic inversion |
//! | [`Mpc`] | `mpc.rs` | linear model predictive control |
//!
//! A law is written once for every [`InputForm`]: torque for the spacecraft, sticks for the quadrotor. This file is the table of
//! the laws: [`ControllerName`] lists their names, [`ControlOptions`] their options, and [`Controller::new`] calls the constructor
//! that belongs to a name. To add a law, write its file and give it a line in each list below; the compiler or a test names
//! the lists that lack it. `docs/your-own-law.md` is an example.

mod adopt;
mod fallback;
mod feedback;
mod filtered_rate;
mod geometric;
mod indi;
mod input;
mod law;
mod lqr;
mod mpc;
mod oqtal;
mod oqtal_dt;
mod pid;
mod px4;
mod regulator;
mod set_point;

use std::fmt;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::estimator::EstimatorOptions;
use crate::options::{OptionError, Rule, check_options};
use crate::predictive::PredictiveOptions;
pub use crate::tracking_error::{AttitudeReference, AttitudeState};
pub use feedback::RateFeedback;
pub use geometric::{Geometric, GeometricOptions};
pub use indi::{Indi, IndiOptions};
pub use input::{InputForm, RateInput, TorqueInput};
pub use law::{AttitudeLaw, LawTerms, SearchRange};
pub use lqr::{ClassicLqr, LqrOptions};
pub use mpc::{Mpc, MpcOptions};
pub use oqtal::{EpsDdot, Oqtal, OqtalOptions};
pub use oqtal_dt::{DiscreteGain, OqtalDt, OqtalDtOptions};
pub use pid::{PidOptions, QuaternionPid};
pub use px4::{Px4Attitude, Px4Options};
pub use regulator::{AugmentedModel, Gain, LawState, Weights};
pub use set_point::SetPointLoop;

/// Name of an attitude law: in a configuration, `oqtal-dt` for [`OqtalDt`](Self::OqtalDt).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ControllerName {
    /// Quaternion PID, Eqs. (17) to (19).
    Pid,
    /// Classic LQR on Euler angles, Eqs. (24), (34).
    Lqr,
    /// OQTAL, the paper's law, Eq. (56).
    #[default]
    Oqtal,
    /// OQTAL in discrete time. Not in the paper.
    OqtalDt,
    /// Geometric tracking on SO(3). Not in the paper.
    Geometric,
    /// PX4's attitude control. Not in the paper.
    Px4,
    /// Incremental nonlinear dynamic inversion. Not in the paper.
    Indi,
    /// Linear model predictive control. Not in the paper.
    Mpc,
    /// A law outside the daemon; a built-in law, the fallback, flies whenever it fails.
    External,
}

impl ControllerName {
    /// Every built-in law.
    pub const ALL: [Self; 8] = [
        Self::Pid,
        Self::Lqr,
        Self::Oqtal,
        Self::OqtalDt,
        Self::Geometric,
        Self::Px4,
        Self::Indi,
        Self::Mpc,
    ];

    /// Names of [`ALL`](Self::ALL) in a configuration.
    pub const NAMES: [&str; Self::ALL.len()] =
        ["pid", "lqr", "oqtal", "oqtal-dt", "geometric", "px4", "indi", "mpc"];

    /// Name in a configuration.
    pub const fn name(self) -> &'static str {
        match self {
            Self::External => "external",
            built_in => Self::NAMES[built_in as usize],
        }
    }

    /// Gains that `oqtal tune` searches, the one that the study of the greatest gain raises first. Keys are relative to the
    /// section of the law.
    pub const fn tuned_gains(self) -> &'static [SearchRange] {
        match self {
            Self::Pid => PidOptions::TUNED,
            Self::Lqr => LqrOptions::TUNED,
            Self::Oqtal => OqtalOptions::TUNED,
            Self::OqtalDt => OqtalDtOptions::TUNED,
            Self::Geometric => GeometricOptions::TUNED,
            Self::Px4 => Px4Options::TUNED,
            Self::Indi => IndiOptions::TUNED,
            Self::Mpc => MpcOptions::TUNED,
            Self::External => &[],
        }
    }

    /// Whether the law always flies within the estimation, prediction and position law of [`crate::predictive`].
    pub const fn is_predictive(self) -> bool {
        matches!(self, Self::OqtalDt | Self::Mpc)
    }
}

impl fmt::Display for ControllerName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Estimation and position control around an attitude law.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LawStack {
    /// The autopilot of [`crate::predictive`] around `oqtal-dt` and `mpc`, estimator and position loops around every other law.
    #[default]
    Default,
    /// The autopilot of [`crate::predictive`] around every law.
    Predictive,
}

/// The section `[control]`. The default is for the Hummingbird in rate form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ControlOptions {
    /// Rate of the loop \[Hz\].
    pub rate_hz: f64,
    /// Law that flies.
    pub controller: ControllerName,
    /// Law that takes over when `controller` fails; `None`: [`GEOMETRIC`](ControllerName::Geometric) for an external law, none for a
    /// built-in one.
    #[serde(with = "fallback")]
    pub fallback: Option<ControllerName>,
    /// Options of the quaternion PID.
    pub pid: PidOptions,
    /// Options of the classic LQR.
    pub lqr: LqrOptions,
    /// Options of OQTAL.
    pub oqtal: OqtalOptions,
    /// Options of OQTAL in discrete time.
    pub oqtal_dt: OqtalDtOptions,
    /// Options of geometric tracking.
    pub geometric: GeometricOptions,
    /// Options of PX4's attitude control.
    pub px4: Px4Options,
    /// Options of incremental nonlinear dynamic inversion.
    pub indi: IndiOptions,
    /// Options of model predictive control.
    pub mpc: MpcOptions,
    /// Estimation and position control around the law.
    pub stack: LawStack,
    /// Filters, reference model and position law of [`Autopilot`](crate::predictive::Autopilot).
    pub predictive: PredictiveOptions,
    /// Estimator of velocity and body rate for a law outside the autopilot.
    pub estimator: EstimatorOptions,
}

impl Default for ControlOptions {
    fn default() -> Self {
        Self {
            rate_hz: 60.0,
            controller: ControllerName::default(),
            fallback: None,
            pid: PidOptions::default(),
            lqr: LqrOptions::default(),
            oqtal: OqtalOptions::default(),
            oqtal_dt: OqtalDtOptions::default(),
            geometric: GeometricOptions::default(),
            px4: Px4Options::default(),
            indi: IndiOptions::default(),
            mpc: MpcOptions::default(),
            stack: LawStack::default(),
            predictive: PredictiveOptions::default(),
            estimator: EstimatorOptions::default(),
        }
    }
}

impl ControlOptions {
    /// The gains of the paper's gravity turn, Table IV: for the spacecraft in torque form.
    pub fn spacecraft() -> Self {
        Self {
            pid: PidOptions::spacecraft(),
            lqr: LqrOptions::spacecraft(),
            oqtal: OqtalOptions::spacecraft(),
            oqtal_dt: OqtalDtOptions::spacecraft(),
            geometric: GeometricOptions::spacecraft(),
            px4: Px4Options::spacecraft(),
            indi: IndiOptions::spacecraft(),
            mpc: MpcOptions::spacecraft(),
            ..Self::default()
        }
    }

    /// Whether the law that flies is outside the daemon.
    pub fn is_external(&self) -> bool {
        self.controller == ControllerName::External
    }

    /// The built-in law that is computed: the one that flies, or the fallback of an external one.
    pub fn built_in(&self) -> ControllerName {
        match self.controller {
            ControllerName::External => self.fallback.unwrap_or(ControllerName::Geometric),
            built_in => built_in,
        }
    }

    /// Whether the autopilot of [`crate::predictive`] is around the built-in law that is computed. It always is around the fallback
    /// of an external law: it has no integrals of the position error, which wind up while another law flies.
    pub fn is_predictive(&self) -> bool {
        self.is_external() || self.built_in().is_predictive() || self.stack == LawStack::Predictive
    }

    /// The options of the fallback of a built-in law, which flies within the autopilot of [`crate::predictive`]; `None` without a
    /// fallback, and for an external law, whose fallback these options describe.
    pub fn of_fallback(&self) -> Option<Self> {
        let controller = self.fallback.filter(|_| !self.is_external())?;
        Some(Self { controller, fallback: None, stack: LawStack::Predictive, ..*self })
    }

    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([("rate-hz", self.rate_hz, Rule::Between(1.0, 1000.0))])?;
        let sections = [
            ("pid", self.pid.check()),
            ("lqr", self.lqr.check()),
            ("oqtal", self.oqtal.check()),
            ("oqtal-dt", self.oqtal_dt.check()),
            ("geometric", self.geometric.check()),
            ("px4", self.px4.check()),
            ("indi", self.indi.check()),
            ("mpc", self.mpc.check()),
            ("predictive", self.predictive.check()),
            ("estimator", self.estimator.check()),
        ];
        sections
            .into_iter()
            .try_for_each(|(section, checked)| checked.map_err(|error| error.within(section)))
    }
}

/// The law that flies, for a vehicle commanded through `I`.
// Not boxed: the cache warm-up copies the law, and a copy must not allocate.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)]
pub enum Controller<I> {
    /// Quaternion PID.
    Pid(QuaternionPid<I>),
    /// Classic LQR.
    Lqr(ClassicLqr<I>),
    /// OQTAL.
    Oqtal(Oqtal<I>),
    /// OQTAL in discrete time.
    OqtalDt(OqtalDt<I>),
    /// Geometric tracking.
    Geometric(Geometric<I>),
    /// PX4's attitude control.
    Px4(Px4Attitude<I>),
    /// Incremental nonlinear dynamic inversion.
    Indi(Indi<I>),
    /// Model predictive control.
    Mpc(Mpc<I>),
}

impl<I: InputForm> Controller<I> {
    /// The law that `options` name, for a vehicle commanded through `input`.
    ///
    /// # Errors
    /// An option of that law whose value is not allowed, with its key in the section `[control]`: `pid.gain`.
    pub fn new(options: &ControlOptions, input: I) -> Result<Self, OptionError> {
        let period_s = 1.0 / options.rate_hz;
        let law = match options.built_in() {
            ControllerName::Pid => QuaternionPid::new(options.pid, input).map(Self::Pid),
            ControllerName::Lqr => ClassicLqr::new(options.lqr, input).map(Self::Lqr),
            ControllerName::Oqtal => Oqtal::new(options.oqtal, input).map(Self::Oqtal),
            ControllerName::OqtalDt => {
                OqtalDt::new(options.oqtal_dt, input, period_s).map(Self::OqtalDt)
            }
            ControllerName::Geometric => {
                Geometric::new(options.geometric, input).map(Self::Geometric)
            }
            ControllerName::Px4 => Px4Attitude::new(options.px4, input).map(Self::Px4),
            ControllerName::Indi => Indi::new(options.indi, input).map(Self::Indi),
            ControllerName::Mpc => Mpc::new(options.mpc, input, period_s).map(Self::Mpc),
            ControllerName::External => {
                return Err(OptionError::new("fallback", "external", "a built-in law"));
            }
        };
        law.map_err(|error| error.within(options.built_in().name()))
    }

    fn law(&self) -> &dyn AttitudeLaw<Command = I::Command> {
        match self {
            Self::Pid(law) => law,
            Self::Lqr(law) => law,
            Self::Oqtal(law) => law,
            Self::OqtalDt(law) => law,
            Self::Geometric(law) => law,
            Self::Px4(law) => law,
            Self::Indi(law) => law,
            Self::Mpc(law) => law,
        }
    }

    fn law_mut(&mut self) -> &mut dyn AttitudeLaw<Command = I::Command> {
        match self {
            Self::Pid(law) => law,
            Self::Lqr(law) => law,
            Self::Oqtal(law) => law,
            Self::OqtalDt(law) => law,
            Self::Geometric(law) => law,
            Self::Px4(law) => law,
            Self::Indi(law) => law,
            Self::Mpc(law) => law,
        }
    }
}

impl<I: InputForm> AttitudeLaw for Controller<I> {
    type Command = I::Command;

    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> I::Command {
        self.law_mut().command(state, reference, dt_s)
    }

    fn reset(&mut self) {
        self.law_mut().reset();
    }

    fn yield_to(&mut self, u: &Vector3<f64>) {
        self.law_mut().yield_to(u);
    }

    fn terms(&self) -> LawTerms {
        self.law().terms()
    }

    fn set_rate_lag(&mut self, lag_s: f64, period_s: f64) {
        self.law_mut().set_rate_lag(lag_s, period_s);
    }

    fn riccati_solves(&self) -> u32 {
        self.law().riccati_solves()
    }

    fn failed_solves(&self) -> u32 {
        self.law().failed_solves()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_in_the_order_of_the_laws_and_those_of_a_configuration() {
        for (index, controller) in ControllerName::ALL.into_iter().enumerate() {
            assert_eq!(controller as usize, index);
            let name = serde_json::to_string(&controller).unwrap();
            assert_eq!(name, format!("\"{}\"", ControllerName::NAMES[index]));
        }
    }
}
