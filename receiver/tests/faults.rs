//! Faults between cameras and receiver, in virtual time: what is published, what is not.

use oqtal_bus::message::Stamps;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_receiver::gate::FrameStamp;
use oqtal_receiver::{FrameSink, MeasuredBody, PoseReceiver};
use oqtal_runtime::pose_source::Delivery;
use oqtal_wire::motion::RigidPose;

/// Interval of the frames: 100 Hz.
const INTERVAL: Span = Span::from_millis(10);
/// Least delay from capture to arrival: the configured latency of the cameras.
const LATENCY: Span = Span::from_millis(5);
/// Offset of the server's clock \[ns\].
const AHEAD_NS: u64 = 77_000_000_000;

/// A camera system whose body moves along x, one metre a second.
struct Cameras {
    receiver: PoseReceiver,
    frame: u32,
}

impl Cameras {
    /// Cameras whose clock is known to the receiver.
    fn known() -> Self {
        let receiver = PoseReceiver::new(&Config::default().receiver, 1);
        let mut cameras = Self { receiver, frame: 0 };
        for _ in 0..100 {
            cameras.next(true);
        }
        assert!(cameras.receiver.clock(0).is_known);
        cameras
    }

    fn captured_at(frame: u32) -> Time {
        Time::VIRTUAL_START + Span::from_nanos(INTERVAL.nanos() * i64::from(frame))
    }

    /// Shows frame `frame`, which arrives `late` after its latency.
    fn show(&mut self, frame: u32, tracked: bool, late: Span) -> Option<Delivery> {
        self.arrive(frame, tracked, Self::captured_at(frame) + LATENCY + late);
        self.receiver.take(0)
    }

    fn arrive(&mut self, frame: u32, tracked: bool, arrival: Time) {
        let stamp_ns = Some(Self::captured_at(frame).nanos() + AHEAD_NS);
        self.receiver.frame(0, FrameStamp { number: Some(frame), stamp_ns }, arrival);
        let x = 0.01 * f64::from(frame);
        let pose = RigidPose::new([x, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]).filter(|_| tracked);
        self.receiver.body(0, 0, MeasuredBody { number: 1, pose, residual_m: 1e-4 });
    }

    /// Shows the next frame without delay.
    fn next(&mut self, tracked: bool) -> Option<Delivery> {
        self.frame += 1;
        self.show(self.frame, tracked, Span::ZERO)
    }

    /// Checks a pose against the truth.
    fn check(delivery: &Delivery, frame: u32) {
        let Stamps { captured_at, pose_received_at, .. } = delivery.stamps;
        let error = captured_at.since(Self::captured_at(frame)).nanos().abs();
        assert!(error < 300_000, "frame {frame} is dated wrong by {error} ns");
        assert!(captured_at <= pose_received_at);
        assert_eq!(delivery.frame, u64::from(frame));
        assert!((delivery.pose.position[0] - 0.01 * f64::from(frame)).abs() < 1e-9);
    }
}

#[test]
fn f50_lost_doubled_and_overtaken_frames_never_repeat_or_reorder_poses() {
    let mut cameras = Cameras::known();
    let (mut published, mut last) = (0, cameras.frame);
    for step in 1..=1000_u32 {
        cameras.frame += 1;
        let frame = cameras.frame;
        // One frame of a hundred is lost, one comes twice, one comes after the next.
        let shown = match step % 100 {
            10 => None,
            20 => {
                let first = cameras.show(frame, true, Span::ZERO);
                assert!(cameras.show(frame, true, Span::from_millis(1)).is_none());
                first
            }
            30 => None,
            31 => {
                let newer = cameras.show(frame, true, Span::ZERO);
                assert!(cameras.show(frame - 1, true, Span::from_millis(11)).is_none());
                newer
            }
            _ => cameras.show(frame, true, Span::ZERO),
        };
        if let Some(delivery) = shown {
            Cameras::check(&delivery, frame);
            assert!(frame > last);
            (published, last) = (published + 1, frame);
        }
    }
    let counts = cameras.receiver.counts(0);
    assert_eq!((counts.lost, counts.repeated, counts.out_of_order), (20, 10, 10));
    assert_eq!(published, 980);
}

#[test]
fn f51_a_lost_body_is_published_as_untracked_and_comes_back_by_itself() {
    let mut cameras = Cameras::known();
    for _ in 0..100 {
        let lost = cameras.next(false).expect("a lost body is reported, not withheld");
        assert_eq!(lost.pose.tracked, 0);
        assert!(!cameras.receiver.is_tracked(0));
    }
    let found = cameras.next(true).unwrap();
    assert_eq!(found.pose.tracked, 1);
    Cameras::check(&found, cameras.frame);
}

#[test]
fn f52_of_queued_frames_only_the_newest_is_published_and_no_old_one() {
    let mut cameras = Cameras::known();
    // A stall of 300 ms: 30 frames arrive at once.
    let first = cameras.frame + 1;
    let arrival = Cameras::captured_at(first + 29) + LATENCY;
    for frame in first..first + 30 {
        cameras.arrive(frame, true, arrival);
    }
    cameras.frame = first + 29;
    let newest = cameras.receiver.take(0).unwrap();
    Cameras::check(&newest, cameras.frame);
    assert!(cameras.receiver.take(0).is_none());
    // Frames that waited more than 50 ms are late even if they come one by one.
    let frame = cameras.frame + 1;
    assert!(cameras.show(frame, true, Span::from_millis(60)).is_none());
    assert_eq!(cameras.receiver.counts(0).late, 25);
}

#[test]
fn f53_a_server_whose_clock_is_set_publishes_nothing_until_it_is_known_again() {
    for jump_ns in [1_000_000_000_i64, -1_000_000_000] {
        let mut cameras = Cameras::known();
        let (mut withheld, mut back) = (0_u32, None);
        for _ in 0..300 {
            cameras.frame += 1;
            let frame = cameras.frame;
            let captured_at = Cameras::captured_at(frame);
            let stamp_ns = (captured_at.nanos() + AHEAD_NS).wrapping_add_signed(jump_ns);
            let stamp = FrameStamp { number: Some(frame), stamp_ns: Some(stamp_ns) };
            cameras.receiver.frame(0, stamp, captured_at + LATENCY);
            let pose = RigidPose::new([0.0; 3], [0.0, 0.0, 0.0, 1.0]);
            cameras.receiver.body(0, 0, MeasuredBody { number: 1, pose, residual_m: 0.0 });
            match cameras.receiver.take(0) {
                Some(delivery) => {
                    let error = delivery.stamps.captured_at.since(captured_at).nanos().abs();
                    assert!(error < 300_000, "{jump_ns}: dated wrong by {error} ns");
                    back.get_or_insert(frame);
                }
                None => withheld += 1,
            }
        }
        assert!(back.is_some() && withheld < 200, "{jump_ns}: {withheld} frames withheld");
        assert_eq!(cameras.receiver.clock(0).relearned, 1);
    }
}

#[test]
fn f54_a_new_connection_uses_neither_the_clock_nor_the_count_of_the_last() {
    let mut cameras = Cameras::known();
    cameras.receiver.forget();
    assert!(!cameras.receiver.clock(0).is_known && !cameras.receiver.is_tracked(0));
    // Another server: its clock is 20 ms behind the first one's, and it counts from 1.
    let mut first = None;
    for number in 1..=100_u32 {
        let captured_at = Cameras::captured_at(cameras.frame + number);
        let stamp_ns = Some(captured_at.nanos() + AHEAD_NS - 20_000_000);
        cameras.receiver.frame(
            0,
            FrameStamp { number: Some(number), stamp_ns },
            captured_at + LATENCY,
        );
        let pose = RigidPose::new([0.0; 3], [0.0, 0.0, 0.0, 1.0]);
        cameras.receiver.body(0, 0, MeasuredBody { number: 1, pose, residual_m: 0.0 });
        let Some(delivery) = cameras.receiver.take(0) else { continue };
        let error = delivery.stamps.captured_at.since(captured_at).nanos().abs();
        assert!(error < 300_000, "dated wrong by {error} ns");
        first.get_or_insert((number, delivery.frame));
    }
    let (number, frame) = first.expect("poses of the new server");
    assert!(number > 40 && frame > 100, "numbers go on: {number}, {frame}");
    assert_eq!(cameras.receiver.counts(0).out_of_order, 0);
}
