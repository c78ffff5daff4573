//! Soak test: all processes fly in real time, repeatedly, while a seeded sequence of events stops, kills and restarts processes
//! and makes topics fail. OQTAL_TEST_SOAK_S sets the duration \[s\], OQTAL_TEST_SOAK_SEED the seed.

mod laboratory;
mod resources;
mod watch;

use std::time::{Duration, Instant};

use crate::common::WAIT_TIMEOUT;
use crate::common::random::{Random, length};
use laboratory::{Laboratory, PROCESSES};
use oqtal_bus::code::{Mode, OperatorCommand, SafetyState};
use resources::ResourceRecord;
use watch::Watch;

/// Time-out of a take-off and of a landing \[ticks\], after which the flight is stopped as by an operator.
const TIMEOUT_TICKS: u64 = 900;
/// Number of flights above which at least a third of them must take off.
const FEW_FLIGHTS: u64 = 5;
/// Number of flights above which every kind of end and disturbance must have occurred.
const MANY_FLIGHTS: u64 = 20;
/// Number of ticks after which processes have released the resources of a dead one.
const SETTLING_TICKS: u64 = 60;

/// Number of outcomes of the flights, and of disturbances.
#[derive(Debug, Default)]
struct Count {
    /// Flights that took off.
    flown: u64,
    landed: u32,
    stopped: u32,
    refused: u32,
    kills: u32,
    stops: u32,
}

/// Waits until `is_over`, for at most `ticks` ticks of the daemon; returns false after them. A daemon without ticks fails the
/// test after its usual time-out.
fn until(watch: &mut Watch, ticks: u64, mut is_over: impl FnMut(&Watch) -> bool) -> bool {
    let (began, first) = (Instant::now(), watch.ticks);
    loop {
        watch.poll();
        if is_over(watch) {
            return true;
        }
        if watch.ticks > first + ticks {
            return false;
        }
        assert!(began.elapsed() < WAIT_TIMEOUT, "the daemon stands still");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Continues the flight for up to two seconds.
fn fly_on(watch: &mut Watch, random: &mut Random) {
    let end = Instant::now() + Duration::from_millis(random.below(2000));
    while Instant::now() < end {
        watch.poll();
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Kills and restarts a process, or stops it for up to half a second.
fn disturb(laboratory: &mut Laboratory, random: &mut Random, count: &mut Count) {
    let process = random.below(PROCESSES.len() as u64) as usize;
    if random.one_in(2) {
        count.kills += 1;
        laboratory.kill(process);
        std::thread::sleep(Duration::from_millis(random.below(300)));
        laboratory.start(process);
    } else {
        count.stops += 1;
        laboratory.pause(process, Duration::from_millis(20 + random.below(480)));
    }
}

/// One flight with up to three disturbances.
fn flight(laboratory: &mut Laboratory, watch: &mut Watch, random: &mut Random, count: &mut Count) {
    if !laboratory.ask(OperatorCommand::Fly) {
        count.refused += 1;
        return;
    }
    let asked_at = watch.ticks;
    let in_the_air = |watch: &Watch| {
        let was_ended = watch.mode == Mode::Disarmed.code();
        watch.height_m > 0.5 || was_ended && watch.ticks > asked_at + SETTLING_TICKS
    };
    until(watch, TIMEOUT_TICKS, in_the_air);
    count.flown += u64::from(watch.height_m > 0.5);
    for _ in 0..random.below(4) {
        fly_on(watch, random);
        disturb(laboratory, random, count);
    }
    until(watch, 30, |_| false);
    let was_flying = watch.mode != Mode::Disarmed.code();
    laboratory.ask(OperatorCommand::Land);
    let is_down = |watch: &Watch| watch.mode == Mode::Disarmed.code();
    let landed = until(watch, TIMEOUT_TICKS, is_down) && was_flying;
    if landed && watch.state != SafetyState::Stop.code() {
        count.landed += 1;
    } else {
        count.stopped += 1;
        laboratory.ask(OperatorCommand::Stop);
    }
}

#[test]
fn processes_that_are_stopped_killed_and_fed_with_garbage_keep_the_invariants() {
    let seconds = length("OQTAL_TEST_SOAK_S", 8);
    let mut random = Random(length("OQTAL_TEST_SOAK_SEED", 1));
    let mut laboratory = Laboratory::new(&mut random, seconds);
    let mut watch = Watch::new(&laboratory);
    let mut count = Count::default();
    let (began, mut flights) = (Instant::now(), 0);
    let mut settled = ResourceRecord::default();
    while count.flown == 0 || began.elapsed() < Duration::from_secs(seconds) {
        laboratory.restart_plant();
        let is_ready = |watch: &Watch| watch.is_fresh && watch.mode == Mode::Disarmed.code();
        assert!(until(&mut watch, TIMEOUT_TICKS, is_ready), "the daemon gets no poses");
        until(&mut watch, SETTLING_TICKS, |_| false);
        laboratory.revive();
        settled.add(laboratory.resources(), flights);
        flight(&mut laboratory, &mut watch, &mut random, &mut count);
        flights += 1;
        watch.assert_sound();
        // Some are stopped by failed poses before take-off.
        let enough = if flights < FEW_FLIGHTS { 0 } else { flights / 3 };
        assert!(count.flown >= enough, "{flights} flights: {count:?}");
    }
    println!(
        "{flights} flights in {} s: {count:?}; {} commands, {} ticks, {} poses refused; {:?}",
        began.elapsed().as_secs(),
        watch.commands,
        watch.ticks,
        watch.refused,
        settled,
    );
    if flights >= MANY_FLIGHTS {
        assert!(count.landed > 0 && count.stopped > 0 && count.kills > 0 && count.stops > 0);
        assert!(watch.refused > 0, "no fault of the poses was seen");
    }
    // Its readers are part of the instance.
    drop(watch);
    laboratory.end();
}
