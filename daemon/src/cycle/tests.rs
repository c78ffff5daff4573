//! The last check of a command, with a law that fails.

use oqtal_control::position::PositionCommand;
use oqtal_control::quaternion::Attitude;
use oqtal_control::tracking_error::AttitudeReference;
use oqtal_control::trajectory::{Phase, Reference};

use super::*;

#[test]
fn f06_a_law_that_decides_on_numbers_that_are_not_finite_disarms() {
    let (config, now) = (Config::default(), Time::VIRTUAL_START);
    let mut cycle = Cycle::new(&config, crate::trajectory(&config).unwrap(), now).unwrap();
    let reference = Reference::rest(Vector3::zeros(), Phase::Settle);
    cycle.memory.setpoint.reference = Some(reference);
    for (thrust_n, is_armed) in [(5.0, true), (f64::NAN, false), (f64::INFINITY, false)] {
        let command = VehicleCommand::level(config.vehicle.interface, 0.0, thrust_n);
        let attitude = AttitudeReference::at_rest(Attitude::LEVEL);
        let setpoint = PositionCommand { attitude, thrust_n, velocity: Vector3::zeros() };
        let output = ControlOutput { setpoint, command: command.clone(), saturated: false };
        let expected = if is_armed { command } else { VehicleCommand::Disarmed };
        assert_eq!(cycle.choose(now, Some(&output)), expected, "{thrust_n} N");
    }
}
