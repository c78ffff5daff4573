//! Datagrams between Betaflight, run as a program (software in the loop), and the simulator of its body. Little endian.
//!
//! The simulator sends the state of the body, 18 numbers of 64 bits, to port 9003; the firmware answers each with the motor values,
//! four numbers of 32 bits, to port 9002. In the state, body rates are in axes x forward, y right, z down, and the specific force has
//! the opposite sign.
//!
//! The firmware scales its clock by the time stamps of the states, each of which may arrive late, or together with another. All stamps are
//! therefore zero; the firmware then uses the machine's clock.

use crate::bytes::{ByteOrder, ByteReader};

/// Length of the motor values \[bytes\].
pub const MOTORS_BYTES: usize = 16;
/// Length of the state \[bytes\].
const STATE_BYTES: usize = 144;
/// Air pressure, constant: the firmware's height is not used \[Pa\].
const PRESSURE: f64 = 101_325.0;

/// Encodes the state of the body: body rate \[rad/s, body\], specific force \[m/s^2, body\], and attitude \[body to world\], scalar
/// last. Position and velocity are zero: the firmware has cameras in place of a satellite receiver.
pub fn state_datagram(rate: [f64; 3], force: [f64; 3], attitude: [f64; 4]) -> [u8; STATE_BYTES] {
    let [roll, pitch, yaw] = rate;
    let [x, y, z, w] = attitude;
    let stamp = 0.0;
    let numbers = [stamp, roll, -pitch, -yaw].into_iter().chain(force.map(|axis| -axis));
    let numbers = numbers.chain([w, x, y, z]).chain([0.0; 6]).chain([PRESSURE]);
    let mut datagram = [0; STATE_BYTES];
    for (bytes, number) in datagram.chunks_exact_mut(8).zip(numbers) {
        bytes.copy_from_slice(&number.to_le_bytes());
    }
    datagram
}

/// Powers of the motors front right, back right, back left, front left \[0..1\] in a datagram of the firmware; `None` for any other.
pub fn read_motors(datagram: &[u8]) -> Option<[f64; 4]> {
    let mut reader = ByteReader::new(datagram, ByteOrder::Little);
    let motors = reader.f32s::<4>().filter(|_| datagram.len() == MOTORS_BYTES)?;
    let [front_right, back_left, front_left, back_right] = motors;
    let motors = [front_right, back_right, back_left, front_left].map(f64::from);
    let is_power = motors.iter().all(|power| power.is_finite());
    is_power.then(|| motors.map(|power| power.clamp(0.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_has_the_layout_and_the_signs_of_the_firmware() {
        let bytes = state_datagram([1.0, 2.0, 3.0], [4.0, 5.0, 9.8], [0.1, 0.2, 0.3, 0.9]);
        let numbers: Vec<f64> =
            bytes.chunks(8).map(|number| f64::from_le_bytes(number.try_into().unwrap())).collect();
        let wanted = [0.0, 1.0, -2.0, -3.0, -4.0, -5.0, -9.8, 0.9, 0.1, 0.2, 0.3];
        assert_eq!(numbers, [&wanted[..], &[0.0; 6], &[101_325.0]].concat());
    }

    #[test]
    fn motors_are_put_in_the_order_of_the_plant() {
        let datagram = [0.1_f32, 0.3, 0.4, 1.5].map(f32::to_le_bytes).concat();
        let motors = read_motors(&datagram).unwrap();
        let wanted = [0.1_f32, 1.0, 0.3, 0.4].map(f64::from);
        assert_eq!(motors, wanted);
        assert_eq!(read_motors(&datagram[..15]), None);
        assert_eq!(read_motors(&[datagram, vec![0]].concat()), None);
        assert_eq!(read_motors(&[f32::NAN; 4].map(f32::to_le_bytes).concat()), None);
    }
}
