//! A bridge to an AscTec vehicle on a serial line, and its turns.

use oqtal_bridge::{
    Asctec, Bridge, FrameSizes, Note, SafetyLimits, VehicleProtocol, VehicleReport,
    VehicleTransport, transport,
};
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, Stamps};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_wire::asctec::{Descriptor, LlStatus, write_telemetry};
use oqtal_wire::xbee::{Address, Framing};

const BAUD: u32 = 57_600;
pub const START: Time = Time::VIRTUAL_START;
pub const PERIOD: Span = Span::from_nanos(16_666_667);
/// Limits of a command gate on its own.
pub const LIMITS: SafetyLimits = SafetyLimits {
    accepts: Actuation::Sticks,
    command_age: Span::from_nanos(50_000_001),
    status_age: Span::from_millis(375),
    sequence: Span::from_millis(3000),
    rest: Span::from_millis(1500),
};
/// Duration of a set-point on the line: 17 bytes of ten bits at 57600 baud.
pub const FRAME: Span = Span::from_nanos(2_951_389);

pub fn bridge() -> Bridge {
    through_radio(Framing::Transparent)
}

pub fn serial(framing: Framing) -> Box<dyn VehicleTransport> {
    let spec = format!("asctec:/dev/ttyS0,baud={BAUD},xbee={framing}").parse().unwrap();
    transport(&spec, Address::BROADCAST)
}

/// Frame lengths on the port \[bytes\].
pub fn sizes(framing: Framing) -> FrameSizes {
    Asctec::new(&Config::default()).unwrap().sizes().with_overhead(serial(framing).overhead())
}

pub fn through_radio(framing: Framing) -> Bridge {
    over(serial(framing))
}

pub fn over(transport: Box<dyn VehicleTransport>) -> Bridge {
    let config = Config::default();
    let mut bridge =
        Bridge::new(&config, Box::new(Asctec::new(&config).unwrap()), transport, START);
    bridge.open(START);
    bridge
}

pub fn header(sequence: u64, at: Time) -> Header {
    let stamps = Stamps { command_published_at: at, ..Stamps::default() };
    Header { sequence, pose_sequence: sequence, stamps, ..Header::default() }
}

pub fn flight() -> CommandV1 {
    let actuation = Actuation::Sticks.code();
    CommandV1 { actuation, sticks: [0.1; 3], thrust: 0.3, ..CommandV1::default() }
}

/// One turn with a port that takes everything; returns the bytes written and the last report.
pub fn turn(bridge: &mut Bridge, now: Time) -> (Vec<u8>, Option<VehicleReport>) {
    let (mut bytes, mut reported) = (Vec::new(), None);
    let mut all = |bridge: &mut Bridge| {
        let count = bridge.outbox().len();
        bytes.extend_from_slice(bridge.outbox());
        if count > 0 {
            reported = bridge.handed_over(now, count).or(reported);
        }
    };
    all(bridge);
    bridge.turn(now, &mut |_: Note| {});
    if !bridge.outbox().is_empty() {
        all(bridge);
        bridge.follow_up(now);
        all(bridge);
    }
    (bytes, reported)
}

/// A status of the vehicle as on the line.
pub fn status(motors_on: i8) -> Vec<u8> {
    let mut frame = [0; 103];
    let payload = LlStatus { battery_1_mv: 11_100, motors_on, ..LlStatus::default() }.payload();
    let length = write_telemetry(Descriptor::LlStatus, &payload, &mut frame).unwrap();
    frame[..length].to_vec()
}
