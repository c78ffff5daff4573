//! AscTec's frames against bytes of independent origin.
//!
//! The telemetry frame was accepted by the parser of nmichael/asctec_quadrotor, and refused by it with one bit of the CRC
//! changed; the command is worked out from the manual by hand.

use crate::common::hex;
use oqtal_wire::asctec::{
    CommandError, ControlInput, Descriptor, EMERGENCY_STOP, HostCommand, HostDecoder, HostEvent,
    ImuCalc, LlStatus, MAX_TELEMETRY, Poll, TelemetryError, TelemetryPacket, VehicleDecoder,
    acknowledgement_frame, poll_frame, read_acknowledgement, read_poll,
};

const COMMAND: &str = "3e2a3e6469 0000 0000 0000 d007 0f00 89b2";
const LL_STATUS: &str = "3e2a3e1000025c2b00000000e8030000010100000c0039773c233c";

fn hover() -> ControlInput {
    ControlInput { thrust: 2000, ..ControlInput::ZERO_SETPOINT }
}

fn status() -> LlStatus {
    LlStatus {
        battery_1_mv: 11_100,
        cpu_load: 1000,
        flying: 1,
        motors_on: 1,
        up_time: 12,
        ..LlStatus::default()
    }
}

#[test]
fn command_is_the_reference() {
    assert_eq!(hover().frame().to_vec(), hex(COMMAND));
    assert_eq!(ControlInput::read(&hex(COMMAND)), Ok(hover()));
    let received: Vec<_> = VehicleDecoder::new().push(&hex(COMMAND)).collect();
    assert_eq!(received, [HostCommand::Control(hover())]);
}

#[test]
fn telemetry_is_the_reference() {
    let mut frame = [0; MAX_TELEMETRY];
    let length = status().write_frame(&mut frame);
    assert_eq!(frame[..length].to_vec(), hex(LL_STATUS));
    let bytes = hex(LL_STATUS);
    let packet = TelemetryPacket::new_checked(&bytes).unwrap();
    assert_eq!(packet.descriptor(), Descriptor::LlStatus);
    assert_eq!(LlStatus::parse(packet.payload()), Some(status()));
    let received: Vec<_> = HostDecoder::new().push(&bytes).collect();
    assert_eq!(received, [HostEvent::LlStatus(status())]);
}

#[test]
fn one_bit_of_the_reference_crc_changed_is_refused() {
    let mut bytes = hex(LL_STATUS);
    bytes[22] ^= 1;
    let refused = TelemetryPacket::new_checked(&bytes).unwrap_err();
    assert_eq!(refused, TelemetryError::Crc { found: 0x7738, wanted: 0x7739 });
}

#[test]
fn polls_acknowledgements_and_the_emergency_stop_are_as_published() {
    assert_eq!(poll_frame(Poll::LL_STATUS).to_vec(), hex("3e2a3e70 0100"));
    assert_eq!(poll_frame(Poll::IMU_CALC | Poll::GPS_DATA_ADVANCED).to_vec(), hex("3e2a3e70 0402"));
    assert_eq!(read_poll(&hex("3e2a3e70 8000")), Ok(Poll::GPS_DATA));
    assert_eq!(acknowledgement_frame(Descriptor::ControlInput).to_vec(), hex("3e61 17 613c"));
    assert_eq!(read_acknowledgement(&hex("3e61 17 613c")), Ok(Descriptor::ControlInput));
    assert_eq!(&EMERGENCY_STOP, b">*>me");
}

#[test]
fn frames_have_the_lengths_that_the_wire_is_planned_with() {
    let length = |descriptor: Descriptor| descriptor.payload_len() + 11;
    assert_eq!(ControlInput::FRAME_LEN, 17);
    assert_eq!((length(Descriptor::LlStatus), length(Descriptor::ImuCalc)), (27, 103));
    let mut frame = [0; MAX_TELEMETRY];
    assert_eq!(ImuCalc::default().write_frame(&mut frame), 103);
    let other = [
        (Descriptor::ImuRaw, 28),
        (Descriptor::ControllerOutput, 16),
        (Descriptor::RcData, 33),
        (Descriptor::GpsData, 44),
        (Descriptor::GpsDataAdvanced, 60),
    ];
    assert!(other.iter().all(|(descriptor, bytes)| descriptor.payload_len() == *bytes));
}

#[test]
fn imu_fields_are_where_the_manual_has_them() {
    let imu = ImuCalc {
        angle_nick: 0x0403_0201,
        rate_yaw: 0x1413_1211,
        acc_x_calib: 0x2221,
        acc_z: 0x3231,
        magnetic_heading: 0x4443_4241,
        height: 0x5453_5251,
        height_reference: 0x6463_6261,
        ..ImuCalc::default()
    };
    let payload = imu.payload();
    for (at, bytes) in [
        (0, &[1, 2, 3, 4][..]),
        (20, &[0x11, 0x12, 0x13, 0x14]),
        (24, &[0x21, 0x22]),
        (34, &[0x31, 0x32]),
        (60, &[0x41, 0x42, 0x43, 0x44]),
        (76, &[0x51, 0x52, 0x53, 0x54]),
        (88, &[0x61, 0x62, 0x63, 0x64]),
    ] {
        assert_eq!(&payload[at..at + bytes.len()], bytes, "at {at}");
    }
}

#[test]
fn a_rejected_command_has_a_reason() {
    let refused = |bytes: &[u8]| ControlInput::read(bytes).unwrap_err();
    let mut bytes = hex(COMMAND);
    assert_eq!(refused(&bytes[..16]), CommandError::Length { found: 16, wanted: 17 });
    bytes[16] ^= 0x80;
    assert_eq!(refused(&bytes), CommandError::Checksum { found: 0x3289, wanted: 0xB289 });
    bytes[0] = b'<';
    assert_eq!(refused(&bytes), CommandError::Head);
    let wild = ControlInput { thrust: 4096, ..ControlInput::ZERO_SETPOINT };
    assert_eq!(refused(&wild.frame()), CommandError::Range);
    assert_eq!(read_poll(&hex("3e2a3e70 2000")), Err(CommandError::Range));
}
