//! The attitude law within the autopilot: `oqtal-dt`, or any other one, so that laws can be compared within the same estimation and prediction.

use nalgebra::Vector3;

use crate::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, Controller, InputForm, LawTerms, OqtalDt,
};

/// The attitude law of an [`Autopilot`](super::Autopilot).
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::large_enum_variant)]
pub(super) enum InnerLaw<I> {
    /// Law for which the autopilot is designed.
    Own(OqtalDt<I>),
    /// Another law, which limits its input before the estimated bias is subtracted.
    Other(Controller<I>),
}

impl<I: InputForm> InnerLaw<I> {
    /// The input for a body at `state` that should be at `reference`, `dt_s` after the last one \[s\]
    /// \[N m, body axes, in rate form -1..1\].
    pub(super) fn input(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> Vector3<f64> {
        match self {
            Self::Own(law) => law.input(state, reference),
            Self::Other(law) => I::u_from(law.update(state, reference, dt_s)),
        }
    }

    /// Sets the lag of the rate \[s\] for a loop that runs every `period_s` \[s\].
    pub(super) fn set_rate_lag(&mut self, lag_s: f64, period_s: f64) {
        match self {
            Self::Own(law) => law.set_rate_lag(lag_s, period_s),
            Self::Other(law) => law.set_rate_lag(lag_s, period_s),
        }
    }

    /// Records that the input `u` of another law was sent in place of the last one \[as the input\].
    pub(super) fn yield_to(&mut self, u: &Vector3<f64>) {
        match self {
            Self::Own(law) => law.yield_to(u),
            Self::Other(law) => law.yield_to(u),
        }
    }

    /// Restarts integral action.
    pub(super) fn reset(&mut self) {
        match self {
            Self::Own(law) => law.reset(),
            Self::Other(law) => law.reset(),
        }
    }

    /// Terms of the last input.
    pub(super) fn terms(&self) -> LawTerms {
        match self {
            Self::Own(law) => law.terms(),
            Self::Other(law) => law.terms(),
        }
    }

    /// Number of Riccati equations solved so far \[-\].
    pub(super) fn riccati_solves(&self) -> u32 {
        match self {
            Self::Own(law) => law.riccati_solves(),
            Self::Other(law) => law.riccati_solves(),
        }
    }

    /// Number of Riccati equations without a usable solution so far \[-\].
    pub(super) fn riccati_failures(&self) -> u32 {
        match self {
            Self::Own(law) => law.failed_solves(),
            Self::Other(law) => law.failed_solves(),
        }
    }
}
