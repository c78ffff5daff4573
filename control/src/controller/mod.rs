//! Attitude laws behind one interface, in both input forms.
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
//! | `Mpc` | `mpc.rs` | linear model predictive control; with the feature `mpc` |
//!
//! A law is written once for every [`InputForm`]: torque for the spacecraft, sticks for the quadrotor. To add a law, write its
//! file, declare it here, and give it a line in the table below: `docs/your-own-law.md`.

mod feedback;
mod filtered_rate;
mod geometric;
mod indi;
mod input;
mod law;
mod lqr;
#[cfg(feature = "mpc")]
mod mpc;
mod oqtal;
mod oqtal_dt;
mod pid;
mod px4;
mod regulator;
mod set_point;

/// The table of the laws: variant, name in a configuration, field, options, law. Names, sections, defaults, checks, tests and
/// studies follow from it.
macro_rules! for_each_law {
    ($callback:ident) => {
        with_optional_laws! {
            $callback
            /// Quaternion PID, Eqs. (17) to (19).
            Pid = "pid", pid: PidOptions => QuaternionPid;
            /// Classic LQR on Euler angles, Eqs. (24), (34).
            Lqr = "lqr", lqr: LqrOptions => ClassicLqr;
            /// OQTAL, the paper's law, Eq. (56).
            Oqtal = "oqtal", oqtal: OqtalOptions => Oqtal;
            /// OQTAL in discrete time. Not in the paper.
            OqtalDt = "oqtal-dt", oqtal_dt: OqtalDtOptions => OqtalDt;
            /// Geometric tracking on SO(3). Not in the paper.
            Geometric = "geometric", geometric: GeometricOptions => Geometric;
            /// PX4's attitude control. Not in the paper.
            Px4 = "px4", px4: Px4Options => Px4Attitude;
            /// Incremental nonlinear dynamic inversion. Not in the paper.
            Indi = "indi", indi: IndiOptions => Indi;
        }
    };
}
pub(crate) use for_each_law;

/// Adds the laws that need more than this crate's own dependencies.
#[cfg(feature = "mpc")]
macro_rules! with_optional_laws {
    ($callback:ident $($laws:tt)*) => {
        $callback! {
            $($laws)*
            /// Linear model predictive control. Not in the paper.
            Mpc = "mpc", mpc: MpcOptions => Mpc;
        }
    };
}
#[cfg(not(feature = "mpc"))]
macro_rules! with_optional_laws {
    ($callback:ident $($laws:tt)*) => {
        $callback! { $($laws)* }
    };
}
pub(crate) use with_optional_laws;

mod registry;

pub use crate::tracking_error::{AttitudeReference, AttitudeState};
pub use feedback::RateFeedback;
pub use geometric::{Geometric, GeometricOptions};
pub use indi::{Indi, IndiOptions};
pub use input::{InputForm, RateInput, TorqueInput};
pub use law::{AttitudeLaw, LawOptions, SearchRange};
pub use lqr::{ClassicLqr, LqrOptions};
#[cfg(feature = "mpc")]
pub use mpc::{Mpc, MpcOptions};
pub use oqtal::{EpsDdot, Oqtal, OqtalOptions};
pub use oqtal_dt::{DiscreteGain, OqtalDt, OqtalDtOptions};
pub use pid::{PidOptions, QuaternionPid};
pub use px4::{Px4Attitude, Px4Options};
pub use registry::{Controller, ControllerName, ControllerOptions};
pub use regulator::{AugmentedModel, Gain, LawState, Weights};
pub use set_point::SetPointLoop;
