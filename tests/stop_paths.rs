//! Stops and landings of a vehicle whose files were removed or whose control service cannot be reached: real processes.
//! OQTAL_TEST_LOST_STOPS sets the number of stops for each loss and pair of losses; the study also prints and bounds the times.

use std::fs::{self, File};
use std::path::PathBuf;
use std::process::Command;

use crate::common::obedience::LandingWatch;
use crate::common::random::length;
use crate::common::{Running, Testbed, assert_refused, json, stderr, wait_for};
use crate::one_name::{rootless, suspended};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Actuation, Answer, Cause, Mode, OperatorCommand};
use oqtal_bus::control::ControlClient;
use oqtal_bus::message::{CommandV1, ControlRequestV1, Stamps, VehicleV1};
use oqtal_bus::obeying::ObeyingProcess;
use oqtal_bus::port::{Reader, Writer};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, TELEMETRY, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_operator::{accepted, arm};
use rustix::fs::{FlockOperation, flock};

/// Loss of files of a running instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Loss {
    /// The stop words were removed.
    Stop,
    /// The stop words were replaced by a file of another size.
    StopReplaced,
    /// The stop words have another size.
    StopLonger,
    /// All shared memory was removed, as at the log-out of a user with `RemoveIPC=yes`.
    Memory,
    /// The root was removed.
    Root,
    /// The members were removed, and another process joined.
    Members,
}

const LOSSES: [Loss; 6] =
    [Loss::Stop, Loss::StopReplaced, Loss::StopLonger, Loss::Memory, Loss::Root, Loss::Members];

/// Stop words of the testbed; `None` after a loss of the link to them.
fn stop_words(testbed: &Testbed) -> Option<PathBuf> {
    let link = testbed.paths().directory().join("shared");
    fs::canonicalize(link).ok().map(|shared| shared.join("stop"))
}

impl Loss {
    /// Causes the loss. After another loss there may be nothing left to lose.
    fn strike(self, testbed: &Testbed) {
        let directory = testbed.paths().directory();
        match (self, stop_words(testbed)) {
            (Self::Stop, Some(words)) => drop(fs::remove_file(words)),
            (Self::StopReplaced, Some(words)) => {
                let _ = fs::remove_file(&words);
                let _ = fs::write(words, [0; 12]);
            }
            (Self::StopLonger, Some(words)) => {
                let _ = File::options().write(true).open(words).map(|file| file.set_len(64));
            }
            (Self::Memory, _) => {
                for name in testbed.remains() {
                    let path = PathBuf::from("/dev/shm").join(name);
                    let _ = fs::remove_file(&path).or_else(|_| fs::remove_dir_all(path));
                }
            }
            (Self::Root, _) => drop(fs::remove_dir_all(testbed.path("run"))),
            (Self::Members, _) => {
                let _ = fs::remove_file(directory.join("members"));
                drop(testbed.bus());
            }
            (_, None) => {}
        }
    }
}

/// `oqtal ctl stop --json`, with the root in every second `round`.
fn stop_command(testbed: &Testbed, round: u64) -> Command {
    match round % 2 {
        0 => rootless(testbed, &["stop", "--json"]),
        _ => testbed.oqtal(&["ctl", "stop", "--json"]),
    }
}

/// Waits for the stop that was requested at `asked_at`; in the study it must act within half a second.
fn acts(vehicles: &mut Reader<VehicleV1>, what: &str, asked_at: Time, mut meanwhile: impl FnMut()) {
    let stopped_at = wait_for(what, || {
        meanwhile();
        let (header, vehicle) = vehicles.receive().unwrap()?;
        (vehicle.armed == 0).then_some(header.stamps.received_at)
    });
    let took = stopped_at.since(asked_at);
    println!("{what}: {:.0} ms", took.seconds() * 1e3);
    assert!(length("OQTAL_TEST_LOST_STOPS", 0) == 0 || took < Span::from_millis(500), "{what}");
}

/// Daemon of the test, which commands thrust whatever is stopped: the process of the vehicle alone must stop.
struct BlindDaemon {
    commands: Writer<CommandV1>,
    vehicles: Reader<VehicleV1>,
}

impl BlindDaemon {
    fn open(bus: &Bus) -> Self {
        let commands = bus.writer(&COMMAND).unwrap();
        Self { commands, vehicles: bus.observer(&VEHICLE).unwrap() }
    }

    fn command(commands: &mut Writer<CommandV1>, actuation: Actuation) {
        let stamps = Stamps { command_published_at: Time::now(), ..Stamps::default() };
        let body = CommandV1 { actuation: actuation.code(), thrust: 0.3, ..CommandV1::default() };
        commands.send(1, stamps, body).unwrap();
        commands.notify().unwrap();
    }

    fn until(&mut self, what: &str, actuation: Actuation, holds: impl Fn(&VehicleV1) -> bool) {
        wait_for(what, || {
            Self::command(&mut self.commands, actuation);
            self.vehicles.latest().unwrap().filter(|(_, vehicle)| holds(vehicle))
        });
    }

    fn is_stopped(&mut self, what: &str, mut operator: Command) {
        self.until("motors", Actuation::Sticks, |vehicle| vehicle.armed == 1);
        let asked_at = Time::now();
        let operator = Running::start(&mut operator);
        let Self { commands, vehicles } = self;
        acts(vehicles, what, asked_at, || Self::command(commands, Actuation::Sticks));
        let output = operator.wait();
        assert_eq!(output.status.code(), Some(0), "{what}: {}", stderr(&output));
        assert_eq!(json(&output)["motors_off"], true, "{what}");
        self.until("the end of the stop", Actuation::Disarmed, |vehicle| vehicle.stopped == 0);
    }
}

#[test]
fn f68_the_process_of_a_vehicle_alone_stops_after_each_pair_of_losses() {
    let rounds = length("OQTAL_TEST_LOST_STOPS", 1);
    for (number, first) in LOSSES.into_iter().enumerate() {
        for second in &LOSSES[number..] {
            for round in 0..rounds {
                // The process of a vehicle leaves a lost instance once its motors are off.
                let testbed = Testbed::new("lost-pair");
                let bus = testbed.bus();
                let mut daemon = BlindDaemon::open(&bus);
                let _plant = testbed.start(&["plant-sim", "run"]);
                daemon.until("motors", Actuation::Sticks, |vehicle| vehicle.armed == 1);
                first.strike(&testbed);
                second.strike(&testbed);
                let what = format!("{first:?}, {second:?}, {round}");
                daemon.is_stopped(&what, stop_command(&testbed, round + number as u64));
            }
        }
    }
}

/// Flight of three processes; its ports were opened before any loss.
struct Laboratory {
    vehicles: Reader<VehicleV1>,
    client: ControlClient,
    _processes: [Running; 3],
}

impl Laboratory {
    fn start(testbed: &Testbed, bus: &Bus) -> Self {
        let (vehicles, client) = (bus.observer(&VEHICLE).unwrap(), bus.control_client().unwrap());
        let mut laboratory = Self { vehicles, client, _processes: testbed.services() };
        laboratory.arm();
        laboratory
    }

    fn arm(&mut self) {
        wait_for("motors", || {
            let request = ControlRequestV1::of(OperatorCommand::Arm);
            self.client.ask(request, Span::from_millis(500)).unwrap();
            self.vehicles.latest().unwrap().filter(|(_, vehicle)| vehicle.armed == 1)
        });
    }

    fn is_stopped(&mut self, what: &str, mut operator: Command) {
        self.arm();
        let asked_at = Time::now();
        let output = operator.output().unwrap();
        acts(&mut self.vehicles, what, asked_at, || {});
        assert_eq!(output.status.code(), Some(0), "{what}: {}", stderr(&output));
        let answer = json(&output);
        assert_eq!((&answer["motors_off"], &answer["daemon_obeys"]), (&true.into(), &true.into()));
        assert_ne!(answer["mode"], "flying", "{what}: {answer}");
    }
}

#[test]
fn f68_a_flight_stops_after_each_loss_and_the_daemon_obeys() {
    let rounds = length("OQTAL_TEST_LOST_STOPS", 1);
    for (number, loss) in LOSSES.into_iter().enumerate() {
        for round in 0..rounds {
            let testbed = Testbed::new("lost-flight");
            let bus = testbed.bus();
            let mut laboratory = Laboratory::start(&testbed, &bus);
            loss.strike(&testbed);
            let operator = stop_command(&testbed, round + number as u64);
            laboratory.is_stopped(&format!("{loss:?}, {round}"), operator);
        }
    }
}

#[test]
fn only_the_addressed_instance_stops_and_others_are_listed() {
    let (testbed, other) = (Testbed::new("addressed"), Testbed::new("other"));
    let (bus, other_bus) = (testbed.bus(), other.bus());
    let (mut daemon, mut other_daemon) = (BlindDaemon::open(&bus), BlindDaemon::open(&other_bus));
    let _other_plant = other.start(&["plant-sim", "run"]);
    other_daemon.until("motors", Actuation::Sticks, |vehicle| vehicle.armed == 1);
    let nobody = rootless(&testbed, &["stop"]).output().unwrap();
    let listed = format!("instance `{}` in {}", other.instance(), other.path("run").display());
    assert_refused(&nobody, 75, &["nothing to stop", "searched: ", "/run/oqtal", &listed]);
    let _plant = testbed.start(&["plant-sim", "run"]);
    daemon.is_stopped("addressed", stop_command(&testbed, 0));
    // The same name under another root is addressed by name, and not by root.
    let elsewhere = other.path("elsewhere").display().to_string();
    let words = ["ctl", "stop", "--instance", other.instance(), "--root", &elsewhere];
    let nobody = testbed.study(&words).output().unwrap();
    assert_refused(&nobody, 75, &["does not run under", &elsewhere, &listed]);
    other_daemon.until("motors", Actuation::Sticks, |vehicle| vehicle.armed == 1);
    while let Some((_, vehicle)) = other_daemon.vehicles.receive().unwrap() {
        assert_eq!(vehicle.stopped, 0);
    }
}

#[test]
fn a_stop_is_not_confirmed_while_another_vehicle_of_that_name_cannot_be_read() {
    let testbed = Testbed::new("two-stops");
    let bus = testbed.bus();
    let mut daemon = BlindDaemon::open(&bus);
    let _plant = testbed.start(&["plant-sim", "run"]);
    daemon.until("motors", Actuation::Sticks, |vehicle| vehicle.armed == 1);
    let (_second, paths) = suspended(&testbed, "plant-sim");
    let words = fs::canonicalize(paths.directory().join("shared")).unwrap().join("stop");
    File::options().write(true).open(words).unwrap().set_len(0).unwrap();
    let output = rootless(&testbed, &["stop"]).output().unwrap();
    assert_refused(&output, 1, &["whether it has obeyed cannot be read"]);
}

#[test]
fn a_stop_calls_off_an_arming_that_waits_for_the_end_of_a_fall() {
    let testbed = Testbed::new("called-off");
    let bus = testbed.bus();
    let _processes = testbed.services();
    testbed.take_off(&bus);
    bus.stop_switch().unwrap().raise();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    wait_for("the stop", || {
        let (_, tick) = telemetry.latest().unwrap()?;
        (tick.mode == Mode::Disarmed.code()).then_some(())
    });
    let mut told = Vec::new();
    let mut tell = |text: &str| {
        told.push(text.to_owned());
        if text.contains("waits") {
            bus.stop_switch().unwrap().raise();
        }
    };
    let arming = ControlRequestV1::of(OperatorCommand::Arm).by("test");
    let response = arm::ask(&bus, arming, None, &mut tell, &|| false).unwrap().unwrap();
    assert_eq!(response.answer, Answer::Refused.code());
    assert_eq!(response.cause, Cause::CalledOff.code(), "{told:?}");
    let failure = accepted(OperatorCommand::Arm, &response, None, &testbed.paths()).unwrap_err();
    assert!(failure.message.starts_with("arm refused: called off by a later stop"), "{failure}");
}

/// Number of clients of the control service in one instance \[-\].
const CLIENTS: usize = 8;

#[test]
fn f68_a_landing_passes_a_control_service_without_a_place_for_the_operator() {
    let testbed = Testbed::new("land-crowded");
    let bus = testbed.bus();
    let _processes = testbed.services();
    testbed.take_off(&bus);
    let mut landing = LandingWatch::open(&bus);
    let _crowd: Vec<_> = (0..CLIENTS).map_while(|_| bus.control_client().ok()).collect();
    let output = rootless(&testbed, &["land"]).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    landing.lands();
}

#[test]
fn f68_a_landing_passes_a_locked_and_a_removed_instance() {
    for is_locked in [true, false] {
        let testbed = Testbed::new("land-locked");
        let bus = testbed.bus();
        let _processes = testbed.services();
        testbed.take_off(&bus);
        let mut landing = LandingWatch::open(&bus);
        let directory = File::open(testbed.paths().directory()).unwrap();
        match is_locked {
            true => flock(&directory, FlockOperation::LockExclusive).unwrap(),
            false => Loss::Root.strike(&testbed),
        }
        let output = rootless(&testbed, &["land"]).output().unwrap();
        assert_refused(&output, 1, &["requested by signal", "the daemon, "]);
        landing.lands();
    }
}

#[test]
fn arming_fails_if_no_flight_follows() {
    let testbed = Testbed::new("arm-nothing");
    // Virtual time does not begin without the others.
    let _daemon = testbed.start(&["daemon", "run", "--set", "clock.kind=lockstep"]);
    let bus = testbed.bus();
    let client = bus.control_client().unwrap();
    wait_for("a daemon", || {
        let request = ControlRequestV1::of(OperatorCommand::Status);
        client.ask(request, Span::from_millis(500)).unwrap()
    });
    testbed.refuses(&["ctl", "arm"], 1, &["arm refused", "the flight did not begin"]);
}

/// A vehicle that waits for the lock of its instance has no stop words yet.
#[test]
fn a_stop_of_a_vehicle_that_starts_does_not_ask_for_another_user() {
    let testbed = Testbed::new("starting");
    let directory = testbed.paths().directory();
    fs::create_dir_all(&directory).unwrap();
    let lock = File::open(&directory).unwrap();
    flock(&lock, FlockOperation::LockExclusive).unwrap();
    let plant = testbed.start(&["plant-sim", "run"]);
    let is_found = || ObeyingProcess::all().iter().any(|process| process.pid == plant.id());
    wait_for("the plant", || is_found().then_some(()));
    let output = testbed.oqtal(&["ctl", "stop"]).output().unwrap();
    assert_refused(&output, 1, &["are not open yet", "repeat to know"]);
    assert!(!stderr(&output).contains("as root"), "{}", stderr(&output));
}
