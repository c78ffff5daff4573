//! Set-points that the bridge sends to a vehicle.

use oqtal_bus::message::CommandV1;

/// Content of one set-point frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VehicleSetpoint {
    /// Zero set-point: sticks centred, no thrust. Running rotors idle; stopped rotors do not start.
    Zero,
    /// Sticks and thrust of a command.
    Fly(CommandV1),
    /// Zero thrust, with the inputs that start the motors.
    StartMotors,
    /// Zero thrust, with the inputs that stop the motors.
    StopMotors,
    /// Nothing is sent: another has control.
    Released,
}
