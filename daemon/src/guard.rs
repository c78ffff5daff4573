//! The guard of the poses: accepts a pose that is recent, in order, finite, of unit norm, and at a place that the vehicle can have reached.

use oqtal_bus::code::Cause;
use oqtal_bus::message::{Header, PoseV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::predictive::{MeasuredPose, MotionTracker};
use oqtal_control::quaternion::Attitude;

use crate::gate::MotionGate;
use crate::measured_noise::PoseDeviations;

/// Distance added to the greatest flight between two poses, so that noise does not count as a jump \[m\].
const JUMP_MARGIN_M: f64 = 0.05;
/// Angle added to the greatest turn between two poses, so that noise does not count as a jump \[rad\].
const JUMP_MARGIN_RAD: f64 = 0.1;

/// A pose that passed the guard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AcceptedPose {
    /// Instant of its capture.
    pub captured_at: Time,
    /// The pose itself.
    pub pose: MeasuredPose,
    /// Whether it is emulated or from a recording.
    pub simulated: bool,
}

/// The guard of the poses.
#[derive(Clone, Debug)]
pub struct Guard {
    /// Compares poses with the motion that the commands sent can have caused.
    gate: MotionGate,
    max_age: Span,
    max_speed: f64,
    max_rate: f64,
    last: Option<AcceptedPose>,
    last_frame: u64,
    last_message: u64,
    last_source: u64,
    /// Time between the last accepted pose and the first of the present consecutive jumps \[s\].
    unseen_s: Option<f64>,
    lost: u64,
    superseded: u64,
    /// Poses that were read and refused after the last one whose numbers were counted \[-\].
    uncounted: u64,
    refused: u64,
    accepted: u64,
    good_in_a_row: u32,
}

impl Guard {
    /// The guard of `config`.
    pub fn new(config: &Config) -> Self {
        let safety = &config.safety;
        Self {
            gate: MotionGate::new(config),
            max_age: Span::from_seconds(safety.max_pose_age_ms * 1e-3),
            max_speed: safety.max_speed_m_s,
            max_rate: safety.max_rate_rad_s,
            last: None,
            last_frame: 0,
            last_message: 0,
            last_source: 0,
            unseen_s: None,
            lost: 0,
            superseded: 0,
            uncounted: 0,
            refused: 0,
            accepted: 0,
            good_in_a_row: 0,
        }
    }

    /// Takes the measured noise of the poses.
    pub fn set_noise(&mut self, noise: &PoseDeviations) {
        self.gate.set_noise(noise);
    }

    /// Begins a flight at the last accepted pose, on the floor below it.
    pub fn begin_flight(&mut self, tracker: &mut MotionTracker) {
        if let Some(last) = self.last {
            tracker.begin(last.captured_at.seconds(), &last.pose, last.pose.position.z);
            self.gate.restart(tracker);
        }
    }

    /// Ends the flight: on the ground no motion is predicted.
    pub fn end_flight(&mut self, tracker: &mut MotionTracker) {
        tracker.end();
        self.gate.restart(tracker);
    }

    /// Propagates a tracked motion that is older than `oldest_s` \[s\] to `t_s` \[s\].
    pub fn propagate(&mut self, tracker: &mut MotionTracker, oldest_s: f64, t_s: f64) {
        if tracker.track().is_some_and(|track| track.t_s < oldest_s) {
            tracker.propagate(t_s);
            self.gate.discard_hypothesis();
        }
    }

    /// Checks a pose that the daemon takes at `now`, `flying` or not, and in flight corrects the motion of `tracker` by it.
    ///
    /// # Errors
    /// Why the pose is refused.
    pub fn check(
        &mut self,
        tracker: &mut MotionTracker,
        now: Time,
        arrival: &(Header, PoseV1),
        flying: bool,
    ) -> Result<AcceptedPose, Cause> {
        let checked = self.check_message(now, arrival, flying).and_then(|accepted| {
            self.gate.check(tracker, accepted.captured_at.seconds(), &accepted.pose)?;
            if tracker.track().is_none() {
                self.check_motion(&accepted)?;
            }
            Ok(accepted)
        });
        match checked {
            Ok(accepted) => {
                self.last = Some(accepted);
                self.unseen_s = None;
                self.accepted += 1;
                self.good_in_a_row = self.good_in_a_row.saturating_add(1);
            }
            Err(_) => {
                self.refused += 1;
                self.good_in_a_row = 0;
            }
        }
        checked
    }

    /// Records that a pose was due and none arrived.
    pub fn missed(&mut self) {
        self.good_in_a_row = 0;
    }

    /// Records a pose that is read and not checked: it is neither accepted nor superseded.
    pub fn ignore(&mut self, header: &Header) {
        self.missed();
        // The order of frames does not matter for a pose that is not used.
        let _ = self.count_frames(header, true);
    }

    /// Discards the last position after a jump: on the ground somebody may have moved the vehicle.
    pub fn forget(&mut self) {
        if self.unseen_s.is_some() {
            self.last = None;
            self.unseen_s = None;
        }
    }

    /// The last accepted pose.
    pub fn last(&self) -> Option<&AcceptedPose> {
        self.last.as_ref()
    }

    /// Number of poses accepted in a row, up to now \[-\].
    pub fn good_in_a_row(&self) -> u32 {
        self.good_in_a_row
    }

    /// Number of frames that were never published as a pose, by the gaps in their numbers \[-\].
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Number of poses that were superseded by the next one before the daemon took them \[-\].
    pub fn superseded(&self) -> u64 {
        self.superseded
    }

    /// Number of poses refused \[-\].
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Number of poses accepted \[-\].
    pub fn accepted(&self) -> u64 {
        self.accepted
    }

    /// Checks a single pose: order, numbers and age.
    fn check_message(
        &mut self,
        now: Time,
        (header, pose): &(Header, PoseV1),
        flying: bool,
    ) -> Result<AcceptedPose, Cause> {
        let captured_at = header.stamps.captured_at;
        if captured_at > now {
            self.uncounted += 1;
            return Err(Cause::Order);
        }
        self.count_frames(header, flying)?;
        if pose.tracked == 0 {
            return Err(Cause::Untracked);
        }
        if !pose.position.iter().chain(&pose.attitude).all(|number| number.is_finite()) {
            return Err(Cause::NotFinite);
        }
        let attitude = Attitude::from_xyzw(pose.attitude).ok_or(Cause::NotUnit)?;
        if now.since(captured_at) > self.max_age {
            return Err(Cause::Stale);
        }
        let simulated = pose.simulated != 0;
        let pose = MeasuredPose { position: pose.position.into(), attitude };
        Ok(AcceptedPose { captured_at, pose, simulated })
    }

    /// Checks that frame numbers and capture times increase, and counts the gaps.
    fn count_frames(&mut self, header: &Header, flying: bool) -> Result<(), Cause> {
        let frame = header.pose_sequence;
        let later = |last: AcceptedPose| header.stamps.captured_at > last.captured_at;
        // A restarted source counts from one again, at later capture times; on the ground so may the camera system behind it.
        let is_recount = !flying && frame <= self.last_frame && self.last.is_none_or(later);
        let restarted = header.source != self.last_source || is_recount;
        self.last_source = header.source;
        if frame <= self.last_frame && !restarted {
            self.uncounted += 1;
            return Err(Cause::Order);
        }
        if self.last_frame > 0 && !restarted {
            let messages = header.sequence.saturating_sub(self.last_message + 1);
            let frames = frame - self.last_frame - 1;
            self.superseded += messages.saturating_sub(self.uncounted);
            self.lost += frames.saturating_sub(messages);
        }
        self.last_frame = frame;
        (self.last_message, self.uncounted) = (header.sequence, 0);
        match self.last {
            Some(last) if header.stamps.captured_at <= last.captured_at => Err(Cause::Order),
            _ => Ok(()),
        }
    }

    /// Checks on the ground, where no motion is predicted, that the vehicle moved no further than its limits allow since the last
    /// accepted pose. Time that passes while poses jump does not count: a body with swapped markers must not become acceptable by
    /// waiting.
    fn check_motion(&mut self, accepted: &AcceptedPose) -> Result<(), Cause> {
        let Some(last) = self.last else { return Ok(()) };
        let elapsed_s = accepted.captured_at.since(last.captured_at).seconds();
        let unseen_s = self.unseen_s.unwrap_or(elapsed_s);
        let moved = (accepted.pose.position - last.pose.position).norm();
        let turned = accepted.pose.attitude.angle_to(&last.pose.attitude);
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
mod tests;
