//! A language: its bridge, and a vehicle that says what it understood.

use oqtal_bridge::Bridge;
use oqtal_bus::time::Time;

/// Set-point as a vehicle understands it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Understood {
    /// No thrust: zero, or what starts or stops motors.
    NoThrust,
    /// Thrust, and this roll stick \[-1..1\].
    Flight(f64),
}

/// Vehicle at the other end of a language.
pub trait LanguageVehicle {
    /// Takes one frame of the bridge; returns what it means if it is a set-point. Answers go to `answers`.
    fn take(&mut self, now: Time, frame: &[u8], answers: &mut Vec<Vec<u8>>) -> Option<Understood>;

    /// What the vehicle says by itself.
    fn tick(&mut self, now: Time, answers: &mut Vec<Vec<u8>>);
}

/// Language: its bridge without a port, and a vehicle.
pub struct Language {
    pub name: &'static str,
    pub bridge: fn(Time) -> Bridge,
    pub vehicle: fn() -> Box<dyn LanguageVehicle>,
}
