//! The gate of frames: forwarded frames and counted ones.

use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, ReceiverOptions, StampSource};
use oqtal_receiver::gate::{DatedFrame, FrameCounts, FrameGate, FrameRefusal, FrameStamp};

/// A gate and a server with 100 frames a second whose clock is 5 s ahead.
struct Feed {
    gate: FrameGate,
}

impl Feed {
    fn new(options: &ReceiverOptions) -> Self {
        Self { gate: FrameGate::new(options) }
    }

    /// Shows frame `number` of the grid, `late_ms` after it was captured.
    fn show(&mut self, number: u32, late_ms: i64) -> Result<DatedFrame, FrameRefusal> {
        let captured_ms = i64::from(number) * 10;
        let arrival = Time::VIRTUAL_START + Span::from_millis(captured_ms + late_ms);
        let stamp_ns = Some((captured_ms + 5000).unsigned_abs() * 1_000_000);
        self.gate.check(FrameStamp { number: Some(number), stamp_ns }, arrival)
    }

    /// A feed whose clock is known, after frame 100.
    fn known() -> Self {
        let mut feed = Self::new(&Config::default().receiver);
        for number in 1..=100 {
            let _ = feed.show(number, 1);
        }
        assert!(feed.gate.clock().is_known);
        feed
    }
}

#[test]
fn f50_lost_repeated_and_overtaken_frames_are_counted_and_dropped() {
    let mut feed = Feed::known();
    let before = feed.gate.counts();
    assert_eq!(feed.show(101, 1).unwrap().frame, 101);
    assert_eq!(feed.show(101, 2), Err(FrameRefusal::Repeated));
    assert_eq!(feed.show(105, 1).unwrap().frame, 105);
    assert_eq!(feed.show(103, 25), Err(FrameRefusal::OutOfOrder));
    assert_eq!(feed.show(106, 1).unwrap().frame, 106);
    let expected = FrameCounts {
        arrived: before.arrived + 5,
        lost: before.lost + 3,
        repeated: 1,
        out_of_order: 1,
        ..before
    };
    assert_eq!(feed.gate.counts(), expected);
}

#[test]
fn a_frame_that_waited_too_long_does_not_go_on() {
    let mut feed = Feed::known();
    assert_eq!(feed.show(101, 52), Err(FrameRefusal::Late));
    assert!(feed.show(107, 1).is_ok());
    assert_eq!(feed.gate.counts().late, 1);
}

#[test]
fn a_restarted_count_is_followed_and_frame_numbers_do_not_decrease() {
    let mut feed = Feed::known();
    let mut gone_on = Vec::new();
    for k in 1..=30_u32 {
        // The same clock, another count.
        let arrival = Time::VIRTUAL_START + Span::from_millis(i64::from(100 + k) * 10 + 1);
        let stamp_ns = Some(u64::from(100 + k) * 10_000_000 + 5_000_000_000);
        if let Ok(dated) = feed.gate.check(FrameStamp { number: Some(k), stamp_ns }, arrival) {
            gone_on.push(dated.frame);
        }
    }
    assert_eq!(gone_on.first(), Some(&101));
    assert!(gone_on.len() == 26 && gone_on.is_sorted(), "{gone_on:?}");
    assert_eq!(feed.gate.counts().restarts, 1);
}

#[test]
fn numbers_of_32_bits_wrap_around_without_a_loss() {
    let mut gate = FrameGate::new(&ReceiverOptions {
        stamps: StampSource::Arrival,
        ..Config::default().receiver
    });
    let mut at = Time::VIRTUAL_START;
    for number in [u32::MAX - 1, u32::MAX, 0, 1] {
        at = at + Span::from_millis(10);
        let dated = gate.check(FrameStamp { number: Some(number), stamp_ns: None }, at).unwrap();
        assert_eq!(at.since(dated.captured.captured_at), Span::from_millis(5));
    }
    assert_eq!((gate.counts().lost, gate.counts().restarts), (0, 0));
}

#[test]
fn frames_without_stamps_are_refused_unless_arrivals_are_asked_for() {
    let mut feed = Feed::new(&Config::default().receiver);
    let bare = FrameStamp { number: None, stamp_ns: None };
    assert_eq!(feed.gate.check(bare, Time::VIRTUAL_START), Err(FrameRefusal::Contradiction));
}
