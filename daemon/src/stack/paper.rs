//! The paper's control stack: the six PIDs of Fig. 16, then the chosen attitude law, on the motion estimated from poses.

use oqtal_config::Config;
use oqtal_control::controller::{AttitudeLaw, AttitudeState, Controller, InputForm};
use oqtal_control::estimator::Estimate;
use oqtal_control::options::OptionError;
use oqtal_control::position::{OuterLoop, PositionLoops};
use oqtal_control::predictive::CommandReport;
use oqtal_control::scalar_pid::PidGains;
use oqtal_control::trajectory::Reference;

use super::flight_stack::{ControlOutput, ControlStep, FlightStack, SATURATED};
use crate::command::{RotationCommand, VehicleCommand};

/// The paper's control stack for a vehicle commanded through `I`.
#[derive(Clone, Debug)]
pub struct PaperStack<I: InputForm> {
    position: PositionLoops,
    law: Controller<I>,
    /// Limit of each component of the rotation command \[as the command\].
    limit: f64,
}

impl<I: InputForm> PaperStack<I> {
    /// The stack of `config`, whose rotation command is at most `limit` \[as the command\].
    ///
    /// # Errors
    /// An option of the law is not allowed.
    pub fn new(config: &Config, input: I, limit: f64) -> Result<Self, OptionError> {
        let vehicle = &config.vehicle;
        let law =
            Controller::new(&config.control, input).map_err(|error| error.within("control"))?;
        let position = PositionLoops::new(&config.position, vehicle.mass_kg, vehicle.gravity_m_s2);
        Ok(Self { position, law, limit })
    }
}

impl<I: InputForm> FlightStack for PaperStack<I>
where
    I::Command: Into<RotationCommand>,
{
    /// The estimate is passed to each tick; nothing is kept.
    fn observe(&mut self, _: f64, _: &Estimate) {}

    fn decide(
        &mut self,
        step: ControlStep,
        estimate: &Estimate,
        reference: &Reference,
    ) -> Option<ControlOutput> {
        let setpoint = self.position.update(estimate, reference, step.dt_s);
        let state = AttitudeState { attitude: estimate.attitude, rate: estimate.rate };
        let rotation = self.law.update(&state, &setpoint.attitude, step.dt_s).into();
        let attitude = setpoint.attitude.attitude;
        let command = VehicleCommand::Armed { rotation, thrust_n: setpoint.thrust_n, attitude };
        let saturated = rotation.vector().amax() / self.limit >= SATURATED;
        Some(ControlOutput { setpoint, command, saturated })
    }

    /// The paper's laws do not predict.
    fn sent(&mut self, _: u64, _: f64, _: &VehicleCommand) {}

    /// The paper's laws do not predict.
    fn applied(&mut self, _: CommandReport) {}

    fn set_loop(&mut self, which: OuterLoop, gains: PidGains) {
        self.position.set_gains(which, gains);
    }

    fn reset(&mut self) {
        self.position.reset();
        self.law.reset();
    }

    fn riccati_solves(&self) -> u32 {
        self.law.riccati_solves()
    }

    fn riccati_failures(&self) -> u32 {
        self.law.failed_solves()
    }
}
