//! Interrupts of `oqtal fly` before its take-off, and landings that are confirmed late.

use std::process::Stdio;
use std::time::Duration;

use crate::common::{Running, Testbed, assert_refused, children, signal, stderr, wait_for};
use oqtal_bus::message::TruthV1;
use oqtal_bus::port::Reader;
use oqtal_bus::topic::TRUTH;
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;

/// Height that a vehicle without thrust never reaches \[m\].
const ON_FLOOR_M: f64 = 0.05;

/// A flight that an interrupt ends, or else nobody within the time-out of a test.
const LONG: [&str; 6] = ["--trajectory", "hover", "--duration", "600", "--out", "d"];

/// Waits for the end of `flight`, and returns the greatest height until then \[m\].
fn highest_m(truths: &mut Reader<TruthV1>, flight: &mut Running) -> f64 {
    let mut highest_m = 0.0_f64;
    wait_for("the end of the flight", || {
        while let Some((_, truth)) = truths.receive().unwrap() {
            highest_m = highest_m.max(truth.position[2]);
        }
        (!flight.runs()).then_some(())
    });
    highest_m
}

/// Interrupts a flight with `words` after `delay` from the moment at which `file` is in its directory; it must end without a
/// take-off, or, if it had taken off by then, land.
#[track_caller]
fn interrupt(words: &[&str], file: &str, delay: Duration, kind: Signal) {
    let testbed = Testbed::new("early");
    let bus = testbed.bus();
    let mut truths = bus.observer(&TRUTH).unwrap();
    let mut flight = testbed.start(&[&["fly"], &LONG[..], words].concat());
    let awaited = testbed.path("d").join(file);
    wait_for(file, || (awaited.exists() || !flight.runs()).then_some(()));
    std::thread::sleep(delay);
    flight.signal(kind);
    let highest_m = highest_m(&mut truths, &mut flight);
    let output = flight.wait();
    let message = stderr(&output);
    if message.contains("interrupted before the take-off") {
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(highest_m < ON_FLOOR_M, "{words:?} {delay:?}: {highest_m} m");
    } else {
        assert!(message.contains("landing; Ctrl-C"), "{words:?} {delay:?}: {message}");
    }
    drop((truths, bus));
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
}

#[test]
fn an_interrupt_at_any_moment_of_the_start_ends_the_flight() {
    for (number, millis) in (0..12).map(|number| (number, 40 * number)) {
        let kind = if number % 2 == 0 { Signal::INT } else { Signal::TERM };
        interrupt(&[], "plant-sim.log", Duration::from_millis(millis), kind);
    }
}

/// Whatever the answer to `command`, `ctl land` or `stop` at an instant of the start, it is what happens.
#[track_caller]
fn answer_is_true(command: &str, delay: Duration) {
    let testbed = Testbed::new("start-ctl");
    let bus = testbed.bus();
    let mut truths = bus.observer(&TRUTH).unwrap();
    let mut flight = testbed.start(&[&["fly"], &LONG[..]].concat());
    let awaited = testbed.path("d/plant-sim.log");
    wait_for("a start", || awaited.exists().then_some(()));
    std::thread::sleep(delay);
    let answer = testbed.oqtal(&["ctl", command]).output().unwrap();
    let said = String::from_utf8_lossy(&answer.stdout).into_owned() + &stderr(&answer);
    let is_called_off = said.starts_with("the flight is called off");
    match answer.status.code() {
        Some(0) => {
            let known = ["the flight is called off", "landing", "stopped"];
            assert!(known.iter().any(|text| said.starts_with(text)), "{command} {delay:?}: {said}");
        }
        // Nobody was asked, and the flight begins.
        Some(75) if said.contains("a flight that begins from now on is not") => {
            flight.signal(Signal::INT)
        }
        // Requested, and obeyed later.
        Some(1) if said.contains("requested by signal") || command == "stop" => {}
        Some(75) if said.contains("stays raised until it is obeyed") => {}
        code => panic!("{command} {delay:?}: {code:?}: {said}"),
    }
    let highest_m = highest_m(&mut truths, &mut flight);
    let output = flight.wait();
    let message = stderr(&output);
    if is_called_off {
        assert!(highest_m < ON_FLOOR_M, "{delay:?}: {said}, but {highest_m} m");
        assert_eq!(output.status.code(), Some(1), "{message}");
        let reason = "called off before the take-off: an operator asked to land";
        assert!(message.contains(reason), "{delay:?}: {message}");
    }
    if said.starts_with("stopped") {
        assert!(message.contains("operator"), "{delay:?}: {message}");
    }
}

#[test]
fn an_operators_answer_is_true_at_any_moment_of_the_start() {
    for millis in (0..8).map(|number| 50 * number) {
        for command in ["land", "stop"] {
            answer_is_true(command, Duration::from_millis(millis));
        }
    }
}

/// The processes are started one after another: each log marks a stage.
#[test]
fn an_interrupt_between_two_processes_starts_no_other() {
    for file in ["plant-sim.log", "mocap-emu.log", "receiver.log", "daemon.log"] {
        interrupt(&["--mocap", "qtm"], file, Duration::ZERO, Signal::INT);
    }
    for file in ["plant-sim.log", "mocap-emu.log", "bridge.log", "daemon.log"] {
        interrupt(&["--vehicle", "bridge:asctec"], file, Duration::ZERO, Signal::INT);
    }
}

/// The daemon confirms the landing only after it was continued.
#[test]
fn a_landing_that_is_confirmed_late_is_waited_for() {
    let testbed = Testbed::new("late");
    let bus = testbed.bus();
    let mut truths = bus.observer(&TRUTH).unwrap();
    let said = testbed.path("said");
    let mut command = testbed.oqtal(&[&["fly"], &LONG[..]].concat());
    let file = std::fs::File::create(&said).unwrap();
    let flight = Running::start_with_stderr(&mut command, Stdio::from(file));
    wait_for("take-off", || truths.latest().unwrap().filter(|(_, t)| t.position[2] > 0.3));
    let name = |pid: u32| std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap();
    let processes = children(flight.id());
    let daemon = *processes.iter().find(|pid| name(**pid).contains("\0daemon\0")).unwrap();
    signal(daemon, Signal::STOP);
    flight.signal(Signal::INT);
    let said = || std::fs::read_to_string(&said).unwrap();
    wait_for("the wait", || {
        said().contains("waits up to 10 s until the daemon confirms").then_some(())
    });
    assert_eq!(children(flight.id()).len(), processes.len(), "processes ended before");
    signal(daemon, Signal::CONT);
    let output = flight.wait();
    assert!(!said().contains("has not confirmed"), "{}", said());
    assert!(output.status.code().is_some());
}

#[test]
fn a_flight_that_an_interrupt_or_a_refusal_ended_is_not_the_latest() {
    let testbed = Testbed::new("latest");
    let brief = ["--duration", "1", "--set", "trajectory.settle-s=0.5", "--trajectory", "hover"];
    let fly = |words: &[&str]| testbed.fly(&[&brief[..], words].concat());
    let recorded = ["--clock", "in-process", "--set", "record.flights=all"];
    assert!(fly(&recorded).status.success());
    // Refused: the vehicle is outside the fence of the daemon from the beginning.
    let refused = fly(&["--set", "safety.arming-z-m=[0.5,0.6]", "--clock", "lockstep"]);
    assert!(!refused.status.success());
    let flights = std::fs::read_dir(testbed.path("flights")).unwrap().count();
    assert_eq!(flights, 2, "{}", stderr(&refused));
    let mut info = testbed.study(&["info", "latest"]);
    let info = info.output().unwrap();
    assert!(info.status.success(), "{}", stderr(&info));
    let first = format!("flights/{}-1/flight.mcap", testbed.instance());
    let told = String::from_utf8(info.stdout).unwrap();
    assert!(told.contains(&first), "{told}");
    assert!(fly(&["--clock", "in-process"]).status.success());
    let output = testbed.study(&["info", "latest"]).output().unwrap();
    assert_refused(
        &output,
        64,
        &[&format!("flights/{}-3", testbed.instance()), "record.flights=all"],
    );
}
