//! Which poses are believed: fresh, ordered, finite, of unit norm, moving as a vehicle can. Anything else is as no pose.

use nalgebra::Vector3;
use oqtal_bus::code::Cause;
use oqtal_bus::message::{Header, PoseV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Safety;
use oqtal_control::quaternion::Attitude;

/// Added to what a vehicle can fly between two poses: noise must not look like a jump.
const JUMP_MARGIN_M: f64 = 0.05;
const JUMP_MARGIN_RAD: f64 = 0.1;
/// So many identical poses in a row under new sequence numbers are a frozen source: real ones carry noise.
const FROZEN_AFTER: u32 = 3;

/// A pose that passed the guard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accepted {
    /// When it was captured.
    pub captured_at: Time,
    /// \[m, world\].
    pub position: Vector3<f64>,
    /// \[body to world\].
    pub attitude: Attitude,
}

/// Judges poses one by one.
#[derive(Clone, Debug)]
pub struct Guard {
    max_age: Span,
    max_speed: f64,
    max_rate: f64,
    last: Option<Accepted>,
    last_frame: u64,
    last_message: u64,
    last_source: u64,
    last_pose: PoseV1,
    repeats: u32,
    /// How long the vehicle had been out of sight when the first of the present run of jumps came \[s\].
    unseen_s: Option<f64>,
    lost: u64,
    superseded: u64,
    refused: u64,
    good_in_a_row: u32,
}

impl Guard {
    /// A guard with the limits of `safety`.
    #[must_use]
    pub fn new(safety: &Safety) -> Self {
        Self {
            max_age: Span::from_seconds(safety.max_pose_age_ms * 1e-3),
            max_speed: safety.max_speed_m_s,
            max_rate: safety.max_rate_rad_s,
            last: None,
            last_frame: 0,
            last_message: 0,
            last_source: 0,
            last_pose: PoseV1::default(),
            repeats: 0,
            unseen_s: None,
            lost: 0,
            superseded: 0,
            refused: 0,
            good_in_a_row: 0,
        }
    }

    /// Judges a pose that the daemon looks at `now`. Only `flying` does a body that does not move at all arouse suspicion:
    /// on the floor, perfect cameras say the same again and again.
    ///
    /// # Errors
    /// Why it is not believed.
    pub fn judge(
        &mut self,
        now: Time,
        header: &Header,
        pose: &PoseV1,
        flying: bool,
    ) -> Result<Accepted, Cause> {
        let verdict = self.examine(now, header, pose, flying);
        match verdict {
            Ok(believed) => {
                self.last = Some(believed);
                self.unseen_s = None;
                self.good_in_a_row = self.good_in_a_row.saturating_add(1);
            }
            Err(_) => {
                self.refused += 1;
                self.good_in_a_row = 0;
            }
        }
        verdict
    }

    /// Tells the guard that a pose was due and none came.
    pub fn missed(&mut self) {
        self.good_in_a_row = 0;
    }

    /// On the ground a vehicle may be carried elsewhere: wherever it is seen next is believed.
    pub fn forget(&mut self) {
        if self.unseen_s.is_some() {
            self.last = None;
            self.unseen_s = None;
        }
    }

    /// The last pose believed.
    #[must_use]
    pub fn last(&self) -> Option<&Accepted> {
        self.last.as_ref()
    }

    /// Poses believed in a row, up to now.
    #[must_use]
    pub fn good_in_a_row(&self) -> u32 {
        self.good_in_a_row
    }

    /// Frames that were never published as a pose, by the gaps in their numbers.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Poses that were published, and overtaken by the next one before anybody looked.
    #[must_use]
    pub fn superseded(&self) -> u64 {
        self.superseded
    }

    /// Poses not believed.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    fn examine(
        &mut self,
        now: Time,
        header: &Header,
        pose: &PoseV1,
        flying: bool,
    ) -> Result<Accepted, Cause> {
        if header.stamps.captured_at > now {
            return Err(Cause::Order);
        }
        self.count_frames(header, flying)?;
        if pose.tracked == 0 {
            return Err(Cause::Untracked);
        }
        let numbers = pose.position.iter().chain(&pose.attitude);
        if !numbers.clone().all(|number| number.is_finite()) {
            return Err(Cause::NotFinite);
        }
        let attitude = Attitude::from_xyzw(pose.attitude).ok_or(Cause::NotUnit)?;
        if self.is_frozen(pose) && flying {
            return Err(Cause::Frozen);
        }
        let captured_at = header.stamps.captured_at;
        if now.since(captured_at) > self.max_age {
            return Err(Cause::Stale);
        }
        let believed = Accepted { captured_at, position: pose.position.into(), attitude };
        self.check_motion(&believed)?;
        Ok(believed)
    }

    /// Frame numbers and capture times only ever go up.
    fn count_frames(&mut self, header: &Header, flying: bool) -> Result<(), Cause> {
        let frame = header.pose_sequence;
        let later = |last: Accepted| header.stamps.captured_at > last.captured_at;
        // A source that restarted counts anew, at later capture times; on the ground so may what the source itself looks at.
        let anew = !flying && frame <= self.last_frame && self.last.is_none_or(later);
        let restarted = header.source != self.last_source || anew;
        self.last_source = header.source;
        if frame <= self.last_frame && !restarted {
            return Err(Cause::Order);
        }
        if self.last_frame > 0 && !restarted {
            let messages = header.sequence.saturating_sub(self.last_message + 1);
            let frames = frame - self.last_frame - 1;
            self.superseded += messages;
            self.lost += frames.saturating_sub(messages);
        }
        self.last_frame = frame;
        self.last_message = header.sequence;
        match self.last {
            Some(last) if header.stamps.captured_at <= last.captured_at => Err(Cause::Order),
            _ => Ok(()),
        }
    }

    fn is_frozen(&mut self, pose: &PoseV1) -> bool {
        self.repeats = if *pose == self.last_pose { self.repeats + 1 } else { 0 };
        self.last_pose = *pose;
        self.repeats >= FROZEN_AFTER - 1
    }

    /// A vehicle moves no further than its speed allows since it was last seen. Time that passes while poses jump does not
    /// count: a body that swapped its markers must not become believable by waiting.
    fn check_motion(&mut self, pose: &Accepted) -> Result<(), Cause> {
        let Some(last) = self.last else { return Ok(()) };
        let elapsed_s = pose.captured_at.since(last.captured_at).seconds();
        let unseen_s = self.unseen_s.unwrap_or(elapsed_s);
        let moved = (pose.position - last.position).norm();
        let turned = pose.attitude.angle_to(&last.attitude);
        let jumped = moved > self.max_speed * unseen_s + JUMP_MARGIN_M
            || turned > self.max_rate * unseen_s + JUMP_MARGIN_RAD;
        if jumped {
            self.unseen_s = Some(unseen_s);
            return Err(Cause::Jump);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::message::Stamps;
    use oqtal_config::Config;

    const FRAME: Span = Span::from_nanos(16_666_667);

    struct Feed {
        guard: Guard,
        frame: u64,
        time: Time,
    }

    impl Feed {
        /// A guard that has believed a few poses at the origin.
        fn settled() -> Self {
            let guard = Guard::new(&Config::default().safety);
            let mut feed = Self { guard, frame: 0, time: Time::VIRTUAL_START };
            for _ in 0..4 {
                assert!(feed.show(pose_at(0.0)).is_ok());
            }
            feed
        }

        /// Shows the next frame.
        fn show(&mut self, pose: PoseV1) -> Result<Accepted, Cause> {
            self.frame += 1;
            self.time = self.time + FRAME;
            self.judge_at(self.frame, self.time, self.time, pose)
        }

        fn judge_at(
            &mut self,
            frame: u64,
            captured_at: Time,
            now: Time,
            mut pose: PoseV1,
        ) -> Result<Accepted, Cause> {
            // Noise, as every real pose has.
            pose.position[1] += 1e-6 * (self.frame % 7) as f64;
            let stamps = Stamps { captured_at, ..Stamps::default() };
            let header = Header { pose_sequence: frame, stamps, ..Header::default() };
            self.guard.judge(now, &header, &pose, true)
        }
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
    fn ordinary_poses_are_believed_and_counted() {
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
    fn a_burst_of_which_the_last_is_seen_is_superseded_and_not_lost() {
        let mut guard = Guard::new(&Config::default().safety);
        let mut show = |frame: u64, message: u64| {
            let now = Time::VIRTUAL_START + Span::from_millis(17 * frame.cast_signed());
            let stamps = Stamps { captured_at: now, ..Stamps::default() };
            let header =
                Header { sequence: message, pose_sequence: frame, stamps, ..Header::default() };
            assert!(guard.judge(now, &header, &pose_at(1e-6 * frame as f64), true).is_ok());
            (guard.superseded(), guard.lost())
        };
        assert_eq!(show(1, 1), (0, 0));
        assert_eq!(show(4, 4), (2, 0), "three at once");
        assert_eq!(show(9, 6), (3, 3), "five frames, of which two became poses");
    }

    #[test]
    fn f03_a_frozen_source_is_no_pose() {
        let mut feed = Feed::settled();
        let frozen = pose_at(0.001);
        let mut verdicts = Vec::new();
        for _ in 0..4 {
            feed.frame += 7; // keeps the noise of this feed the same
            feed.time = feed.time + FRAME;
            verdicts.push(feed.judge_at(feed.frame, feed.time, feed.time, frozen).map(drop));
        }
        assert_eq!(verdicts, [Ok(()), Ok(()), Err(Cause::Frozen), Err(Cause::Frozen)]);
    }

    #[test]
    fn f04_a_late_pose_is_refused_by_its_capture_time() {
        let mut feed = Feed::settled();
        let captured = feed.time + FRAME;
        let verdict =
            feed.judge_at(feed.frame + 1, captured, captured + Span::from_millis(90), pose_at(0.0));
        assert_eq!(verdict, Err(Cause::Stale));
    }

    #[test]
    fn f05_repeats_and_time_running_back_are_refused() {
        let mut feed = Feed::settled();
        assert_eq!(
            feed.judge_at(feed.frame, feed.time + FRAME, feed.time + FRAME, pose_at(0.0)),
            Err(Cause::Order)
        );
        assert_eq!(
            feed.judge_at(feed.frame + 1, feed.time - FRAME, feed.time, pose_at(0.0)),
            Err(Cause::Order)
        );
    }

    #[test]
    fn f17_frames_that_count_anew_are_refused_in_flight_and_believed_on_the_ground() {
        let mut feed = Feed::settled();
        let captured_at = feed.time + FRAME;
        let stamps = Stamps { captured_at, ..Stamps::default() };
        let header = Header { pose_sequence: 1, stamps, ..Header::default() };
        let mut judge = |flying| feed.guard.judge(captured_at, &header, &pose_at(0.0), flying);
        assert_eq!(judge(true), Err(Cause::Order));
        assert!(judge(false).is_ok());
        assert_eq!(judge(false), Err(Cause::Order), "the same capture again");
    }

    #[test]
    fn f06_nothing_that_is_not_finite_or_not_tracked_is_believed() {
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
    fn f09_a_jump_is_refused_and_the_next_good_pose_believed() {
        let mut feed = Feed::settled();
        assert_eq!(feed.show(pose_at(0.5)), Err(Cause::Jump));
        assert!(feed.show(pose_at(0.01)).is_ok());
    }

    #[test]
    fn f10_a_lasting_jump_never_becomes_believable_in_flight() {
        let mut feed = Feed::settled();
        for _ in 0..600 {
            assert_eq!(feed.show(pose_at(1.0)), Err(Cause::Jump));
        }
        feed.guard.forget();
        assert!(feed.show(pose_at(1.0)).is_ok(), "carried there on the ground");
    }

    #[test]
    fn after_a_gap_the_vehicle_may_have_moved_on() {
        let mut feed = Feed::settled();
        feed.time = feed.time + Span::from_millis(200);
        assert!(feed.show(pose_at(0.6)).is_ok());
    }
}
