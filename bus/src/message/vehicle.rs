//! State of a vehicle, as its message gives it.

use super::bodies::VehicleV1;
use crate::code::VehicleLink;

impl VehicleV1 {
    /// Whether the bridge is stopping the motors after a flight: they would not follow the next one.
    pub fn is_being_stopped(&self) -> bool {
        self.armed != 0 && self.starting != 0
    }

    /// Whether the motors are being started.
    pub fn is_starting(&self) -> bool {
        self.starting != 0 && self.armed == 0
    }

    /// Whether the vehicle answers, with or without the state of its motors.
    pub fn answers(&self) -> bool {
        self.link != VehicleLink::Silent.code()
    }
}
