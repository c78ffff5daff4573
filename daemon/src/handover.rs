//! Bumpless hand-over: after a change of the control stack the slew of the command is limited for a quarter of a second. Meanwhile the
//! filters of the new stack settle; their first commands may jump. The feedback of the new stack is effective from its first tick
//! on, within the slew limit.
//!
//! Afterwards the limit grows without bound over another quarter of a second, and the hand-over ends once the command equals that of
//! the new stack. A limited slew delays the command: a loop that this delay makes oscillate would never reach its own command.

use oqtal_config::{Config, Interface};
use oqtal_control::quantity::{StickCommand, Torque};

use crate::command::{RotationCommand, VehicleCommand};

/// Time in which a command may change by its whole range \[s\]; also the minimum duration of a hand-over, and half of its maximum duration.
const FULL_RANGE_S: f64 = 0.25;
/// Range of the attitude of a command \[rad\].
const ATTITUDE_RANGE_RAD: f64 = 1.0;

/// Greatest change of a command in one second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlewLimits {
    /// Slew limit of each component of the rotation command \[1/s for sticks, N m/s for a torque\].
    pub rotation_per_s: f64,
    /// Slew limit of the thrust \[N/s\].
    pub thrust_n_per_s: f64,
    /// Slew limit of each component of the attitude \[rad/s\].
    pub attitude_rad_s: f64,
}

impl SlewLimits {
    /// The limits for a vehicle of `config`: the whole range of a command in a quarter of a second.
    pub fn of(config: &Config) -> Self {
        let range = 2.0 * rotation_limit(config);
        Self {
            rotation_per_s: range / FULL_RANGE_S,
            thrust_n_per_s: config.vehicle.max_thrust_n / FULL_RANGE_S,
            attitude_rad_s: ATTITUDE_RANGE_RAD / FULL_RANGE_S,
        }
    }
}

/// Greatest component of a rotation command of a vehicle of `config` \[- for sticks, N m for a torque\].
fn rotation_limit(config: &Config) -> f64 {
    match config.vehicle.interface {
        Interface::Rate | Interface::Attitude => 1.0,
        Interface::Torque => config.vehicle.max_torque_nm,
    }
}

/// The hand-over from one control stack to another. No method allocates.
#[derive(Clone, Debug)]
pub struct Handover {
    slew: SlewLimits,
    /// Remaining minimum duration of the hand-over \[s\]; below zero the limit grows, and the hand-over ends once the command is
    /// reached; `None` outside one.
    left_s: Option<f64>,
}

impl Handover {
    /// The hand-over for a vehicle of `config`, inactive.
    pub fn new(config: &Config) -> Self {
        Self { slew: SlewLimits::of(config), left_s: None }
    }

    /// Begins a hand-over: the next command passed to [`Handover::apply`] is the first one of another stack.
    pub fn begin(&mut self) {
        self.left_s = Some(FULL_RANGE_S);
    }

    /// Like [`Handover::begin`], without a minimum duration: the limit grows at once, and the hand-over ends once the command is reached,
    /// after a quarter of a second at the latest.
    pub fn begin_until_reached(&mut self) {
        self.left_s = Some(0.0);
    }

    /// Ends a hand-over at once: a flight begins.
    pub fn reset(&mut self) {
        self.left_s = None;
    }

    /// Whether the slew of commands is limited.
    #[cfg(test)]
    fn is_active(&self) -> bool {
        self.left_s.is_some()
    }

    /// The command to send for `command`, that of the present stack, `dt_s` \[s\] after the command `last` was sent. Outside a
    /// hand-over it is `command` itself, bit for bit. Commands that disarm, or that are not finite, end a hand-over.
    pub fn apply(
        &mut self,
        last: &VehicleCommand,
        command: VehicleCommand,
        dt_s: f64,
    ) -> VehicleCommand {
        let Some(left_s) = self.left_s else { return command };
        // Bounds of a range must be numbers in order.
        let dt_s = dt_s.max(0.0);
        let full_range_s = FULL_RANGE_S + left_s.min(0.0);
        let step_s = (dt_s < full_range_s).then(|| dt_s * FULL_RANGE_S / full_range_s);
        let Some(limited) = step_s.and_then(|step_s| self.limited(last, &command, step_s)) else {
            self.left_s = None;
            return command;
        };
        self.left_s = Some(left_s - dt_s).filter(|left_s| *left_s > 0.0 || limited != command);
        limited
    }

    /// Limits `command` to the change from `last` that the slew limits permit in `step_s` \[s\]; `None` if one of the two disarms, they are
    /// of different kinds, or a number is not finite.
    fn limited(
        &self,
        last: &VehicleCommand,
        command: &VehicleCommand,
        step_s: f64,
    ) -> Option<VehicleCommand> {
        let (
            VehicleCommand::Armed { rotation: last, thrust_n: last_n, attitude: last_attitude },
            VehicleCommand::Armed { rotation, thrust_n, attitude },
        ) = (last.finite_or_disarmed(), command.finite_or_disarmed())
        else {
            return None;
        };
        let SlewLimits { rotation_per_s, thrust_n_per_s, attitude_rad_s } = self.slew;
        let near = |value: f64, last: f64, step: f64| value.clamp(last - step, last + step);
        let (from, to) = (last.vector(), rotation.vector());
        let vector = to.zip_map(&from, |value, last| near(value, last, rotation_per_s * step_s));
        let rotation = match (last, rotation) {
            (RotationCommand::Sticks(_), RotationCommand::Sticks(_)) => StickCommand(vector).into(),
            (RotationCommand::Torque(_), RotationCommand::Torque(_)) => Torque(vector).into(),
            _ => return None,
        };
        let turn = last_attitude.rotation_to(&attitude);
        let step = attitude_rad_s * step_s;
        // An attitude within reach is kept bit for bit.
        let attitude = match turn.amax() <= step {
            true => attitude,
            false => last_attitude.turned_by(turn.map(|angle| angle.clamp(-step, step))),
        };
        let thrust_n = near(thrust_n, last_n, thrust_n_per_s * step_s);
        Some(VehicleCommand::Armed { rotation, thrust_n, attitude })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use oqtal_control::quaternion::Attitude;

    use super::*;

    const DT_S: f64 = 1.0 / 60.0;

    fn sticks(roll: f64, thrust_n: f64, yaw_rad: f64) -> VehicleCommand {
        VehicleCommand::Armed {
            rotation: StickCommand(Vector3::x() * roll).into(),
            thrust_n,
            attitude: Attitude::from_rotation_vector(Vector3::z() * yaw_rad),
        }
    }

    fn numbers(command: &VehicleCommand) -> [f64; 3] {
        let VehicleCommand::Armed { rotation, thrust_n, attitude } = command else {
            panic!("{command:?}")
        };
        [rotation.vector().x, *thrust_n, Attitude::LEVEL.rotation_to(attitude).z]
    }

    #[test]
    fn without_a_change_a_command_passes_bit_for_bit() {
        let mut handover = Handover::new(&Config::default());
        let command = sticks(0.123, 4.9, 0.3);
        assert_eq!(handover.apply(&sticks(-1.0, 0.0, 0.0), command, DT_S), command);
        assert!(!handover.is_active());
    }

    #[test]
    fn no_step_is_above_the_slew_limit_and_the_hand_over_ends() {
        let config = Config::default();
        let (mut handover, slew) = (Handover::new(&config), SlewLimits::of(&config));
        let steps = [slew.rotation_per_s, slew.thrust_n_per_s, slew.attitude_rad_s];
        let (mut last, next) = (sticks(0.9, 9.0, -0.4), sticks(-0.8, 2.0, 0.3));
        handover.begin();
        for _ in 0..60 {
            let sent = handover.apply(&last, next, DT_S);
            let before = numbers(&last);
            for (index, now) in numbers(&sent).into_iter().enumerate() {
                let change = (now - before[index]).abs();
                assert!(change <= steps[index] * DT_S + 1e-12, "{index}: {change}");
            }
            last = sent;
        }
        assert_eq!((last, handover.is_active()), (next, false));
    }

    #[test]
    fn a_hand_over_ends_with_what_is_not_finite_or_disarms() {
        let mut handover = Handover::new(&Config::default());
        handover.begin();
        let wrong = handover.apply(&sticks(0.0, 5.0, 0.0), sticks(0.0, f64::NAN, 0.0), DT_S);
        assert_eq!(wrong.finite_or_disarmed(), VehicleCommand::Disarmed);
        assert!(!handover.is_active());
        handover.begin();
        let next = sticks(0.5, 5.0, 0.0);
        assert_eq!(handover.apply(&sticks(f64::NAN, 5.0, 0.0), next, DT_S), next);
        assert!(!handover.is_active());
        handover.begin();
        assert_eq!(handover.apply(&sticks(0.0, 5.0, 0.0), next, f64::NAN), sticks(0.0, 5.0, 0.0));
        handover.reset();
        handover.begin();
        let off = VehicleCommand::Disarmed;
        assert_eq!(handover.apply(&off, sticks(0.5, 5.0, 0.0), DT_S), sticks(0.5, 5.0, 0.0));
        assert!(!handover.is_active());
    }

    /// The first commands of a new stack may be far apart while its filters settle.
    #[test]
    fn commands_that_swing_after_the_change_are_limited_for_a_quarter_of_a_second() {
        let config = Config::default();
        let (mut handover, slew) = (Handover::new(&config), SlewLimits::of(&config));
        let mut last = sticks(0.0, 5.0, 0.0);
        handover.begin();
        for tick in 0..14 {
            let wanted = sticks(if tick % 2 == 0 { 0.0 } else { 0.9 }, 5.0, 0.0);
            let sent = handover.apply(&last, wanted, DT_S);
            let change = (numbers(&sent)[0] - numbers(&last)[0]).abs();
            assert!(change <= slew.rotation_per_s * DT_S + 1e-12, "{tick}: {change}");
            last = sent;
        }
    }

    /// Until the limited command reaches that of the stack: a loop that oscillates with the delay of the limit never would.
    #[test]
    fn a_hand_over_to_commands_that_swing_for_ever_ends_within_half_a_second() {
        for begin in [Handover::begin, Handover::begin_until_reached] {
            let mut handover = Handover::new(&Config::default());
            let mut last = sticks(0.0, 5.0, 0.0);
            begin(&mut handover);
            for tick in 0..30 {
                let wanted = sticks(if tick % 2 == 0 { -1.0 } else { 1.0 }, 5.0, 0.0);
                last = handover.apply(&last, wanted, DT_S);
            }
            assert!(!handover.is_active());
        }
    }
}
