//! Flights in real time on a loaded machine, replayed: every command must agree bit for bit. A separate test program, since its
//! load would disturb other tests. `REPLAYED_FLIGHTS` sets the number of flights.
#![allow(clippy::disallowed_methods, reason = "tests have time-outs")]

#[allow(dead_code, reason = "this program uses a part")]
mod common;

use std::sync::atomic::{AtomicBool, Ordering};

use common::{Testbed, number, stderr};
use serde_json::Value;

const LAWS: [&str; 5] = ["oqtal", "oqtal-dt", "pid", "lqr", "geometric"];
/// Missing and wrong poses.
const ROUGH: [&str; 4] =
    ["--set", "mocap.dropout-probability=0.05", "--set", "mocap.outlier-probability=0.02"];

/// Settings by kind of flight: slow turns, missed deadlines and poses altered at the daemon; through the bridge; unchanged.
fn kind(number: usize) -> &'static [&'static str] {
    match number % 4 {
        0 => &[
            "--fault",
            "daemon:slow=25ms@0+1",
            "--fault",
            "pose:wrong=0.01m@2.5+0.3",
            // A pose read later than a period after its publication: its deadline is missed under any load.
            "--fault",
            "pose:delayed=20ms@3+0.2",
        ],
        1 => &["--vehicle", "bridge:asctec"],
        _ => &[],
    }
}

/// Runs `work` under load: one busy thread per processor, and one more.
fn under_load<T>(work: impl FnOnce() -> T) -> T {
    let threads = std::thread::available_parallelism().map_or(1, usize::from) + 1;
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        let result = work();
        is_over.store(true, Ordering::Relaxed);
        result
    })
}

/// Flies once and replays; returns the result of the replay.
fn fly_and_replay(number: usize) -> Value {
    let testbed = Testbed::new("busy");
    let seed = number.to_string();
    let flight = ["--trajectory", "hover", "--duration", "1", "--seed", &seed, "--out", "d"];
    let law = ["--controller", LAWS[number % LAWS.len()]];
    let output = testbed.fly(&[&flight, &law[..], &ROUGH[..], kind(number)].concat());
    assert!(testbed.path("d/flight.mcap").exists(), "{}", stderr(&output));
    serde_json::from_str(&testbed.succeeds(&["replay", "--json", "d/flight.mcap"])).unwrap()
}

#[test]
fn flights_on_a_busy_machine_replay_bit_for_bit() {
    let flights = std::env::var("REPLAYED_FLIGHTS").ok().and_then(|text| text.parse().ok());
    let mut missed = 0.0;
    for flight in 0..flights.unwrap_or(2) {
        let result = under_load(|| fly_and_replay(flight));
        let figure = |name: &str| number(&result, name);
        println!(
            "flight {flight:>2}, {:<9} {:<14}: {} ticks, {} identical, {} deadlines missed",
            LAWS[flight % LAWS.len()],
            kind(flight).first().map_or("", |_| kind(flight)[1]),
            figure("/ticks"),
            figure("/identical"),
            figure("/deadline_misses"),
        );
        // The load may end a flight early, or keep it on the ground.
        assert!(figure("/ticks") > 0.0, "{result}");
        assert_eq!(result["identical"], result["ticks"], "{result}");
        assert_eq!((figure("/unmatched"), figure("/missing")), (0.0, 0.0), "{result}");
        missed += figure("/deadline_misses");
    }
    assert!(missed > 0.0, "no deadline was missed");
}
