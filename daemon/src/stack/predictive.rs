//! The predictive control stack: Kalman filters, prediction over the measured delay, reference model and `oqtal-dt`.

use oqtal_config::Config;
use oqtal_control::controller::{Controller, ControllerName, InputForm};
use oqtal_control::estimator::Estimate;
use oqtal_control::options::OptionError;
use oqtal_control::predictive::{
    AdaptedModel, Autopilot, CommandReport, Design, FilterInnovation, Motion, PredictiveCommand,
    PredictiveOutput,
};
use oqtal_control::trajectory::Reference;

use super::flight_stack::{ControlOutput, ControlStep, FlightStack, SATURATED};
use crate::command::{RotationCommand, VehicleCommand, collective};
use crate::command_model::CommandModel;

/// The predictive control stack for a vehicle commanded through `I`.
#[derive(Clone, Debug)]
pub struct PredictiveStack<I> {
    autopilot: Autopilot<I>,
    /// Limit of each component of the rotation command \[as the command\].
    limit: f64,
    max_thrust_n: f64,
}

impl<I: InputForm + Copy> PredictiveStack<I> {
    /// The stack of `config` for a vehicle whose rotation command is at most `limit` \[as the command\].
    ///
    /// # Errors
    /// An option of the law or of the vehicle is not allowed.
    pub fn new(config: &Config, input: I, limit: f64) -> Result<Self, OptionError> {
        let (vehicle, control) = (&config.vehicle, &config.control);
        let model = CommandModel::new(config)?.model;
        let design = Design {
            model,
            input,
            delay_s: vehicle.command_delay_ms * 1e-3,
            period_s: 1.0 / control.rate_hz,
        };
        let autopilot =
            Autopilot::new(design, control.oqtal_dt, &control.predictive, &config.position)
                .map_err(|error| error.within("control.oqtal-dt"))?;
        let autopilot = match control.controller {
            ControllerName::OqtalDt => autopilot,
            _ => autopilot.with_law(
                Controller::new(&control, input).map_err(|error| error.within("control"))?,
            ),
        };
        Ok(Self { autopilot, limit, max_thrust_n: vehicle.max_thrust_n })
    }
}

impl<I: InputForm + Copy> FlightStack for PredictiveStack<I>
where
    I::Command: Into<RotationCommand>,
{
    fn observe(&mut self, captured_s: f64, measured: &Estimate) {
        self.autopilot.observe(captured_s, measured);
    }

    /// The autopilot has an estimate of its own.
    fn decide(
        &mut self,
        step: ControlStep,
        _: &Estimate,
        reference: &Reference,
    ) -> Option<ControlOutput> {
        let decision = self.autopilot.decide(step.now_s, reference)?;
        let PredictiveOutput { setpoint, u, attitude } = decision;
        let rotation: RotationCommand = I::command_from(u).into();
        let command = VehicleCommand::Armed { rotation, thrust_n: setpoint.thrust_n, attitude };
        let saturated = rotation.vector().amax() / self.limit >= SATURATED;
        Some(ControlOutput { setpoint, command, saturated })
    }

    fn filtered(&self) -> Option<(&Motion, Option<&FilterInnovation>)> {
        self.autopilot.filtered()
    }

    fn sent(&mut self, sequence: u64, sent_s: f64, command: &VehicleCommand) {
        let command = match command {
            VehicleCommand::Disarmed => PredictiveCommand::default(),
            // The thrust as the message carries it, a fraction of maximum thrust.
            VehicleCommand::Armed { rotation, thrust_n, attitude } => {
                let fraction = collective(*thrust_n, self.max_thrust_n);
                let thrust_n = fraction * self.max_thrust_n;
                PredictiveCommand { u: rotation.vector(), attitude: *attitude, thrust_n }
            }
        };
        self.autopilot.sent(sequence, sent_s, &command);
    }

    fn applied(&mut self, report: CommandReport) {
        self.autopilot.applied(report);
    }

    fn adapted(&self) -> Option<AdaptedModel> {
        self.autopilot.adapted()
    }

    fn reset(&mut self) {
        self.autopilot.reset();
    }

    fn riccati_solves(&self) -> u32 {
        self.autopilot.riccati_solves()
    }

    fn riccati_failures(&self) -> u32 {
        self.autopilot.riccati_failures()
    }
}
