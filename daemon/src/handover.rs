//! Bumpless hand-over: after a change of the control stack the command continues from the last one.
//!
//! At the change, the difference between the last command and that of the new stack becomes an offset to the new commands. The
//! offset shrinks by at most one step per tick, the slew limit of the hand-over, until it is zero. The feedback of the new stack
//! is effective from its first tick on: only the difference between the stacks is spread over time.

use nalgebra::Vector3;
use oqtal_config::{Config, Interface};
use oqtal_control::quantity::{StickCommand, Torque};

use crate::command::{RotationCommand, VehicleCommand};

/// Time in which an offset of the whole range of a command vanishes \[s\].
const FULL_RANGE_S: f64 = 0.25;
/// Range of the attitude of a command \[rad\].
const ATTITUDE_RANGE_RAD: f64 = 1.0;

/// Difference between two commands.
#[derive(Clone, Copy, Debug, PartialEq)]
struct CommandOffset {
    /// Sticks \[-\] or torque \[N m, body\].
    rotation: Vector3<f64>,
    /// Thrust \[N\].
    thrust_n: f64,
    /// Rotation vector \[rad, body\].
    turn: Vector3<f64>,
}

/// Greatest change of the offset in one second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlewLimits {
    /// Of each component of the rotation command \[1/s for sticks, N m/s for a torque\].
    pub rotation_per_s: f64,
    /// Of the thrust \[N/s\].
    pub thrust_n_per_s: f64,
    /// Of each component of the attitude \[rad/s\].
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
    rotation_limit: f64,
    max_thrust_n: f64,
    /// Whether the next command is the first one of another stack.
    begins: bool,
    offset: Option<CommandOffset>,
}

impl Handover {
    /// The hand-over for a vehicle of `config`, inactive.
    pub fn new(config: &Config) -> Self {
        Self {
            slew: SlewLimits::of(config),
            rotation_limit: rotation_limit(config),
            max_thrust_n: config.vehicle.max_thrust_n,
            begins: false,
            offset: None,
        }
    }

    /// Begins a hand-over: the next command passed to [`Handover::apply`] is the first one of another stack.
    pub fn begin(&mut self) {
        self.begins = true;
    }

    /// Ends a hand-over at once: a flight begins.
    pub fn reset(&mut self) {
        (self.begins, self.offset) = (false, None);
    }

    /// Whether commands are offset.
    pub fn is_active(&self) -> bool {
        self.begins || self.offset.is_some()
    }

    /// The command to send for `command`, that of the present stack, `dt_s` \[s\] after the command `last` was sent. Outside a
    /// hand-over it is `command` itself, bit for bit. Commands that disarm, or that are not finite, end a hand-over.
    pub fn apply(
        &mut self,
        last: &VehicleCommand,
        command: VehicleCommand,
        dt_s: f64,
    ) -> VehicleCommand {
        if std::mem::take(&mut self.begins) {
            self.offset = offset(last, &command);
        }
        let Some(offset) = self.offset else { return command };
        self.offset = self.shrunk(&offset, dt_s);
        self.offset.map_or(command, |offset| self.shifted(command, &offset))
    }

    /// `offset`, smaller by a step of `dt_s` \[s\]; `None` once it is zero, or not finite.
    fn shrunk(&self, offset: &CommandOffset, dt_s: f64) -> Option<CommandOffset> {
        let SlewLimits { rotation_per_s, thrust_n_per_s, attitude_rad_s } = self.slew;
        let toward_zero = |value: f64, step: f64| value - value.clamp(-step, step);
        let next = CommandOffset {
            rotation: offset.rotation.map(|value| toward_zero(value, rotation_per_s * dt_s)),
            thrust_n: toward_zero(offset.thrust_n, thrust_n_per_s * dt_s),
            turn: offset.turn.map(|value| toward_zero(value, attitude_rad_s * dt_s)),
        };
        let mut numbers = next.rotation.iter().chain(&next.turn).chain([&next.thrust_n]);
        let is_finite = numbers.clone().all(|number| number.is_finite());
        (is_finite && numbers.any(|number| *number != 0.0)).then_some(next)
    }

    /// `command`, shifted by `offset` within the vehicle's range.
    fn shifted(&self, command: VehicleCommand, offset: &CommandOffset) -> VehicleCommand {
        let VehicleCommand::Armed { rotation, thrust_n, attitude } = command else {
            return command;
        };
        let limit = self.rotation_limit;
        let vector = (rotation.vector() + offset.rotation).map(|value| value.clamp(-limit, limit));
        VehicleCommand::Armed {
            rotation: match rotation {
                RotationCommand::Sticks(_) => StickCommand(vector).into(),
                RotationCommand::Torque(_) => Torque(vector).into(),
            },
            thrust_n: (thrust_n + offset.thrust_n).clamp(0.0, self.max_thrust_n),
            attitude: attitude.turned_by(offset.turn),
        }
    }
}

/// The difference from `command` to `last`; `None` if one of them disarms, they are of different kinds, or a number is not finite.
fn offset(last: &VehicleCommand, command: &VehicleCommand) -> Option<CommandOffset> {
    let (
        VehicleCommand::Armed { rotation: last, thrust_n: last_n, attitude: last_attitude },
        VehicleCommand::Armed { rotation, thrust_n, attitude },
    ) = (last, command.finite_or_disarmed())
    else {
        return None;
    };
    let is_same_kind = std::mem::discriminant(last) == std::mem::discriminant(&rotation);
    is_same_kind.then(|| CommandOffset {
        rotation: last.vector() - rotation.vector(),
        thrust_n: last_n - thrust_n,
        turn: attitude.rotation_to(last_attitude),
    })
}

#[cfg(test)]
mod tests {
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
    fn no_step_is_above_the_slew_limit_and_the_offset_ends() {
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
    fn a_hand_over_stays_in_range_and_passes_what_is_not_finite() {
        let mut handover = Handover::new(&Config::default());
        handover.begin();
        handover.apply(&sticks(0.9, 5.0, 0.0), sticks(0.0, 5.0, 0.0), DT_S);
        assert!(
            numbers(&handover.apply(&sticks(0.0, 5.0, 0.0), sticks(0.9, 5.0, 0.0), DT_S))[0] <= 1.0
        );
        let wrong = handover.apply(&sticks(0.0, 5.0, 0.0), sticks(0.0, f64::NAN, 0.0), DT_S);
        assert_eq!(wrong.finite_or_disarmed(), VehicleCommand::Disarmed);
        handover.begin();
        let off = VehicleCommand::Disarmed;
        assert_eq!(handover.apply(&off, sticks(0.5, 5.0, 0.0), DT_S), sticks(0.5, 5.0, 0.0));
        assert!(!handover.is_active());
    }
}
