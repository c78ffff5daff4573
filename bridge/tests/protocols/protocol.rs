//! A protocol: its bridge, and an emulated vehicle that records the decoded commands.

use oqtal_bridge::Bridge;
use oqtal_bus::time::Time;

/// Meaning of a frame to a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Understood {
    /// A set-point without thrust.
    Zero,
    /// A set-point with thrust, and this roll stick \[-1..1\].
    Flight(f64),
    /// A command that starts or stops motors, or prepares it.
    Motors,
    /// A pose, dated by the bridge's clock \[us\] where the protocol dates poses.
    Pose(Option<u64>),
    /// Anything else.
    Word,
}

impl Understood {
    /// Whether it commands the vehicle.
    pub fn commands(self) -> bool {
        matches!(self, Self::Zero | Self::Flight(_) | Self::Motors)
    }
}

/// Vehicle at the other end of a protocol.
pub trait ProtocolVehicle {
    /// Takes one frame of the bridge. Answers go to `answers`.
    fn take(&mut self, now: Time, frame: &[u8], answers: &mut Vec<Vec<u8>>) -> Understood;

    /// Unsolicited frames of the vehicle.
    fn tick(&mut self, now: Time, answers: &mut Vec<Vec<u8>>);

    /// A pilot starts or stops its motors and flies it manually.
    fn manual_override(&mut self, motors_on: bool, is_piloted: bool);

    /// Whether motors run.
    fn motors_on(&self) -> bool;

    /// Whether the vehicle has reported that another has control. Not every protocol can report it.
    fn told_piloted(&self) -> bool;
}

/// Protocol: its bridge without a port, and a vehicle.
pub struct Protocol {
    pub name: &'static str,
    pub bridge: fn(Time) -> Bridge,
    pub vehicle: fn() -> Box<dyn ProtocolVehicle>,
}
