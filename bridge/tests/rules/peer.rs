//! The vehicle at the other end of any language.

use std::fmt::Debug;

use oqtal_bridge::{VehicleProtocol, VehicleTransport};
use oqtal_config::Config;

/// What a frame means to a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Heard {
    /// A zero set-point.
    Zero,
    /// A set-point with thrust.
    Flight { thrust: f64 },
    /// A command that starts the motors, or prepares it.
    Start,
    /// A command that stops the motors.
    Stop,
    /// One that does either.
    Toggle,
    /// A pose, dated by the bridge's clock where it is told.
    Pose { captured_us: Option<u64> },
    /// Anything else.
    Word,
}

/// A vehicle that understands one language.
pub trait LanguagePeer: Debug {
    fn name(&self) -> &'static str;

    /// The bridge's protocol and transport to this vehicle.
    fn ends(&self, config: &Config) -> (Box<dyn VehicleProtocol>, Box<dyn VehicleTransport>);

    /// A port was opened: bytes of before are gone.
    fn reset(&mut self);

    /// Whether the vehicle tells who has control.
    fn tells_control(&self) -> bool;

    /// What the vehicle says of its motors, and of who flies.
    fn status(&mut self, running: bool, piloted: bool) -> Vec<u8>;

    /// What the bytes of one frame mean.
    fn hears(&mut self, bytes: &[u8]) -> Vec<Heard>;
}
