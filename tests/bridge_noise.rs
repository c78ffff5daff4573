//! A hover behind a radio that corrupts bits, in virtual time: the same errors in every run. Cameras, daemon, bridge and emulated
//! vehicle run in one process, over the memory bus and the bytes of the wire.

use oqtal_bridge::{Asctec, Bridge, VehicleReport, transport};
use oqtal_bus::code::{Mode, OperatorCommand};
use oqtal_bus::memory::{MemoryBus, MemoryReader, MemoryWriter};
use oqtal_bus::message::{CommandV1, TelemetryV1, TruthV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, TELEMETRY, TRUTH, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_config::{Config, Setting};
use oqtal_daemon::{
    CacheWarmup, Cycle, DaemonPorts, DaemonTurn, LawPort, OperatorRequests, loop_handoff,
    trajectory,
};
use oqtal_mocap_emu::{Cameras, EmulatedCameras};
use oqtal_plant_sim::PlantOutput;
use oqtal_plant_sim::wire::AsctecVehicle;
use oqtal_runtime::pose_source::PoseTurn;
use oqtal_runtime::turn::{Turn, step};
use oqtal_wire::link::LinkSpec;
use oqtal_wire::xbee::Address;

/// A minute of hover through one wrong bit in a hundred.
const SETTINGS: [&str; 6] = [
    "clock.seed=7",
    "trajectory.kind=hover",
    "trajectory.hover.duration-s=60.0",
    "plant.wire.bit-error-rate=0.01",
    "safety.allow-emulated-poses=true",
    "bridge.vehicle-time-out-ms=1000",
];
/// Time-out of the flight.
const TIMEOUT: Span = Span::from_millis(100_000);

struct NoisyFlight {
    now: Time,
    vehicle: AsctecVehicle,
    bridge: Bridge,
    cameras: PoseTurn<MemoryBus, EmulatedCameras<MemoryBus>>,
    daemon: DaemonTurn<'static, MemoryBus>,
    /// Kept open: a closed hand-off does not accept a status.
    _requests: OperatorRequests,
    truths: MemoryWriter<TruthV1>,
    vehicles: MemoryWriter<VehicleV1>,
    commands: MemoryReader<CommandV1>,
    telemetry: MemoryReader<TelemetryV1>,
    reports: Vec<VehicleReport>,
    ticks: Vec<TelemetryV1>,
    height_m: f64,
    /// Distances from the reference in flight \[m\].
    errors_m: Vec<f64>,
}

impl NoisyFlight {
    fn new() -> Self {
        let settings = SETTINGS.map(|text| Setting::parse("test", text).unwrap());
        let config = Config::from_settings(&settings).unwrap();
        let (bus, now) = (MemoryBus::new(), Time::VIRTUAL_START);
        let link: LinkSpec = "asctec:/dev/null".parse().unwrap();
        let LinkSpec::Asctec(wire) = &link else { panic!("{link}") };
        let protocol = Box::new(Asctec::new(&config).unwrap());
        let carrier = transport(&link, Address::BROADCAST);
        let mut bridge = Bridge::new(&config, protocol, carrier, now);
        bridge.open(now);
        let cameras = Cameras::new(&config.mocap, config.clock.seed);
        let cameras = EmulatedCameras::open(&bus, cameras).unwrap();
        let cycle = Cycle::new(&config, trajectory(&config).unwrap(), now).unwrap();
        let (handle, requests) = loop_handoff();
        let ports = DaemonPorts::open(&bus).unwrap();
        Self {
            now,
            vehicle: AsctecVehicle::new(&config, wire, now).unwrap(),
            bridge,
            cameras: PoseTurn::open(&bus, cameras).unwrap(),
            daemon: DaemonTurn {
                ports,
                cycle,
                warmup: CacheWarmup::never(),
                handle,
                law: LawPort::default(),
            },
            _requests: requests,
            truths: bus.writer(&TRUTH).unwrap(),
            vehicles: bus.writer(&VEHICLE).unwrap(),
            commands: bus.reader(&COMMAND).unwrap(),
            telemetry: bus.reader(&TELEMETRY).unwrap(),
            reports: Vec::new(),
            ticks: Vec::new(),
            height_m: 0.0,
            errors_m: Vec::new(),
        }
    }

    /// Flies until the vehicle is disarmed after landing.
    fn fly(mut self) -> Self {
        let mode = |flight: &Self| flight.ticks.last().map(|tick| tick.mode);
        while mode(&self) != Some(Mode::Flying.code()) {
            self.daemon.cycle.request(self.now, OperatorCommand::Fly);
            self.advance_to_next_event();
        }
        while mode(&self) != Some(Mode::Disarmed.code()) {
            self.advance_to_next_event();
        }
        self
    }

    fn advance_to_next_event(&mut self) {
        let waits = [self.cameras.next_event(self.now), self.daemon.next_event(self.now)];
        let waits = waits.into_iter().flatten();
        let next = waits.chain([self.vehicle.next_event(), self.bridge.next_event(self.now)]).min();
        self.now = next.unwrap().max(self.now + Span::from_nanos(1));
        assert!(self.now.since(Time::VIRTUAL_START) < TIMEOUT, "the flight does not end");
        let mut is_captured = false;
        let Self { vehicle, truths, height_m, .. } = self;
        vehicle.advance(self.now, |output| {
            let PlantOutput::Truth(truth) = output else { return };
            is_captured |= truth.capture > 0;
            *height_m = truth.position[2];
            truths.send(truth.capture, Default::default(), truth).unwrap();
        });
        let is_due = |next: Option<Time>| next.is_some_and(|next| next <= self.now);
        let mut is_posed = false;
        if is_captured || is_due(self.cameras.next_event(self.now)) {
            is_posed = step(&mut self.cameras, self.now).unwrap().published;
        }
        let is_due = |next: Option<Time>| next.is_some_and(|next| next <= self.now);
        if is_posed || is_due(self.daemon.next_event(self.now)) {
            step(&mut self.daemon, self.now).unwrap();
            self.record();
        }
        self.bridge_turn();
    }

    fn record(&mut self) {
        let Some((_, tick)) = self.telemetry.latest().unwrap() else { return };
        if tick.mode == Mode::Flying.code() {
            let truth = self.vehicle.plant().truth();
            let errors = truth.position.iter().zip(tick.reference_position);
            self.errors_m
                .push(errors.map(|(is, wanted)| (is - wanted).powi(2)).sum::<f64>().sqrt());
        }
        self.ticks.push(tick);
    }

    /// Reads the vehicle's replies, takes the newest command, and writes the frames that are due.
    fn bridge_turn(&mut self) {
        let now = self.now;
        let mut bytes = Vec::new();
        self.vehicle.host_reads(now, |packet| bytes.extend_from_slice(packet));
        self.bridge.begin_read(now);
        self.bridge.receive_bytes(now, &bytes, &mut |_| {});
        if let Some((header, command)) = self.commands.latest().unwrap() {
            self.bridge.receive_command(now, &header, command, 0);
        }
        let due = self.bridge.turn(now, &mut |_| {});
        self.publish(due);
        self.write();
        while self.bridge.follow_up(now) {
            self.write();
        }
    }

    fn write(&mut self) {
        let bytes = self.bridge.outbox().to_vec();
        self.vehicle.host_writes(self.now, &bytes);
        let due = self.bridge.handed_over(self.now, bytes.len());
        self.publish(due);
    }

    fn publish(&mut self, report: Option<VehicleReport>) {
        let Some((pose_sequence, stamps, vehicle)) = report else { return };
        self.vehicles.send(pose_sequence, stamps, vehicle).unwrap();
        self.reports.push((pose_sequence, stamps, vehicle));
    }
}

/// A quarter of the commands and a fifteenth of the poll answers arrive intact. A poll delays a command by at most a frame.
#[test]
fn a_hover_lasts_a_minute_through_one_wrong_bit_in_a_hundred() {
    let flight = NoisyFlight::new().fly();
    assert!(flight.height_m < 0.05, "{} m", flight.height_m);
    let reports = || flight.reports.iter().map(|(.., vehicle)| vehicle);
    // A full battery has 12.6 V; a minute of hover uses slightly more than half a volt.
    let voltages: Vec<f64> = reports().map(|v| v.battery_v).filter(|v| v.is_finite()).collect();
    assert!(!voltages.is_empty());
    assert!(voltages.iter().all(|voltage| (11.8..=12.6).contains(voltage)), "{voltages:?}");
    // Running motors are never reported as stopped before they are actually stopped.
    let mut motors: Vec<u8> = reports().map(|vehicle| vehicle.armed).collect();
    motors.dedup();
    assert!(matches!(motors[..], [0, 1] | [0, 1, 0]), "{motors:?}");
    assert_commands_are_in_time(&flight.reports);
    assert!(flight.errors_m.len() > 60 * 60, "{} ticks", flight.errors_m.len());
    let error = flight.errors_m.iter().sum::<f64>() / flight.errors_m.len() as f64;
    assert!(error < 0.3, "{error} m");
    let qualities: Vec<f64> = reports().map(|vehicle| vehicle.link_quality).collect();
    let answered = qualities.iter().sum::<f64>() / qualities.len() as f64;
    assert!((0.1..0.25).contains(&answered), "{answered}");
}

/// Checks that the last byte of a command is sent within a period and a frame after its arrival, also behind a poll.
fn assert_commands_are_in_time(reports: &[VehicleReport]) {
    let (period_ns, frame_ns) = (16_666_667, 2_951_389);
    let applied: Vec<_> =
        reports.iter().filter(|(_, stamps, _)| stamps.applied_at.is_set()).collect();
    assert!(applied.len() > 2000, "{} commands", applied.len());
    for (_, stamps, vehicle) in applied {
        assert!(vehicle.wire_ns <= 2 * frame_ns, "{vehicle:?}");
        let waited = stamps.applied_at.since(stamps.received_at).nanos();
        assert!(waited + vehicle.wire_ns <= period_ns + frame_ns, "{vehicle:?}");
    }
}
