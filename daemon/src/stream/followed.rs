//! A reference of a planner that is followed, from its time stamp on.

use nalgebra::{Vector3, Vector4};
use oqtal_bus::time::Time;
use oqtal_control::euler::EulerAngles;
use oqtal_control::quaternion::Attitude;
use oqtal_control::tracking_error::AttitudeReference;
use oqtal_control::trajectory::{Reference, ReferenceMotion};

/// Greatest difference of the velocity between a reference and the extrapolation of the one before, over the time between them
/// \[m/s^2\].
const VELOCITY_MISMATCH: f64 = 2.0;
/// The same of the acceleration \[m/s^3\].
const ACCELERATION_MISMATCH: f64 = 10.0;
/// Number of bisections of the time at which an attitude reaches the tilt limit \[-\].
const BISECTIONS: usize = 12;

/// A reference that was accepted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FollowedReference {
    /// Instant for which it is given.
    pub(super) time: Time,
    /// End of its validity.
    pub(super) valid_until: Time,
    /// The motion at that instant.
    pub(super) motion: ReferenceMotion,
    /// Jerk \[m/s^3, world\].
    pub(super) jerk: Vector3<f64>,
    /// Whether acceleration and jerk are those of the motion: laws feed them forward.
    pub(super) is_smooth: bool,
    /// Prescribed attitude; the heading of the motion is then that of this attitude.
    pub(super) attitude: Option<AttitudeReference>,
}

impl FollowedReference {
    /// The motion that the derivatives lead to at `now`.
    fn extrapolated(&self, now: Time) -> ReferenceMotion {
        let dt_s = now.since(self.time).seconds();
        let mut motion = self.motion.after(dt_s);
        let bend = self.jerk * (dt_s * dt_s / 2.0);
        motion.value += (bend * (dt_s / 3.0)).push(0.0);
        motion.rate += bend.push(0.0);
        motion.acceleration += (self.jerk * dt_s).push(0.0);
        motion
    }

    /// Motion and prescribed attitude at `now`; the heading of the motion is that of the attitude.
    fn flown(&self, now: Time, least_upright: f64) -> (ReferenceMotion, Option<AttitudeReference>) {
        let mut motion = self.extrapolated(now);
        let attitude = self.attitude(now, least_upright);
        if let Some(prescribed) = &attitude {
            motion.value.w = EulerAngles::from_attitude(&prescribed.attitude).yaw;
        }
        (motion, attitude)
    }

    /// The motion at `now`; a prescribed attitude turns on up to the tilt of this cosine, and is held there.
    pub(super) fn motion(&self, now: Time, least_upright: f64) -> ReferenceMotion {
        self.flown(now, least_upright).0
    }

    /// Whether velocity and acceleration lead to those of `next`, up to an acceleration of [`VELOCITY_MISMATCH`]. A planner whose
    /// derivatives are wrong would push the vehicle away.
    pub(super) fn leads_to(&self, next: &Self) -> bool {
        let dt_s = next.time.since(self.time).seconds();
        let expected = self.extrapolated(next.time);
        let gap = |from: Vector4<f64>, to: Vector4<f64>| (to - from).xyz().norm();
        dt_s > 0.0
            && gap(expected.rate, next.motion.rate) <= VELOCITY_MISMATCH * dt_s
            && gap(expected.acceleration, next.motion.acceleration) <= ACCELERATION_MISMATCH * dt_s
    }

    /// The prescribed attitude at `now`; `None` if none is prescribed.
    fn attitude(&self, now: Time, least_upright: f64) -> Option<AttitudeReference> {
        let prescribed = self.attitude?;
        let after = |dt_s: f64| prescribed.attitude.turned_by(prescribed.rate.0 * dt_s);
        let (mut within_s, mut beyond_s) = (0.0, now.since(self.time).seconds());
        if is_upright(&after(beyond_s), least_upright) {
            return Some(AttitudeReference { attitude: after(beyond_s), ..prescribed });
        }
        for _ in 0..BISECTIONS {
            let middle_s = 0.5 * (within_s + beyond_s);
            let is_within = is_upright(&after(middle_s), least_upright);
            *(if is_within { &mut within_s } else { &mut beyond_s }) = middle_s;
        }
        Some(AttitudeReference::at_rest(after(within_s)))
    }

    /// The reference at `now`, with the same limit of the tilt.
    pub(super) fn reference(&self, now: Time, least_upright: f64) -> Reference {
        let (motion, attitude) = self.flown(now, least_upright);
        let reference = Reference { attitude, ..motion.reference() };
        match self.is_smooth {
            true => Reference { jerk: self.jerk, ..reference },
            false => Reference { acceleration: Vector3::zeros(), ..reference },
        }
    }
}

/// `motion` at constant velocity.
pub(super) fn without_acceleration(motion: &ReferenceMotion) -> ReferenceMotion {
    ReferenceMotion { acceleration: Vector4::zeros(), ..*motion }
}

/// Whether `attitude` is tilted by no more than the angle of this cosine.
pub(super) fn is_upright(attitude: &Attitude, least_upright: f64) -> bool {
    attitude.to_world(&Vector3::z()).z >= least_upright
}
