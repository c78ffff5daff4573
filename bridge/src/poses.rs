//! Poses to a vehicle that estimates its own motion: only the newest one is sent, once, while it is recent.

use oqtal_bus::message::{Header, PoseV1, Stamps};
use oqtal_bus::time::{Span, Time};
use oqtal_control::quaternion::Attitude;

use crate::protocol::VehiclePose;
use crate::safety::is_within;

/// Share of the shortest time between two poses by which a pose may arrive too early \[-\]: the period of cameras varies.
const TOLERANCE: f64 = 0.05;

/// Pose that has not been sent.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    published_at: Time,
    pose: VehiclePose,
}

/// The newest pose, and when the next one is due.
#[derive(Clone, Debug)]
pub struct PoseRelay {
    /// Age since its publication above which a pose is not sent.
    age: Span,
    waiting: Option<Waiting>,
    captured_at: Time,
    /// Instant at which the next pose is due; unset before the first.
    due_at: Time,
}

impl PoseRelay {
    /// Relay of poses published at most `age` ago.
    pub fn new(age: Span) -> Self {
        Self { age, waiting: None, captured_at: Time::UNSET, due_at: Time::UNSET }
    }

    /// Takes a pose from the bus at `now`; ignores poses that are not finite, of a lost body, not newer than the last one, or stamped in
    /// the future.
    pub fn receive(&mut self, now: Time, header: &Header, pose: &PoseV1) {
        let Stamps { captured_at, pose_published_at: published_at, .. } = header.stamps;
        let is_newer = captured_at.is_set()
            && captured_at.max(published_at) <= now
            && (!self.captured_at.is_set() || captured_at > self.captured_at);
        let is_finite = pose.position.iter().all(|number| number.is_finite());
        let attitude = Attitude::from_xyzw(pose.attitude).filter(|_| is_finite && is_newer);
        let Some(attitude) = attitude.filter(|_| pose.tracked == 1) else { return };
        self.captured_at = captured_at;
        let pose = VehiclePose { captured_at, position: pose.position, attitude };
        self.waiting = Some(Waiting { published_at, pose });
    }

    /// Takes the pose that is due at `now`, where poses are sent every `period`.
    pub fn take(&mut self, now: Time, period: Span) -> Option<VehiclePose> {
        let Waiting { published_at, pose } = self.waiting?;
        if !is_within(now, published_at, self.age) {
            self.waiting = None;
            return None;
        }
        if self.due_at.since(now) > period.scaled(TOLERANCE) {
            return None;
        }
        // A pose that had to wait does not delay the next one, and one that came early does.
        let is_in_rhythm = now < self.due_at + period;
        self.due_at = if is_in_rhythm { self.due_at } else { now } + period;
        self.waiting = None;
        Some(pose)
    }

    /// Discards the waiting pose when a port was opened.
    pub fn reset(&mut self) {
        self.waiting = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Span = Span::from_millis(20);

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    fn header(captured_ms: i64) -> Header {
        let (captured_at, pose_published_at) = (at(captured_ms), at(captured_ms + 15));
        let stamps = Stamps { captured_at, pose_published_at, ..Stamps::default() };
        Header { stamps, ..Header::default() }
    }

    const SEEN: PoseV1 = PoseV1 {
        position: [1.0, 2.0, 3.0],
        attitude: [0.0, 0.0, 0.0, 1.0],
        residual_m: 0.0,
        capture_uncertainty_s: 0.0,
        body: 1,
        tracked: 1,
        simulated: 0,
    };

    #[test]
    fn the_newest_pose_is_sent_once_at_its_rate_with_its_time_and_no_old_one() {
        let mut relay = PoseRelay::new(Span::from_millis(50));
        relay.receive(at(15), &header(0), &SEEN);
        assert_eq!(relay.take(at(16), PERIOD).unwrap().captured_at, at(0));
        assert!(relay.take(at(40), PERIOD).is_none(), "once");
        relay.receive(at(23), &header(4), &SEEN);
        relay.receive(at(23), &header(8), &SEEN);
        assert!(relay.take(at(34), PERIOD).is_none(), "too soon");
        assert_eq!(relay.take(at(42), PERIOD).unwrap().captured_at, at(8));
        relay.receive(at(50), &header(32), &SEEN);
        assert!(relay.take(at(54), PERIOD).is_none(), "too soon");
        assert!(relay.take(at(56), PERIOD).is_some(), "the last one had waited");
        relay.receive(at(55), &header(40), &SEEN);
        assert!(relay.take(at(106), PERIOD).is_none(), "published more than 50 ms ago");
    }

    #[test]
    fn poses_of_nothing_and_poses_that_go_back_are_left_out() {
        let mut relay = PoseRelay::new(Span::from_millis(50));
        for wrong in [
            PoseV1 { tracked: 0, ..SEEN },
            PoseV1 { position: [f64::NAN, 0.0, 0.0], ..SEEN },
            PoseV1 { attitude: [0.0; 4], ..SEEN },
        ] {
            relay.receive(at(17), &header(1), &wrong);
            assert!(relay.take(at(17), PERIOD).is_none(), "{wrong:?}");
        }
        relay.receive(at(17), &header(900), &SEEN);
        relay.receive(at(17), &header(2), &SEEN);
        assert!(relay.take(at(18), PERIOD).is_some(), "one of the future locks nothing out");
        relay.receive(at(18), &header(2), &SEEN);
        relay.receive(at(18), &header(1), &SEEN);
        assert!(relay.take(at(60), PERIOD).is_none());
    }
}
