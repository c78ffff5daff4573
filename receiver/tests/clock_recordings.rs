//! The estimator of a server's clock against the arrivals of real rooms: jitter, stalls, and poses that come queued behind them.
//!
//! `OQTAL_RECORDINGS=DIRECTORY` adds the CSV files of a directory, whose first column is the arrival \[s\].

use oqtal_bus::time::{Span, Time};
use oqtal_receiver::clock::{ServerClock, StampVerdict};

/// Intervals between arrivals \[ms\], as they are in a room whose frames are taken at 240 Hz, sent about every 15 ms and polled every
/// 10 ms, with a stall of 0.4 s behind which poses come queued.
const INTERVALS_MS: [f64; 48] = [
    19.9, 10.1, 20.3, 19.8, 9.9, 20.0, 30.2, 10.0, 9.8, 20.1, 20.0, 10.2, 0.6, 29.4, 19.9, 10.3,
    19.8, 20.0, 10.1, 9.7, 31.0, 19.4, 20.2, 9.8, 10.0, 20.1, 404.2, 0.4, 3.1, 0.5, 2.8, 9.9, 20.2,
    19.7, 10.4, 20.0, 9.6, 29.9, 10.1, 20.3, 10.0, 19.8, 20.1, 41.2, 8.7, 10.2, 19.9, 10.1,
];
/// Least delay from capture to arrival: what no client can see.
const LEAST_DELAY: Span = Span::from_millis(8);
/// The cameras' period.
const GRID_NS: i64 = 4_166_667;
/// Frames that come at once were taken so far apart.
const QUEUED_NS: i64 = 3 * GRID_NS;

/// A frame: true instant of capture and arrival.
type Frame = (Time, Time);

/// The frames of a room with these arrivals \[ns\]. Captures are not in a recording: each is taken to be the newest frame of a 240 Hz
/// grid that can have arrived then, and of frames that come at once the earlier ones are older.
fn frames(arrivals_ns: &[i64]) -> Vec<Frame> {
    let mut frames = Vec::with_capacity(arrivals_ns.len());
    let mut next = i64::MAX;
    for arrival in arrivals_ns.iter().rev() {
        let newest = (arrival - LEAST_DELAY.nanos()).div_euclid(GRID_NS) * GRID_NS;
        let captured = newest.min(next - QUEUED_NS);
        next = captured;
        let at = |ns: i64| Time::VIRTUAL_START + Span::from_nanos(1_000_000_000 + ns);
        frames.push((at(captured), at(*arrival)));
    }
    frames.reverse();
    frames
}

/// Arrivals for two minutes from a list of intervals, again and again.
fn repeated(intervals_ms: &[f64]) -> Vec<i64> {
    let mut at_ns = 0.0;
    let arrivals = intervals_ms.iter().cycle().map(|interval| {
        at_ns += interval * 1e6;
        at_ns as i64
    });
    arrivals.take_while(|at| *at < 120_000_000_000).collect()
}

/// The rooms: ours, and those of the directory that is named.
fn rooms() -> Vec<(String, Vec<Frame>)> {
    let mut rooms = vec![("ours".to_owned(), frames(&repeated(&INTERVALS_MS)))];
    let Some(directory) = std::env::var_os("OQTAL_RECORDINGS") else { return rooms };
    for entry in std::fs::read_dir(directory).unwrap().flatten() {
        let path = entry.path();
        if path.extension().is_some_and(|extension| extension == "csv") {
            let text = std::fs::read_to_string(&path).unwrap();
            // A last line may be cut off.
            let whole = text.lines().filter(|line| line.split(',').count() == 8);
            let times = whole.filter_map(|line| line.split(',').next()?.parse().ok());
            let times: Vec<f64> = times.collect();
            let ns = times.iter().map(|at: &f64| ((at - times[0]) * 1e9) as i64);
            rooms.push((path.display().to_string(), frames(&ns.collect::<Vec<_>>())));
        }
    }
    rooms
}

/// A server's clock with an offset and a drift.
fn stamp_ns(captured: Time, drift: f64, offset_ns: i64) -> u64 {
    let true_s = captured.since(Time::VIRTUAL_START).seconds();
    ((true_s * (1.0 + drift) * 1e9) as i64 + offset_ns).unsigned_abs()
}

#[test]
fn capture_is_known_within_300_us_after_five_seconds_of_a_real_room() {
    for (name, frames) in rooms() {
        for drift in [-100e-6, 0.0, 100e-6] {
            let mut clock = ServerClock::new(Span::ZERO);
            let (mut errors, mut held) = (Vec::new(), 0);
            for (captured, arrival) in &frames {
                let stamp = stamp_ns(*captured, drift, 77_000_000_000);
                match clock.observe(stamp, *arrival) {
                    StampVerdict::Known(known) => {
                        assert!(known.captured_at <= *arrival, "{name}: captured after it arrived");
                        if captured.since(frames[0].0) > Span::from_millis(5000) {
                            let error = known.captured_at.since(*captured) - LEAST_DELAY;
                            errors.push(error.nanos().abs());
                        }
                    }
                    _ => held += 1,
                }
            }
            errors.sort_unstable();
            let p99 = errors[(errors.len() - 1) * 99 / 100];
            println!("{name}, {drift:e}: p99 {p99} ns of {} frames, {held} held", errors.len());
            assert!(p99 <= 300_000, "{name}, {drift}: {p99} ns");
            assert!(held < 60, "{name}, {drift}: {held} frames held back");
        }
    }
}

#[test]
fn a_jump_of_one_second_is_learned_within_two_in_a_real_room() {
    for (name, frames) in rooms() {
        for jump_ns in [1_000_000_000, -1_000_000_000] {
            let mut clock = ServerClock::new(Span::ZERO);
            let jump_at = frames[frames.len() / 2].0;
            let mut known_again = None;
            for (captured, arrival) in &frames {
                let jumped = *captured >= jump_at;
                let offset_ns = 77_000_000_000 + if jumped { jump_ns } else { 0 };
                let verdict = clock.observe(stamp_ns(*captured, 50e-6, offset_ns), *arrival);
                let StampVerdict::Known(known) = verdict else { continue };
                let error = (known.captured_at.since(*captured) - LEAST_DELAY).nanos().abs();
                assert!(error < 20_000_000, "{name}: dated wrong by {error} ns");
                if jumped {
                    known_again.get_or_insert(captured.since(jump_at));
                }
            }
            let after = known_again.expect("the clock is learned again");
            println!("{name}, {jump_ns} ns: known again after {:.2} s", after.seconds());
            assert!(after <= Span::from_millis(2000), "{name}, {jump_ns}: {after:?}");
        }
    }
}
