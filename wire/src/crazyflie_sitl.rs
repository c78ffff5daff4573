//! Datagrams between the Crazyflie's firmware, run as a program (software in the loop), and the simulator of its body.
//!
//! Each datagram is one CRTP packet: a header, port in the upper and channel in the lower four bits, and up to 30 bytes. Port 9
//! transfers sensors to the firmware and motor values from it; all other ports are traffic with a client, which the simulator
//! forwards. The firmware introduces itself by a packet of the header alone and waits for the same in answer.

use crate::bytes::{ByteOrder, ByteReader};

/// Longest datagram \[bytes\].
pub const MAX_DATAGRAM: usize = 31;
/// Datagram by which the firmware announces itself, and the answer to it.
pub const HELLO: [u8; 1] = [0xF3];

/// Port of sensors and motors.
const BODY_PORT: u8 = 9;
/// First byte of a body packet with gyroscope and accelerometer.
const IMU: u8 = 0;
/// Acceleration of one count \[m/s^2\]: 32 g over 16 bits.
const ACCELERATION_COUNT: f64 = 32.0 * 9.80665 / 65536.0;
/// Rate of one count \[rad/s\]: 4000 deg/s over 16 bits.
const RATE_COUNT: f64 = 4000.0 / 65536.0 * std::f64::consts::PI / 180.0;

/// Packet from the firmware, by what the simulator does with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FirmwarePacket {
    /// Asks for an answer; the firmware has just started.
    Hello,
    /// Power of the motors front right, back right, back left, front left \[0..1\].
    Motors([f64; 4]),
    /// The gyroscope's bias is known.
    Calibrated,
    /// Traffic with a client.
    Client,
    /// No packet of the firmware.
    Invalid,
}

impl FirmwarePacket {
    /// Decodes a datagram from the firmware.
    pub fn decode(datagram: &[u8]) -> Self {
        match datagram {
            [] => Self::Invalid,
            _ if datagram.len() > MAX_DATAGRAM => Self::Invalid,
            _ if *datagram == HELLO => Self::Hello,
            [header, data @ ..] if header >> 4 == BODY_PORT => Self::decode_body(data),
            _ => Self::Client,
        }
    }

    fn decode_body(data: &[u8]) -> Self {
        if let [1] = data {
            return Self::Calibrated;
        }
        let Ok(data): Result<[u8; 8], _> = data.try_into() else { return Self::Invalid };
        let mut reader = ByteReader::new(&data, ByteOrder::Little);
        Self::Motors(std::array::from_fn(|_| {
            f64::from(reader.u16().unwrap_or_default()) / f64::from(u16::MAX)
        }))
    }
}

/// Whether a client may send `datagram` to the firmware: a CRTP packet to any port but the body's.
pub fn is_from_client(datagram: &[u8]) -> bool {
    let header = datagram.first().map(|header| header >> 4);
    datagram.len() <= MAX_DATAGRAM
        && *datagram != HELLO
        && header.is_some_and(|port| port != BODY_PORT)
}

/// Encodes a sample of the inertial sensors, body axes: specific force \[m/s^2, body\] and rate \[rad/s, body\]. Values beyond the
/// sensors' range saturate.
pub fn imu_datagram(specific_force: [f64; 3], rate: [f64; 3]) -> [u8; 14] {
    let mut datagram = [0; 14];
    let (header, counts) = datagram.split_at_mut(2);
    header.copy_from_slice(&[BODY_PORT << 4, IMU]);
    let forces = specific_force.map(|value| value / ACCELERATION_COUNT);
    let rates = rate.map(|value| value / RATE_COUNT);
    for (bytes, value) in counts.chunks_exact_mut(2).zip(forces.into_iter().chain(rates)) {
        // The conversion saturates.
        bytes.copy_from_slice(&(value.round() as i16).to_le_bytes());
    }
    datagram
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_vehicle_at_rest_measures_one_g_upward() {
        let datagram = imu_datagram([0.0, 0.0, 9.80665], [0.0; 3]);
        assert_eq!(datagram, [0x90, 0, 0, 0, 0, 0, 0, 8, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn values_beyond_the_range_saturate_and_keep_their_sign() {
        let datagram = imu_datagram([1e6, -1e6, 0.0], [std::f64::consts::TAU, -1e6, f64::NAN]);
        assert_eq!(&datagram[2..6], [0xFF, 0x7F, 0x00, 0x80]);
        // One turn per second is 360 deg/s.
        assert_eq!(i16::from_le_bytes([datagram[8], datagram[9]]), 5898);
        assert_eq!(&datagram[10..14], [0x00, 0x80, 0, 0]);
    }

    #[test]
    fn motor_values_are_parts_of_full_power_in_the_firmware_s_order() {
        let datagram = [0x90, 0xFF, 0xFF, 0, 0, 0xFF, 0x7F, 1, 0];
        let FirmwarePacket::Motors(motors) = FirmwarePacket::decode(&datagram) else { panic!() };
        assert_eq!(motors, [1.0, 0.0, 32767.0 / 65535.0, 1.0 / 65535.0]);
        assert_eq!(FirmwarePacket::decode(&datagram[..8]), FirmwarePacket::Invalid);
        assert_eq!(FirmwarePacket::decode(&[0x90, 1]), FirmwarePacket::Calibrated);
        assert_eq!(FirmwarePacket::decode(&HELLO), FirmwarePacket::Hello);
        assert_eq!(FirmwarePacket::decode(&[0xF3, 1]), FirmwarePacket::Client);
        assert_eq!(FirmwarePacket::decode(&[0; 32]), FirmwarePacket::Invalid);
    }

    #[test]
    fn a_client_reaches_every_port_but_the_body_s() {
        assert!(is_from_client(&[0xFF]) && is_from_client(&[0x3C, 0, 0]));
        assert!(!is_from_client(&[]) && !is_from_client(&HELLO) && !is_from_client(&[0; 32]));
        assert!(!is_from_client(&[0x90, 0, 1, 2]));
    }

    proptest! {
        #[test]
        fn any_datagram_is_decoded_to_finite_motor_values(datagram: Vec<u8>) {
            if let FirmwarePacket::Motors(motors) = FirmwarePacket::decode(&datagram) {
                prop_assert!(motors.iter().all(|motor| (0.0..=1.0).contains(motor)));
            }
        }
    }
}
