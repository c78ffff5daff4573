//! Emulated vehicle at the far end of a wire: switched on, controlled and polled through bytes.

use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Interface};
use oqtal_plant_sim::wire::{AsctecVehicle, LinkDirection, LinkModel, RadioModel};
use oqtal_runtime::random::{RandomSource, stream};
use oqtal_wire::asctec::{
    ControlInput, EMERGENCY_STOP, HostCommand, HostDecoder, HostEvent, LlStatus, Poll, Scales,
    StickMeaning, Sticks, VehicleDecoder, poll_frame,
};
use oqtal_wire::link::{AsctecLink, LinkSpec};
use oqtal_wire::xbee::{Address, Carrier, RadioEvent, Side};
use proptest::prelude::*;
use rand::RngExt;

use crate::START;

fn link(text: &str) -> AsctecLink {
    match text.parse() {
        Ok(LinkSpec::Asctec(link)) => link,
        other => panic!("{other:?}"),
    }
}

const PERIOD_US: i64 = 16_667;

/// Scales at the vehicle's end; sticks mean rates or an attitude.
fn scales_of(config: &Config) -> Scales {
    let scales: Scales = config.plant.wire.asctec.convert("plant.wire.asctec").unwrap();
    match config.plant.interface {
        Interface::Attitude => Scales { sticks: StickMeaning::Attitude, ..scales },
        _ => scales,
    }
}

/// A host that writes and reads at 60 Hz.
struct Host {
    vehicle: AsctecVehicle,
    scales: Scales,
    decoder: HostDecoder,
    events: Vec<HostEvent>,
    now: Time,
}

impl Host {
    fn new(config: &Config) -> Self {
        let link = link("asctec:/dev/null");
        Self {
            vehicle: AsctecVehicle::new(config, &link, START).unwrap(),
            scales: scales_of(config),
            decoder: HostDecoder::new(),
            events: Vec::new(),
            now: START,
        }
    }

    /// Writes `bytes`, and advances by a period.
    fn write(&mut self, bytes: &[u8]) {
        self.vehicle.host_writes(self.now, bytes);
        self.now = self.now + Span::from_nanos(1000 * PERIOD_US);
        self.vehicle.advance(self.now, |_| {});
        let Self { vehicle, decoder, events, now, .. } = self;
        vehicle.host_reads(*now, |bytes| events.extend(decoder.push(bytes)));
    }

    fn command(&mut self, input: &ControlInput, periods: u32) {
        (0..periods).for_each(|_| self.write(&input.frame()));
    }

    fn start_motors(&mut self) {
        let switch = self.scales.motor_switch();
        self.command(&switch, 40);
        assert!(self.vehicle.board().motors_run());
    }

    fn fly(&mut self, sticks: &Sticks, periods: u32) {
        let input = self.scales.encode(sticks);
        self.command(&input, periods);
    }

    fn status(&mut self) -> LlStatus {
        self.events.clear();
        self.write(&poll_frame(Poll::LL_STATUS));
        (0..3).for_each(|_| self.write(&[]));
        let status = |event: &HostEvent| match event {
            HostEvent::LlStatus(status) => Some(*status),
            _ => None,
        };
        self.events.iter().find_map(status).expect("an answer")
    }

    fn height(&self) -> f64 {
        self.vehicle.plant().truth().position[2]
    }
}

fn host() -> Host {
    Host::new(&Config::default())
}

const LIFT: Sticks = Sticks { roll: 0.0, pitch: 0.0, yaw: 0.0, thrust: 0.3 };

#[test]
fn commands_are_ignored_until_the_motors_run() {
    let mut host = host();
    host.fly(&LIFT, 60);
    assert_eq!((host.height(), host.vehicle.board().motors_run()), (0.0, false));
    host.start_motors();
    host.fly(&LIFT, 60);
    assert!(host.height() > 0.5, "{}", host.height());
}

#[test]
fn every_command_is_acknowledged_and_the_status_reports_the_motors() {
    let mut host = host();
    host.command(&ControlInput::ZERO_SETPOINT, 30);
    host.command(&ControlInput::ZERO_SETPOINT, 30);
    let acknowledged =
        host.events.iter().filter(|event| matches!(event, HostEvent::Acknowledged(_))).count();
    assert!((57..=60).contains(&acknowledged), "{acknowledged}, the last ones are on their way");
    let before = host.status();
    assert_eq!((before.motors_on, before.flying, before.battery_1_mv), (0, 0, 12_600));
    host.start_motors();
    host.fly(&LIFT, 60);
    let after = host.status();
    assert_eq!((after.motors_on, after.flying), (1, 1));
    assert!(after.battery_1_mv < before.battery_1_mv && after.up_time >= 1, "{after:?}");
}

#[test]
fn an_emergency_stop_stops_the_motors_and_a_silent_host_too() {
    let mut host = host();
    host.start_motors();
    host.fly(&LIFT, 30);
    host.write(&EMERGENCY_STOP);
    host.write(&[]);
    host.write(&[]);
    assert!(!host.vehicle.board().motors_run());
    let mut host = self::host();
    host.start_motors();
    (0..58).for_each(|_| host.write(&[]));
    assert!(host.vehicle.board().motors_run());
    (0..6).for_each(|_| host.write(&[]));
    assert!(
        !host.vehicle.board().motors_run(),
        "a second has passed since the last command arrived"
    );
}

/// Flights with and without a wire are then comparable.
#[test]
fn a_command_acts_after_the_delay_of_the_direct_simulation() {
    let config = Config::default();
    let link = link("asctec:/dev/null");
    let mut vehicle = AsctecVehicle::new(&config, &link, START).unwrap();
    vehicle.host_writes(START, &ControlInput::ZERO_SETPOINT.frame());
    let delay = |millis: f64| START + Span::from_seconds(1e-3 * millis);
    vehicle.advance(delay(config.plant.command_delay_ms - 0.01), |_| {});
    assert_eq!(vehicle.counters().frames.read, 0);
    vehicle.advance(delay(config.plant.command_delay_ms + 0.01), |_| {});
    assert_eq!(vehicle.counters().frames.read, 1);
}

/// API frames are unwrapped and wrapped; delivery is reported where requested.
#[test]
fn both_api_modes_transport_commands_and_replies() {
    for framing in ["api1", "api2"] {
        let config = Config::default();
        let link = link(&format!("asctec:/dev/null,xbee={framing}"));
        let mut vehicle = AsctecVehicle::new(&config, &link, START).unwrap();
        let mut host = Carrier::new(link.xbee, Side::Host, Address::BROADCAST);
        let request = host.wrap(1, &poll_frame(Poll::LL_STATUS)).unwrap();
        vehicle.host_writes(START, request.as_bytes());
        let later = START + Span::from_millis(200);
        vehicle.advance(later, |_| {});
        let (mut bytes, mut decoder) = (Vec::new(), HostDecoder::new());
        vehicle.host_reads(later, |arrived| bytes.extend(arrived));
        let arrivals: Vec<RadioEvent> = host.push(&bytes).collect();
        assert_eq!(arrivals[0], RadioEvent::Delivery { id: 1, delivered: true }, "{framing}");
        let RadioEvent::Payload { payload, .. } = arrivals[1] else { panic!("{arrivals:?}") };
        let events: Vec<HostEvent> = decoder.push(&payload).collect();
        assert!(matches!(events[..], [HostEvent::LlStatus(_)]), "{framing} {events:?}");
    }
}

#[test]
fn sticks_that_mean_an_attitude_are_followed_by_a_loop_on_board() {
    let mut config = Config::default();
    config.plant.interface = Interface::Attitude;
    let mut host = Host::new(&config);
    host.start_motors();
    let tilt = 10.0_f64.to_radians();
    host.fly(&Sticks { thrust: 0.3, ..Sticks::default() }, 60);
    host.fly(&Sticks { roll: tilt, pitch: -tilt, yaw: 0.0, thrust: 0.26 }, 120);
    let q = host.vehicle.plant().truth().attitude;
    let attitude = oqtal_control::quaternion::Attitude::from_xyzw(q).unwrap();
    let angles = oqtal_control::euler::EulerAngles::from_attitude(&attitude);
    assert!((angles.roll - tilt).abs() < 0.02, "{angles:?}");
    assert!((angles.pitch + tilt).abs() < 0.02, "{angles:?}");
}

#[test]
fn the_inertial_measurements_are_those_of_the_flight() {
    let mut host = host();
    host.start_motors();
    host.fly(&Sticks { roll: 0.1, ..LIFT }, 30);
    host.events.clear();
    host.write(&poll_frame(Poll::IMU_CALC | Poll::LL_STATUS));
    (0..3).for_each(|_| host.write(&[]));
    let imu = host.events.iter().find_map(|event| match event {
        HostEvent::ImuCalc(imu) => Some(host.scales.decode_imu(imu)),
        _ => None,
    });
    let (imu, truth) = (imu.expect("an answer"), host.vehicle.plant().truth());
    // The measurement is a few periods old.
    assert!((imu.rate[0] - truth.rate[0]).abs() < 0.02 && imu.rate[0] > 0.1, "{imu:?}");
    assert!(imu.height > 0.1 && imu.height < truth.position[2], "{imu:?}");
}

/// Verifies the figure in the documentation of the on-board computer.
#[test]
fn six_commands_in_a_thousand_are_wrong_at_one_wrong_bit_in_a_hundred() {
    let mut config = Config::default();
    config.plant.wire.bit_error_rate = 0.01;
    config.plant.wire.latency_ms = 0.0;
    let mut radio = RadioModel::new(&config.plant.wire, 7, 57_600);
    let mut decoder = VehicleDecoder::new();
    let mut generator = stream(7, RandomSource::Gust);
    let scales = Scales::default();
    let (frames, mut read, mut wrong, mut now, mut bytes) = (200_000, 0, 0, START, Vec::new());
    for _ in 0..frames {
        let stick = |value: f64| 0.3 * (value - 0.5);
        let [roll, pitch, yaw, thrust] = std::array::from_fn(|_| generator.random::<f64>());
        let sticks = Sticks {
            roll: stick(roll),
            pitch: stick(pitch),
            yaw: stick(yaw),
            thrust: 0.2 + 0.1 * thrust,
        };
        let input = scales.encode(&sticks);
        radio.send(LinkDirection::Up, now, &input.frame());
        now = now + Span::from_millis(10);
        bytes.clear();
        radio.receive(LinkDirection::Up, now, &mut bytes);
        for command in decoder.push(&bytes) {
            read += 1;
            wrong += u32::from(command != HostCommand::Control(input));
        }
    }
    let (read, wrong) = (f64::from(read) / f64::from(frames), f64::from(wrong) / f64::from(read));
    assert!((0.25..0.265).contains(&read), "{read}");
    assert!((0.005..0.007).contains(&wrong), "{wrong}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Arbitrary bytes from a host cause no panic, only finite values, and no running motors without the switch.
    #[test]
    fn arbitrary_bytes_leave_the_vehicle_in_a_valid_state(
        writes in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..300), 0..30),
    ) {
        let mut host = host();
        for bytes in writes {
            host.write(&bytes);
            let truth = host.vehicle.plant().truth();
            prop_assert!(truth.position.iter().chain(&truth.attitude).all(|x| x.is_finite()));
        }
        prop_assert!(!host.vehicle.board().motors_run());
    }
}
