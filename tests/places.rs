//! The directory and shared memory of an instance: permissions, required space, cleanup, and start in any order.

use std::process::Command;

use crate::common::{
    Running, SERVICES, Testbed, assert_refused, has_namespaces, json, stderr, wait_for,
};
use oqtal_bus::code::SafetyState;
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;

/// All start orders of three processes.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// Starts the processes in the given order and waits until the daemon is in the state Nominal.
fn all_find_each_other(testbed: &Testbed, order: [usize; 3]) -> Vec<Running> {
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let started: Vec<Running> =
        order.iter().map(|&k| testbed.start(&[SERVICES[k], "run"])).collect();
    let daemon = order.iter().position(|&k| SERVICES[k] == "daemon").unwrap();
    let daemon = started[daemon].id();
    wait_for(&format!("poses with the order {order:?}"), || {
        let (header, tick) = telemetry.latest().unwrap()?;
        (header.origin().process() == daemon && tick.state == SafetyState::Nominal.code())
            .then_some(())
    });
    started
}

#[test]
fn f32_processes_find_each_other_in_any_order_of_their_starts() {
    for order in ORDERS {
        let testbed = Testbed::new("order");
        for process in all_find_each_other(&testbed, order) {
            process.signal(Signal::TERM);
            assert!(process.wait().status.success());
        }
        assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
        assert!(!testbed.paths().directory().exists(), "the last process leaves nothing");
    }
}

/// All start orders of four processes.
fn orders_of_four() -> Vec<[usize; 4]> {
    let mut orders = Vec::new();
    for order in ORDERS {
        for place in 0..4 {
            let mut four: Vec<usize> = order.to_vec();
            four.insert(place, 3);
            orders.push(four.try_into().unwrap());
        }
    }
    orders
}

#[test]
fn f32_a_daemon_finds_cameras_vehicle_and_bridge_in_all_24_orders() {
    let orders = orders_of_four();
    assert_eq!(orders.len(), 24);
    // The short version has each pair in both orders; `TEST_LONG=1` has all orders.
    let is_long = std::env::var_os("TEST_LONG").is_some();
    let step = if is_long { 1 } else { 7 };
    for order in orders.into_iter().step_by(step) {
        let testbed = Testbed::new("wired");
        let link = format!("asctec:{}", testbed.path("port").display());
        let commands: [Vec<&str>; 4] = [
            vec!["plant-sim", "run", "--wire", &link],
            vec!["mocap-emu", "run"],
            vec!["daemon", "run"],
            vec!["bridge", "run", "--link", &link],
        ];
        let bus = testbed.bus();
        let mut telemetry = bus.observer(&TELEMETRY).unwrap();
        let mut running: [Option<Running>; 4] = [None, None, None, None];
        for k in order {
            running[k] = Some(testbed.start(&commands[k]));
        }
        wait_for(&format!("Nominal with the order {order:?}"), || {
            // Without its port the bridge ends, and the service manager restarts it.
            let bridge = running[3].as_mut().unwrap();
            if !bridge.runs() {
                running[3] = Some(testbed.start(&commands[3]));
            }
            let (_, tick) = telemetry.latest().unwrap()?;
            (tick.state == SafetyState::Nominal.code()).then_some(())
        });
    }
}

#[test]
fn f29_remains_of_killed_processes_do_not_hinder_the_next() {
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
fn f27_too_little_shared_memory_is_reported_at_the_start() {
    if !has_namespaces() {
        return;
    }
    let testbed = Testbed::new("full");
    let daemon = testbed.oqtal(&["daemon", "run"]);
    let words: Vec<_> = daemon.get_args().map(ToOwned::to_owned).collect();
    // A private mount for one process; a user namespace makes it possible without privileges.
    let script = "mount -t tmpfs -o size=64k tmpfs /dev/shm && exec \"$0\" \"$@\"";
    let mut small = Command::new("unshare");
    small.args(["--map-root-user", "--mount", "sh", "-c", script]).arg(daemon.get_program());
    assert_refused(&small.args(words).output().unwrap(), 71, &["/dev/shm has 64 KiB free"]);
}

#[test]
fn f27_a_flight_starts_in_the_least_shared_memory_that_doctor_accepts() {
    if !has_namespaces() {
        return;
    }
    let testbed = Testbed::new("least");
    let run_in = |mib: u32, words: &[&str]| {
        let script = format!("mount -t tmpfs -o size={mib}m tmpfs /dev/shm && exec \"$0\" \"$@\"");
        let mut small = Command::new("unshare");
        small.args(["--map-root-user", "--mount", "sh", "-c", &script]);
        let command = testbed.oqtal(words);
        small.arg(command.get_program()).args(command.get_args()).output().unwrap()
    };
    let is_accepted = |mib: &u32| {
        let document = json(&run_in(*mib, &["doctor", "--json"]));
        let mut checks = document["checks"].as_array().unwrap().iter();
        checks.find(|check| check["name"] == "shared memory").unwrap()["level"] != "problem"
    };
    let least = (16..64).find(is_accepted).unwrap();
    let out = testbed.path("d").display().to_string();
    let output = run_in(least, &["fly", "--trajectory", "hover", "--duration", "1", "--out", &out]);
    assert_eq!(output.status.code(), Some(0), "{least} MiB: {}", stderr(&output));
}

/// Runs in a private `/dev/shm` of the size `$1`: three processes, and an observer that is stopped for two seconds while a file
/// fills the rest. Prints the exit code of each process after its end was requested.
const FULL_MEMORY: &str = r#"
set -e
mount -t tmpfs -o size=$1 tmpfs /dev/shm
shift
for process in plant-sim mocap-emu daemon; do
    "$@" $process run $PLACE & pids="$pids $!"
done
until "$@" ctl arm $PLACE >/dev/null; do for pid in $pids; do kill -0 $pid; done; sleep 0.1; done
"$@" latency --attach --seconds 60 $PLACE >/dev/null 2>&1 & observer=$!
sleep 1
kill -STOP $observer
dd if=/dev/zero of=/dev/shm/filler bs=4k 2>/dev/null || true
sleep 2
kill -CONT $observer
sleep 1
kill $observer
wait $observer || true
for pid in $pids; do kill $pid; code=0; wait $pid || code=$?; echo $code; done
"#;

#[test]
fn f27_a_full_memory_and_a_stopped_observer_end_no_process() {
    if !has_namespaces() {
        return;
    }
    let testbed = Testbed::new("filled");
    let mut private = Command::new("unshare");
    private.args(["--map-root-user", "--mount", "--pid", "--fork", "sh", "-c", FULL_MEMORY]);
    private.args(["sh", "64m", env!("CARGO_BIN_EXE_oqtal")]);
    let root = testbed.path("run").display().to_string();
    let place = format!("--instance {} --root {root}", testbed.instance());
    let output = private.env("PLACE", place).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stdout), "0\n0\n0\n", "{}", stderr(&output));
}

/// Lands and stops a flight in a private `/dev/shm` that was filled, and arms it once the memory is free again. Prints the answers.
const FILLED_FLIGHT: &str = r#"
mount -t tmpfs -o size=64m tmpfs /dev/shm
for process in plant-sim mocap-emu daemon; do
    "$@" $process run $PLACE 2>/dev/null & pids="$pids $!"
done
until "$@" ctl arm $PLACE >/dev/null 2>&1; do for pid in $pids; do kill -0 $pid || exit; done; sleep 0.1; done
dd if=/dev/zero of=/dev/shm/filler bs=4k 2>/dev/null
"$@" ctl land $PLACE 2>&1
"$@" ctl stop $PLACE 2>&1
rm /dev/shm/filler
"$@" ctl arm $PLACE 2>&1
kill $pids
wait
"#;

#[test]
fn f27_operators_of_a_flight_with_full_memory_are_told_that_it_is_full() {
    if !has_namespaces() {
        return;
    }
    let testbed = Testbed::new("told-full");
    let mut private = Command::new("unshare");
    private.args(["--map-root-user", "--mount-proc", "--pid", "--fork", "sh", "-c", FILLED_FLIGHT]);
    private.args(["sh", env!("CARGO_BIN_EXE_oqtal")]);
    let root = testbed.path("run").display().to_string();
    let place = format!("--instance {} --root {root}", testbed.instance());
    let output = private.env("PLACE", place).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert_eq!(said.matches("/dev/shm has 0 KiB free").count(), 2, "{said}");
    assert!(said.contains("\nto fly again: `oqtal ctl arm ") && !said.contains("lost"), "{said}");
    assert!(said.contains("armed, the flight has begun"), "{said}");
}

#[test]
fn too_low_a_limit_of_open_files_is_reported_with_the_remedy() {
    let testbed = Testbed::new("few-files");
    let mut shell = Command::new("sh");
    let daemon = testbed.oqtal(&["daemon", "run"]);
    shell.args(["-c", "ulimit -n 32; exec \"$0\" \"$@\""]).arg(daemon.get_program());
    let output = shell.args(daemon.get_args()).output().unwrap();
    assert_refused(&output, 71, &["may open 32 files", "ulimit -n"]);
}
