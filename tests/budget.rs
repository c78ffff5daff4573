//! Limits on the cost of real-time turns: no heap allocation in a daemon tick or a camera frame, and no system calls except those
//! that wait and wake.

mod camera_link;
#[path = "../control/tests/allocation/counter.rs"]
mod counter;
mod flight;

use std::collections::BTreeMap;
use std::process::{Command, Stdio};

use crate::common::{Running, Testbed, skipped, wait_for};
use counter::allocations;
use oqtal_bus::code::Mode;
use oqtal_bus::message::{PoseV1, Stamps, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{POSE, TELEMETRY};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_config::{Config, Setting};
use oqtal_control::controller::ControllerName;
use oqtal_mocap_emu::Cameras;
use oqtal_receiver::PoseReceiver;
use rustix::process::Signal;

#[test]
fn the_counter_counts() {
    assert_eq!(allocations(|| Box::new(7)).0, 1);
    assert_eq!(allocations(|| 7).0, 0);
}

#[test]
fn no_turn_of_the_daemon_allocates_in_a_whole_flight_under_any_law() {
    for law in ControllerName::NAMES {
        for resolve in ["on-cell-change", "every-tick"] {
            let mut taken = 0;
            let flown = flight::fly(law, resolve, |turn| taken += allocations(turn).0);
            assert!(flown > 1500, "{law}, {resolve}: {flown} ticks armed");
            assert_eq!(taken, 0, "{law}, {resolve}");
        }
    }
}

/// Number of allocations in twenty seconds of the cameras \[-\].
fn allocations_of_cameras(settings: &[(&str, &str)]) -> u64 {
    let settings = settings.iter().map(|(key, value)| Setting::flag("test", key, *value));
    let config = Config::from_settings(&settings.collect::<Vec<_>>()).unwrap();
    let mut cameras = Cameras::new(&config.mocap, 7);
    let mut truth = TruthV1 {
        time: Time::VIRTUAL_START,
        position: [0.1, 0.2, 1.0],
        attitude: [0.0, 0.0, 0.0, 1.0],
        ..TruthV1::default()
    };
    let (taken, delivered) = allocations(|| {
        let mut delivered = 0;
        for _ in 0..(20.0 * config.mocap.rate_hz) as u64 {
            truth.capture += 1;
            truth.time = truth.time + Span::period_of(config.mocap.rate_hz);
            cameras.capture(&truth);
            while cameras.deliver(truth.time).is_some() {
                delivered += 1;
            }
        }
        delivered
    });
    assert!(delivered > 1000);
    taken
}

#[test]
fn no_frame_of_any_model_of_the_cameras_allocates() {
    assert_eq!(allocations_of_cameras(&[]), 0);
    assert_eq!(allocations_of_cameras(&[("mocap.model", "markers")]), 0);
    assert_eq!(allocations_of_cameras(&[("mocap.preset", "room")]), 0);
    let both = [("mocap.preset", "room"), ("mocap.model", "markers")];
    assert_eq!(allocations_of_cameras(&both), 0);
}

/// Number of allocations while frames of a camera system are received and its list of bodies changes twice \[-\].
fn allocations_of_receiver(kind: &'static str, rest: &str) -> u64 {
    let link = format!("{kind}:{},body=quad{rest}", camera_link::serve(kind));
    let mut stream = oqtal_receiver::connect_to_all(&link.parse().unwrap()).unwrap().stream;
    let mut receiver = PoseReceiver::new(&Config::default().receiver, 1);
    let (mut taken, mut frames, mut changes) = (0, 0, 0);
    let (mut last, mut number) = (Time::UNSET, 0);
    wait_for("frames and changes", || {
        // A keep-alive message is due at each call.
        let ahead = Span::from_millis(1000 * i64::from(frames));
        let (count, definitions) = allocations(|| {
            stream.receive(&Time::now, &mut receiver).unwrap();
            stream.maintain(Time::now() + ahead).unwrap();
            stream.take_definitions()
        });
        taken += count;
        if let Some(mut definitions) = definitions {
            definitions.read().unwrap();
            taken += allocations(|| stream.apply_definitions(definitions)).0;
        }
        frames += u32::from(receiver.arrived_at() != last);
        last = receiver.arrived_at();
        if let Some(delivery) = receiver.take(0) {
            changes += u32::from(number != delivery.pose.body);
            number = delivery.pose.body;
        }
        (frames > 100 && changes > 2).then_some(())
    });
    taken
}

#[test]
fn no_frame_of_a_real_camera_system_allocates_even_when_its_bodies_change() {
    for (kind, rest) in
        [("qtm", ""), ("qtm", ",transport=tcp"), ("vrpn", ""), ("natnet", ",unicast")]
    {
        assert_eq!(allocations_of_receiver(kind, rest), 0, "{kind}{rest}");
    }
}

#[test]
fn the_bus_allocates_once_for_each_message_published_and_nowhere_else() {
    const MESSAGES: u64 = 500;
    let testbed = Testbed::new("heap");
    let bus = testbed.bus();
    let mut writer = bus.writer(&POSE).unwrap();
    let mut reader = bus.reader(&POSE).unwrap();
    let listener = bus.listener(&POSE).unwrap();
    let (mut sending, mut waking, mut waiting, mut reading) = (0, 0, 0, 0);
    for message in 1..=MESSAGES + 10 {
        let pose = PoseV1::default();
        let sent = allocations(|| writer.send(message, Stamps::default(), pose).unwrap());
        let notified = allocations(|| writer.notify().unwrap());
        let woken = allocations(|| listener.wait(Time::now() + Span::from_millis(1000)).unwrap());
        let read = allocations(|| reader.latest().unwrap());
        assert_eq!(read.1.unwrap().0.pose_sequence, message);
        // Connections are still being established during the first messages.
        if message > 10 {
            sending += sent.0;
            waking += notified.0;
            waiting += woken.0;
            reading += read.0;
        }
    }
    // The one allocation per message is made by iceoryx2, in `loan`.
    assert_eq!((sending, waking, waiting, reading), (MESSAGES, 0, 0, 0));
}

/// System call: its name, its maximum number per tick, and its purpose.
type Call = (&'static str, u64, &'static str);

/// Expected system calls of the daemon's loop in steady state.
const EXPECTED: [Call; 2] = [
    (
        "futex",
        4,
        "sleep until the warm-up and until the pose; wake the vehicle; one spurious wake-up",
    ),
    ("restart_syscall", 1, "the sleep that strace interrupted when it attached"),
];

#[test]
fn the_loop_makes_only_the_system_calls_that_wait_and_wake() {
    if !may_trace() || !may_attach() {
        return skipped("strace is not installed, or may not trace here (package strace)");
    }
    let (calls, ticks) = trace(120);
    for (name, count) in &calls {
        let most = EXPECTED.iter().find(|(call, ..)| call == name).map_or(0, |call| call.1);
        assert!(*count <= most * ticks, "{name} {count} times in {ticks} ticks");
    }
    assert!(calls.values().sum::<u64>() >= 2 * 120, "{calls:?} in {ticks} ticks");
}

fn may_trace() -> bool {
    let mut strace = Command::new("strace");
    strace.args(["-o", "/dev/null", "true"]).stdout(Stdio::null()).stderr(Stdio::null());
    strace.status().is_ok_and(|status| status.success())
}

/// Whether a process that is not a child may be traced.
fn may_attach() -> bool {
    let scope = std::fs::read_to_string("/proc/sys/kernel/yama/ptrace_scope").unwrap_or_default();
    scope.trim().is_empty() || scope.trim() == "0" || rustix::process::getuid().is_root()
}

/// System calls of a flying daemon's loop by name, and an upper bound of the ticks in which they were made; the bound is at least
/// `ticks`.
fn trace(ticks: u64) -> (BTreeMap<String, u64>, u64) {
    let testbed = Testbed::new("trace");
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let words = ["fly", "--trajectory", "hover", "--duration", "600"];
    let flight = testbed.start(&[&words[..], &["--set", "realtime.scheduling=other"]].concat());
    let mut flying = || telemetry.latest().unwrap().filter(|(_, t)| t.mode == Mode::Flying.code());
    let (header, before) = wait_for("take-off", &mut flying);
    let log = testbed.path("strace");
    let mut strace = Command::new("strace");
    strace.arg("-o").arg(&log).args([
        "-e",
        "signal=none",
        "-p",
        &header.origin().process().to_string(),
    ]);
    let strace = Running::start(&mut strace);
    let lines = || std::fs::read_to_string(&log).unwrap_or_default().lines().count() as u64;
    wait_for("the first calls", || (lines() > 0).then_some(()));
    let traced_from = wait_for("a tick", &mut flying).1.tick;
    wait_for("ticks", || flying().filter(|(_, t)| t.tick >= traced_from + ticks));
    strace.signal(Signal::INT);
    strace.wait();
    let after = wait_for("a tick", &mut flying).1;
    flight.signal(Signal::INT);
    drop(flight);
    let mut calls = BTreeMap::new();
    for line in std::fs::read_to_string(&log).unwrap().lines() {
        // Lines about signals have no bracket directly after a name.
        if let Some((name, _)) = line.split_once('(')
            && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
        {
            *calls.entry(name.to_owned()).or_default() += 1;
        }
    }
    (calls, after.tick - before.tick + 1)
}
