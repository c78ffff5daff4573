//! From what is known of the vehicle and where it should be to a command: the outer loops of Fig. 16, then the attitude law;
//! or the autopilot, which estimates, predicts and has both.

use nalgebra::Vector3;
use oqtal_bus::code::Actuation;
use oqtal_bus::message::CommandV1;
use oqtal_bus::time::Time;
use oqtal_config::{Config, VehicleKind};
use oqtal_control::controller::{
    AttitudeLaw, AttitudeState, Controller, ControllerName, InputForm, RateInput, TorqueInput,
};
use oqtal_control::estimator::Estimate;
use oqtal_control::position::{PositionCommand, PositionLoops};
use oqtal_control::predictive::{Autopilot, Design, PredictiveOutput, Rotation, VehicleModel};
use oqtal_control::trajectory::Reference;

/// Sticks this close to their end, or a torque this close to its limit, count as saturated.
const SATURATED: f64 = 1.0 - 1e-9;

/// What the pilot wants in one tick.
#[derive(Clone, Copy, Debug)]
pub struct ControlOutput {
    /// What the outer loops want.
    pub setpoint: PositionCommand,
    /// What the vehicle is told.
    pub command: CommandV1,
    /// Whether the attitude command is at its limit.
    pub saturated: bool,
}

/// The loops for a vehicle commanded through `I`.
// Neither is boxed: the daemon rehearses on a copy, which must not allocate.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)]
enum Loops<I: InputForm> {
    /// The paper's.
    Paper(PaperLoops<I>),
    /// Estimation, prediction and `oqtal-dt`.
    Predictive(Autopilot<I>),
}

/// The six PIDs and the chosen law, on the motion as differenced from poses.
#[derive(Clone, Debug)]
struct PaperLoops<I: InputForm> {
    position: PositionLoops,
    law: Controller<I>,
}

/// The loops in the form that the vehicle takes.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)]
enum Form {
    Sticks(Loops<RateInput>),
    Torque(Loops<TorqueInput>),
}

/// The control loops. Pure, and free of allocation in a tick.
#[derive(Clone, Debug)]
pub struct Pilot {
    form: Form,
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
        let form = match vehicle.kind {
            VehicleKind::Hummingbird => {
                let input = RateInput::new(Vector3::from(vehicle.rate_authority_rad_s));
                let lag_s = vehicle.rate_lag_ms * 1e-3;
                let rotation = Rotation::RateLoop { lag_s };
                let predictive = config.control.controller == ControllerName::OqtalDt;
                let input = input.and_then(|input| match predictive {
                    true => input.with_lag(lag_s, 1.0 / config.control.rate_hz),
                    false => Ok(input),
                });
                Form::Sticks(Loops::new(config, input.map_err(|e| e.to_string())?, rotation)?)
            }
            VehicleKind::Spacecraft => {
                let inertia = vehicle.inertia().map_err(|error| error.to_string())?;
                let input = TorqueInput::new(inertia, vehicle.max_torque_nm);
                let rotation = Rotation::RigidBody { inertia };
                Form::Torque(Loops::new(config, input.map_err(|e| e.to_string())?, rotation)?)
            }
        };
        Ok(Self { form, max_thrust: vehicle.max_thrust_n, max_torque: vehicle.max_torque_nm })
    }

    /// Starts anew: nothing is left of an earlier flight in any integrator.
    pub fn reset(&mut self) {
        match &mut self.form {
            Form::Sticks(loops) => loops.reset(),
            Form::Torque(loops) => loops.reset(),
        }
    }

    /// Takes a believed pose captured at `captured_at`, with the rates that follow from differences.
    pub fn observe(&mut self, captured_at: Time, measured: &Estimate) {
        let captured_s = seconds(captured_at);
        match &mut self.form {
            Form::Sticks(Loops::Predictive(autopilot)) => autopilot.observe(captured_s, measured),
            Form::Torque(Loops::Predictive(autopilot)) => autopilot.observe(captured_s, measured),
            _ => {}
        }
    }

    /// The command that wants motors to run, and nothing of them.
    #[must_use]
    pub fn idle(&self) -> CommandV1 {
        let actuation = match self.form {
            Form::Sticks(_) => Actuation::Sticks,
            Form::Torque(_) => Actuation::Torque,
        };
        // Level.
        CommandV1 {
            actuation: actuation.code(),
            attitude: [0.0, 0.0, 0.0, 1.0],
            ..CommandV1::default()
        }
    }

    /// Remembers what was sent, and when: a prediction rests on it.
    pub fn sent(&mut self, sequence: u64, at: Time, command: &CommandV1) {
        let thrust = command.thrust * self.max_thrust;
        match &mut self.form {
            Form::Sticks(Loops::Predictive(autopilot)) => {
                autopilot.sent(sequence, seconds(at), (&command.sticks.into(), thrust));
            }
            Form::Torque(Loops::Predictive(autopilot)) => {
                autopilot.sent(sequence, seconds(at), (&command.torque.into(), thrust));
            }
            _ => {}
        }
    }

    /// Learns when a command began to act.
    pub fn applied(&mut self, sequence: u64, at: Time) {
        match &mut self.form {
            Form::Sticks(Loops::Predictive(autopilot)) => autopilot.applied(sequence, seconds(at)),
            Form::Torque(Loops::Predictive(autopilot)) => autopilot.applied(sequence, seconds(at)),
            _ => {}
        }
    }

    /// The command at `now` for a vehicle at `estimate` that should be at `reference`, `dt_s` seconds after the last. `None`
    /// if there is nothing to go by.
    pub fn decide(
        &mut self,
        (now, dt_s): (Time, f64),
        estimate: &Estimate,
        reference: &Reference,
    ) -> Option<ControlOutput> {
        let now_s = seconds(now);
        let (PredictiveOutput { setpoint, u }, actuation, limit) = match &mut self.form {
            Form::Sticks(loops) => {
                (loops.decide((now_s, dt_s), estimate, reference)?, Actuation::Sticks, 1.0)
            }
            Form::Torque(loops) => {
                let output = loops.decide((now_s, dt_s), estimate, reference)?;
                (output, Actuation::Torque, self.max_torque)
            }
        };
        // Eq. (61), erratum E-61: T = K_T delta_c.
        let thrust = (setpoint.thrust_n / self.max_thrust).clamp(0.0, 1.0);
        let attitude = setpoint.attitude.attitude.xyzw();
        let neutral =
            CommandV1 { actuation: actuation.code(), attitude, thrust, ..CommandV1::default() };
        let command = match actuation {
            Actuation::Torque => CommandV1 { torque: u.into(), ..neutral },
            _ => CommandV1 { sticks: u.into(), ..neutral },
        };
        Some(ControlOutput { setpoint, command, saturated: u.amax() / limit >= SATURATED })
    }

    /// Riccati equations that had no solution, so that the last gain was kept.
    #[must_use]
    pub fn riccati_failures(&self) -> u32 {
        match &self.form {
            Form::Sticks(loops) => loops.riccati_failures(),
            Form::Torque(loops) => loops.riccati_failures(),
        }
    }

    /// Riccati equations solved so far.
    #[must_use]
    pub fn riccati_solves(&self) -> u32 {
        match &self.form {
            Form::Sticks(loops) => loops.riccati_solves(),
            Form::Torque(loops) => loops.riccati_solves(),
        }
    }
}

/// The last line of defence: a command with a number that is not finite is none.
pub(crate) fn finite_or_neutral(command: CommandV1) -> CommandV1 {
    let CommandV1 { sticks, torque, attitude, thrust, .. } = &command;
    let numbers = sticks.iter().chain(torque).chain(attitude).chain([thrust]);
    if numbers.clone().all(|number| number.is_finite()) {
        command
    } else {
        CommandV1 { actuation: Actuation::Disarmed.code(), ..CommandV1::default() }
    }
}

impl<I: InputForm + Copy> Loops<I> {
    fn new(config: &Config, input: I, rotation: Rotation) -> Result<Self, String> {
        let (vehicle, options) = (&config.vehicle, config.control.controller_options());
        if options.controller != ControllerName::OqtalDt {
            let law = Controller::new(&options, input).map_err(|error| error.to_string())?;
            let position =
                PositionLoops::new(&config.position, vehicle.mass_kg, vehicle.gravity_m_s2);
            return Ok(Self::Paper(PaperLoops { position, law }));
        }
        let model = VehicleModel {
            rotation,
            mass_kg: vehicle.mass_kg,
            gravity_m_s2: vehicle.gravity_m_s2,
            drag_per_s: vehicle.drag_per_s,
            thrust_lag_s: vehicle.thrust_lag_ms * 1e-3,
        };
        let design = Design {
            model,
            input,
            delay_s: vehicle.radio_delay_ms * 1e-3,
            period_s: 1.0 / options.rate_hz,
        };
        let (law, aids) = (options.oqtal_dt, &config.control.predictive);
        let autopilot = Autopilot::new(design, law, aids, &config.position);
        Ok(Self::Predictive(autopilot.map_err(|error| error.to_string())?))
    }

    fn reset(&mut self) {
        match self {
            Self::Paper(loops) => {
                loops.position.reset();
                loops.law.reset();
            }
            Self::Predictive(autopilot) => autopilot.reset(),
        }
    }

    fn decide(
        &mut self,
        (now_s, dt_s): (f64, f64),
        estimate: &Estimate,
        reference: &Reference,
    ) -> Option<PredictiveOutput> {
        match self {
            Self::Paper(loops) => {
                let setpoint = loops.position.update(estimate, reference, dt_s);
                let state = AttitudeState { attitude: estimate.attitude, rate: estimate.rate };
                let u = I::u_from(loops.law.update(&state, &setpoint.attitude, dt_s));
                Some(PredictiveOutput { setpoint, u })
            }
            Self::Predictive(autopilot) => autopilot.decide(now_s, reference),
        }
    }

    fn riccati_failures(&self) -> u32 {
        match self {
            Self::Paper(loops) => loops.law.failed_solves(),
            // It has one equation, and does not begin without its solution.
            Self::Predictive(_) => 0,
        }
    }

    fn riccati_solves(&self) -> u32 {
        match self {
            Self::Paper(loops) => loops.law.riccati_solves(),
            Self::Predictive(autopilot) => autopilot.riccati_solves(),
        }
    }
}

/// Times since the clock's origin keep microseconds in an f64 for a century.
fn seconds(time: Time) -> f64 {
    time.since(Time::UNSET).seconds()
}
