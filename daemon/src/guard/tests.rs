//! Tests of the gate for poses.

use super::*;
use oqtal_bus::message::Stamps;
use oqtal_config::Config;

use crate::command_model::{CommandModel, motion_tracker};

const FRAME: Span = Span::from_nanos(16_666_667);

struct Feed {
    guard: Guard,
    tracker: MotionTracker,
    frame: u64,
    time: Time,
}

impl Feed {
    /// A guard that has accepted a few poses at the origin.
    fn settled() -> Self {
        let (guard, tracker) = on_the_ground();
        let mut feed = Self { guard, tracker, frame: 0, time: Time::VIRTUAL_START };
        for _ in 0..4 {
            assert!(feed.show(pose_at(0.0)).is_ok());
        }
        feed
    }

    /// Shows the next frame.
    fn show(&mut self, pose: PoseV1) -> Result<AcceptedPose, Cause> {
        self.frame += 1;
        self.time = self.time + FRAME;
        self.check_at(self.frame, self.time, self.time, pose)
    }

    fn check_at(
        &mut self,
        frame: u64,
        captured_at: Time,
        now: Time,
        mut pose: PoseV1,
    ) -> Result<AcceptedPose, Cause> {
        // Noise, as every real pose has.
        pose.position[1] += 1e-6 * (self.frame % 7) as f64;
        let stamps = Stamps { captured_at, ..Stamps::default() };
        let header = Header { pose_sequence: frame, stamps, ..Header::default() };
        self.guard.check(&mut self.tracker, now, &(header, pose), true)
    }
}

fn on_the_ground() -> (Guard, MotionTracker) {
    let config = Config::default();
    let model = CommandModel::new(&config).unwrap().model;
    (Guard::new(&config), motion_tracker(&config, model))
}

fn pose_at(x: f64) -> PoseV1 {
    PoseV1 {
        position: [x, 0.0, 1.0],
        attitude: [0.0, 0.0, 0.0, 1.0],
        tracked: 1,
        ..PoseV1::default()
    }
}

#[test]
fn ordinary_poses_are_accepted_and_counted() {
    let mut feed = Feed::settled();
    assert!(feed.show(pose_at(0.01)).is_ok());
    assert_eq!(feed.guard.good_in_a_row(), 5);
    assert_eq!((feed.guard.lost(), feed.guard.refused()), (0, 0));
}

#[test]
fn missing_frames_are_counted_by_their_numbers() {
    let mut feed = Feed::settled();
    feed.frame += 3;
    assert!(feed.show(pose_at(0.0)).is_ok());
    assert_eq!(feed.guard.lost(), 3);
}

#[test]
fn a_burst_of_which_the_last_pose_is_read_is_superseded_and_not_lost() {
    let (mut guard, mut tracker) = on_the_ground();
    let mut show = |frame: u64, message: u64| {
        let now = Time::VIRTUAL_START + Span::from_millis(17 * frame.cast_signed());
        let stamps = Stamps { captured_at: now, ..Stamps::default() };
        let header =
            Header { sequence: message, pose_sequence: frame, stamps, ..Header::default() };
        let arrival = (header, pose_at(1e-6 * frame as f64));
        assert!(guard.check(&mut tracker, now, &arrival, true).is_ok());
        (guard.superseded(), guard.lost())
    };
    assert_eq!(show(1, 1), (0, 0));
    assert_eq!(show(4, 4), (2, 0), "three at once");
    assert_eq!(show(9, 6), (3, 3), "five frames, of which two became poses");
}

#[test]
fn poses_that_are_read_and_not_used_are_not_superseded() {
    let (mut guard, mut tracker) = on_the_ground();
    let at = |frame: u64| Time::VIRTUAL_START + Span::from_millis(17 * frame.cast_signed());
    let header = |number: u64| {
        let stamps = Stamps { captured_at: at(number), ..Stamps::default() };
        Header { sequence: number, pose_sequence: number, stamps, ..Header::default() }
    };
    let mut check = |guard: &mut Guard, number: u64, now: Time| {
        let arrival = (header(number), pose_at(1e-6 * number as f64));
        guard.check(&mut tracker, now, &arrival, true)
    };
    assert!(check(&mut guard, 1, at(1)).is_ok());
    // In Coast, by evidence against the poses, and by a clock of the cameras that is ahead.
    (2..5).for_each(|number| guard.ignore(&header(number)));
    assert!((5..8).all(|number| check(&mut guard, number, at(0)) == Err(Cause::Order)));
    assert!(check(&mut guard, 9, at(9)).is_ok());
    assert_eq!((guard.superseded(), guard.lost()), (1, 0));
}

#[test]
fn f04_a_late_pose_is_refused_by_its_capture_time() {
    let mut feed = Feed::settled();
    let captured = feed.time + FRAME;
    let verdict =
        feed.check_at(feed.frame + 1, captured, captured + Span::from_millis(90), pose_at(0.0));
    assert_eq!(verdict, Err(Cause::Stale));
}

#[test]
fn f05_repeats_and_time_running_back_are_refused() {
    let mut feed = Feed::settled();
    assert_eq!(
        feed.check_at(feed.frame, feed.time + FRAME, feed.time + FRAME, pose_at(0.0)),
        Err(Cause::Order)
    );
    assert_eq!(
        feed.check_at(feed.frame + 1, feed.time - FRAME, feed.time, pose_at(0.0)),
        Err(Cause::Order)
    );
    assert_eq!(
        feed.check_at(feed.frame + 2, feed.time, feed.time, pose_at(0.0)),
        Err(Cause::Order),
        "another frame of the same instant"
    );
}

#[test]
fn f17_frames_that_restart_from_one_are_refused_in_flight_and_accepted_on_the_ground() {
    let mut feed = Feed::settled();
    let captured_at = feed.time + FRAME;
    let stamps = Stamps { captured_at, ..Stamps::default() };
    let header = Header { pose_sequence: 1, stamps, ..Header::default() };
    let Feed { guard, tracker, .. } = &mut feed;
    let arrival = (header, pose_at(0.0));
    let mut check = |flying| guard.check(tracker, captured_at, &arrival, flying);
    assert_eq!(check(true), Err(Cause::Order));
    assert!(check(false).is_ok());
    assert_eq!(check(false), Err(Cause::Order), "the same capture again");
}

#[test]
fn f06_a_pose_that_is_not_finite_or_not_tracked_is_refused() {
    let mut feed = Feed::settled();
    for index in 0..7 {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut pose = pose_at(0.0);
            let (position, attitude) = (&mut pose.position, &mut pose.attitude);
            *position.iter_mut().chain(attitude).nth(index).unwrap() = value;
            assert_eq!(feed.show(pose), Err(Cause::NotFinite));
        }
    }
    assert_eq!(feed.show(PoseV1 { tracked: 0, ..pose_at(0.0) }), Err(Cause::Untracked));
}

#[test]
fn f07_a_quaternion_must_be_of_unit_norm() {
    let mut feed = Feed::settled();
    let scaled = PoseV1 { attitude: [0.0, 0.0, 0.0, 1.2], ..pose_at(0.0) };
    assert_eq!(feed.show(scaled), Err(Cause::NotUnit));
}

#[test]
fn f08_the_opposite_quaternion_is_the_same_attitude() {
    let mut feed = Feed::settled();
    let flipped = PoseV1 { attitude: [0.0, 0.0, 0.0, -1.0], ..pose_at(0.0) };
    assert!(feed.show(flipped).is_ok());
}

#[test]
fn f09_a_jump_is_refused_and_the_next_good_pose_accepted() {
    let mut feed = Feed::settled();
    assert_eq!(feed.show(pose_at(0.5)), Err(Cause::Jump));
    assert!(feed.show(pose_at(0.01)).is_ok());
}

#[test]
fn a_lasting_jump_is_accepted_once_the_vehicle_was_moved_there() {
    let mut feed = Feed::settled();
    for _ in 0..600 {
        assert_eq!(feed.show(pose_at(1.0)), Err(Cause::Jump));
    }
    feed.guard.forget();
    assert!(feed.show(pose_at(1.0)).is_ok());
}

#[test]
fn after_a_gap_the_vehicle_may_have_moved_on() {
    let mut feed = Feed::settled();
    feed.time = feed.time + Span::from_millis(200);
    assert!(feed.show(pose_at(0.6)).is_ok());
}

/// On the ground, where no motion is predicted, only the limits of a vehicle tell a turn from another body.
#[test]
fn f10_a_pose_that_turned_further_than_a_vehicle_can_is_a_jump() {
    let greatest = Config::default().safety.max_rate_rad_s * FRAME.seconds() + JUMP_MARGIN_RAD;
    for (share, is_accepted) in [(0.98, true), (1.02, false)] {
        let half = share * greatest / 2.0;
        let turned = PoseV1 { attitude: [half.sin(), 0.0, 0.0, half.cos()], ..pose_at(0.0) };
        let shown = Feed::settled().show(turned);
        assert_eq!(
            shown.map(|_| ()),
            if is_accepted { Ok(()) } else { Err(Cause::Jump) },
            "{share}"
        );
    }
}

#[test]
fn the_gate_takes_the_measured_noise() {
    let (mut guard, _) = on_the_ground();
    let gate = |guard: &Guard| format!("{:?}", guard.gate);
    let before = gate(&guard);
    guard.set_noise(&PoseDeviations { position_m: 0.01, attitude_rad: 0.05 });
    assert_ne!(gate(&guard), before);
}

#[test]
fn the_first_frame_may_have_any_number_and_a_pose_the_greatest_age() {
    let (guard, tracker) = on_the_ground();
    let mut feed = Feed { guard, tracker, frame: 5, time: Time::VIRTUAL_START };
    assert!(feed.show(pose_at(0.0)).is_ok());
    assert_eq!(feed.guard.lost(), 0);
    let oldest = Span::from_seconds(Config::default().safety.max_pose_age_ms * 1e-3);
    let captured_at = feed.time + FRAME;
    assert!(feed.check_at(7, captured_at, captured_at + oldest, pose_at(0.0)).is_ok());
}

#[test]
fn a_motion_is_propagated_if_it_is_old_and_ends_with_the_flight() {
    let Feed { mut guard, mut tracker, .. } = Feed::settled();
    guard.begin_flight(&mut tracker);
    let age_s = |tracker: &MotionTracker| tracker.track().map(|track| track.t_s);
    let began_s = age_s(&tracker).unwrap();
    guard.propagate(&mut tracker, began_s, began_s + 0.1);
    assert_eq!(age_s(&tracker), Some(began_s), "not older than that");
    guard.propagate(&mut tracker, began_s + 0.05, began_s + 0.1);
    assert_eq!(age_s(&tracker), Some(began_s + 0.1));
    guard.end_flight(&mut tracker);
    assert_eq!(age_s(&tracker), None);
}
