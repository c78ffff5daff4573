//! Processes killed at random instants on one instance: the next start succeeds, and nothing of them stays in shared memory.
//! OQTAL_TEST_KILLS sets the kills per seed, OQTAL_TEST_KILL_SEEDS the number of seeds.

use std::time::{Duration, Instant};

use crate::common::random::{Random, length};
use crate::common::{Running, SERVICES, Testbed, children, is_alive, stderr, wait_for};
use crate::lost_files;
use oqtal_bus::code::SafetyState;
use oqtal_bus::remains::{self, SHARED_MEMORY};
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;

/// Number of killed flights before one that lands.
const KILLS_PER_LANDING: u64 = 25;

/// Waits for up to half a second.
fn pause(random: &mut Random) {
    std::thread::sleep(Duration::from_micros(random.below(500_000)));
}

fn start(testbed: &Testbed, process: &str) -> Running {
    testbed.start(&[process, "run"])
}

/// Starts the processes that do not run, and waits until the running daemon is in the state Nominal.
fn all_work(testbed: &Testbed, running: &mut [Option<Running>; 3]) {
    for (slot, process) in running.iter_mut().zip(SERVICES) {
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
    assert_eq!(output.status.code(), None, "ended by itself: {}", stderr(&output));
}

/// Number of kills per seed, `short` unless the study of docs/faults.md is run, and number of seeds.
fn study(short: u64) -> (u64, u64) {
    (length("OQTAL_TEST_KILLS", short), length("OQTAL_TEST_KILL_SEEDS", 1))
}

/// Starts all processes again and prints the time taken; in the study of docs/faults.md it must be at most 5 s.
fn starts_again(testbed: &Testbed, running: &mut [Option<Running>; 3], what: &str) {
    let began = Instant::now();
    all_work(testbed, running);
    let took = began.elapsed();
    println!("{what}: the next start took {} ms", took.as_millis());
    assert!(
        length("OQTAL_TEST_KILLS", 0) == 0 || took < Duration::from_secs(5),
        "{what}: {took:?}"
    );
}

/// Ends all processes, and checks that no files remain.
fn ends_without_remains(testbed: &Testbed, running: [Option<Running>; 3]) {
    for process in running.into_iter().flatten().rev() {
        process.signal(Signal::TERM);
        let output = process.wait();
        assert!(output.status.success(), "{}", stderr(&output));
    }
    assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
    assert!(!testbed.paths().directory().exists());
}

/// Kills a flight: its main process, one of its children, all children, or all processes; waits until all have ended.
fn kill_flight(flight: Running, random: &mut Random) {
    let mut family = children(flight.id());
    let door = flight.id();
    let victims: Vec<u32> = match (random.below(4), family.is_empty()) {
        (0, _) | (_, true) => vec![door],
        (1, false) => vec![random.pick(&family)],
        (2, false) => family.clone(),
        (_, false) => family.iter().copied().chain([door]).collect(),
    };
    for &victim in &victims {
        // The process may already have ended with another one.
        let pid = rustix::process::Pid::from_raw(victim.cast_signed()).unwrap();
        let _ = rustix::process::kill_process(pid, Signal::KILL);
    }
    let output = flight.wait();
    let by_itself = output.status.code().is_some() && victims.contains(&door);
    assert!(!by_itself, "ended by itself: {}", stderr(&output));
    family.retain(|&pid| is_alive(pid));
    wait_for("the end of the children", || family.iter().all(|&pid| !is_alive(pid)).then_some(()));
}

#[test]
fn f29_flights_killed_at_random_instants_leave_nothing_after_the_next_flight() {
    let (kills, seeds) = study(4);
    for seed in 1..=seeds {
        let testbed = Testbed::new("doors");
        let mut random = Random(seed);
        for number in 1..=kills {
            let flight = testbed.start(&["fly", "--trajectory", "hover", "--duration", "60"]);
            // Most are killed while they start, the others in the air.
            let rounds = if random.one_in(4) { 8 } else { 1 };
            (0..rounds).for_each(|_| pause(&mut random));
            kill_flight(flight, &mut random);
            if number.is_multiple_of(KILLS_PER_LANDING) || number == kills {
                testbed.lands(&["--trajectory", "hover", "--duration", "1", "--clock", "lockstep"]);
                assert_eq!(testbed.remains(), [""; 0], "after {number} kills, seed {seed}");
                assert!(!testbed.paths().directory().exists());
            }
        }
        println!("{kills} killed flights, seed {seed}: nothing of them is left after each landing");
    }
}

#[test]
fn f29_processes_killed_while_they_start_do_not_hinder_the_next() {
    let (kills, seeds) = study(6);
    for seed in 1..=seeds {
        let testbed = Testbed::new("kills");
        let mut random = Random(seed + 28);
        for _ in 0..kills {
            let started = SERVICES.map(|process| start(&testbed, process));
            pause(&mut random);
            for process in started {
                kill(Some(process));
            }
        }
        let mut running = [None, None, None];
        starts_again(&testbed, &mut running, &format!("{kills} times all processes, seed {seed}"));
        ends_without_remains(&testbed, running);
    }
}

#[test]
fn f29_a_process_killed_while_it_starts_does_not_hinder_the_others() {
    let (kills, seeds) = study(15);
    for seed in 1..=seeds {
        let testbed = Testbed::new("singles");
        let mut random = Random(seed + 6);
        let mut running = [None, None, None];
        all_work(&testbed, &mut running);
        for _ in 0..kills {
            let which = random.below(3) as usize;
            kill(running[which].take());
            let started = start(&testbed, SERVICES[which]);
            pause(&mut random);
            kill(Some(started));
        }
        starts_again(&testbed, &mut running, &format!("{kills} single processes, seed {seed}"));
        ends_without_remains(&testbed, running);
    }
}

/// Waits until shared memory contains only the run of the processes that run.
fn only_one_run_is_left(testbed: &Testbed) {
    wait_for("the removal of earlier runs", || {
        let runs = remains::runs(SHARED_MEMORY.as_ref(), &testbed.paths().prefix());
        (runs.len() == 1 && runs[0].is_alive()).then_some(())
    });
}

/// Removes one file of the instance, in its directory or in shared memory, or all of either.
fn remove_something(testbed: &Testbed, random: &mut Random) {
    let directory = testbed.paths().directory();
    let mut files = lost_files::objects(testbed);
    let names = ["members", "shared", "shared/services", "shared/nodes", ""];
    files.extend(names.map(|name| directory.join(name)));
    match random.below(8) {
        0 => lost_files::objects(testbed).iter().for_each(lost_files::remove),
        _ => lost_files::remove(&files[random.below(files.len() as u64) as usize]),
    }
}

#[test]
fn f68_processes_killed_between_removals_of_their_files_start_again_and_stop() {
    let (kills, seeds) = study(3);
    for seed in 1..=seeds {
        let testbed = Testbed::new("removals");
        let mut random = Random(seed + 91);
        let mut running = [None, None, None];
        for number in 0..kills {
            lost_files::work_again(&testbed, &mut running);
            only_one_run_is_left(&testbed);
            remove_something(&testbed, &mut random);
            let stop = testbed.oqtal(&["ctl", "stop"]).output().unwrap();
            // After an earlier loss the vehicle's process may just have left, with its motors off.
            let has_left = !running[0].as_ref().is_some_and(Running::runs);
            assert!(stop.status.success() || has_left, "{number}: {}", stderr(&stop));
            let which = random.below(4) as usize;
            let victims = if which < 3 { which..which + 1 } else { 0..3 };
            pause(&mut random);
            for process in running[victims].iter_mut().filter_map(Option::take) {
                process.signal(Signal::KILL);
                drop(process.wait());
            }
        }
        // A process that has lost a file may be about to end: it is not one of the last start.
        for process in running.iter_mut().filter_map(Option::take) {
            process.signal(Signal::KILL);
            drop(process.wait());
        }
        lost_files::work_again(&testbed, &mut running);
        only_one_run_is_left(&testbed);
        println!("{kills} kills, seed {seed}: every start and every stop worked");
        ends_without_remains(&testbed, running);
    }
}
