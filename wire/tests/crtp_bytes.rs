//! CRTP's packets against bytes of cflib 0.1.34, which `tests/peers/crtp_packets.py` printed, and the vehicle's end against the
//! host's.

use crate::common::{crtp_examples, hex};
use oqtal_wire::crtp::{
    CrtpPacket, CrtpPose, CrtpReply, CrtpRequest, CrtpValue, LegacySetpoint, LogCommand, LogType,
    PackedPose, PackedPoses, ParameterType, Supervision, SupervisorAnswer, SupervisorCommand,
    TableElement, TableInfo, TableKind,
};
use proptest::prelude::*;

#[test]
fn packets_are_those_of_cflib() {
    crtp_examples::check(include_str!("golden/crtp.jsonl"));
}

/// Signs of the wire: a turn to the right about x is positive, nose up is positive, clockwise from above is positive.
#[test]
fn a_turn_about_each_axis_has_the_sign_of_the_vehicle() {
    let degree = 1.0_f64.to_radians();
    let setpoint = LegacySetpoint { roll: degree, pitch: degree, yaw_rate: degree, thrust: 1 };
    let (one, minus_one) = (1.0_f32.to_le_bytes(), (-1.0_f32).to_le_bytes());
    let packet = CrtpRequest::Setpoint(setpoint).packet();
    assert_eq!(packet.payload(), [&one[..], &minus_one, &minus_one, &[1, 0]].concat());
    let zero = CrtpRequest::Setpoint(LegacySetpoint::ZERO).packet();
    assert_eq!(zero.payload(), [0; 14]);
}

#[test]
fn thrust_is_limited_to_full_power() {
    let setpoint = LegacySetpoint { thrust: u16::MAX, ..LegacySetpoint::ZERO };
    assert_eq!(CrtpRequest::Setpoint(setpoint).packet().payload()[12..], 60_000_u16.to_le_bytes());
}

/// Layout of crtp_localization_service.c: number, three i16 in millimetres, the attitude in 32 bits.
#[test]
fn two_vehicles_share_a_packet_of_poses() {
    let pose = |x: f64| CrtpPose { position: [x, -1.0, 0.001], attitude: [0.0, 0.0, 0.0, 1.0] };
    let packed = [(0xE7, 1.5), (0xE8, -2.0)].map(|(id, x)| PackedPose::of(id, &pose(x)).unwrap());
    let packet = CrtpRequest::Poses(PackedPoses::of(&packed)).packet();
    let bytes = hex("6d 09 e7 dc05 18fc 0100 000000c0 e8 30f8 18fc 0100 000000c0");
    assert_eq!(packet.as_bytes(), bytes);
    let Some(CrtpRequest::Poses(read)) = CrtpRequest::read(&packet) else { panic!() };
    assert_eq!(read.poses(), packed);
    assert_eq!(read.poses()[1].pose(), pose(-2.0));
    assert_eq!(PackedPose::of(1, &pose(32.768)), None);
    assert_eq!(PackedPose::of(1, &pose(f64::NAN)), None);
}

fn replies() -> Vec<CrtpReply<'static>> {
    let element = TableElement { id: 300, kind: 7, group: "stateEstimate", name: "roll" };
    let value = CrtpValue::of(ParameterType::F32, 0.25);
    let granted = SupervisorAnswer { is_arming: true, granted: true };
    vec![
        CrtpReply::Null,
        CrtpReply::Console(b"SYS: Ready\n"),
        CrtpReply::Echo(77),
        CrtpReply::Source,
        CrtpReply::ProtocolVersion(7),
        CrtpReply::Supervision(Supervision::ARMED.with(Supervision::CAN_FLY)),
        CrtpReply::Granted(granted),
        CrtpReply::TableInfo(TableKind::Logging, TableInfo { count: 337, crc: 0x1234_5678 }),
        CrtpReply::TableElement(TableKind::Parameters, element),
        CrtpReply::NoElement(TableKind::Logging),
        CrtpReply::Parameter(3, value),
        CrtpReply::Written(3, value),
        CrtpReply::NoParameter(9),
        CrtpReply::MemoryCount(0),
        CrtpReply::Log(LogCommand::Create, 1, 0),
    ]
}

#[test]
fn the_host_reads_the_messages_of_a_vehicle() {
    for reply in replies() {
        let packet = CrtpPacket::parse(reply.packet().as_bytes()).unwrap();
        assert_eq!(CrtpReply::read(&packet), Some(reply));
    }
}

#[test]
fn the_supervisors_own_port_answers_with_its_state() {
    let answer = SupervisorAnswer { is_arming: true, granted: false };
    let packet = answer.packet(SupervisorCommand::Arm(true), Supervision::default());
    assert_eq!(packet.as_bytes(), hex("9d 81 00 00"));
    assert_eq!(CrtpReply::read(&packet), Some(CrtpReply::Granted(answer)));
}

#[test]
fn log_data_are_read_in_the_order_of_the_block() {
    let values = [(LogType::F32, 3.75), (LogType::U16, 15.0), (LogType::I8, -2.0)];
    let packet = CrtpReply::log_data(4, 0x12_3456, values.into_iter());
    assert_eq!(packet.as_bytes(), hex("5e 04 563412 00007040 0f00 fe"));
    let Some(CrtpReply::LogData { block: 4, clock_ms: 0x12_3456, values: mut read }) =
        CrtpReply::read(&packet)
    else {
        panic!("{packet:?}")
    };
    for (kind, number) in values {
        assert_eq!(read.next(kind), Some(number));
    }
    assert_eq!(read.next(LogType::U8), None);
}

/// Answers of firmware that no packet above has: a state of one byte, an element that ends with its packet.
#[test]
fn shorter_forms_of_answers_are_read_as_well() {
    let read = |bytes: &str| {
        let packet = CrtpPacket::parse(&hex(bytes)).unwrap();
        CrtpReply::read(&packet).map(|reply| format!("{reply:?}"))
    };
    let state = CrtpReply::Supervision(Supervision::ARMED);
    assert_eq!(read("9c 8c 02"), Some(format!("{state:?}")));
    let element = TableElement { id: 1, kind: 7, group: "pm", name: "vbat" };
    let element = CrtpReply::TableElement(TableKind::Logging, element);
    assert_eq!(read("5c 02 0100 07 706d 00 76626174"), Some(format!("{element:?}")));
    assert_eq!(read("9c 0c 02"), None, "a request, not an answer");
}

proptest! {
    #[test]
    fn a_cut_packet_is_read_or_refused(kind in 0..15_usize, cut in 1..31_usize) {
        let packet = replies()[kind].packet();
        let cut = cut.min(packet.as_bytes().len());
        let part = CrtpPacket::parse(&packet.as_bytes()[..cut]).unwrap();
        let _ = CrtpReply::read(&part);
        let _ = CrtpRequest::read(&part);
    }
}
