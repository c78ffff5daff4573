//! The directory and shared memory of an instance: permissions, required space, cleanup, and start in any order.

mod common;

use std::os::unix::process::CommandExt;
use std::process::Command;

use common::{Running, Testbed, stderr, wait_for};
use oqtal_bus::code::SafetyState;
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;

const PROCESSES: [&str; 3] = ["plant-sim", "mocap-emu", "daemon"];

/// All orders in which three processes can be started.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// Starts the processes in the given order and waits until the daemon is in the state Nominal.
fn all_find_each_other(testbed: &Testbed, order: [usize; 3]) -> Vec<Running> {
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let started: Vec<Running> =
        order.iter().map(|&k| testbed.start(&[PROCESSES[k], "run"])).collect();
    let daemon = order.iter().position(|&k| PROCESSES[k] == "daemon").unwrap();
    let daemon = started[daemon].id();
    wait_for(&format!("poses with the order {order:?}"), || {
        let (header, tick) = telemetry.latest().unwrap()?;
        (header.origin().process() == daemon && tick.state == SafetyState::Nominal.code())
            .then_some(())
    });
    started
}

#[test]
fn f32_processes_find_each_other_in_whatever_order_they_start() {
    for order in ORDERS {
        let testbed = Testbed::new("order");
        for process in all_find_each_other(&testbed, order) {
            process.signal(Signal::TERM);
            assert!(process.wait().status.success());
        }
        assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
    }
}

#[test]
fn f29_what_killed_processes_leave_behind_does_not_hinder_the_next() {
    let testbed = Testbed::new("remains");
    for order in &ORDERS[..3] {
        let processes = all_find_each_other(&testbed, *order);
        processes.iter().for_each(|process| process.signal(Signal::KILL));
        processes.into_iter().for_each(|process| drop(process.wait()));
    }
    let processes = all_find_each_other(&testbed, ORDERS[0]);
    drop(processes);
}

#[test]
fn f27_too_little_shared_memory_is_said_before_it_kills() {
    let testbed = Testbed::new("full");
    let daemon = testbed.oqtal(&["daemon", "run"]);
    let words: Vec<_> = daemon.get_args().map(ToOwned::to_owned).collect();
    // A private mount for one process; the user namespace makes it possible without privileges.
    let script = "mount -t tmpfs -o size=64k tmpfs /dev/shm && exec \"$0\" \"$@\"";
    let mut small = Command::new("unshare");
    small.args(["--map-root-user", "--mount", "sh", "-c", script]).arg(daemon.get_program());
    let output = small.args(words).output().unwrap();
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(71), "{message}");
    assert!(message.contains("/dev/shm has 64 KiB free"), "{message}");
}

#[test]
fn f28_another_user_is_refused_and_told_where() {
    if !rustix::process::getuid().is_root() {
        eprintln!("skipped: only root can become another user");
        return;
    }
    let testbed = Testbed::new("stranger");
    let _daemon = testbed.start(&["daemon", "run"]);
    let root = testbed.path("run");
    wait_for("the daemon's root", || root.exists().then_some(()));
    let mut stranger = testbed.oqtal(&["ctl", "status"]);
    stranger.uid(65534);
    let output = stranger.output().unwrap();
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(77), "{message}");
    assert!(message.contains(&root.display().to_string()), "{message}");
}
