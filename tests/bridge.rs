//! The bridge as a process on a pseudo-terminal: its frames, its safety without the daemon's help, its port.

mod common;
#[path = "bridge/vehicle.rs"]
mod vehicle;

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};

use common::{Running, Testbed, signal, stderr, wait_for};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps, VehicleV1};
use oqtal_bus::port::{Reader, Writer};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, POSE, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_wire::asctec::ControlInput;
use rustix::process::Signal;
use vehicle::{Manner, Vehicle};

const PERIOD: std::time::Duration = std::time::Duration::from_nanos(16_666_667);

/// A bridge, the vehicle at its link, and the bus they share with the test.
struct Flight {
    testbed: Testbed,
    vehicle: Vehicle,
    bridge: Running,
    bus: Bus,
    said: Reader<VehicleV1>,
}

impl Flight {
    fn new(name: &str, manner: Manner) -> Self {
        let testbed = Testbed::new(name);
        let vehicle = Vehicle::new(&testbed.path("port"), manner);
        let bus = testbed.bus();
        let said = bus.observer(&VEHICLE).unwrap();
        let bridge = testbed.start(&["bridge", "run", "--link", &vehicle.link()]);
        wait_for("frames", || (vehicle.log().orders.len() > 3).then_some(()));
        Self { testbed, vehicle, bridge, bus, said }
    }

    /// The next thing that the bridge says of its vehicle.
    fn next(&mut self) -> (Header, VehicleV1) {
        wait_for("a word of the bridge", || self.said.receive().unwrap())
    }

    fn until(&mut self, what: &str, holds: impl Fn(&VehicleV1) -> bool) -> VehicleV1 {
        wait_for(what, || self.said.receive().unwrap().map(|(_, v)| v).filter(&holds))
    }

    /// Waits for so many more orders on the wire.
    fn orders(&self, count: usize) -> Vec<ControlInput> {
        self.vehicle.forget();
        wait_for("orders", || {
            let orders = self.vehicle.log().orders;
            (orders.len() >= count).then_some(orders)
        })
    }
}

/// Commands from this test, as from a daemon.
struct Commander {
    commands: Writer<CommandV1>,
}

impl Commander {
    fn new(bus: &Bus) -> Self {
        Self { commands: bus.writer(&COMMAND).unwrap() }
    }

    fn send(&mut self, command: CommandV1, published_at: Time) -> u64 {
        let stamps = Stamps { command_published_at: published_at, ..Stamps::default() };
        let sequence = self.commands.send(1, stamps, command).unwrap();
        self.commands.notify().unwrap();
        sequence
    }

    /// Commands at the loop's rate until `done`.
    fn until<T>(
        &mut self,
        what: &str,
        command: CommandV1,
        mut done: impl FnMut() -> Option<T>,
    ) -> T {
        let began = std::time::Instant::now();
        loop {
            self.send(command, Time::now());
            std::thread::sleep(PERIOD);
            if let Some(found) = done() {
                return found;
            }
            assert!(began.elapsed() < common::WAIT_TIMEOUT, "commanded in vain for {what}");
        }
    }
}

fn stick(roll: f64) -> CommandV1 {
    let actuation = Actuation::Sticks.code();
    CommandV1 { actuation, sticks: [roll, 0.0, 0.0], thrust: 0.25, ..CommandV1::default() }
}

fn is_neutral(order: &ControlInput) -> bool {
    *order == ControlInput::NEUTRAL
}

/// A flight whose vehicle's motors run and which follows commands.
fn airborne(name: &str) -> (Flight, Commander) {
    let mut flight = Flight::new(name, Manner::Answers);
    let mut commander = Commander::new(&flight.bus);
    flight.until("an answer", |vehicle| vehicle.link == 1);
    let vehicle = &flight.vehicle;
    commander.until("motors", stick(0.1), || vehicle.log().motors_run.then_some(()));
    commander.until("a command on the wire", stick(0.1), || {
        vehicle.log().orders.last().filter(|order| order.thrust > 0).map(drop)
    });
    (flight, commander)
}

#[test]
fn a_flight_leaves_nothing_in_shared_memory_whatever_is_dropped_first() {
    let (flight, commander) = airborne("remains");
    let Flight { testbed, bus, said, bridge, vehicle } = flight;
    bridge.signal(Signal::TERM);
    assert!(bridge.wait().status.success());
    drop((bus, commander));
    assert!(!testbed.remains().is_empty());
    drop(said);
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
    drop(vehicle);
}

/// The independent reader, told `words`: by the interpreter of `OQTAL_PEERS_PYTHON`, which must then be there, or by any.
fn independent_reader(words: &[&str]) -> Option<Child> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/peers/asctec_reader.py");
    let named = std::env::var_os("OQTAL_PEERS_PYTHON");
    let mut reader = Command::new(named.as_deref().unwrap_or("python3".as_ref()));
    reader.arg(script).args(words).stdin(Stdio::piped()).stdout(Stdio::piped());
    match reader.spawn() {
        Ok(reader) => Some(reader),
        Err(error) => {
            assert!(named.is_none(), "OQTAL_PEERS_PYTHON names no interpreter: {error}");
            eprintln!("skipped: there is no python3 to read the frames with");
            None
        }
    }
}

#[test]
fn an_independent_reader_sees_in_a_flight_what_was_ordered_and_nothing_invalid() {
    let Some(mut reader) = independent_reader(&["-"]) else { return };
    let (flight, mut commander) = airborne("flown-reader");
    let vehicle = &flight.vehicle;
    let mut count = 0;
    for stick in [0.3, -0.7, 1.0] {
        count += 40;
        commander.until("flight", self::stick(stick), || {
            (vehicle.log().orders.iter().filter(|order| order.thrust > 0).count() > count)
                .then_some(())
        });
    }
    let log = flight.vehicle.log();
    assert_eq!((log.damaged, log.skipped), (0, 0));
    reader.stdin.take().unwrap().write_all(&log.bytes).unwrap();
    let output = reader.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let seen: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let fields = |order: &ControlInput| {
        serde_json::json!([order.pitch, order.roll, order.yaw, order.thrust, order.enabled])
    };
    let orders: Vec<_> = log.orders.iter().map(fields).collect();
    assert_eq!(seen["fields"], serde_json::Value::from(orders));
    assert_eq!((&seen["invalid"], &seen["strange_bytes"]), (&0.into(), &0.into()));
    assert_eq!((&seen["polls"], &seen["stops"]), (&log.polls.into(), &0.into()));
}

#[test]
fn an_independent_reader_sees_valid_neutral_frames_at_sixty_hertz_without_a_daemon_or_an_answer() {
    let testbed = Testbed::new("reader");
    let link = testbed.path("port");
    let Some(mut reader) = independent_reader(&[link.to_str().unwrap(), "300"]) else { return };
    let mut lines = BufReader::new(reader.stdout.take().unwrap()).lines();
    assert_eq!(lines.next().unwrap().unwrap(), "ready");
    let _bridge =
        testbed.start(&["bridge", "run", "--link", &format!("asctec:{}", link.display())]);
    let seen: serde_json::Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
    assert!(reader.wait().unwrap().success());
    assert_eq!(seen["invalid"], 0, "{seen}");
    assert_eq!(seen["strange_bytes"], 0, "{seen}");
    assert_eq!(seen["neutral"], 300, "{seen}");
    assert_eq!(seen["stops"], 0, "{seen}");
    // 8 polls a second on 60 frames: 40 on 300.
    assert!((35..=45).contains(&seen["polls"].as_u64().unwrap()), "{seen}");
    let gap = seen["median_gap_ms"].as_f64().unwrap();
    assert!((gap - 16.667).abs() < 1.0, "{seen}");
}

#[test]
fn a_vehicle_that_answers_is_heard_and_one_that_falls_silent_is_missed() {
    let mut flight = Flight::new("silence", Manner::Answers);
    let heard = flight.until("an answer", |vehicle| vehicle.link == 1);
    assert!((heard.air_ns, heard.armed, heard.starting) == (17_000_000, 0, 0), "{heard:?}");
    let settled = flight.until("quality", |v| v.link_quality > 0.9 && v.battery_v > 0.0);
    assert!((settled.battery_v - 11.1).abs() < 1e-3);
    // 17 bytes of ten bits at 57600 baud; a frame may wait for a poll before it.
    assert!((2_900_000..5_000_000).contains(&settled.wire_ns), "{settled:?}");
    flight.vehicle.be(Manner::Silent);
    let missed = flight.until("silence", |vehicle| vehicle.link == 0);
    assert!(missed.link_quality < 0.1, "{missed:?}");
    let status = flight.testbed.oqtal(&["ctl", "status"]).output().unwrap();
    assert_eq!(status.status.code(), Some(75), "no daemon runs");
    flight.vehicle.be(Manner::Answers);
    flight.until("an answer again", |vehicle| vehicle.link == 1);
}

#[test]
fn f20_noise_in_place_of_telemetry_is_never_an_answer_and_frames_go_on() {
    let mut flight = Flight::new("noise", Manner::Babbles);
    let orders = flight.orders(240);
    assert!(orders.iter().all(is_neutral));
    for _ in 0..100 {
        let (_, vehicle) = flight.next();
        assert_eq!((vehicle.link, vehicle.armed), (0, 0), "{vehicle:?}");
    }
    flight.bridge.signal(Signal::TERM);
    assert!(flight.bridge.wait().status.success());
}

#[test]
fn motors_are_started_and_stopped_and_commands_flow_in_between() {
    let (mut flight, mut commander) = airborne("motors");
    let running = flight.until("motors", |vehicle| vehicle.armed == 1);
    assert_eq!(running.starting, 0);
    let wanted = commander.send(stick(0.2), Time::now());
    let (header, applied) = wait_for("a command applied", || {
        flight.said.receive().unwrap().filter(|(_, v)| v.command_sequence >= wanted)
    });
    assert!(header.stamps.applied_at >= header.stamps.received_at);
    assert!(header.stamps.received_at >= header.stamps.command_published_at);
    assert!(applied.wire_ns >= 2_900_000);
    let vehicle = &flight.vehicle;
    vehicle.forget();
    commander.until("motors to stop", CommandV1::default(), || {
        (!vehicle.log().motors_run).then_some(())
    });
    let orders = vehicle.log().orders;
    let rest = orders.iter().skip_while(|order| !is_neutral(order)).take_while(|o| is_neutral(o));
    assert!(rest.count() > 60, "neutral for a while before the switch");
    assert_eq!(vehicle.log().emergency_stops, 0);
}

#[test]
fn f14_after_the_last_command_at_most_four_frames_are_not_neutral() {
    let (flight, commander) = airborne("last-command");
    flight.vehicle.forget();
    drop(commander);
    let orders = wait_for("orders", || {
        let orders = flight.vehicle.log().orders;
        (orders.len() > 180).then_some(orders)
    });
    assert_few_then_neutral(&orders);
}

fn assert_few_then_neutral(orders: &[ControlInput]) {
    let others = orders.iter().filter(|order| !is_neutral(order)).count();
    assert!(others <= 4, "{others} frames were not neutral");
    assert!(orders[4..].iter().all(is_neutral));
}

#[test]
fn a_command_that_is_old_when_it_arrives_is_never_sent() {
    let (flight, mut commander) = airborne("old");
    std::thread::sleep(4 * PERIOD);
    let orders = flight.orders(10);
    assert!(orders[4..].iter().all(is_neutral));
    flight.vehicle.forget();
    for _ in 0..20 {
        commander.send(stick(0.9), Time::now() - Span::from_millis(51));
        commander.send(stick(0.9), Time::now() + Span::from_millis(500));
        std::thread::sleep(PERIOD);
    }
    assert!(flight.vehicle.log().orders.iter().all(is_neutral));
}

/// Poses of a vehicle that stands, as motion capture would give them.
fn show_poses(bus: &Bus, stop: &std::sync::atomic::AtomicBool) {
    let mut poses = bus.writer(&POSE).unwrap();
    let mut frame = 0;
    while !stop.load(std::sync::atomic::Ordering::Acquire) {
        frame += 1;
        let now = Time::now();
        let position = [1e-6 * (frame % 7) as f64, 0.0, 0.0];
        let pose =
            PoseV1 { position, attitude: [0.0, 0.0, 0.0, 1.0], tracked: 1, ..PoseV1::default() };
        let stamps = Stamps { captured_at: now, pose_published_at: now, ..Stamps::default() };
        poses.send(frame, stamps, pose).unwrap();
        poses.notify().unwrap();
        std::thread::sleep(PERIOD);
    }
}

/// A real daemon that flies is given `blow`: the bridge must go neutral by itself.
fn daemon_falls(name: &str, blow: Signal) {
    let mut flight = Flight::new(name, Manner::Answers);
    flight.until("an answer", |vehicle| vehicle.link == 1);
    let stop = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|threads| {
        let testbed = &flight.testbed;
        threads.spawn(|| show_poses(&testbed.bus(), &stop));
        let daemon = testbed.start(&["daemon", "run"]);
        wait_for("the daemon to arm", || {
            testbed.oqtal(&["ctl", "arm"]).output().unwrap().status.success().then_some(())
        });
        wait_for("thrust on the wire", || {
            flight.vehicle.log().orders.last().filter(|order| order.thrust > 0).map(drop)
        });
        signal(daemon.id(), blow);
        flight.vehicle.forget();
        let orders = wait_for("orders", || {
            let orders = flight.vehicle.log().orders;
            (orders.len() > 150).then_some(orders)
        });
        stop.store(true, std::sync::atomic::Ordering::Release);
        assert_few_then_neutral(&orders);
    });
}

#[test]
fn f14_a_killed_daemon_is_followed_by_neutral() {
    daemon_falls("killed", Signal::KILL);
}

#[test]
fn f15_a_stopped_daemon_is_followed_by_neutral() {
    daemon_falls("stopped", Signal::STOP);
}

#[test]
fn f19_a_port_that_comes_back_is_found_and_neutral_comes_first() {
    let (mut flight, mut commander) = airborne("unplugged");
    let port = flight.testbed.path("port");
    let log = std::mem::replace(
        &mut flight.vehicle,
        Vehicle::new(&flight.testbed.path("spare"), Manner::Answers),
    )
    .unplug();
    assert_eq!(log.damaged, 0);
    flight.until("the loss", |vehicle| vehicle.link == 0);
    flight.vehicle = Vehicle::new(&port, Manner::Answers);
    let vehicle = &flight.vehicle;
    // The daemon never stopped wanting to fly: nothing but neutral until it does.
    let orders = commander.until("frames after the loss", stick(0.5), || {
        let orders = vehicle.log().orders;
        (orders.len() > 90).then_some(orders)
    });
    assert!(orders.iter().all(is_neutral));
    let mut count = 0;
    commander.until("calm", CommandV1::default(), || {
        count += 1;
        (count > 10).then_some(())
    });
    commander.until("motors", stick(0.1), || vehicle.log().motors_run.then_some(()));
}

#[test]
fn f33_asked_to_end_the_bridge_says_neutral_and_stops_motors_that_run() {
    let (flight, mut commander) = airborne("term");
    let Flight { vehicle, bridge, .. } = flight;
    commander.until("some flight", stick(0.1), || (vehicle.log().orders.len() > 30).then_some(()));
    commander.send(stick(0.1), Time::now());
    bridge.signal(Signal::TERM);
    let output = bridge.wait();
    assert!(output.status.success(), "{}", stderr(&output));
    let log =
        wait_for("the last words", || Some(vehicle.log()).filter(|log| log.emergency_stops > 0));
    let last = log.orders.iter().rev().take_while(|order| is_neutral(order)).count();
    assert!((3..=4).contains(&last), "{last} neutral frames at last");
    assert!(!log.motors_run);
}

/// The bridge with these words must end by itself, with this code and these words.
fn refused(testbed: &Testbed, words: &[&str], code: i32, says: &[&str]) {
    let output = testbed.oqtal(&[&["bridge"], words].concat()).output().unwrap();
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{words:?}: {message}");
    for word in says {
        assert!(message.contains(word), "{words:?} says: {message}");
    }
}

#[test]
fn a_port_that_is_none_is_named_with_a_remedy() {
    let testbed = Testbed::new("ports");
    let file = testbed.write("file", "no port");
    refused(&testbed, &["run"], 78, &["bridge.link", "--link"]);
    refused(&testbed, &["run", "--link", "asctec:/dev/nowhere"], 71, &["/dev/nowhere", "plug"]);
    let link = format!("asctec:{}", file.display());
    refused(&testbed, &["run", "--link", &link], 71, &["not a serial port"]);
    refused(&testbed, &["run", "--link", "asctec:/"], 71, &["not a serial port"]);
    refused(&testbed, &["check", "--link", "boat:/dev/ttyS0"], 78, &["boat"]);
    let slow = ["check", "--link", "asctec:/dev/ttyS0,baud=9600"];
    refused(&testbed, &slow, 78, &["bridge.link", "9600"]);
    let virtual_time = ["check", "--link", "asctec:/dev/ttyS0", "--set", "clock.kind=lockstep"];
    refused(&testbed, &virtual_time, 64, &["clock"]);
    let bad = testbed.write("bad.toml", "[bridge]\n\nlink = \"boat:/dev/ttyS0\"\n");
    refused(&testbed, &["check", "--config", bad.to_str().unwrap()], 78, &["bad.toml:3: ", "boat"]);
}

#[test]
fn a_port_without_permission_says_so() {
    let testbed = Testbed::new("nobody");
    let vehicle = Vehicle::new(&testbed.path("port"), Manner::Answers);
    let device = testbed.path("port").canonicalize().unwrap();
    std::fs::set_permissions(&device, std::os::unix::fs::PermissionsExt::from_mode(0o000)).unwrap();
    let mut command =
        testbed.oqtal(&["bridge", "run", "--link", &format!("asctec:{}", device.display())]);
    if rustix::process::geteuid().is_root() {
        // Nothing is forbidden to root: somebody else tries, in a root of his own.
        use std::os::unix::process::CommandExt;
        let root = tempfile::tempdir().unwrap();
        std::os::unix::fs::chown(root.path(), Some(65534), Some(65534)).unwrap();
        command = Command::new(env!("CARGO_BIN_EXE_oqtal"));
        command.args(["bridge", "run", "--link", &format!("asctec:{}", device.display())]);
        command.args(["--instance", testbed.instance(), "--root"]).arg(root.path());
        command.current_dir("/").uid(65534).gid(65534);
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(77), "{}", stderr(&output));
        assert!(stderr(&output).contains("no permission for /dev/pts/"), "{}", stderr(&output));
    } else {
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(77), "{}", stderr(&output));
    }
    drop(vehicle);
}

#[test]
fn f25_a_second_bridge_is_refused_and_the_first_goes_on() {
    let flight = Flight::new("second-bridge", Manner::Answers);
    let link = flight.vehicle.link();
    refused(&flight.testbed, &["run", "--link", &link], 75, &["vehicle", "already has a writer"]);
    // Another instance knows nothing of the first but the port.
    let other = Testbed::new("other-bridge");
    refused(&other, &["run", "--link", &link], 75, &["used by another process"]);
    assert!(flight.orders(10).iter().all(is_neutral));
}
