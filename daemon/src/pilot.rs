//! From what is known of the vehicle and where it should be to a command: the outer loops of Fig. 16, then the attitude law.

use nalgebra::Vector3;
use oqtal_bus::code::Actuation;
use oqtal_bus::config::{Config, VehicleKind};
use oqtal_bus::message::CommandV1;
use oqtal_control::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, Controller, RateInput, TorqueInput,
};
use oqtal_control::estimator::Estimate;
use oqtal_control::position::{PositionCommand, PositionLoops};
use oqtal_control::trajectory::Reference;

/// Sticks this close to their end, or a torque this close to its limit, count as saturated.
const SATURATED: f64 = 1.0 - 1e-9;

/// The chosen attitude law, in the form that the vehicle takes.
#[derive(Clone, Debug)]
enum Law {
    Sticks(Controller<RateInput>),
    Torque(Controller<TorqueInput>),
}

/// What the pilot wants in one tick.
#[derive(Clone, Copy, Debug)]
pub struct Decision {
    /// What the outer loops want.
    pub wish: PositionCommand,
    /// What the vehicle is told.
    pub command: CommandV1,
    /// Whether the attitude command is at its limit.
    pub saturated: bool,
}

/// The control loops. Pure, and free of allocation in a tick.
#[derive(Clone, Debug)]
pub struct Pilot {
    loops: PositionLoops,
    law: Law,
    max_thrust: f64,
    max_torque: f64,
}

impl Pilot {
    /// The loops of a configuration.
    ///
    /// # Errors
    /// An option of the law, or the inertia, has no meaning; says which.
    pub fn new(config: &Config) -> Result<Self, String> {
        let vehicle = &config.vehicle;
        let options = config.control.controller_options();
        let law = match vehicle.kind {
            VehicleKind::Hummingbird => {
                let input = RateInput::new(Vector3::from(vehicle.rate_authority_rad_s));
                let input = input.map_err(|error| error.to_string())?;
                Law::Sticks(Controller::new(&options, input).map_err(|error| error.to_string())?)
            }
            VehicleKind::Spacecraft => {
                let inertia = vehicle.inertia().map_err(|error| error.to_string())?;
                let input = TorqueInput::new(inertia, vehicle.max_torque_nm);
                let input = input.map_err(|error| error.to_string())?;
                Law::Torque(Controller::new(&options, input).map_err(|error| error.to_string())?)
            }
        };
        Ok(Self {
            loops: PositionLoops::new(&config.position, vehicle.mass_kg, vehicle.gravity_m_s2),
            law,
            max_thrust: vehicle.max_thrust_n,
            max_torque: vehicle.max_torque_nm,
        })
    }

    /// Starts anew: nothing is left of an earlier flight in any integrator.
    pub fn reset(&mut self) {
        self.loops.reset();
        match &mut self.law {
            Law::Sticks(law) => law.reset(),
            Law::Torque(law) => law.reset(),
        }
    }

    /// The command for a vehicle at `estimate` that should be at `reference`, `dt_s` seconds after the last.
    pub fn decide(&mut self, estimate: &Estimate, reference: &Reference, dt_s: f64) -> Decision {
        let wish = self.loops.update(estimate, reference, dt_s);
        let state = AttitudeState { attitude: estimate.attitude, rate: estimate.rate };
        // The outer loops command attitudes, not rates: omega_d = 0, as in the paper's experiments.
        let target = AttitudeReference { attitude: wish.attitude, ..AttitudeReference::default() };
        // Eq. (61), erratum E-61: T = K_T delta_c.
        let thrust = (wish.thrust_n / self.max_thrust).clamp(0.0, 1.0);
        let (command, largest) = match &mut self.law {
            Law::Sticks(law) => {
                let sticks = law.update(&state, &target, dt_s).0;
                let actuation = Actuation::Sticks.code();
                let command =
                    CommandV1 { actuation, sticks: sticks.into(), thrust, ..CommandV1::default() };
                (command, sticks.amax())
            }
            Law::Torque(law) => {
                let torque = law.update(&state, &target, dt_s).0;
                let actuation = Actuation::Torque.code();
                let command =
                    CommandV1 { actuation, torque: torque.into(), thrust, ..CommandV1::default() };
                (command, torque.amax() / self.max_torque)
            }
        };
        Decision { wish, command, saturated: largest >= SATURATED }
    }

    /// Riccati equations that had no solution, so that the last gain was kept.
    #[must_use]
    pub fn riccati_failures(&self) -> u32 {
        match &self.law {
            Law::Sticks(law) => law.failed_solves(),
            Law::Torque(law) => law.failed_solves(),
        }
    }

    /// Riccati equations solved so far.
    #[must_use]
    pub fn riccati_solves(&self) -> u32 {
        match &self.law {
            Law::Sticks(law) => law.riccati_solves(),
            Law::Torque(law) => law.riccati_solves(),
        }
    }
}

/// The last line of defence: a command with a number that is not finite is none.
pub(crate) fn finite_or_neutral(command: CommandV1) -> CommandV1 {
    let numbers = command.sticks.iter().chain(&command.torque).chain([&command.thrust]);
    if numbers.clone().all(|number| number.is_finite()) {
        command
    } else {
        CommandV1 { actuation: Actuation::Neutral.code(), ..CommandV1::default() }
    }
}
