//! The control stack: from the motion of the vehicle and its reference to the command.

use nalgebra::Vector3;
use oqtal_config::{Config, Interface};
use oqtal_control::controller::{
    AttitudeLaw, AttitudeState, Controller, InputForm, LawTerms, RateInput, TorqueInput,
};
use oqtal_control::estimator::Estimate;
use oqtal_control::options::OptionError;
use oqtal_control::position::{OuterLoop, PositionCommand, PositionLoops};
use oqtal_control::predictive::{Autopilot, Design, MotionTracker};
use oqtal_control::quaternion::Attitude;
use oqtal_control::scalar_pid::PidGains;
use oqtal_control::tracking_error::AttitudeError;
use oqtal_control::trajectory::Reference;

use crate::command::{RotationCommand, SATURATED, VehicleCommand};
use crate::command_model::{CommandModel, inertia};

/// Greatest stick \[-\].
const MAX_STICK: f64 = 1.0;

/// Share of the rates of roll and pitch that a reference may demand \[-\]; the rest is for corrections.
const REFERENCE_RATE_SHARE: f64 = 0.9;

/// Input of the control stack in one tick.
#[derive(Clone, Copy, Debug)]
pub struct LawInput<'a> {
    /// The present instant \[s since the clock's origin\].
    pub now_s: f64,
    /// Time since the last tick \[s\].
    pub dt_s: f64,
    /// The motion estimated from poses, for a law of the paper.
    pub estimate: Estimate,
    /// The predicted motion, for a law that flies on it.
    pub tracker: &'a MotionTracker,
    /// The reference.
    pub reference: &'a Reference,
}

/// Output of the control stack in one tick.
#[derive(Clone, Copy, Debug)]
pub struct ControlOutput {
    /// The setpoint of the outer loops.
    pub setpoint: PositionCommand,
    /// The command to the vehicle.
    pub command: VehicleCommand,
    /// Terms of the rotation command.
    pub terms: LawTerms,
    /// Whether the rotation command is at its limit.
    pub saturated: bool,
}

/// The control stack, in the form that the vehicle takes. No method but the constructor allocates.
// Not boxed: the cache warm-up copies the stack, and a copy must not allocate.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)]
pub enum ControlStack {
    /// Sticks out, and the attitude that they bring about.
    Rate(Stack<RateInput>),
    /// Torque out.
    Torque(Stack<TorqueInput>),
}

/// The control stack of a vehicle commanded through `I`.
#[derive(Clone, Debug)]
pub struct Stack<I> {
    loops: Loops<I>,
    /// Limit of each component of the rotation command \[as the command\].
    limit: f64,
    /// Control of the heading of a vehicle that holds attitudes.
    heading: Option<HeadingLoop>,
}

/// Yaw rate commanded beside an attitude, to vehicles that hold roll and pitch alone: their heading then turns to the commanded one
/// as fast as the on-board loop turns roll and pitch, and as the model of `[vehicle]` predicts. The yaw command of the attitude law
/// would make the heading oscillate: the prediction for this vehicle does not contain it.
#[derive(Clone, Copy, Debug)]
struct HeadingLoop {
    /// Gain of the on-board attitude loop \[1/s\].
    gain_per_s: f64,
    /// Yaw rate at full stick \[rad/s\].
    authority_rad_s: f64,
}

impl HeadingLoop {
    /// The loop of `config`; `None` for a vehicle that does not hold attitudes.
    fn of(config: &Config) -> Option<Self> {
        let vehicle = &config.vehicle;
        let [_, _, authority_rad_s] = vehicle.rate_authority_rad_s;
        let gain_per_s = vehicle.attitude_gain_per_s;
        vehicle.interface.holds_attitude().then_some(Self { gain_per_s, authority_rad_s })
    }

    /// The yaw stick for a vehicle that is at `attitude` when the stick takes effect, and should be at `wanted` \[-1..1\].
    fn stick(&self, attitude: &Attitude, wanted: &Attitude) -> f64 {
        let left_rad = 2.0 * AttitudeError::between(attitude, wanted).eps().z;
        (self.gain_per_s * left_rad / self.authority_rad_s).clamp(-MAX_STICK, MAX_STICK)
    }
}

#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)]
enum Loops<I> {
    /// The six PIDs of Fig. 16, then an attitude law, on the motion estimated from poses.
    Paper(PositionLoops, Controller<I>),
    /// Position law and attitude law on the predicted motion.
    Predictive(Autopilot<I>),
}

impl ControlStack {
    /// The stack of `config`.
    ///
    /// # Errors
    /// An option of the law or of the vehicle is not allowed.
    pub fn new(config: &Config) -> Result<Self, OptionError> {
        let vehicle = &config.vehicle;
        let of_vehicle = |error: OptionError| error.within("vehicle");
        match vehicle.interface {
            Interface::Rate | Interface::Attitude => {
                let input = RateInput::new(Vector3::from(vehicle.rate_authority_rad_s));
                // Of the laws in the paper's loops, only a feed-forward of the reference's acceleration uses the lag.
                let lag_s = vehicle.rate_lag_ms * 1e-3;
                let period_s = 1.0 / config.control.rate_hz;
                let input = input.and_then(|input| input.with_lag(lag_s, period_s));
                // The attitude loop on board takes the place of the sticks, which limit nothing then.
                let holds_attitude = vehicle.interface.holds_attitude();
                let limit = if holds_attitude { f64::INFINITY } else { MAX_STICK };
                Stack::new(config, input.map_err(of_vehicle)?, limit).map(Self::Rate)
            }
            Interface::Torque => {
                let limit = vehicle.max_torque_nm;
                let input = TorqueInput::new(inertia(vehicle)?, limit).map_err(of_vehicle)?;
                Stack::new(config, input, limit).map(Self::Torque)
            }
        }
    }

    /// The fallback of the built-in law of `config`; `None` without one, and for an external law.
    ///
    /// # Errors
    /// Like [`ControlStack::new`].
    pub fn of_fallback(config: &Config) -> Result<Option<Self>, OptionError> {
        let Some(control) = config.control.of_fallback() else { return Ok(None) };
        let mut config = config.clone();
        config.control = control;
        Self::new(&config).map(Some)
    }

    /// The output for `input`; `None` if the law has no motion to work with.
    pub fn compute(&mut self, input: &LawInput) -> Option<ControlOutput> {
        match self {
            Self::Rate(stack) => stack.compute(input),
            Self::Torque(stack) => stack.compute(input),
        }
    }

    /// Replaces the gains of one of the outer loops of Fig. 16; without effect on a stack that has others.
    pub fn set_loop(&mut self, which: OuterLoop, gains: PidGains) {
        match self {
            Self::Rate(stack) => stack.set_loop(which, gains),
            Self::Torque(stack) => stack.set_loop(which, gains),
        }
    }

    /// Continues a flight that `old` controlled: takes over the state of loops and laws that both stacks have, and the whole
    /// attitude law if `keeps_law`: its options are the same.
    pub fn adopt(&mut self, old: &Self, keeps_law: bool) {
        match (self, old) {
            (Self::Rate(stack), Self::Rate(old)) => stack.adopt(old, keeps_law),
            (Self::Torque(stack), Self::Torque(old)) => stack.adopt(old, keeps_law),
            _ => {}
        }
    }

    /// Records that `command` of another law was sent in place of the last output: integral action continues from before that output,
    /// an incremental law from `command`.
    pub fn yield_to(&mut self, command: &VehicleCommand, tracker: &MotionTracker) {
        let VehicleCommand::Armed { rotation, .. } = command else { return };
        match self {
            Self::Rate(stack) => stack.yield_to(&rotation.vector(), tracker),
            Self::Torque(stack) => stack.yield_to(&rotation.vector(), tracker),
        }
    }

    /// Stops the vehicle from the next tick on; without effect on a stack without a model of the reference.
    pub fn begin_stop(&mut self) {
        match self {
            Self::Rate(stack) => stack.begin_stop(),
            Self::Torque(stack) => stack.begin_stop(),
        }
    }

    /// Resets integrators and filters for a new flight. Counters are kept.
    pub fn reset(&mut self) {
        match self {
            Self::Rate(stack) => stack.reset(),
            Self::Torque(stack) => stack.reset(),
        }
    }

    /// Number of Riccati equations solved so far, and of those without a solution, at which the law keeps its last gain \[-\].
    pub fn riccati_counts(&self) -> [u32; 2] {
        match self {
            Self::Rate(stack) => stack.riccati_counts(),
            Self::Torque(stack) => stack.riccati_counts(),
        }
    }
}

impl<I: InputForm + Copy> Stack<I>
where
    I::Command: Into<RotationCommand>,
{
    fn new(config: &Config, input: I, limit: f64) -> Result<Self, OptionError> {
        let mut control = config.control;
        if control.is_predictive() {
            // The motion is predicted for the effect of the command.
            control.indi.input_delay_ticks = 0;
        }
        let law = Controller::new(&control, input).map_err(|error| error.within("control"))?;
        let loops = if control.is_predictive() {
            let model = CommandModel::new(config)?.model;
            let turning_jerk_m_s3 = turning_jerk_m_s3(config);
            let design =
                Design { model, input, period_s: 1.0 / control.rate_hz, turning_jerk_m_s3 };
            let autopilot = Autopilot::new(design, law, &control.predictive, &config.position);
            Loops::Predictive(autopilot)
        } else {
            let (vehicle, options) = (&config.vehicle, &config.position);
            let position = PositionLoops::new(options, vehicle.mass_kg, vehicle.gravity_m_s2);
            Loops::Paper(position, law)
        };
        Ok(Self { loops, limit, heading: HeadingLoop::of(config) })
    }

    fn compute(&mut self, input: &LawInput) -> Option<ControlOutput> {
        let LawInput { now_s, dt_s, estimate, tracker, reference } = input;
        let (setpoint, rotation, terms, attitude) = match &mut self.loops {
            Loops::Paper(position, law) => {
                let setpoint = position.update(estimate, reference, *dt_s);
                let state = AttitudeState { attitude: estimate.attitude, rate: estimate.rate };
                let rotation = law.update(&state, &setpoint.attitude, *dt_s);
                (setpoint, rotation, law.terms(), setpoint.attitude.attitude)
            }
            Loops::Predictive(autopilot) => {
                let mut output = autopilot.compute(*now_s, tracker, reference)?;
                if let Some(heading) = &self.heading {
                    output.u.z = heading.stick(&output.motion.attitude, &output.attitude);
                }
                (output.setpoint, I::command_from(output.u), output.terms, output.attitude)
            }
        };
        let rotation: RotationCommand = rotation.into();
        let command = VehicleCommand::Armed { rotation, thrust_n: setpoint.thrust_n, attitude };
        let saturated = rotation.vector().amax() / self.limit >= SATURATED;
        Some(ControlOutput { setpoint, command, terms, saturated })
    }

    fn set_loop(&mut self, which: OuterLoop, gains: PidGains) {
        if let Loops::Paper(position, _) = &mut self.loops {
            position.set_gains(which, gains);
        }
    }

    fn adopt(&mut self, old: &Self, keeps_law: bool) {
        match (&mut self.loops, &old.loops) {
            (Loops::Paper(position, law), Loops::Paper(old_position, old_law)) => {
                position.adopt(old_position);
                if keeps_law {
                    *law = *old_law;
                } else {
                    law.adopt(old_law);
                }
            }
            (Loops::Predictive(autopilot), Loops::Predictive(old)) => {
                autopilot.adopt(old, keeps_law);
            }
            _ => {}
        }
    }

    fn yield_to(&mut self, u: &Vector3<f64>, tracker: &MotionTracker) {
        // A fallback always has predictive loops.
        if let Loops::Predictive(autopilot) = &mut self.loops {
            autopilot.yield_to(u, tracker);
        }
    }

    fn begin_stop(&mut self) {
        if let Loops::Predictive(autopilot) = &mut self.loops {
            autopilot.begin_stop();
        }
    }

    fn reset(&mut self) {
        match &mut self.loops {
            Loops::Paper(position, law) => {
                position.reset();
                law.reset();
            }
            Loops::Predictive(autopilot) => autopilot.reset(),
        }
    }

    fn riccati_counts(&self) -> [u32; 2] {
        match &self.loops {
            Loops::Paper(_, law) => [law.riccati_solves(), law.failed_solves()],
            Loops::Predictive(autopilot) => {
                [autopilot.riccati_solves(), autopilot.riccati_failures()]
            }
        }
    }
}

/// Greatest jerk of a reference that the vehicle can follow by turning its thrust \[m/s^3\]: gravity times the rate at which it rolls and
/// pitches, without the share for corrections. A vehicle commanded by torque has no limit of its rates.
fn turning_jerk_m_s3(config: &Config) -> f64 {
    let vehicle = &config.vehicle;
    let [roll, pitch, _] = vehicle.rate_authority_rad_s;
    match vehicle.interface {
        Interface::Rate | Interface::Attitude => {
            REFERENCE_RATE_SHARE * vehicle.gravity_m_s2 * roll.min(pitch)
        }
        Interface::Torque => f64::INFINITY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command_model::motion_tracker;
    use oqtal_control::controller::ControllerName;
    use oqtal_control::predictive::MeasuredPose;
    use oqtal_control::trajectory::Phase;

    /// The law's own yaw stick is at its limit with this error.
    #[test]
    fn beside_an_attitude_the_heading_turns_as_by_the_on_board_loop() {
        for law in [ControllerName::OqtalDt, ControllerName::Mpc] {
            let mut config = Config::default();
            config.control.controller = law;
            config.vehicle.interface = Interface::Attitude;
            let pose = MeasuredPose { position: Vector3::z(), attitude: Attitude::LEVEL };
            let mut tracker = motion_tracker(&config, CommandModel::new(&config).unwrap().model);
            tracker.begin(0.0, &pose, 0.0);
            let off_rad = 0.1;
            let reference =
                Reference { yaw_rad: off_rad, ..Reference::rest(pose.position, Phase::Trajectory) };
            let mut stack = ControlStack::new(&config).unwrap();
            let input = LawInput {
                now_s: 0.0,
                dt_s: 1.0 / 60.0,
                estimate: Estimate::default(),
                tracker: &tracker,
                reference: &reference,
            };
            let VehicleCommand::Armed { rotation, .. } = stack.compute(&input).unwrap().command
            else {
                panic!("{law}: motors off");
            };
            let rate = rotation.vector().z * config.vehicle.rate_authority_rad_s[2];
            let expected = config.vehicle.attitude_gain_per_s * off_rad;
            assert!((rate / expected - 1.0).abs() < 0.02, "{law}: {rate} rad/s");
        }
    }
}
