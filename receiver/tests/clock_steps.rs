//! Steps of a server's clock of any size, forward and back, against delays that grow by as much.

use crate::clock::server::{self, Jitter, LEAST_DELAY, Server};
use oqtal_bus::time::{Span, Time};
use oqtal_receiver::clock::{ServerClock, StampVerdict};
use proptest::prelude::*;

/// Frames that are dated around a change: errors \[ns\] of those in the first two seconds behind it, and of those later.
#[derive(Default)]
struct Dated {
    soon: Vec<i64>,
    later: Vec<i64>,
    /// Errors of a clock that was unknown at the change.
    later_again: Vec<i64>,
    /// Number of times the clock was estimated again after the change.
    relearned: u64,
}

/// Eight seconds of frames, a change, and eight seconds more, whose stamps are set by `step_ns` and whose delays grow by `slower`.
fn around(mut server: Server, (step_ns, slower): (i64, Span)) -> Dated {
    let mut clock = ServerClock::new(Span::ZERO);
    let mut fresh = ServerClock::new(Span::ZERO);
    let frames = (8.0 * server.rate_hz) as u64;
    let soon = frames..frames + (2.0 * server.rate_hz) as u64;
    let mut dated = Dated::default();
    for frame in 0..2 * frames {
        if frame == frames {
            dated.relearned = clock.state().relearned;
            server.offset_ns = server.offset_ns.wrapping_add_signed(step_ns);
        }
        let (captured, stamp_ns, arrival) = server.next();
        let behind = frame >= frames;
        let arrival = arrival + if behind { slower } else { Span::ZERO };
        let error = |verdict| match verdict {
            StampVerdict::Known(known) => {
                assert!(known.captured_at <= arrival, "captured after it arrived");
                Some((known.captured_at.since(captured) - LEAST_DELAY).nanos().abs())
            }
            _ => None,
        };
        let of_clock = error(clock.observe(stamp_ns, arrival));
        if soon.contains(&frame) {
            dated.soon.extend(of_clock);
        } else if behind {
            dated.later.extend(of_clock);
        }
        if behind {
            let of_fresh = error(fresh.observe(stamp_ns, arrival));
            dated.later_again.extend(of_fresh.filter(|_| !soon.contains(&frame)));
        }
    }
    dated.relearned = clock.state().relearned - dated.relearned;
    dated.soon.sort_unstable();
    dated.later.sort_unstable();
    dated.later_again.sort_unstable();
    dated
}

/// Number of the jitter with stalls.
const STALLS: usize = 2;

fn server(seed: u64, rate_hz: f64, jitter: usize) -> Server {
    let jitter = [Jitter::Uniform, Jitter::Exponential, Jitter::Stalls][jitter];
    let mut server = Server::new(seed, 40e-6, jitter);
    server.rate_hz = rate_hz;
    server
}

fn p99(sorted: &[i64]) -> i64 {
    sorted[(sorted.len() - 1) * 99 / 100]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn f53_a_step_of_any_size_is_over_after_two_seconds(
        (exponent, back, seed) in (0.0..1.0_f64, any::<bool>(), any::<u64>()),
        (rate_hz, jitter) in (prop::sample::select(vec![60.0, 100.0, 240.0]), 0..3_usize),
    ) {
        // From 2 ms to 2 s, as many small ones as great ones.
        let step_ns = (2e6 * 1000_f64.powf(exponent)) as i64;
        let step_ns = if back { -step_ns } else { step_ns };
        let dated = around(server(seed, rate_hz, jitter), (step_ns, Span::ZERO));
        let frames = (6.0 * rate_hz) as usize;
        prop_assert!(dated.later.len() >= frames * 9 / 10, "{step_ns}: {} known", dated.later.len());
        let late = p99(&dated.later);
        // Six seconds of frames do not always show the clock to 0.6 ms: then one that knew nothing before the step is hardly better,
        // which has seen the frames that were held back besides.
        let bound = (p99(&dated.later_again).max(600_000) + 100_000).min(800_000);
        prop_assert!(late <= bound, "{step_ns} ns at {rate_hz} Hz: {late} ns, bound {bound} ns");
        // Until a small step is known its frames are dated wrong by it, and never by more than that.
        let greatest = dated.soon.last().copied().unwrap_or(0);
        // Frames that queue in a stall do not arrive before they were captured, however their clock was set.
        prop_assert!(jitter == STALLS || greatest <= 26_000_000, "{step_ns} ns: {greatest} ns");
    }

    #[test]
    fn a_delay_that_grew_by_any_amount_is_not_a_step(
        // With a stall more it would be a silence.
        (slower_ms, seed) in (2..450_i64, any::<u64>()),
        (rate_hz, jitter) in (prop::sample::select(vec![60.0, 100.0, 240.0]), 0..3_usize),
    ) {
        let slower = Span::from_millis(slower_ms);
        let dated = around(server(seed, rate_hz, jitter), (0, slower));
        prop_assert_eq!(dated.relearned, 0, "{} ms", slower_ms);
        // A line of the greatest slope follows a delay by 2 ms in 10 s.
        let greatest = p99(&dated.later);
        prop_assert!(greatest <= 2_500_000, "{slower_ms} ms: {greatest} ns");
    }
}

/// While a clock is being estimated, its line falls.
#[test]
fn a_start_is_hardly_ever_taken_for_a_step() {
    for (rate_hz, jitter) in [60.0, 240.0].into_iter().flat_map(|hz| (0..2).map(move |j| (hz, j))) {
        let relearned = |seed| {
            let (mut server, mut clock) =
                (server(seed, rate_hz, jitter), ServerClock::new(Span::ZERO));
            for _ in 0..(20.0 * rate_hz) as u64 {
                let (_, stamp_ns, arrival) = server.next();
                clock.observe(stamp_ns, arrival);
            }
            clock.state().relearned
        };
        let relearned: u64 = (0..100).map(relearned).sum();
        assert!(relearned <= 6, "{rate_hz} Hz, jitter {jitter}: {relearned} of 100");
    }
}

/// A clock that is slewed, in a network whose delays differ by some 10 us.
#[test]
fn a_clock_that_is_slewed_forward_within_a_second_is_followed() {
    for slew_ns in [2e6, 3e6, 5e6, 15e6] {
        let (mut random, mut clock) = (server::Random(7), ServerClock::new(Span::ZERO));
        let mut late = Vec::new();
        for frame in 0..50 * 240_u64 {
            let t_s = frame as f64 / 240.0;
            let captured = Time::VIRTUAL_START + Span::from_seconds(t_s);
            let arrival = captured + Span::from_seconds(1e-4 + 2e-5 * random.uniform());
            let stamp_ns =
                1_000_000_000 + (t_s * 1e9 + (t_s - 30.0).clamp(0.0, 1.0) * slew_ns) as u64;
            if let StampVerdict::Known(known) = clock.observe(stamp_ns, arrival)
                && t_s > 33.0
            {
                late.push((known.captured_at.since(captured) - LEAST_DELAY).nanos().abs());
            }
        }
        late.sort_unstable();
        assert_eq!(late.len(), 17 * 240 - 1);
        assert!(p99(&late) <= 300_000, "{slew_ns} ns: {} ns", p99(&late));
    }
}

/// Behind a step the line falls as behind a start.
#[test]
fn a_small_step_forward_is_noticed_once() {
    for (rate_hz, jitter) in [60.0, 240.0].into_iter().flat_map(|hz| (0..2).map(move |j| (hz, j))) {
        let relearned =
            |seed| around(server(seed, rate_hz, jitter), (3_000_000, Span::ZERO)).relearned;
        let relearned: Vec<u64> = (0..100).map(relearned).collect();
        let once = relearned.iter().filter(|count| **count == 1).count();
        assert!(once >= 94, "{rate_hz} Hz, jitter {jitter}: {relearned:?}");
    }
}
