//! Faults of processes: killed, stopped or started twice, and interrupts by an operator. Uses real processes and signals.

use crate::chaos::mission;
use crate::common::{
    Running, SERVICES, Testbed, assert_refused, is_alive, json, number, signal, stderr, wait_for,
};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::Mode;
use oqtal_bus::message::TelemetryV1;
use oqtal_bus::topic::{TELEMETRY, TRUTH};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_lab::simulation::fly;
use rustix::process::Signal;

const LONG: [&str; 5] = ["fly", "--trajectory", "hover", "--duration", "60"];

/// Starts a flight and waits until it is airborne; returns it with the process ids of its daemon and its plant.
fn airborne(testbed: &Testbed) -> (Running, Bus, u32, u32) {
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let mut truth = bus.observer(&TRUTH).unwrap();
    let flight = testbed.start(&[&LONG[..], &["--json"]].concat());
    let daemon = wait_for("take-off", || {
        let (header, telemetry) = telemetry.latest().unwrap()?;
        (telemetry.mode == Mode::Flying.code() && telemetry.position[2] > 0.3)
            .then_some(header.origin().process())
    });
    let plant = wait_for("the truth", || {
        truth.latest().unwrap().map(|(header, _)| header.origin().process())
    });
    (flight, bus, daemon, plant)
}

#[test]
fn f14_a_killed_daemon_ends_the_flight_with_a_clear_message_and_no_remains() {
    let testbed = Testbed::new("kill-daemon");
    let (flight, bus, daemon, plant) = airborne(&testbed);
    drop(bus);
    signal(daemon, Signal::KILL);
    assert_refused(&flight.wait(), 1, &["daemon was killed by signal 9"]);
    assert!(!is_alive(plant), "an orphan");
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
}

#[test]
fn f14_a_daemon_after_one_that_ended_in_flight_is_in_stop_until_an_operator_arms() {
    let testbed = Testbed::new("ended");
    let bus = testbed.bus();
    let [_plant, _cameras, mut daemon] = testbed.services();
    let status = || json(&testbed.oqtal(&["ctl", "status", "--json"]).output().unwrap());
    let ended = "the daemon before this one ended in flight";
    for end in [Signal::KILL, Signal::TERM] {
        testbed.take_off(&bus);
        daemon.signal(end);
        daemon.wait();
        // The second one knows it, too.
        for _ in 0..2 {
            daemon = testbed.start(&["daemon", "run"]);
            testbed.wait_for_daemon();
            let status = status();
            assert_eq!((&status["state"], &status["cause"]), (&"Stop".into(), &ended.into()));
            daemon.signal(Signal::TERM);
            daemon.wait();
        }
        daemon = testbed.start(&["daemon", "run"]);
    }
    testbed.take_off(&bus);
    assert!(testbed.oqtal(&["ctl", "land"]).status().unwrap().success());
    wait_for("the end of the landing", || (status()["mode"] == "disarmed").then_some(()));
    daemon.signal(Signal::TERM);
    daemon.wait();
    daemon = testbed.start(&["daemon", "run"]);
    testbed.wait_for_daemon();
    assert_ne!(status()["cause"], ended);
    drop(daemon);
}

#[test]
fn f17_a_killed_plant_ends_the_flight_too() {
    let testbed = Testbed::new("kill-plant");
    let (flight, bus, daemon, plant) = airborne(&testbed);
    drop(bus);
    signal(plant, Signal::KILL);
    assert_refused(&flight.wait(), 1, &["plant-sim was killed by signal 9"]);
    assert!(!is_alive(daemon), "an orphan");
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
}

#[test]
fn a_killed_front_door_leaves_no_orphans() {
    let testbed = Testbed::new("kill-door");
    let (flight, _bus, daemon, plant) = airborne(&testbed);
    flight.signal(Signal::KILL);
    wait_for("the processes to end", || (!is_alive(daemon) && !is_alive(plant)).then_some(()));
}

#[test]
fn f13_killed_cameras_and_a_killed_daemon_are_replaced_under_running_peers() {
    let testbed = Testbed::new("replace");
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let mut tick = |what: &str, writer: u32, is_fresh: bool| {
        wait_for(what, || {
            let (header, tick) = telemetry.receive().unwrap()?;
            let ours = header.origin().process() == writer;
            (ours && (tick.fresh != 0) == is_fresh).then_some(())
        });
    };
    let _plant = testbed.start(&["plant-sim", "run"]);
    let mut cameras = testbed.start(&["mocap-emu", "run"]);
    let mut daemon = testbed.start(&["daemon", "run"]);
    tick("poses", daemon.id(), true);
    for _ in 0..2 {
        cameras.signal(Signal::KILL);
        cameras.wait();
        // A pose of the killed cameras may still arrive; poses after a gap are from the new ones.
        tick("a gap", daemon.id(), false);
        cameras = testbed.start(&["mocap-emu", "run"]);
        tick("poses of new cameras", daemon.id(), true);
        daemon.signal(Signal::KILL);
        daemon.wait();
        daemon = testbed.start(&["daemon", "run"]);
        tick("poses in a new daemon", daemon.id(), true);
    }
}

#[test]
fn one_interrupt_lands() {
    let testbed = Testbed::new("land");
    let (flight, _bus, ..) = airborne(&testbed);
    flight.signal(Signal::INT);
    let output = flight.wait();
    assert!(output.status.success(), "{}", stderr(&output));
    let summary = json(&output);
    assert_eq!(summary["outcome"], "landed");
    assert!(number(&summary, "/duration_s") < 30.0);
}

#[test]
fn two_interrupts_stop() {
    let testbed = Testbed::new("stop");
    let (flight, bus, ..) = airborne(&testbed);
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    flight.signal(Signal::INT);
    wait_for("the landing", || {
        telemetry.latest().unwrap().filter(|(_, t)| t.mode == Mode::Landing.code())
    });
    flight.signal(Signal::INT);
    let output = flight.wait();
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(json(&output)["outcome"], "stopped");
}

#[test]
fn f25_a_second_daemon_is_refused_and_the_first_flies_on() {
    let testbed = Testbed::new("second");
    let (flight, _bus, daemon, _) = airborne(&testbed);
    let held = format!("is held by `oqtal daemon` ({daemon})");
    testbed.refuses(&["daemon", "run"], 75, &["topic `command`", &held]);
    assert!(is_alive(daemon));
    flight.signal(Signal::INT);
    assert!(flight.wait().status.success());
}

#[test]
fn a_second_flight_leaves_the_first_alone() {
    let testbed = Testbed::new("company");
    let (flight, _bus, daemon, plant) = airborne(&testbed);
    let runs = format!("`oqtal plant-sim` ({plant}) already runs on instance");
    testbed.refuses(&["fly", "--trajectory", "hover"], 75, &[&runs, "--instance"]);
    let directories = std::fs::read_dir(testbed.path("flights")).unwrap().count();
    assert_eq!(directories, 1, "the refused flight leaves none");
    assert!(is_alive(daemon));
    flight.signal(Signal::INT);
    assert!(flight.wait().status.success());
}

#[test]
fn f33_a_daemon_asked_to_end_leaves_the_vehicle_disarmed() {
    let testbed = Testbed::new("term");
    let (flight, bus, daemon, _plant) = airborne(&testbed);
    let mut commands = bus.observer(&oqtal_bus::topic::COMMAND).unwrap();
    let (_, flown) = wait_for("commands", || commands.latest().unwrap());
    assert_ne!(flown.actuation, 0);
    signal(daemon, Signal::TERM);
    assert_refused(&flight.wait(), 1, &["daemon ended with exit code 0"]);
    let (_, last) = commands.latest().unwrap().expect("a last command");
    assert_eq!(last.actuation, 0);
}

#[test]
fn f34_a_daemon_whose_log_is_closed_continues() {
    let testbed = Testbed::new("closed-log");
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let mut command = testbed.oqtal(&["daemon", "run", "--set", "log.level=trace"]);
    let mut daemon = command.stderr(std::process::Stdio::piped()).spawn().unwrap();
    drop(daemon.stderr.take());
    for _ in 0..10 {
        wait_for("a tick", || telemetry.receive().unwrap());
    }
    signal(daemon.id(), Signal::TERM);
    assert_eq!(daemon.wait().unwrap().code(), Some(0));
}

#[test]
fn f31_status_reports_every_process_and_whether_their_configurations_agree() {
    let testbed = Testbed::new("status");
    let status = || {
        let output = testbed.oqtal(&["ctl", "status", "--json"]).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        json(&output)
    };
    let daemon = testbed.start(&["daemon", "run"]);
    let alone = status();
    assert_eq!(alone["processes"][2]["name"], "daemon");
    assert_eq!(alone["processes"][2]["heard"]["pid"], daemon.id());
    assert_eq!(alone["processes"][2]["heard"]["daemon"]["mode"], "disarmed");
    assert!(alone["processes"][0]["heard"].is_null(), "a plant that does not run");
    assert!(alone["processes"][0]["silent"].is_null(), "a plant that does not run is not silent");
    assert_eq!(alone["config_agrees"], true);
    let plant = testbed.start(&["plant-sim", "run"]);
    let mocap = testbed.start(&["mocap-emu", "run", "--set", "mocap.rate-hz=100"]);
    let all = wait_for("all processes", || {
        let all = status();
        let reports = |k: usize| all["processes"][k]["heard"].is_object();
        (reports(0) && reports(1) && reports(2)).then_some(all)
    });
    assert_eq!(all["processes"][1]["heard"]["pid"], mocap.id());
    assert_eq!(all["config_agrees"], false);
    let text = testbed.oqtal(&["ctl", "status"]).output().unwrap().stdout;
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains("configurations differ"), "{text}");
    assert!(text.contains("bridge     not started, or ended"), "{text}");
    plant.signal(Signal::STOP);
    let hangs = format!("`oqtal plant-sim` ({})", plant.id());
    wait_for("the silence of a plant that hangs", || {
        let plant = &status()["processes"][0];
        plant["heard"].is_null().then(|| assert_eq!(plant["silent"], hangs))
    });
}

#[test]
fn ctl_reaches_a_daemon_and_reports_a_missing_one() {
    let testbed = Testbed::new("ctl");
    testbed.refuses(&["ctl", "status"], 75, &["no daemon answers"]);
    for command in ["status", "arm", "land", "stop", "goto"] {
        let arguments = if command == "goto" { &["0", "0", "1"][..] } else { &[] };
        let words = [&["ctl", "--json", command], arguments].concat();
        let output = testbed.oqtal(&words).output().unwrap();
        let answer = json(&output);
        assert_eq!(answer["command"], command, "{answer}");
        assert_eq!(answer["answer"], "none", "{answer}");
        assert_eq!(answer["exit_code"], 75, "{answer}");
        assert_eq!(output.status.code(), Some(75));
        assert!(stderr(&output).contains(answer["error"].as_str().unwrap()), "{answer}");
    }
    let daemon = testbed.start(&["daemon", "run"]);
    let status = testbed.oqtal(&["ctl", "status"]).output().unwrap();
    assert!(status.status.success(), "{}", stderr(&status));
    assert!(String::from_utf8_lossy(&status.stdout).contains("disarmed"));
    let elsewhere = testbed.path("elsewhere").display().to_string();
    let words = ["ctl", "status", "--instance", testbed.instance(), "--root", &elsewhere];
    let here = format!("runs it under --root {}", testbed.path("run").display());
    assert_refused(&testbed.study(&words).output().unwrap(), 75, &[&here]);
    testbed.refuses(&["ctl", "arm"], 1, &["no pose"]);
    testbed.refuses(
        &["ctl", "land"],
        1,
        &["land refused: the motors are commanded off, and the vehicle does not answer"],
    );
    let refused = testbed.oqtal(&["ctl", "arm", "--json"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(1));
    assert_eq!(json(&refused)["answer"], "refused");
    let unused = ["ctl", "goto", "0", "0", "1", "--set", "reference.leg-vertical-m-s=2"];
    testbed.refuses(&unused, 64, &["--set reference.leg-vertical-m-s=2", "oqtal ctl set"]);
    daemon.signal(Signal::STOP);
    let hangs = format!("`oqtal daemon` ({}) runs on instance", daemon.id());
    testbed.refuses(&["ctl", "arm"], 75, &[&hangs, "does not answer"]);
    daemon.signal(Signal::CONT);
}

/// `arm --config` expects the configuration of the file alone; without it, the answer lists what was changed.
#[test]
fn arming_tells_which_settings_were_changed_since_the_start() {
    let testbed = Testbed::new("changed");
    let file = testbed.write("lab.toml", "[trajectory]\nkind = \"hover\"\n");
    let config = ["--config", file.to_str().unwrap()];
    let _processes =
        SERVICES.map(|process| testbed.start(&[&[process, "run"], &config[..]].concat()));
    testbed.wait_for_daemon();
    let ctl = |words: &[&str]| {
        let output = testbed.oqtal(&[&["ctl"], words].concat()).output().unwrap();
        let told = String::from_utf8_lossy(&output.stdout).into_owned();
        (output.status.code(), told, stderr(&output))
    };
    let set = "position.tilt-limit-deg=8";
    assert_eq!(ctl(&["set", set]).0, Some(0));
    let expected = [&["arm"], &config[..]].concat();
    let (code, _, message) = ctl(&expected);
    assert_eq!(code, Some(1), "{message}");
    for part in ["another configuration expected", "position.tilt-limit-deg=8", "`oqtal ctl undo "]
    {
        assert!(message.contains(part), "no {part} in: {message}");
    }
    let armed = |words: &[&str]| {
        wait_for("a flight", || {
            let (code, told, _) = ctl(words);
            (code == Some(0)).then_some(told)
        })
    };
    let told = armed(&["arm"]);
    assert!(told.contains("since the daemon's start:\n  position.tilt-limit-deg=8"), "{told}");
    assert_eq!(ctl(&["stop"]).0, Some(0));
    assert_eq!(ctl(&["undo"]).0, Some(0));
    let told = armed(&expected);
    assert!(!told.contains("since the daemon's start"), "{told}");
}

/// Its vehicle has had no command, and must not start its motors on the floor.
#[test]
fn f15_a_daemon_that_hangs_for_longer_than_poses_may_be_missing_does_not_fly_on() {
    for hang_s in [0.3, 0.6, 3.0] {
        let fault = format!("fault.inject=[\"daemon:stop@4+{hang_s}\"]");
        let flight = fly(&mission(&["trajectory.kind=hover".to_owned(), fault])).unwrap();
        let reason = flight.shortfall().unwrap();
        assert!(
            reason
                .ends_with(" s without a tick, during which the vehicle may have stopped its motors by itself: loop late"),
            "{reason}"
        );
        let began = flight.origin();
        let after = |tick: &TelemetryV1| tick.time.since(began).seconds() > 4.1;
        let mut ticks = flight.samples.iter().map(|sample| &sample.telemetry).filter(|t| after(t));
        assert!(ticks.all(|tick| tick.thrust == 0.0), "{hang_s} s");
    }
}
