//! Processes killed at random instants of their first half second, on one instance: the next start succeeds.

mod common;

use std::time::Duration;

use common::{Running, Testbed, wait_for};
use oqtal_bus::code::SafetyState;
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;

const PROCESSES: [&str; 3] = ["plant-sim", "mocap-emu", "daemon"];

/// Generator of pseudo-random numbers (Knuth's MMIX) with a fixed seed, so that a failure can be repeated.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % limit
    }

    /// Waits for up to half a second.
    fn pause(&mut self) {
        std::thread::sleep(Duration::from_micros(self.below(500_000)));
    }
}

fn start(testbed: &Testbed, process: &str) -> Running {
    testbed.start(&[process, "run"])
}

/// Starts the processes that do not run, and waits until the running daemon is in the state Nominal.
fn all_work(testbed: &Testbed, running: &mut [Option<Running>; 3]) {
    for (slot, process) in running.iter_mut().zip(PROCESSES) {
        slot.get_or_insert_with(|| start(testbed, process));
    }
    let daemon = running[2].as_ref().map(Running::id).unwrap();
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    wait_for("accepted poses", || {
        let (header, tick) = telemetry.latest().unwrap()?;
        let is_nominal = tick.state == SafetyState::Nominal.code();
        (header.origin().process() == daemon && is_nominal).then_some(())
    });
}

fn kill(process: Option<Running>) {
    let Some(process) = process else { return };
    process.signal(Signal::KILL);
    let output = process.wait();
    assert_eq!(output.status.code(), None, "ended by itself: {}", common::stderr(&output));
}

#[test]
fn f29_processes_killed_while_they_start_do_not_hinder_the_next() {
    let testbed = Testbed::new("kills");
    let mut random = Random(29);
    for _ in 0..6 {
        let started = PROCESSES.map(|process| start(&testbed, process));
        random.pause();
        for process in started {
            kill(Some(process));
        }
    }
    all_work(&testbed, &mut [None, None, None]);
}

#[test]
fn f29_a_process_killed_while_it_starts_does_not_hinder_the_others() {
    let testbed = Testbed::new("singles");
    let mut random = Random(7);
    let mut running = [None, None, None];
    all_work(&testbed, &mut running);
    for _ in 0..15 {
        let which = random.below(3) as usize;
        kill(running[which].take());
        let started = start(&testbed, PROCESSES[which]);
        random.pause();
        kill(Some(started));
    }
    all_work(&testbed, &mut running);
}

#[test]
fn a_process_that_leaves_last_leaves_nothing() {
    let testbed = Testbed::new("last");
    let mut running = [None, None, None];
    all_work(&testbed, &mut running);
    for process in running.into_iter().flatten() {
        process.signal(Signal::TERM);
        assert!(process.wait().status.success());
    }
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
    assert!(!testbed.paths().directory().exists());
}
