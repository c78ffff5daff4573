//! Attitude laws behind one interface, in both input forms.
//!
//! | law | file | what it is |
//! |---|---|---|
//! | [`Oqtal`] | `oqtal.rs` | the paper's: LQR on the quaternion error model, Eq. (56) |
//! | [`ClassicLqr`] | `lqr.rs` | LQR on Euler angles, Eqs. (24), (34) |
//! | [`QuaternionPid`] | `pid.rs` | PID on the quaternion error, Eqs. (17) to (19) |
//! | [`OqtalDt`] | `oqtal_dt.rs` | ours: discrete time, split weights, feed-forward |
//! | [`Geometric`] | `geometric.rs` | Lee's tracking on SO(3) |
//!
//! A law is written once for every [`InputForm`]: torque for the spacecraft, sticks for the
//! quadrotor. To add a law, give it a file and options like these and a line in each list of this
//! file.

mod feedback;
mod geometric;
mod input;
mod lqr;
mod oqtal;
mod oqtal_dt;
mod pid;
mod regulator;

use serde::{Deserialize, Serialize};

use crate::options::OptionError;
pub use crate::tracking_error::{AttitudeReference, AttitudeState};
pub use feedback::RateFeedback;
pub use geometric::{Geometric, GeometricOptions};
pub use input::{InputForm, RateInput, TorqueInput};
pub use lqr::{ClassicLqr, LqrOptions};
pub use oqtal::{EpsDdot, Oqtal, OqtalOptions};
pub use oqtal_dt::{DiscreteGain, OqtalDt, OqtalDtOptions};
pub use pid::{PidOptions, QuaternionPid};
pub use regulator::{AugmentedModel, Gain, LawState, Weights};

/// A law that turns the body to its reference.
///
/// Whatever a law is given, it commands something finite and within the vehicle's range, and
/// nothing it is given spoils a later command.
pub trait AttitudeLaw {
    /// What the vehicle is commanded: [`Torque`](crate::quantity::Torque) or
    /// [`StickCommand`](crate::quantity::StickCommand). The default is neutral.
    type Command: Default;

    /// The command for a body at `state` that should be at `reference`, `dt_s` seconds after the
    /// last. Neutral, and the law unchanged, if any number it is given is not finite.
    fn update(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> Self::Command {
        if state.is_finite() && reference.is_finite() && dt_s.is_finite() {
            self.command(state, reference, dt_s)
        } else {
            Self::Command::default()
        }
    }

    /// What [`update`](Self::update) does with numbers that are finite: the law itself.
    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> Self::Command;

    /// Starts anew: integral action at zero, and a gain computed in the next step. Counts go on.
    fn reset(&mut self);

    /// How often a Riccati equation was solved, the first time and failures included.
    fn riccati_solves(&self) -> u32 {
        0
    }

    /// How often solving one failed, so that the last gain was kept.
    fn failed_solves(&self) -> u32 {
        0
    }
}

/// The names of the laws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ControllerName {
    /// [`QuaternionPid`].
    Pid,
    /// [`ClassicLqr`].
    Lqr,
    /// [`Oqtal`].
    #[default]
    Oqtal,
    /// [`OqtalDt`].
    OqtalDt,
    /// [`Geometric`].
    Geometric,
}

/// Which law flies, and the options of all of them. The default is for the Hummingbird in rate
/// form.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ControllerOptions {
    /// The law that flies.
    pub controller: ControllerName,
    /// Rate of the loop, for laws that are designed for it \[Hz\].
    pub rate_hz: f64,
    /// Options of [`QuaternionPid`].
    pub pid: PidOptions,
    /// Options of [`ClassicLqr`].
    pub lqr: LqrOptions,
    /// Options of [`Oqtal`].
    pub oqtal: OqtalOptions,
    /// Options of [`OqtalDt`].
    pub oqtal_dt: OqtalDtOptions,
    /// Options of [`Geometric`].
    pub geometric: GeometricOptions,
}

impl Default for ControllerOptions {
    fn default() -> Self {
        Self {
            controller: ControllerName::default(),
            rate_hz: 60.0,
            pid: PidOptions::default(),
            lqr: LqrOptions::default(),
            oqtal: OqtalOptions::default(),
            oqtal_dt: OqtalDtOptions::default(),
            geometric: GeometricOptions::default(),
        }
    }
}

impl ControllerOptions {
    /// The gains of the paper's gravity turn, Table IV: for the spacecraft in torque form.
    #[must_use]
    pub fn spacecraft() -> Self {
        Self {
            pid: PidOptions::spacecraft(),
            lqr: LqrOptions::spacecraft(),
            oqtal: OqtalOptions::spacecraft(),
            oqtal_dt: OqtalDtOptions::spacecraft(),
            geometric: GeometricOptions::spacecraft(),
            ..Self::default()
        }
    }

    /// Whether every law could be built with these options.
    ///
    /// # Errors
    /// The first option whose value has no meaning.
    pub fn check(&self) -> Result<(), OptionError> {
        self.pid.check()?;
        self.lqr.check()?;
        self.oqtal.check()?;
        self.oqtal_dt.check()?;
        self.geometric.check()
    }
}

/// Any of the laws, chosen by name.
#[derive(Clone, Copy, Debug, PartialEq)]
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
}

impl<I: InputForm> Controller<I> {
    /// The law that `options` names, for a vehicle commanded through `input`.
    ///
    /// # Errors
    /// An option of that law whose value has no meaning.
    pub fn new(options: &ControllerOptions, input: I) -> Result<Self, OptionError> {
        Ok(match options.controller {
            ControllerName::Pid => Self::Pid(QuaternionPid::new(options.pid, input)?),
            ControllerName::Lqr => Self::Lqr(ClassicLqr::new(options.lqr, input)?),
            ControllerName::Oqtal => Self::Oqtal(Oqtal::new(options.oqtal, input)?),
            ControllerName::OqtalDt => {
                Self::OqtalDt(OqtalDt::new(options.oqtal_dt, input, 1.0 / options.rate_hz)?)
            }
            ControllerName::Geometric => Self::Geometric(Geometric::new(options.geometric, input)?),
        })
    }

    fn law(&self) -> &dyn AttitudeLaw<Command = I::Command> {
        match self {
            Self::Pid(law) => law,
            Self::Lqr(law) => law,
            Self::Oqtal(law) => law,
            Self::OqtalDt(law) => law,
            Self::Geometric(law) => law,
        }
    }

    fn law_mut(&mut self) -> &mut dyn AttitudeLaw<Command = I::Command> {
        match self {
            Self::Pid(law) => law,
            Self::Lqr(law) => law,
            Self::Oqtal(law) => law,
            Self::OqtalDt(law) => law,
            Self::Geometric(law) => law,
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

    fn riccati_solves(&self) -> u32 {
        self.law().riccati_solves()
    }

    fn failed_solves(&self) -> u32 {
        self.law().failed_solves()
    }
}
