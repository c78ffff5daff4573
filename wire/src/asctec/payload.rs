//! Telemetry payloads, field by field in the order of the wire.

use super::telemetry::write_telemetry;
use super::{Descriptor, MAX_TELEMETRY};

/// Defines a payload by its fields in the order of the wire: little endian, packed.
macro_rules! payload {
    ($(#[$meta:meta])* $name:ident { $($(#[$field_meta:meta])* $field:ident: $type:ty,)* }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* }

        impl $name {
            /// Descriptor of the payload.
            pub const DESCRIPTOR: Descriptor = Descriptor::$name;
            /// Length of the payload \[bytes\].
            pub const LEN: usize = $(size_of::<$type>() +)* 0;

            /// Decodes the fields; `None` if `payload` has another length.
            pub fn parse(payload: &[u8]) -> Option<Self> {
                // The length is compared once: with offsets that are constants the compiler drops every other bounds check.
                // With one check per field, LLVM spends 30 s on this function.
                let payload: &[u8; Self::LEN] = payload.try_into().ok()?;
                let mut at = 0;
                Some(Self { $($field: <$type>::from_le_bytes(take(payload, &mut at)),)* })
            }

            /// Encodes the payload.
            pub fn payload(&self) -> [u8; Self::LEN] {
                let mut payload = [0; Self::LEN];
                let mut at = 0;
                $(
                    let field = self.$field.to_le_bytes();
                    payload[at..at + field.len()].copy_from_slice(&field);
                    at += field.len();
                )*
                debug_assert_eq!(at, Self::LEN);
                payload
            }

            /// Writes the frame to the front of `out`; returns its length \[bytes\].
            pub fn write_frame(&self, out: &mut [u8; MAX_TELEMETRY]) -> usize {
                write_telemetry(Self::DESCRIPTOR, &self.payload(), out).unwrap_or(0)
            }
        }

        const _: () = assert!($name::LEN == $name::DESCRIPTOR.payload_len());
        const _: () = assert!($name::LEN + super::telemetry::ENVELOPE <= MAX_TELEMETRY);
    };
}

/// Reads `N` bytes at `at` and advances it. Panics beyond the end of `payload`; the offsets of the fields are constants.
fn take<const N: usize>(payload: &[u8], at: &mut usize) -> [u8; N] {
    let mut field = [0; N];
    field.copy_from_slice(&payload[*at..*at + N]);
    *at += N;
    field
}

payload! {
    /// `LL_STATUS`: battery and state.
    LlStatus {
        /// Battery voltage \[mV\].
        battery_1_mv: i16,
        /// Voltage of a second battery \[mV\]; 0 without one.
        battery_2_mv: i16,
        /// Of unpublished meaning \[-\].
        status: i16,
        /// Controller cycles per second, about 1000 \[1/s\].
        cpu_load: i16,
        /// Of unpublished meaning \[-\].
        compass_enabled: i8,
        /// Of unpublished meaning \[-\].
        checksum_error: i8,
        /// Not zero if the vehicle flies \[-\]; asctec_drivers reads it as the state of the motors.
        flying: i8,
        /// Not zero if the motors run \[-\].
        motors_on: i8,
        /// Flight mode, bits \[-\].
        flight_mode: i16,
        /// Time since the motors started \[unit not published\].
        up_time: i16,
    }
}

payload! {
    /// `IMU_CALCDATA`: the fused inertial measurements, in the vehicle's axes.
    ImuCalc {
        /// Nick (pitch) angle \[mdeg, -90000..90000\].
        angle_nick: i32,
        /// Roll angle \[mdeg, -90000..90000\].
        angle_roll: i32,
        /// Yaw angle \[mdeg, 0..360000\].
        angle_yaw: i32,
        /// Nick rate \[1/64.8 deg/s\].
        rate_nick: i32,
        /// Roll rate \[1/64.8 deg/s\].
        rate_roll: i32,
        /// Yaw rate \[1/64.8 deg/s\].
        rate_yaw: i32,
        /// Calibrated accelerometer \[1e-4 g\].
        acc_x_calib: i16,
        /// Calibrated accelerometer \[1e-4 g\].
        acc_y_calib: i16,
        /// Calibrated accelerometer \[1e-4 g\].
        acc_z_calib: i16,
        /// Horizontal acceleration, x \[1e-4 g\].
        acc_x: i16,
        /// Horizontal acceleration \[1e-4 g\].
        acc_y: i16,
        /// Vertical acceleration \[1e-4 g\].
        acc_z: i16,
        /// Nick angle from acceleration alone \[mdeg\].
        acc_angle_nick: i32,
        /// Roll angle from acceleration alone \[mdeg\].
        acc_angle_roll: i32,
        /// Magnitude of the acceleration \[1e-4 g\].
        acc_absolute: i32,
        /// Magnetic field without offset \[-\].
        magnetic_x: i32,
        /// Magnetic field without offset \[-\].
        magnetic_y: i32,
        /// Magnetic field without offset \[-\].
        magnetic_z: i32,
        /// Compass reading \[mdeg, 0..360000\].
        magnetic_heading: i32,
        /// Pseudo speed \[unit not published\].
        speed_x: i32,
        /// Pseudo speed \[unit not published\].
        speed_y: i32,
        /// Pseudo speed \[unit not published\].
        speed_z: i32,
        /// Height, fused \[mm\].
        height: i32,
        /// Climb rate, fused \[mm/s\].
        climb: i32,
        /// Climb rate of the pressure sensor \[mm/s\].
        climb_reference: i32,
        /// Height of the pressure sensor \[mm\].
        height_reference: i32,
    }
}
