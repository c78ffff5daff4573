//! The estimator of a server's clock in virtual time: against clocks whose truth is known.

pub mod server;

use oqtal_bus::time::Span;
use oqtal_receiver::clock::{CaptureTime, ServerClock, StampVerdict};
use server::{Jitter, LEAST_DELAY, Server};

/// Errors \[ns\] of the frames after `from_s` seconds, beyond the least delay.
fn errors_after(from_s: f64, server: &mut Server, clock: &mut ServerClock) -> Vec<i64> {
    let mut errors = Vec::new();
    let end = server.frame + (20.0 * server.rate_hz) as u64;
    while server.frame < end {
        let (captured, stamp_ns, arrival) = server.next();
        if let StampVerdict::Known(CaptureTime { captured_at, .. }) =
            clock.observe(stamp_ns, arrival)
        {
            assert!(captured_at <= arrival, "captured after it arrived");
            if server.frame as f64 > from_s * server.rate_hz {
                errors.push((captured_at.since(captured) - LEAST_DELAY).nanos().abs());
            }
        }
    }
    errors.sort_unstable();
    errors
}

fn p99(sorted: &[i64]) -> i64 {
    sorted[(sorted.len() - 1) * 99 / 100]
}

#[test]
fn capture_is_known_within_300_us_after_five_seconds() {
    for jitter in [Jitter::Uniform, Jitter::Exponential, Jitter::Stalls] {
        for drift in [-100e-6, 0.0, 37e-6, 100e-6] {
            for seed in 0..8 {
                let mut server = Server::new(seed, drift, jitter);
                let mut clock = ServerClock::new(Span::ZERO);
                let errors = errors_after(5.0, &mut server, &mut clock);
                assert!(errors.len() > 800);
                let p99 = p99(&errors);
                assert!(p99 <= 300_000, "{jitter:?} {drift} {seed}: {p99} ns");
                let state = clock.state();
                let expected_ppm = (1.0 / (1.0 + drift) - 1.0) * 1e6;
                assert!((state.drift_ppm - expected_ppm).abs() < 15.0, "{jitter:?}: {state:?}");
            }
        }
    }
}

#[test]
fn the_uncertainty_is_kept_by_99_frames_of_100() {
    for jitter in [Jitter::Uniform, Jitter::Exponential, Jitter::Stalls] {
        let (mut within, mut all) = (0, 0);
        for seed in 0..20 {
            let mut server = Server::new(seed, 60e-6, jitter);
            let mut clock = ServerClock::new(Span::ZERO);
            for _ in 0..600 {
                let (captured, stamp_ns, arrival) = server.next();
                if let StampVerdict::Known(known) = clock.observe(stamp_ns, arrival) {
                    let error = known.captured_at.since(captured) - LEAST_DELAY;
                    all += 1;
                    within += u32::from(error.nanos().abs() <= known.uncertainty.nanos());
                }
            }
        }
        assert!(f64::from(within) >= 0.99 * f64::from(all), "{jitter:?}: {within} of {all}");
    }
}

#[test]
fn f53_a_jump_of_one_second_is_learned_within_two_and_no_frame_is_dated_wrong() {
    for (jump_ns, seed) in [(1_000_000_000_i64, 1), (-1_000_000_000, 2), (3_600_000_000_000, 3)] {
        let mut server = Server::new(seed, 50e-6, Jitter::Uniform);
        let mut clock = ServerClock::new(Span::ZERO);
        errors_after(5.0, &mut server, &mut clock);
        server.offset_ns = server.offset_ns.wrapping_add_signed(jump_ns);
        let jumped = server.frame;
        let mut known_again = None;
        for _ in 0..600 {
            let (captured, stamp_ns, arrival) = server.next();
            if let StampVerdict::Known(known) = clock.observe(stamp_ns, arrival) {
                let error = known.captured_at.since(captured).nanos().abs();
                assert!(error < 5_000_000, "{jump_ns}: dated wrong by {error} ns");
                known_again.get_or_insert(server.frame);
            }
        }
        let frames = known_again.expect("the clock is learned again") - jumped;
        assert!(frames <= 2 * 60, "{jump_ns}: {frames} frames");
        assert_eq!(clock.state().relearned, 1);
    }
}

#[test]
fn a_single_wrong_stamp_and_frames_out_of_order_are_held_back_and_change_nothing() {
    let mut server = Server::new(4, 0.0, Jitter::Exponential);
    let mut clock = ServerClock::new(Span::ZERO);
    errors_after(5.0, &mut server, &mut clock);
    let before = clock.state();
    let (_, stamp_ns, arrival) = server.next();
    let (_, _, later) = server.next();
    assert_eq!(clock.observe(stamp_ns + 800_000_000, arrival), StampVerdict::Contradiction);
    assert_eq!(clock.observe(stamp_ns - 900_000_000, later), StampVerdict::Contradiction);
    assert_eq!(clock.state(), before);
    let (_, stamp_ns, arrival) = server.next();
    assert!(matches!(clock.observe(stamp_ns, arrival), StampVerdict::Known(_)));
}

#[test]
fn a_queue_that_is_never_drained_is_old_and_not_a_clock_that_was_set() {
    let mut server = Server::new(5, 0.0, Jitter::Exponential);
    let mut clock = ServerClock::new(Span::ZERO);
    errors_after(5.0, &mut server, &mut clock);
    for _ in 0..300 {
        let (captured, stamp_ns, arrival) = server.next();
        let verdict = clock.observe(stamp_ns, arrival + Span::from_millis(80));
        let StampVerdict::Known(known) = verdict else { panic!("{verdict:?}") };
        assert!(known.captured_at.since(captured).nanos().abs() < 400_000, "{known:?}");
    }
}

#[test]
fn the_configured_latency_lies_between_capture_and_the_fastest_arrival() {
    let mut server = Server::new(6, 0.0, Jitter::Exponential);
    let mut clock = ServerClock::new(Span::from_millis(12));
    for _ in 0..600 {
        let (captured, stamp_ns, arrival) = server.next();
        if let StampVerdict::Known(known) = clock.observe(stamp_ns, arrival) {
            let early = captured.since(known.captured_at) + LEAST_DELAY;
            assert!((early.nanos() - 12_000_000).abs() < 2_500_000, "{early:?}");
        }
    }
}

#[test]
fn the_clock_of_a_silent_server_is_learned_again() {
    let mut server = Server::new(7, 0.0, Jitter::Uniform);
    let mut clock = ServerClock::new(Span::ZERO);
    errors_after(5.0, &mut server, &mut clock);
    server.frame += 90;
    let (_, stamp_ns, arrival) = server.next();
    assert_eq!(clock.observe(stamp_ns, arrival), StampVerdict::Learning);
    assert_eq!(clock.state().relearned, 0, "it was not set");
}
