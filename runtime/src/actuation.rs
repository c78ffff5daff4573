//! Actuation by interface: the kind of command that a vehicle takes.

use oqtal_bus::code::Actuation;
use oqtal_config::Interface;

/// Actuation of commands to a vehicle with this interface.
pub const fn actuation_of(interface: Interface) -> Actuation {
    match interface {
        Interface::Rate => Actuation::Sticks,
        Interface::Torque => Actuation::Torque,
        Interface::Attitude => Actuation::Attitude,
    }
}
