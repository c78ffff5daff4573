//! The control stack that a configuration asks for.

use nalgebra::Vector3;
use oqtal_config::{Config, Interface};
use oqtal_control::controller::{RateInput, TorqueInput};
use oqtal_control::options::OptionError;

use super::flight_stack::FlightStack;
use super::paper::PaperStack;
use super::predictive::PredictiveStack;
use crate::command_model::inertia;

/// Greatest stick \[-\].
const MAX_STICK: f64 = 1.0;

/// One of the control stacks, in the form that the vehicle takes.
// Not boxed: the cache warm-up copies the stack, and a copy must not allocate.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)]
pub enum ControlStack {
    /// The paper's loops, sticks and the attitude that they bring about out.
    PaperRate(PaperStack<RateInput>),
    /// The paper's loops, torque out.
    PaperTorque(PaperStack<TorqueInput>),
    /// The predictive autopilot, sticks and the attitude that they bring about out.
    PredictiveRate(PredictiveStack<RateInput>),
    /// The predictive autopilot, torque out.
    PredictiveTorque(PredictiveStack<TorqueInput>),
}

impl ControlStack {
    /// The stack of `config`.
    ///
    /// # Errors
    /// An option of the law or of the vehicle is not allowed.
    pub fn new(config: &Config) -> Result<Self, OptionError> {
        let is_predictive = config.control.is_predictive();
        match config.vehicle.interface {
            Interface::Rate | Interface::Attitude => Self::rate(config, is_predictive),
            Interface::Torque => Self::torque(config, is_predictive),
        }
    }

    fn rate(config: &Config, is_predictive: bool) -> Result<Self, OptionError> {
        let vehicle = &config.vehicle;
        let of_vehicle = |error: OptionError| error.within("vehicle");
        let input = RateInput::new(Vector3::from(vehicle.rate_authority_rad_s));
        let input = input.map_err(of_vehicle)?;
        let holds_attitude = vehicle.interface.holds_attitude();
        // The attitude loop on board takes the place of the sticks, which limit nothing then.
        let limit = if holds_attitude { f64::INFINITY } else { MAX_STICK };
        // Of the paper's laws, and of others in its loops, only a feed-forward of the reference's acceleration uses the lag.
        let lag_s = vehicle.rate_lag_ms * 1e-3;
        let input = input.with_lag(lag_s, 1.0 / config.control.rate_hz).map_err(of_vehicle)?;
        if !is_predictive {
            return PaperStack::new(config, input, limit).map(Self::PaperRate);
        }
        PredictiveStack::new(config, input, limit).map(Self::PredictiveRate)
    }

    fn torque(config: &Config, is_predictive: bool) -> Result<Self, OptionError> {
        let vehicle = &config.vehicle;
        let inertia = inertia(vehicle)?;
        let limit = vehicle.max_torque_nm;
        let input = TorqueInput::new(inertia, limit).map_err(|error| error.within("vehicle"))?;
        if !is_predictive {
            return PaperStack::new(config, input, limit).map(Self::PaperTorque);
        }
        PredictiveStack::new(config, input, limit).map(Self::PredictiveTorque)
    }

    /// The stack behind its interface.
    #[must_use]
    pub fn active(&self) -> &dyn FlightStack {
        match self {
            Self::PaperRate(stack) => stack,
            Self::PaperTorque(stack) => stack,
            Self::PredictiveRate(stack) => stack,
            Self::PredictiveTorque(stack) => stack,
        }
    }

    /// The stack behind its interface, to be changed.
    pub fn active_mut(&mut self) -> &mut dyn FlightStack {
        match self {
            Self::PaperRate(stack) => stack,
            Self::PaperTorque(stack) => stack,
            Self::PredictiveRate(stack) => stack,
            Self::PredictiveTorque(stack) => stack,
        }
    }
}
