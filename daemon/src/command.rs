//! The command to the vehicle in SI units, and its message.

use nalgebra::Vector3;
use oqtal_bus::message::CommandV1;
use oqtal_config::Interface;
use oqtal_control::quantity::{StickCommand, Torque};
use oqtal_control::quaternion::Attitude;
use oqtal_runtime::actuation::actuation_of;

/// Fraction of its limit above which a rotation command counts as saturated \[-\].
pub(crate) const SATURATED: f64 = 1.0 - 1e-9;

/// A command about the vehicle's rotation, in the form that the vehicle takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RotationCommand {
    /// Body rates as sticks, Eq. (61).
    Sticks(StickCommand),
    /// Torque.
    Torque(Torque),
}

impl From<StickCommand> for RotationCommand {
    fn from(sticks: StickCommand) -> Self {
        Self::Sticks(sticks)
    }
}

impl From<Torque> for RotationCommand {
    fn from(torque: Torque) -> Self {
        Self::Torque(torque)
    }
}

impl RotationCommand {
    /// The components: sticks \[-1..1, body\] or torque \[N m, body\].
    pub fn vector(&self) -> Vector3<f64> {
        match self {
            Self::Sticks(StickCommand(vector)) | Self::Torque(Torque(vector)) => *vector,
        }
    }
}

/// A command to the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum VehicleCommand {
    /// Motors off.
    #[default]
    Disarmed,
    /// Motors on.
    Armed {
        /// Sticks or torque.
        rotation: RotationCommand,
        /// Thrust along body z \[N\].
        thrust_n: f64,
        /// The attitude that `rotation` is to bring about \[body to world\]: the command itself for a vehicle that holds
        /// attitudes.
        attitude: Attitude,
    },
}

impl VehicleCommand {
    /// The command that keeps the rotors idling: motors on, level at the heading `yaw_rad` \[rad, world\], zero rotation command,
    /// no thrust.
    pub fn idle(interface: Interface, yaw_rad: f64) -> Self {
        Self::level(interface, yaw_rad, 0.0)
    }

    /// The command with zero rotation command and the thrust `thrust_n` \[N\], level at the heading `yaw_rad` \[rad, world\].
    pub fn level(interface: Interface, yaw_rad: f64, thrust_n: f64) -> Self {
        let rotation = match interface {
            Interface::Rate | Interface::Attitude => StickCommand::default().into(),
            Interface::Torque => Torque::default().into(),
        };
        let attitude = Attitude::from_rotation_vector(Vector3::z() * yaw_rad);
        Self::Armed { rotation, thrust_n, attitude }
    }

    /// Thrust along body z \[N\]; `None` if the motors are off.
    pub fn thrust_n(&self) -> Option<f64> {
        match self {
            Self::Armed { thrust_n, .. } => Some(*thrust_n),
            Self::Disarmed => None,
        }
    }

    /// Last check before a command is sent: returns [`Self::Disarmed`] instead of a command with a number that is not finite.
    pub fn finite_or_disarmed(self) -> Self {
        let Self::Armed { rotation, thrust_n, attitude } = &self else { return self };
        let rotation = rotation.vector();
        let numbers = rotation.iter().copied().chain(attitude.xyzw()).chain([*thrust_n]);
        if numbers.into_iter().all(f64::is_finite) { self } else { Self::Disarmed }
    }

    /// The message of this command, for a vehicle commanded through `interface`, with the greatest thrust `max_thrust_n` \[N\].
    pub fn to_message(&self, interface: Interface, max_thrust_n: f64) -> CommandV1 {
        let Self::Armed { rotation, thrust_n, attitude } = self else {
            return CommandV1::default();
        };
        let base = CommandV1 {
            actuation: actuation_of(interface).code(),
            attitude: attitude.xyzw(),
            thrust: collective(*thrust_n, max_thrust_n),
            ..CommandV1::default()
        };
        match rotation {
            RotationCommand::Sticks(StickCommand(sticks)) => {
                CommandV1 { sticks: (*sticks).into(), ..base }
            }
            RotationCommand::Torque(Torque(torque)) => {
                CommandV1 { torque: (*torque).into(), ..base }
            }
        }
    }
}

/// The collective thrust `delta_c` \[0..1\] of a thrust \[N\].
pub fn collective(thrust_n: f64, max_thrust_n: f64) -> f64 {
    // Eq. (61), erratum E-61: T = K_T delta_c.
    (thrust_n / max_thrust_n).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::code::Actuation;

    fn armed(rotation: RotationCommand, thrust_n: f64) -> VehicleCommand {
        VehicleCommand::Armed { rotation, thrust_n, attitude: Attitude::default() }
    }

    #[test]
    fn a_command_is_converted_to_the_fractions_of_the_message() {
        let sticks = StickCommand(Vector3::new(0.1, -0.2, 0.3));
        let rate = |command: VehicleCommand| command.to_message(Interface::Rate, 20.0);
        let message = rate(armed(sticks.into(), 5.0));
        assert_eq!(message.actuation, Actuation::Sticks.code());
        assert_eq!((message.sticks, message.torque), ([0.1, -0.2, 0.3], [0.0; 3]));
        assert_eq!((message.thrust, message.attitude), (0.25, [0.0, 0.0, 0.0, 1.0]));
        assert_eq!(rate(armed(sticks.into(), 30.0)).thrust, 1.0);
        assert_eq!(rate(armed(sticks.into(), -3.0)).thrust, 0.0);
        assert_eq!(rate(VehicleCommand::Disarmed), CommandV1::default());
        let held = armed(sticks.into(), 5.0).to_message(Interface::Attitude, 20.0);
        assert_eq!(held, CommandV1 { actuation: Actuation::Attitude.code(), ..message });
    }

    #[test]
    fn idle_rotors_keep_the_heading() {
        let idle = VehicleCommand::idle(Interface::Attitude, 0.7);
        let VehicleCommand::Armed { rotation, thrust_n, attitude } = idle else {
            panic!("{idle:?}")
        };
        assert_eq!((rotation.vector(), thrust_n), (Vector3::zeros(), 0.0));
        assert!(
            attitude.rotation_to(&Attitude::LEVEL).metric_distance(&(Vector3::z() * -0.7)) < 1e-12
        );
    }

    #[test]
    fn a_command_that_is_not_finite_disarms() {
        let torque = |value| RotationCommand::from(Torque(Vector3::new(0.0, value, 0.0)));
        for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for command in [armed(torque(wrong), 5.0), armed(torque(0.0), wrong)] {
                assert_eq!(command.finite_or_disarmed(), VehicleCommand::Disarmed);
            }
        }
        let good = armed(torque(0.1), 5.0);
        assert_eq!(good.finite_or_disarmed(), good);
    }
}
