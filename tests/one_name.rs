//! Two instances of one name under two roots, addressed by the name: real processes.

use std::process::Command;

use crate::common::network::free_port;
use crate::common::{Running, Testbed, assert_refused, wait_for};
use oqtal_bus::bus::Bus;
use oqtal_bus::obeying::ObeyingProcess;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::stop::StopSwitch;
use oqtal_bus::topic::Role;
use rustix::process::Signal;

/// `oqtal ctl` of an operator who does not name the root.
pub fn rootless(testbed: &Testbed, words: &[&str]) -> Command {
    let mut command = testbed.study(&[&["ctl"], words].concat());
    command.args(["--instance", testbed.instance()]);
    command
}

#[test]
fn a_stop_by_name_is_not_confirmed_by_a_vehicle_under_another_root() {
    let testbed = Testbed::new("orphan");
    let (plant, _) = second(&testbed, "plant-sim");
    let _daemon = testbed.start(&["daemon", "run"]);
    testbed.wait_for_daemon();
    wait_for("the vehicle", || is_found(&plant).then_some(()));
    let output = rootless(&testbed, &["stop"]).output().unwrap();
    assert_refused(&output, 75, &["without a process of its vehicle", "the daemon obeys"]);
}

/// A process of a second vehicle of the same name, under another root.
fn second(testbed: &Testbed, role: &str) -> (Running, InstancePaths) {
    let root = testbed.path("elsewhere");
    let place = ["--instance", testbed.instance(), "--root", &root.display().to_string()];
    let process = Running::start(&mut testbed.study(&[&[role, "run"], &place[..]].concat()));
    (process, InstancePaths { instance: testbed.instance().to_owned(), root })
}

/// Whether an operator's command finds `process`.
fn is_found(process: &Running) -> bool {
    ObeyingProcess::all().iter().any(|found| found.pid == process.id())
}

/// As [`second`], suspended.
pub fn suspended(testbed: &Testbed, role: &str) -> (Running, InstancePaths) {
    let (process, paths) = second(testbed, role);
    wait_for("a second process", || {
        (is_found(&process) && StopSwitch::existing(&paths).is_ok_and(|it| it.is_some()))
            .then_some(())
    });
    process.signal(Signal::STOP);
    (process, paths)
}

#[test]
fn a_landing_is_not_confirmed_while_another_daemon_of_that_name_hangs() {
    let testbed = Testbed::new("two-landings");
    let bus = testbed.bus();
    let _processes = testbed.services();
    testbed.take_off(&bus);
    let (_second, paths) = suspended(&testbed, "daemon");
    let output = rootless(&testbed, &["land"]).output().unwrap();
    let place = paths.root.display().to_string();
    assert_refused(&output, 1, &["not confirmed: the daemon", &place]);
}

#[test]
fn a_landing_and_a_stop_by_name_under_two_roots_name_both() {
    let testbed = Testbed::new("two-roots");
    let bus = testbed.bus();
    let _processes = testbed.services();
    let (_plant, paths) = second(&testbed, "plant-sim");
    let (daemon, _) = second(&testbed, "daemon");
    testbed.take_off(&bus);
    wait_for("a second daemon", || {
        let running = Bus::open_running(&paths).unwrap()?;
        is_found(&daemon).then(|| running.holder(&Role::Daemon.health()).unwrap())?
    });
    let roots = [testbed.paths().root, paths.root].map(|root| root.display().to_string());
    let said = |command| {
        let output = rootless(&testbed, &[command]).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let status = testbed.oqtal(&["ctl", "status"]).output().unwrap();
    let status = String::from_utf8_lossy(&status.stdout).into_owned();
    let line = format!("under {}; others of this name run under {}", roots[0], roots[1]);
    assert!(status.contains(&line), "{status}");
    let landed = said("land");
    assert!(roots.iter().all(|root| landed.contains(root)), "{landed}");
    let stopped = said("stop");
    for root in roots {
        let instance = testbed.instance();
        let line = format!(
            "\nto fly again under {root}: `oqtal ctl arm --instance {instance} --root {root}`"
        );
        assert!(stopped.contains(&line), "{stopped}");
    }
}

#[test]
fn a_landing_by_name_is_confirmed_by_the_only_daemon_that_is_left() {
    let testbed = Testbed::new("one-landing");
    // The vehicle of a daemon that has ended.
    let _plant = second(&testbed, "plant-sim");
    let bus = testbed.bus();
    let _processes = testbed.services();
    testbed.take_off(&bus);
    let output = rootless(&testbed, &["land"]).output().unwrap();
    assert!(output.status.success(), "{output:?}");
}

#[test]
fn a_stop_is_not_confirmed_by_one_of_two_daemons() {
    let testbed = Testbed::new("two-daemons");
    let bus = testbed.bus();
    let _processes = testbed.services();
    testbed.take_off(&bus);
    let (_second, paths) = suspended(&testbed, "daemon");
    let output = rootless(&testbed, &["stop"]).output().unwrap();
    let place = paths.root.display().to_string();
    assert_refused(&output, 75, &["not every daemon has obeyed", &place]);
}

#[test]
fn a_stop_under_the_wrong_root_names_the_right_one() {
    let testbed = Testbed::new("wrong-root");
    let (plant, paths) = second(&testbed, "plant-sim");
    wait_for("the vehicle", || is_found(&plant).then_some(()));
    let root = testbed.path("wrong").display().to_string();
    let output = rootless(&testbed, &["stop", "--root", &root]).output().unwrap();
    let remedy = format!(
        "run `oqtal ctl stop --instance {} --root {}`",
        testbed.instance(),
        paths.root.display()
    );
    assert_refused(&output, 75, &["does not run under", &remedy]);
}

#[test]
fn a_stop_that_reaches_nobody_names_the_processes_that_run() {
    let testbed = Testbed::new("cameras-only");
    let bus = testbed.bus();
    let _cameras = testbed.start(&["mocap-emu", "run"]);
    let holds = |role: Role| bus.holder(&role.health()).unwrap();
    wait_for("the cameras", || holds(Role::Mocap));
    let stopped = || testbed.oqtal(&["ctl", "stop"]).output().unwrap();
    let output = stopped();
    assert_refused(&output, 75, &["only `oqtal mocap-emu` (", "there is nothing to stop"]);
    let wire = format!("asctec:{}", testbed.path("wire").display());
    let truth = format!("betaflight-sitl:udp:127.0.0.1:{}", free_port());
    for far in [["--wire", &wire], ["--truth", &truth]] {
        let _plant = testbed.start(&[&["plant-sim", "run"], &far[..]].concat());
        wait_for("the vehicle behind a bridge", || holds(Role::Plant));
        let output = stopped();
        assert_refused(&output, 75, &["`oqtal plant-sim` (", "takes its commands over a wire"]);
    }
}

#[test]
fn the_next_flight_has_the_configuration_of_the_processes_that_run() {
    let testbed = Testbed::new("other-config");
    let bus = testbed.bus();
    let plant = testbed.start(&["plant-sim", "run"]);
    wait_for("the vehicle", || bus.holder(&Role::Plant.health()).unwrap());
    std::fs::write(testbed.paths().config(), "[mocap]\nrate-hz = 100.0\n").unwrap();
    let like = format!("with the --config and --set of `oqtal plant-sim` ({})", plant.id());
    for command in ["stop", "status"] {
        let output = testbed.oqtal(&["ctl", command]).output().unwrap();
        let said =
            String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
        assert!(said.contains(&like) && !said.contains("daemon run"), "{said}");
    }
}
