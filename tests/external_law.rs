//! An external law in a process of its own: the examples in Python and C fly, and whatever becomes of the process, the vehicle lands.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use oqtal_bus::message::{ExternalV1, Field, FieldType, Message, StateV1};
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;
use serde_json::Value;

use crate::common::obedience::MotorWatch;
use crate::common::{Running, Testbed, json, number, skipped, stderr, wait_for};

const EXAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/external_law");
const SABOTEUR: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/external_law/saboteur.py");
/// A flight of 13 s.
const SHORT: [&str; 8] = [
    "--trajectory",
    "hover",
    "--duration",
    "6",
    "--set",
    "trajectory.settle-s=1",
    "--controller",
    "external",
];

/// The fields of a structure of the C header after `magic`: element type, name, number of elements.
fn fields_of(structure: &str) -> Vec<(String, String, usize)> {
    let header = std::fs::read_to_string(Path::new(EXAMPLES).join("oqtal_law.h")).unwrap();
    let body = header.split(&format!("struct {structure} {{")).nth(1).unwrap();
    let lines = body.split('}').next().unwrap().lines().filter_map(|line| line.split_once(';'));
    let fields = lines.map(|(declaration, _)| {
        let (kind, name) = declaration.trim().split_once(' ').unwrap();
        let (name, length) = name.split_once('[').unwrap_or((name, "1]"));
        let length = length.trim_end_matches(']').parse().unwrap();
        (kind.to_owned(), name.to_owned(), length)
    });
    fields.skip(1).collect()
}

fn described(fields: &[Field]) -> Vec<(String, String, usize)> {
    let kind = |element| match element {
        FieldType::F64 => "double",
        FieldType::U64 | FieldType::Time => "uint64_t",
        _ => "?",
    };
    let described = fields.iter().map(|field| (kind(field.element), field.name, field.length));
    described.map(|(kind, name, length)| (kind.to_owned(), name.to_owned(), length)).collect()
}

#[test]
fn the_structures_of_the_c_header_are_the_messages() {
    assert_eq!(fields_of("oqtal_state"), described(StateV1::FIELDS));
    let answer = fields_of("oqtal_answer");
    assert_eq!(answer, described(&ExternalV1::FIELDS[..answer.len()]));
    assert_eq!(answer.last().unwrap().1, "thrust");
}

/// The script, once the socket of its instance exists; `None` without Python.
fn script(testbed: &Testbed) -> Option<Command> {
    if Command::new("python3").arg("--version").output().is_err() {
        skipped("there is no python3");
        return None;
    }
    let mut command = Command::new("python3");
    command.arg(Path::new(EXAMPLES).join("pd.py")).arg(socket(testbed));
    Some(command)
}

fn socket(testbed: &Testbed) -> PathBuf {
    testbed.paths().law()
}

/// Flies with the process of `law`, which connects as soon as the daemon listens; returns summary and output of the law.
fn flown(testbed: &Testbed, words: &[&str], law: &mut Command) -> (Value, String) {
    let flight = testbed.start(&[&["fly", "--json"], words].concat());
    wait_for("the socket", || socket(testbed).exists().then_some(()));
    // Its connection ends with the flight. In lockstep a law that ended early would block the flight.
    let told = Running::start(law).wait();
    if !told.status.success() {
        flight.signal(Signal::INT);
    }
    let output = flight.wait();
    assert!(told.status.success(), "{}", stderr(&told));
    assert!(output.status.success(), "{}", stderr(&output));
    (json(&output), String::from_utf8_lossy(&told.stdout).into_owned() + &stderr(&told))
}

fn handovers(summary: &Value) -> &Value {
    &summary["handovers"]
}

#[test]
fn the_scripts_in_python_and_c_fly_the_square_in_lockstep_with_the_same_bits_each_time() {
    let square = ["--clock", "lockstep", "--seed", "7", "--controller", "external"];
    let once = |law: Option<Command>, testbed: &Testbed| {
        let (summary, told) = flown(testbed, &square, &mut law?);
        assert_eq!(summary["outcome"], "landed", "{told}");
        assert_eq!(handovers(&summary)["count"], 0, "{summary:#}");
        assert_eq!(handovers(&summary)["fallback_ticks"], 0);
        let error_m = number(&summary, "/position_error_m/mean");
        println!("lockstep: {error_m:.3} m; {told}");
        assert!(error_m < 0.3, "{error_m} m");
        Some(summary["trajectory_hash"].as_str().unwrap().to_owned())
    };
    let hashes = ["law-a", "law-b"].map(Testbed::new).map(|it| once(script(&it), &it));
    assert_eq!(hashes[0], hashes[1]);
    let testbed = Testbed::new("law-c");
    let program = testbed.path("pd");
    let mut compiler = Command::new("cc");
    compiler.args(["-std=gnu99", "-O2", "-Wall", "-Wextra", "-Werror", "-o"]).arg(&program);
    compiler.arg(Path::new(EXAMPLES).join("pd.c")).arg("-lm");
    match compiler.output() {
        Err(_) => skipped("there is no C compiler `cc`"),
        Ok(output) => {
            assert!(output.status.success(), "{}", stderr(&output));
            let mut law = Command::new(program);
            law.arg(socket(&testbed));
            once(Some(law), &testbed);
        }
    }
}

#[test]
fn a_recording_with_an_external_law_replays_bit_for_bit_without_it() {
    let testbed = Testbed::new("law-replay");
    let Some(mut law) = script(&testbed) else { return };
    let words = [&SHORT[..], &["--clock", "lockstep", "--out", "flown"]].concat();
    let (summary, _) = flown(&testbed, &words, &mut law);
    assert_eq!(summary["outcome"], "landed");
    let recording = testbed.path("flown/flight.mcap").display().to_string();
    testbed.succeeds(&["replay", &recording]);
}

/// Fate of a law in flight.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fate {
    Lives,
    Killed,
    Stopped,
    /// It fails in its own process, from a random instant on: a failure of `saboteur.py`.
    Fails(&'static str),
}

/// Failures of `saboteur.py`, each with whether the fallback law must take over.
const FAILURES: [(&str, bool); 9] = [
    ("raises", true),
    ("sleeps", true),
    ("not-a-number", true),
    ("wrong-sign", false),
    ("full-stick", true),
    ("diverging-gain", false),
    ("constant-bias", false),
    ("last-question", true),
    ("answers-twice", false),
];

/// Flies in real time; the law's process meets its fate two seconds into the hover, or fails at an instant drawn from `seed`.
fn in_real_time(fate: Fate, seed: u32) {
    let testbed = Testbed::new("law-real");
    let Some(mut law) = script(&testbed) else { return };
    if let Fate::Fails(failure) = fate {
        law = Command::new("python3");
        law.arg(SABOTEUR).arg(EXAMPLES).arg(socket(&testbed)).args([failure, &seed.to_string()]);
    }
    let flight = testbed.start(&[&["fly", "--json"], &SHORT[..]].concat());
    wait_for("the socket", || socket(&testbed).exists().then_some(()));
    let law = Running::start(law.stdin(Stdio::null()));
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    wait_for("the hover", || {
        let (_, tick) = telemetry.latest().unwrap()?;
        (tick.mission_s > 5.0).then_some(())
    });
    match fate {
        Fate::Lives | Fate::Fails(_) => {}
        Fate::Killed => law.signal(Signal::KILL),
        Fate::Stopped => law.signal(Signal::STOP),
    }
    let output = flight.wait();
    // A vehicle that a failing law has driven from its reference is landed by the daemon.
    let ends_early = matches!(fate, Fate::Fails(_)) && output.status.code() == Some(1);
    assert!(output.status.success() || ends_early, "{fate:?}: {}", stderr(&output));
    let summary = json(&output);
    println!("{fate:?} {seed}: {}", handovers(&summary));
    let is_told = |cause| handovers(&summary)["causes"][cause].as_u64() >= Some(1);
    match fate {
        // One that is killed while it computes has not answered in time, and is not connected afterwards.
        Fate::Killed => assert!(
            is_told("the law ended")
                || is_told("no answer in time") && number(&summary, "/answers/unconnected") > 60.0,
            "{summary:#}"
        ),
        Fate::Stopped => assert!(is_told("no answer in time"), "{summary:#}"),
        Fate::Lives | Fate::Fails(_) => {}
    }
    if FAILURES.iter().any(|(failure, taken_over)| *taken_over && fate == Fate::Fails(failure)) {
        assert!(number(&summary, "/handovers/count") >= 1.0, "{fate:?}: {summary:#}");
    }
    assert_eq!(summary["outcome"], "landed", "{fate:?}");
}

#[test]
fn f70_a_stop_does_not_wait_for_a_law_that_hangs() {
    let testbed = Testbed::new("law-stop");
    let Some(mut law) = script(&testbed) else { return };
    let flight = testbed.start(&[&["fly"], &SHORT[..]].concat());
    wait_for("the socket", || socket(&testbed).exists().then_some(()));
    let law = Running::start(law.stdin(Stdio::null()));
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    wait_for("the hover", || telemetry.latest().unwrap().filter(|(_, tick)| tick.mission_s > 4.0));
    let mut motors = MotorWatch::open(&bus);
    law.signal(Signal::STOP);
    motors.obeys(|| {
        let stopped = testbed.oqtal(&["ctl", "stop", "--json"]).output().unwrap();
        assert_eq!(json(&stopped)["motors_off"], true, "{}", stderr(&stopped));
    });
    assert_eq!(flight.wait().status.code(), Some(1));
}

#[test]
fn f70_a_process_that_fails_in_flight_does_not_cost_the_vehicle() {
    in_real_time(Fate::Killed, 0);
    in_real_time(Fate::Stopped, 0);
    in_real_time(Fate::Fails("last-question"), 0);
    let runs = std::env::var("OQTAL_TEST_LAW_RUNS").ok().and_then(|text| text.parse().ok());
    for seed in 0..runs.unwrap_or(0) {
        let failures = FAILURES.map(|(failure, _)| Fate::Fails(failure));
        for fate in [Fate::Lives, Fate::Killed, Fate::Stopped].into_iter().chain(failures) {
            in_real_time(fate, seed);
        }
    }
}
