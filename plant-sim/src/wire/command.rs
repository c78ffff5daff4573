//! Commands to the simulated vehicle, as the loops of on-board computers make them.

use oqtal_bus::code::Actuation;
use oqtal_bus::message::CommandV1;
use oqtal_control::euler::EulerAngles;
use oqtal_control::quaternion::Attitude;

/// Command to hold `attitude` \[body to world\] at `thrust` \[0..1\].
pub(super) fn attitude_command(attitude: [f64; 4], thrust: f64) -> CommandV1 {
    let actuation = Actuation::Attitude.code();
    CommandV1 { actuation, attitude, thrust, ..CommandV1::default() }
}

/// Command to turn at `rates` \[rad/s, body\], of which `authority` is the greatest, at `thrust` \[0..1\].
pub(super) fn rate_command(rates: [f64; 3], authority: [f64; 3], thrust: f64) -> CommandV1 {
    let sticks = [0, 1, 2].map(|axis| rates[axis] / authority[axis]);
    CommandV1 { actuation: Actuation::Sticks.code(), sticks, thrust, ..CommandV1::default() }
}

/// Command to hold `roll` and `pitch` \[rad\] and to turn at `yaw_rate` \[rad/s\]: the commanded heading is that far ahead of
/// the present `yaw` \[rad\] that an attitude loop of `gain` \[1/s\] turns at this rate.
pub(super) fn turning_command(
    [roll, pitch]: [f64; 2],
    (yaw, yaw_rate): (f64, f64),
    gain: f64,
    thrust: f64,
) -> CommandV1 {
    let yaw = yaw + yaw_rate / gain;
    attitude_command(EulerAngles { roll, pitch, yaw }.xyzw(), thrust)
}

/// Euler angles of an attitude \[body to world\]; level for numbers that are not an attitude.
pub(super) fn angles(attitude: [f64; 4]) -> EulerAngles {
    EulerAngles::from_attitude(&Attitude::from_xyzw(attitude).unwrap_or_default())
}
