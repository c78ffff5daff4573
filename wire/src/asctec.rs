//! The serial interface of AscTec's X-3D-BL and Hummingbird with AutoPilot: 57600 baud, 8N1, little endian, packed.
//!
//! | bytes | host to vehicle |
//! |---|---|
//! | 17 | command: `>*>di`, then pitch, roll, yaw (i16, -2047..2047), thrust (i16, 0..4095), enabled axes (i16, bits 0..3), checksum (their sum + 0xAAAA) |
//! | 6 | poll: `>*>p`, then the requested telemetry (u16, bits of [`Poll`]) |
//! | 5 | emergency stop of the motors: `>*>me` |
//!
//! | bytes | vehicle to host |
//! |---|---|
//! | 5 | acknowledgement: `>a`, descriptor (u8), `a<` |
//! | length + 11 | telemetry: `>*>`, length (u16), descriptor (u8), payload, CRC of the payload (u16), `<#<` |
//!
//! Sources: AscTec, *Hummingbird with AutoPilot User's Manual*, pp. 15-17 and 24-26; CCNYRoboticsLab/asctec_drivers;
//! nmichael/asctec_quadrotor; ethz-asl/asctec_mav_framework. The older *ResearchPilot* firmware of the X-3D-BL frames
//! differently (length and CRC big endian, no end mark) and is not supported.
//!
//! The vehicle obeys the serial interface only while channel 5 of its remote control releases it and the remote control is on
//! (manual, p. 17).
//!
//! The command's checksum detects every single wrong bit, but not every pair; the poll and the emergency stop have no checksum.

mod command;
mod crc;
mod decoder;
mod descriptor;
mod invalid_scale;
mod meaning;
mod payload;
mod telemetry;
mod thrust;

pub use command::{
    CommandError, ControlInput, EMERGENCY_STOP, FULL_STICK, FULL_THRUST, HostCommand, poll_frame,
    read_poll,
};
pub use crc::crc16;
pub use decoder::{HostDecoder, HostEvent, HostGrammar, VehicleDecoder, VehicleGrammar};
pub use descriptor::{Descriptor, Poll};
pub use invalid_scale::InvalidScale;
pub use meaning::{AxisSigns, CountLimits, Imu, Scales, Status, StickMeaning, Sticks};
pub use payload::{ImuCalc, LlStatus};
pub use telemetry::{
    MAX_TELEMETRY, TelemetryError, TelemetryPacket, acknowledgement_frame, read_acknowledgement,
    write_telemetry,
};
pub use thrust::ThrustTable;
