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

/// All orders in which four processes can be started.
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
    // Each pair in either order in the short version; `TEST_LONG=1` all.
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
            // Without its port the bridge ends; the service manager starts it again.
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

/// Runs in a private `/dev/shm` of the size `$1`: three processes and an observer that is stopped for two seconds while a file fills
/// what is left. Prints the exit code of each process after it was asked to end.
const FULL_MEMORY: &str = r#"
set -e
mount -t tmpfs -o size=$1 tmpfs /dev/shm
shift
for process in plant-sim mocap-emu daemon; do
    "$@" $process run $PLACE 2>/dev/null & pids="$pids $!"
done
until "$@" ctl arm $PLACE >/dev/null 2>&1; do sleep 0.1; done
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
fn f27_a_full_memory_and_an_observer_that_sleeps_kill_nobody() {
    let testbed = Testbed::new("filled");
    let mut private = Command::new("unshare");
    private.args(["--map-root-user", "--mount", "--pid", "--fork", "sh", "-c", FULL_MEMORY]);
    private.args(["sh", "64m", env!("CARGO_BIN_EXE_oqtal")]);
    let root = testbed.path("run").display().to_string();
    let place = format!("--instance {} --root {root}", testbed.instance());
    let output = private.env("PLACE", place).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stdout), "0\n0\n0\n", "{}", stderr(&output));
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

#[test]
fn f28_names_that_another_user_plants_in_shared_memory_hinder_nobody() {
    use std::os::unix::fs::PermissionsExt;
    if !rustix::process::getuid().is_root() {
        eprintln!("skipped: only root can become other users");
        return;
    }
    let testbed = Testbed::new("planted");
    let (owner, root) = (65_533, testbed.path("run"));
    std::fs::set_permissions(testbed.path(""), PermissionsExt::from_mode(0o755)).unwrap();
    std::fs::create_dir(&root).unwrap();
    std::os::unix::fs::chown(&root, Some(owner), Some(owner)).unwrap();
    // Directories of a third user, which the owner of the instance cannot remove.
    let names = ["stop", "pose.count", "truth.count", "vehicle.count", "shared"];
    let planted = names.map(|name| format!("/dev/shm/{}{name}", testbed.paths().prefix()));
    let mut stranger = Command::new("mkdir");
    assert!(stranger.args(&planted).uid(65_534).gid(65_534).status().unwrap().success());
    let as_owner = |words: &[&str]| {
        let mut command = testbed.oqtal(words);
        command.uid(owner).gid(owner);
        command
    };
    let plant = Running::start(&mut as_owner(&["plant-sim", "run"]));
    wait_for("a stop that is obeyed", || {
        as_owner(&["ctl", "stop"]).output().unwrap().status.success().then_some(())
    });
    plant.signal(Signal::TERM);
    assert!(plant.wait().status.success());
    let mut left = testbed.remains();
    left.retain(|name| !planted.contains(&format!("/dev/shm/{name}")));
    assert!(left.is_empty() && !root.join(testbed.instance()).exists(), "{left:?}");
    planted.iter().for_each(|path| std::fs::remove_dir(path).unwrap());
    std::os::unix::fs::chown(&root, Some(0), Some(0)).unwrap();
}

#[test]
fn too_few_files_for_the_ports_are_said_with_the_remedy() {
    let testbed = Testbed::new("few-files");
    let mut shell = Command::new("sh");
    let daemon = testbed.oqtal(&["daemon", "run"]);
    shell.args(["-c", "ulimit -n 32; exec \"$0\" \"$@\""]).arg(daemon.get_program());
    let output = shell.args(daemon.get_args()).output().unwrap();
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(71), "{message}");
    assert!(message.contains("may open 32 files") && message.contains("ulimit -n"), "{message}");
}
