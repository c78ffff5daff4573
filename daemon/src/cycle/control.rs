//! Control of the cycle: from a directive to the command of the tick.

use oqtal_bus::message::CommandV1;
use oqtal_bus::time::Time;
use oqtal_config::{Config, Interface};
use oqtal_control::euler::EulerAngles;
use oqtal_control::options::OptionError;
use oqtal_control::position::OuterLoop;
use oqtal_control::scalar_pid::PidGains;
use oqtal_control::trajectory::Reference;

use super::intake::Intake;
use crate::command::VehicleCommand;
use crate::descent::BlindDescent;
use crate::handover::Handover;
use crate::stack::{ControlOutput, ControlStack, LawInput};

/// Time after the end of the landing's reference from which on thrust is reduced \[s\].
const REDUCED_AFTER_S: f64 = 1.5;
/// Rate at which the share of the thrust is reduced \[1/s\], low enough that the vehicle sinks and does not fall.
const REDUCED_PER_S: f64 = 0.1;
/// Greatest share of the thrust that is taken away \[-\].
const GREATEST_REDUCTION: f64 = 0.5;

/// Task of the control in one tick.
// Not boxed: the real-time thread does not allocate.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant)]
pub(super) enum Directive {
    /// Motors off.
    Disarm,
    /// Idling rotors, level at the present heading.
    Idle,
    /// Level and below the thrust of a hover, without poses.
    Descend,
    /// Fly to the reference. The reference of the landing has ended `overdue_s` ago \[s\]; negative before.
    Fly { reference: Reference, overdue_s: f64 },
}

/// The instant of a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct ControlTick {
    /// The present instant.
    pub(super) now: Time,
    /// Time since the last tick \[s\].
    pub(super) dt_s: f64,
    /// Whether the tick has a pose.
    pub(super) is_fresh: bool,
}

/// The control stack with the commands of the last tick.
#[derive(Clone, Debug)]
pub(super) struct FlightControl {
    observe_only: bool,
    interface: Interface,
    max_thrust_n: f64,
    stack: ControlStack,
    /// Counts of the Riccati equations of earlier stacks, as [`ControlStack::riccati_counts`].
    earlier_counts: [u32; 2],
    handover: Handover,
    descent: BlindDescent,
    /// The last command of the law or of the daemon, repeated while poses are missing.
    held: VehicleCommand,
}

impl FlightControl {
    /// The control of `config`, with motors off.
    ///
    /// # Errors
    /// An option of the law or of the vehicle is not allowed.
    pub(super) fn new(config: &Config) -> Result<Self, OptionError> {
        Ok(Self {
            observe_only: config.safety.observe_only,
            interface: config.vehicle.interface,
            max_thrust_n: config.vehicle.max_thrust_n,
            stack: ControlStack::new(config)?,
            earlier_counts: [0; 2],
            handover: Handover::new(config),
            descent: BlindDescent::of(config),
            held: VehicleCommand::Disarmed,
        })
    }

    /// The command that was sent in the last tick.
    pub(super) fn sent(&self) -> VehicleCommand {
        if self.observe_only { VehicleCommand::Disarmed } else { self.held }
    }

    /// Numbers of Riccati equations since the start, as [`ControlStack::riccati_counts`].
    pub(super) fn riccati_counts(&self) -> [u32; 2] {
        let (own, earlier) = (self.stack.riccati_counts(), self.earlier_counts);
        std::array::from_fn(|index| own[index] + earlier[index])
    }

    /// Resets integrators and filters for a new flight.
    pub(super) fn reset(&mut self) {
        self.stack.reset();
        self.handover.reset();
    }

    /// Stops the vehicle from the next tick on: a hold begins.
    pub(super) fn begin_stop(&mut self) {
        self.stack.begin_stop();
    }

    /// Replaces the control stack by `stack`, which continues the flight, and returns the old one in its place. `keeps_law` if the
    /// attitude law has the same options.
    pub(super) fn exchange_stack(&mut self, stack: &mut ControlStack, keeps_law: bool) {
        // A law that is kept keeps its counts.
        if !keeps_law {
            self.earlier_counts = self.riccati_counts();
        }
        stack.adopt(&self.stack, keeps_law);
        std::mem::swap(&mut self.stack, stack);
    }

    /// Records that `command` of another law is sent in place of that of the stack.
    pub(super) fn yield_to(&mut self, command: &VehicleCommand, intake: &Intake) {
        self.stack.yield_to(command, intake.tracker());
    }

    /// Limits the slew of the next commands: what computes them has changed.
    pub(super) fn begin_handover(&mut self) {
        self.handover.begin();
    }

    /// Replaces the gains of one of the outer loops of Fig. 16.
    pub(super) fn set_loop(&mut self, which: OuterLoop, gains: PidGains) {
        self.stack.set_loop(which, gains);
    }

    /// Computes the output of the law for `directive`; `None` if the law is not used, or has no motion to work with.
    pub(super) fn compute(
        &mut self,
        tick: &ControlTick,
        directive: &Directive,
        intake: &Intake,
    ) -> Option<ControlOutput> {
        let Directive::Fly { reference, .. } = directive else { return None };
        let output = self.stack.compute(&LawInput {
            now_s: tick.now.seconds(),
            dt_s: tick.dt_s,
            estimate: intake.motion(tick.now, tick.is_fresh)?,
            tracker: intake.tracker(),
            reference,
        })?;
        let command = self.handover.apply(&self.held, output.command, tick.dt_s);
        Some(ControlOutput { command, ..output })
    }

    /// The command for `directive`: that of `output` where the law computed one, else the last one. Records it as sent, unless the
    /// daemon only observes, and returns its message, which telemetry has in either case, and the one to send.
    pub(super) fn command(
        &mut self,
        now: Time,
        directive: &Directive,
        output: Option<&ControlOutput>,
        intake: &Intake,
    ) -> [CommandV1; 2] {
        let command = self.select_command(now, directive, output, intake);
        let message = command.to_message(self.interface, self.max_thrust_n);
        self.held = command;
        [message, if self.observe_only { CommandV1::default() } else { message }]
    }

    fn select_command(
        &self,
        now: Time,
        directive: &Directive,
        output: Option<&ControlOutput>,
        intake: &Intake,
    ) -> VehicleCommand {
        let heading = || EulerAngles::from_attitude(&intake.estimate().attitude).yaw;
        match (directive, output) {
            (Directive::Disarm, _) => VehicleCommand::Disarmed,
            (Directive::Idle, _) => VehicleCommand::idle(self.interface, heading()),
            (Directive::Descend, _) => {
                let tracker = intake.tracker();
                let track = tracker.predict_coarsely(now.seconds());
                let lift = track.map_or(0.0, |track| track.bias().acceleration.z);
                let thrust_n = self.descent.thrust_n(tracker.model().mass_kg, lift);
                VehicleCommand::level(self.interface, heading(), thrust_n)
            }
            (Directive::Fly { overdue_s, .. }, Some(output)) => {
                with_reduced_thrust(output.command.finite_or_disarmed(), *overdue_s)
            }
            (Directive::Fly { .. }, None) => self.held,
        }
    }
}

/// `command` with less thrust if the vehicle has not landed although the reference of the landing ended `overdue_s` ago \[s\]. A
/// vehicle with more thrust or less mass than configured stays above the reference, by more than the loops correct.
fn with_reduced_thrust(command: VehicleCommand, overdue_s: f64) -> VehicleCommand {
    let VehicleCommand::Armed { rotation, thrust_n, attitude } = command else {
        return command;
    };
    let share = (REDUCED_PER_S * (overdue_s - REDUCED_AFTER_S)).clamp(0.0, GREATEST_REDUCTION);
    VehicleCommand::Armed { rotation, thrust_n: thrust_n * (1.0 - share), attitude }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use oqtal_control::controller::LawTerms;
    use oqtal_control::position::PositionCommand;
    use oqtal_control::quaternion::Attitude;
    use oqtal_control::tracking_error::AttitudeReference;
    use oqtal_control::trajectory::Phase;

    use super::*;

    #[test]
    fn f06_a_law_that_decides_on_numbers_that_are_not_finite_disarms() {
        let (config, now) = (Config::default(), Time::VIRTUAL_START);
        let trajectory = crate::trajectory(&config).unwrap();
        let intake = Intake::new(&config, &trajectory).unwrap();
        let mut control = FlightControl::new(&config).unwrap();
        let reference = Reference::rest(Vector3::zeros(), Phase::Settle);
        let directive = Directive::Fly { reference, overdue_s: f64::NEG_INFINITY };
        for (thrust_n, is_armed) in [(5.0, true), (f64::NAN, false), (f64::INFINITY, false)] {
            let command = VehicleCommand::level(config.vehicle.interface, 0.0, thrust_n);
            let attitude = AttitudeReference::at_rest(Attitude::LEVEL);
            let setpoint = PositionCommand { attitude, thrust_n, velocity: Vector3::zeros() };
            let terms = LawTerms::default();
            let output = ControlOutput { setpoint, command, terms, saturated: false };
            control.command(now, &directive, Some(&output), &intake);
            let expected = if is_armed { command } else { VehicleCommand::Disarmed };
            assert_eq!(control.sent(), expected, "{thrust_n} N");
        }
    }

    #[test]
    fn f41_thrust_is_lowered_by_a_tenth_per_second_down_to_half() {
        let thrust_n = |overdue_s| {
            let command = VehicleCommand::level(Interface::Rate, 0.0, 10.0);
            with_reduced_thrust(command, overdue_s).thrust_n().unwrap()
        };
        for (overdue_s, expected_n) in
            [(f64::NEG_INFINITY, 10.0), (1.5, 10.0), (2.5, 9.0), (6.5, 5.0), (1e3, 5.0)]
        {
            let found_n = thrust_n(overdue_s);
            assert!((found_n - expected_n).abs() < 1e-12, "{overdue_s} s: {found_n} N");
        }
    }
}
