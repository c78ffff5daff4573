//! An operator's stop that bypasses a daemon unable to execute it: real processes, real signals.

use crate::common::obedience::MotorWatch;
use crate::common::{Running, Testbed, assert_refused, json, signal, state_of, stderr, wait_for};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Actuation, Cause, Mode, SafetyState};
use oqtal_bus::message::{CommandV1, Stamps, VehicleV1};
use oqtal_bus::port::Reader;
use oqtal_bus::time::Time;
use oqtal_bus::topic::{COMMAND, Role, TELEMETRY, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use rustix::process::Signal;
use serde_json::Value;

/// Runs `oqtal ctl stop --json`; returns its exit code and its output.
fn stop(testbed: &Testbed) -> (Option<i32>, Value, String) {
    let output = testbed.oqtal(&["ctl", "stop", "--json"]).output().unwrap();
    let answer = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code(), answer, stderr(&output))
}

/// Starts the three processes, arms, and waits until the vehicle is in the air.
fn airborne(testbed: &Testbed, bus: &Bus) -> [Running; 3] {
    let processes = testbed.services();
    testbed.take_off(bus);
    processes
}

fn until(vehicles: &mut Reader<VehicleV1>, what: &str, holds: impl Fn(&VehicleV1) -> bool) {
    wait_for(what, || vehicles.receive().unwrap().filter(|(_, vehicle)| holds(vehicle)));
}

#[test]
fn f15_a_stop_bypasses_a_stopped_daemon_and_is_latched_when_it_continues() {
    let testbed = Testbed::new("stop-past");
    let bus = testbed.bus();
    let [_plant, _cameras, daemon] = airborne(&testbed, &bus);
    let mut vehicles = bus.observer(&VEHICLE).unwrap();
    let mut motors = MotorWatch::open(&bus);
    let mut result = None;
    motors.obeys(|| {
        daemon.signal(Signal::STOP);
        result = Some(stop(&testbed));
    });
    let (code, answer, message) = result.unwrap();
    assert_eq!(code, Some(0), "{message}");
    assert_eq!(answer["motors_off"], true);
    assert_eq!(answer["daemon_obeys"], false);
    assert!(answer.get("arm_again").is_none(), "{answer}");
    let told = String::from_utf8(testbed.oqtal(&["ctl", "stop"]).output().unwrap().stdout).unwrap();
    let remedy = format!(
        "\nto fly again: the daemon does not answer; continue it with `kill -CONT {}`",
        daemon.id()
    );
    assert!(told.contains(&remedy), "{told}");
    until(&mut vehicles, "the stop", |vehicle| (vehicle.armed, vehicle.stopped) == (0, 1));
    daemon.signal(Signal::CONT);
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    wait_for("a latched stop", || {
        let (_, tick) = telemetry.receive().unwrap()?;
        let stopped = (Mode::Disarmed.code(), SafetyState::Stop.code(), Cause::Operator.code());
        ((tick.mode, tick.state, tick.cause) == stopped).then_some(())
    });
    until(&mut vehicles, "the end of the stop", |vehicle| vehicle.stopped == 0);
    wait_for("motors again", || {
        testbed.oqtal(&["ctl", "arm"]).output().unwrap();
        vehicles.latest().unwrap().filter(|(_, vehicle)| vehicle.armed == 1)
    });
    let (code, answer, message) = stop(&testbed);
    assert_eq!(code, Some(0), "{message}");
    assert_eq!(answer["daemon_obeys"], true);
}

#[test]
fn a_stop_outlasts_regular_restarts_until_an_arm() {
    let testbed = Testbed::new("stop-restarts");
    let bus = testbed.bus();
    let (mut vehicles, mut telemetry) =
        (bus.observer(&VEHICLE).unwrap(), bus.observer(&TELEMETRY).unwrap());
    let start = |process| testbed.start(&[process, "run", "--set", "safety.arm-at-start=true"]);
    let [_plant, _cameras, mut daemon] = ["plant-sim", "mocap-emu", "daemon"].map(start);
    until(&mut vehicles, "a take-off by itself", |vehicle| vehicle.armed == 1);
    let (code, _, message) = stop(&testbed);
    assert_eq!(code, Some(0), "{message}");
    for reason in ["", "no take-off at start: the daemon before this one was stopped"] {
        daemon.signal(Signal::TERM);
        let output = daemon.wait();
        assert!(output.status.success() && stderr(&output).contains(reason), "{output:?}");
        let started = Time::now();
        daemon = start("daemon");
        wait_for("a daemon that could fly", || {
            let (_, tick) = telemetry.receive().unwrap().filter(|(_, it)| it.time > started)?;
            assert_eq!(tick.mode, Mode::Disarmed.code());
            (tick.obstacles == 0).then_some(())
        });
    }
    wait_for("a take-off by `arm`", || {
        testbed.oqtal(&["ctl", "arm"]).output().unwrap();
        vehicles.latest().unwrap().filter(|(_, vehicle)| vehicle.armed == 1)
    });
}

#[test]
fn no_command_published_after_a_stop_acts_although_the_daemon_continues_to_command() {
    let testbed = Testbed::new("stop-commands");
    let bus = testbed.bus();
    let mut vehicles = bus.observer(&VEHICLE).unwrap();
    let mut commands = bus.writer(&COMMAND).unwrap();
    let _plant = testbed.start(&["plant-sim", "run"]);
    let mut command = |actuation: Actuation| {
        let stamps = Stamps { command_published_at: Time::now(), ..Stamps::default() };
        let body = CommandV1 { actuation: actuation.code(), thrust: 0.3, ..CommandV1::default() };
        commands.send(1, stamps, body).unwrap();
        commands.notify().unwrap();
    };
    wait_for("motors", || {
        command(Actuation::Sticks);
        vehicles.latest().unwrap().filter(|(_, vehicle)| vehicle.armed == 1)
    });
    bus.stop_switch().unwrap().raise();
    let raised_at = Time::now();
    let mut seen = 0;
    wait_for("twenty reports", || {
        command(Actuation::Sticks);
        while let Some((header, vehicle)) = vehicles.receive().unwrap() {
            let is_later = header.stamps.command_published_at > raised_at;
            assert!(!(is_later && vehicle.armed == 1), "{header:?}");
            seen += u32::from(is_later && vehicle.stopped == 1);
        }
        (seen >= 20).then_some(())
    });
    wait_for("the end of the stop", || {
        command(Actuation::Disarmed);
        vehicles.latest().unwrap().filter(|(_, vehicle)| vehicle.stopped == 0)
    });
    wait_for("motors again", || {
        command(Actuation::Sticks);
        vehicles.latest().unwrap().filter(|(_, vehicle)| vehicle.armed == 1)
    });
}

#[test]
fn a_stop_without_a_vehicle_is_reported_and_waits_for_it() {
    let testbed = Testbed::new("stop-nobody");
    let (code, _, message) = stop(&testbed);
    assert_eq!(code, Some(75));
    assert!(message.contains("nothing to stop"), "{message}");
    let bus = testbed.bus();
    let _daemon = testbed.start(&["daemon", "run"]);
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    wait_for("ticks", || telemetry.latest().unwrap());
    let (code, answer, message) = stop(&testbed);
    assert_eq!(code, Some(75), "{message}");
    assert_eq!((&answer["vehicle_obeys"], &answer["daemon_obeys"]), (&false.into(), &true.into()));
    // A vehicle started later is stopped until the daemon's "disarmed" lifts the stop.
    let mut vehicles = bus.observer(&VEHICLE).unwrap();
    let _plant = testbed.start(&["plant-sim", "run"]);
    until(&mut vehicles, "the stop", |vehicle| vehicle.stopped == 1);
    until(&mut vehicles, "its end", |vehicle| (vehicle.armed, vehicle.stopped) == (0, 0));
}

#[test]
fn in_lockstep_a_stop_waits_for_virtual_time_to_advance() {
    let testbed = Testbed::new("stop-lockstep");
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let words = ["fly", "--clock", "lockstep", "--trajectory", "hover", "--duration", "600000"];
    let flight = testbed.start(&[&words[..], &["--json"]].concat());
    let daemon = wait_for("flight", || {
        let (header, tick) = telemetry.latest().unwrap()?;
        (tick.mode == Mode::Flying.code()).then_some(header.origin().process())
    });
    signal(daemon, Signal::STOP);
    // The daemon is suspended within its turn; the virtual time of the others ends there.
    wait_for("the stand-still", || (state_of(daemon) == Some('T')).then_some(()));
    let (code, _, message) = stop(&testbed);
    signal(daemon, Signal::CONT);
    assert_eq!(code, Some(75), "{message}");
    assert!(message.contains("virtual time stands still"), "{message}");
    let output = flight.wait();
    assert_eq!(json(&output)["outcome"], "stopped", "{}", stderr(&output));
}

#[test]
fn stop_and_land_need_no_valid_configuration() {
    let testbed = Testbed::new("stop-broken");
    let bus = testbed.bus();
    let mut health = bus.observer(&Role::Plant.health()).unwrap();
    let _plant = testbed.start(&["plant-sim", "run"]);
    wait_for("a vehicle", || health.latest().unwrap());
    let half = testbed.write("half.toml", "[vehicle]\nmass-kg = \n[safe").display().to_string();
    let broken = [
        (vec![], Some(("OQTAL_FOO", "1"))),
        (vec![], Some(("OQTAL_VEHICLE__MASS_KG", "banana"))),
        (vec!["--config", &half], None),
        (vec!["--config", "/nowhere.toml"], None),
        (vec!["--set", "vehicle.mass-kg=9", "--set", "nonsense"], None),
    ];
    for (words, variables) in broken {
        let run = |command: &str| {
            let mut command = testbed.oqtal(&[&["ctl", command], &words[..]].concat());
            let output = command.envs(variables).output().unwrap();
            (output.status.code(), stderr(&output))
        };
        let (code, message) = run("stop");
        assert_eq!(code, Some(0), "{words:?} {variables:?}: {message}");
        assert!(message.contains("warning: ") && message.contains(testbed.instance()), "{message}");
        // Every other command refuses an invalid configuration.
        assert_eq!(run("status").0, Some(78), "{words:?} {variables:?}");
    }
    let land = testbed.oqtal(&["ctl", "land", "--config", &half]).output().unwrap();
    assert_refused(&land, 75, &["no daemon answers", "its motors are off"]);
    for command in ["arm", "status"] {
        testbed.refuses(&["ctl", command], 75, &["no daemon answers", "its motors are off"]);
    }
    let (_, answer, message) = stop(&testbed);
    for (key, command) in
        [("start_again", "oqtal daemon run --inst"), ("arm_again", "oqtal ctl arm --inst")]
    {
        assert!(answer[key].as_str().unwrap().starts_with(command), "{answer}, {message}");
    }
}

#[test]
fn a_stop_of_a_flight_of_fly_is_recorded_and_names_the_command_that_flies_again() {
    let testbed = Testbed::new("stop-fly");
    let bus = testbed.bus();
    let flight = testbed.start(&["fly", "--trajectory", "hover", "--duration", "5"]);
    testbed.take_off(&bus);
    let (code, answer, message) = stop(&testbed);
    assert_eq!(code, Some(0), "{message}");
    let again = answer["arm_again"].as_str().unwrap();
    assert!(again.starts_with("oqtal fly --trajectory hover --duration 5"), "{again}");
    let output = flight.wait();
    assert_eq!(output.status.code(), Some(1));
    let figures = String::from_utf8_lossy(&output.stdout);
    assert!(figures.contains("operator: stop"), "{figures}");
}

#[test]
fn answers_to_an_operator_state_the_result_and_arming_is_allowed_while_the_vehicle_falls() {
    let testbed = Testbed::new("stop-answers");
    let bus = testbed.bus();
    let _processes = airborne(&testbed, &bus);
    let ctl = |command: &str| {
        let output = testbed.oqtal(&["ctl", command]).output().unwrap();
        (
            output.status.code(),
            String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(&output),
        )
    };
    let (code, said) = ctl("disarm");
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("`oqtal ctl land ") && said.contains(" ends a flight"), "{said}");
    let (code, said) = ctl("stop");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.starts_with("stopped: motors off"), "{said}");
    // The vehicle falls from its height; arming waits for the end of the fall.
    let (code, said) = ctl("arm");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("armed, the flight has begun; flying"), "{said}");
    assert!(said.contains("waits until the vehicle is at rest"), "{said}");
    let (code, said) = ctl("land");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.starts_with("landing where it is"), "{said}");
}
