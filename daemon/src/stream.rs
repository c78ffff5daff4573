//! References of a planner, topic `reference`: their check, the reference between two of them, and their end.
//!
//! The newest accepted reference is followed until its validity ends; between two it is extrapolated. The end of a flight, or an
//! operator's request that changes one, ends the stream: further references of the same planner are ignored until it pauses.

use nalgebra::{Vector3, Vector4};
use oqtal_bus::code::ReferenceKind;
use oqtal_bus::message::ReferenceV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::euler::EulerAngles;
use oqtal_control::quantity::BodyRate;
use oqtal_control::quaternion::Attitude;
use oqtal_control::tracking_error::AttitudeReference;
use oqtal_control::trajectory::{Reference, ReferenceMotion};

use crate::room::StoppingRoom;
use crate::setpoint::{SetpointRefusal, require, require_turn};

/// Least pause after which a planner's references count as a new stream; the longest validity if that is longer.
const PAUSE: Span = Span::from_millis(500);
/// Deviation of the norm of a quaternion from 1 above which it is invalid \[-\].
const NORM_TOLERANCE: f64 = 1e-3;
/// Limit of the speed at the end of the validity over that at the beginning \[-\]: most references are replaced earlier.
const END_SPEED: f64 = 2.0;
/// Greatest difference of the velocity between a reference and the extrapolation of the one before, over the time between them
/// \[m/s^2\].
const VELOCITY_MISMATCH: f64 = 2.0;
/// The same of the acceleration \[m/s^3\].
const ACCELERATION_MISMATCH: f64 = 10.0;
/// Limit of the jerk over that of the acceleration \[1/s\]: the limit of the acceleration is reached within a tenth of a second.
const JERK_FACTOR: f64 = 10.0;
/// Name of the turn from one reference to the next.
const TURN: &str = "turn from the present heading";
/// Refusal of a reference outside the room.
const NO_ROOM: &str =
    "it leads outside the soft border of [fence], or less than 0.1 m above the floor";
/// Refusal of a reference from which a vehicle cannot stop in the room.
const NO_STOP: &str = "a stop from it would lead outside the soft border of [fence], or less than 0.1 m above the floor";
/// Refusal of an invalid attitude.
const INVALID_ATTITUDE: SetpointRefusal =
    SetpointRefusal::Invalid("its attitude is not a rotation, or its rate not finite");
/// Number of bisections of the time at which an attitude reaches the tilt limit \[-\].
const BISECTIONS: usize = 12;

/// Limits of a planner's references.
#[derive(Clone, Copy, Debug)]
struct StreamLimits {
    speed_m_s: f64,
    acceleration_m_s2: f64,
    jump_m: f64,
    rate_rad_s: [f64; 3],
    cosine_of_tilt: f64,
    longest_validity: Span,
    /// Pause after which references are of another stream: within one validity, they are of one.
    pause: Span,
}

/// A reference that was accepted.
#[derive(Clone, Copy, Debug, PartialEq)]
struct FollowedReference {
    time: Time,
    valid_until: Time,
    motion: ReferenceMotion,
    jerk: Vector3<f64>,
    /// Whether acceleration and jerk are those of the motion: laws feed them forward.
    is_smooth: bool,
    attitude: Option<AttitudeReference>,
}

impl FollowedReference {
    /// The motion at `now`.
    fn motion(&self, now: Time) -> ReferenceMotion {
        let dt_s = now.since(self.time).seconds();
        let mut motion = self.motion.after(dt_s);
        let bend = self.jerk * (dt_s * dt_s / 2.0);
        motion.value += (bend * (dt_s / 3.0)).push(0.0);
        motion.rate += bend.push(0.0);
        motion.acceleration += (self.jerk * dt_s).push(0.0);
        motion
    }

    /// Whether velocity and acceleration lead to those of `next`, up to an acceleration of [`VELOCITY_MISMATCH`]. A planner whose
    /// derivatives are wrong would push the vehicle away.
    fn leads_to(&self, next: &Self) -> bool {
        let dt_s = next.time.since(self.time).seconds();
        let expected = self.motion(next.time);
        let gap = |from: Vector4<f64>, to: Vector4<f64>| (to - from).xyz().norm();
        dt_s > 0.0
            && gap(expected.rate, next.motion.rate) <= VELOCITY_MISMATCH * dt_s
            && gap(expected.acceleration, next.motion.acceleration) <= ACCELERATION_MISMATCH * dt_s
    }

    /// The reference at `now`; a prescribed attitude turns on up to the tilt of this cosine, and is held there.
    fn reference(&self, now: Time, cosine_of_tilt: f64) -> Reference {
        let turned = |prescribed: AttitudeReference| {
            let after = |dt_s: f64| prescribed.attitude.turned_by(prescribed.rate.0 * dt_s);
            let (mut within_s, mut beyond_s) = (0.0, now.since(self.time).seconds());
            if is_upright(&after(beyond_s), cosine_of_tilt) {
                return AttitudeReference { attitude: after(beyond_s), ..prescribed };
            }
            for _ in 0..BISECTIONS {
                let middle_s = 0.5 * (within_s + beyond_s);
                let is_within = is_upright(&after(middle_s), cosine_of_tilt);
                *(if is_within { &mut within_s } else { &mut beyond_s }) = middle_s;
            }
            AttitudeReference::at_rest(after(within_s))
        };
        let attitude = self.attitude.map(turned);
        let reference = Reference { attitude, ..self.motion(now).reference() };
        match self.is_smooth {
            true => Reference { jerk: self.jerk, ..reference },
            false => Reference { acceleration: Vector3::zeros(), ..reference },
        }
    }
}

/// `motion` at constant velocity.
fn without_acceleration(motion: &ReferenceMotion) -> ReferenceMotion {
    ReferenceMotion { acceleration: Vector4::zeros(), ..*motion }
}

/// Whether `attitude` is tilted by no more than the angle of this cosine.
fn is_upright(attitude: &Attitude, cosine_of_tilt: f64) -> bool {
    attitude.to_world(&Vector3::z()).z >= cosine_of_tilt
}

/// Writer of references, and the instant of its last one.
type Writer = (u64, Time);

/// The references of a planner. No method allocates.
#[derive(Clone, Debug)]
pub struct ReferenceStream {
    limits: StreamLimits,
    land_after: Span,
    followed: Option<FollowedReference>,
    /// Since when the vehicle holds its position because the references ended.
    ended_since: Option<Time>,
    /// The planner whose stream an operator, or the end of a flight, has ended.
    ignored: Option<Writer>,
    last: Option<Writer>,
    refusal: Option<SetpointRefusal>,
}

impl ReferenceStream {
    /// The stream of `config`, before the first reference.
    pub fn new(config: &Config) -> Self {
        Self {
            limits: StreamLimits::new(config),
            land_after: Span::from_seconds(config.reference.land_after_ms * 1e-3),
            followed: None,
            ended_since: None,
            ignored: None,
            last: None,
            refusal: None,
        }
    }

    /// Replaces the limits by those of `other`.
    pub fn set_limits(&mut self, other: &Self) {
        self.limits = other.limits;
        self.land_after = other.land_after;
    }

    /// Discards all references at the beginning of a flight. A planner whose stream was ended remains ignored until it pauses.
    pub fn reset(&mut self) {
        (self.followed, self.ended_since, self.refusal) = (None, None, None);
    }

    /// Ends the stream, since an operator determines the flight, or it is over; its writer is ignored until it pauses.
    pub fn end(&mut self) {
        self.reset();
        self.ignored = self.last;
    }

    /// Interrupts the stream, and restarts the time until the vehicle lands. Returns whether references were followed.
    pub fn interrupt(&mut self, now: Time) -> bool {
        let was_followed = self.followed.take().is_some();
        if was_followed || self.ended_since.is_some() {
            self.ended_since = Some(now);
        }
        was_followed
    }

    /// Takes a reference of the writer `source`; `at` is the motion of the reference that is flown at `now`, the heading of the vehicle
    /// \[rad\], and the room; `None` if no reference can be followed now, which does not count as a pause of the writer.
    pub fn receive(
        &mut self,
        now: Time,
        (source, message): (u64, &ReferenceV1),
        at: Option<(&ReferenceMotion, f64, &StoppingRoom)>,
    ) {
        self.last = Some((source, now));
        if let Some((ignored, at)) = &mut self.ignored {
            if *ignored == source && now.since(*at) < self.limits.pause {
                *at = now;
                return;
            }
            self.ignored = None;
        }
        let Some(at) = at else { return };
        match self.limits.check(now, message, at) {
            Ok(reference) => {
                let is_smooth = self.followed.is_some_and(|last| last.leads_to(&reference));
                let reference = FollowedReference { is_smooth, ..reference };
                (self.followed, self.ended_since) = (Some(reference), None);
            }
            Err(refusal) => self.refusal = Some(refusal),
        }
    }

    /// Whether references arrive that are ignored.
    pub fn is_ignored(&self, now: Time) -> bool {
        self.ignored.is_some_and(|(_, at)| now.since(at) < self.limits.pause)
    }

    /// Whether references are followed.
    pub fn is_followed(&self) -> bool {
        self.followed.is_some()
    }

    /// The reference at `now`; `None` if none is followed.
    pub fn reference(&self, now: Time) -> Option<Reference> {
        self.followed.map(|followed| followed.reference(now, self.limits.cosine_of_tilt))
    }

    /// The motion of the reference at `now`, with its acceleration only if that is fed forward; `None` if none is followed.
    pub fn motion(&self, now: Time) -> Option<ReferenceMotion> {
        self.followed.map(|followed| match followed.is_smooth {
            true => followed.motion(now),
            false => without_acceleration(&followed.motion(now)),
        })
    }

    /// Whether the followed reference prescribes an attitude.
    pub fn prescribes_attitude(&self) -> bool {
        self.followed.is_some_and(|followed| followed.attitude.is_some())
    }

    /// Ends the stream if the validity of its last reference is over at `now`; returns whether it ended.
    pub fn expire(&mut self, now: Time) -> bool {
        let is_over = self.followed.is_some_and(|followed| now > followed.valid_until);
        if is_over {
            (self.followed, self.ended_since) = (None, Some(now));
        }
        is_over
    }

    /// Whether the vehicle holds its position because the references ended, and whether it must land because this has lasted too long.
    pub fn ended(&self, now: Time) -> [bool; 2] {
        let is_over = self.ended_since.is_some_and(|since| now.since(since) >= self.land_after);
        [self.ended_since.is_some(), is_over]
    }

    /// Why a reference was refused since the last call; `None` if none was.
    pub fn take_refusal(&mut self) -> Option<SetpointRefusal> {
        self.refusal.take()
    }
}

impl StreamLimits {
    fn new(config: &Config) -> Self {
        let options = &config.reference;
        let longest_validity = Span::from_seconds(options.longest_validity_ms * 1e-3);
        Self {
            speed_m_s: options.speed_limit_m_s,
            acceleration_m_s2: options.acceleration_limit_m_s2,
            jump_m: options.jump_limit_m,
            rate_rad_s: config.vehicle.rate_authority_rad_s,
            cosine_of_tilt: config.position.tilt_limit_deg.to_radians().cos(),
            longest_validity,
            pause: PAUSE.max(longest_validity),
        }
    }

    /// The reference of `message`.
    ///
    /// # Errors
    /// It is invalid, too old, or beyond a limit.
    fn check(
        &self,
        now: Time,
        message: &ReferenceV1,
        (present, heading_rad, room): (&ReferenceMotion, f64, &StoppingRoom),
    ) -> Result<FollowedReference, SetpointRefusal> {
        let age_ms = now.since(message.time).seconds().abs() * 1e3;
        let longest_ms = self.longest_validity.seconds() * 1e3;
        let limit = ("reference.longest-validity-ms", longest_ms);
        require(["difference of its time stamp from the present", "ms"], age_ms, limit)?;
        if message.valid_until <= now {
            return Err(SetpointRefusal::Invalid("its validity is over"));
        }
        let kind = ReferenceKind::from_code(message.kind)
            .ok_or(SetpointRefusal::Invalid("its kind is unknown"))?;
        let [position, velocity, acceleration, jerk] =
            [message.position, message.velocity, message.acceleration, message.jerk]
                .map(Vector3::from);
        let motion = ReferenceMotion {
            value: position.push(message.yaw),
            rate: velocity.push(message.yaw_rate),
            acceleration: acceleration.push(0.0),
        };
        let valid_until = message.valid_until.min(now + self.longest_validity);
        let (time, is_smooth, attitude) = (message.time, false, None);
        let mut reference =
            FollowedReference { time, valid_until, motion, jerk, is_smooth, attitude };
        if kind == ReferenceKind::Attitude {
            let attitude = self.attitude(message, present.value.w)?;
            // Horizontal position is not controlled; the next heading is compared with this one.
            let (height, [x, y]) = (reference.motion.value.z, present.value.xy().into());
            let heading = EulerAngles::from_attitude(&attitude.attitude).yaw;
            reference.motion.value = Vector4::new(x, y, height, heading);
            reference.attitude = Some(attitude);
            for derivative in [&mut reference.motion.rate, &mut reference.motion.acceleration] {
                *derivative = Vector4::z() * derivative.z;
            }
            reference.jerk = Vector3::z() * reference.jerk.z;
        }
        self.require_allowed(now, &reference, (present, room))?;
        // Derivatives do not bound the heading: the vehicle may not follow it.
        let turn_rad = reference.motion(now).value.w - heading_rad;
        require_turn("difference of its heading from that of the vehicle", turn_rad)?;
        Ok(reference)
    }

    /// Requires that `reference` is within the limits, now and at the end of its validity.
    fn require_allowed(
        &self,
        now: Time,
        reference: &FollowedReference,
        (present, room): (&ReferenceMotion, &StoppingRoom),
    ) -> Result<(), SetpointRefusal> {
        let [now, end] = [now, reference.valid_until].map(|at| reference.motion(at));
        let jump_m = (now.value - present.value).xyz().norm();
        let jump = ("reference.jump-limit-m", self.jump_m);
        require(["distance from the present reference", "m"], jump_m, jump)?;
        let speed = ("reference.speed-limit-m-s", self.speed_m_s);
        require(["speed", "m/s"], now.rate.xyz().norm(), speed)?;
        let acceleration = ("reference.acceleration-limit-m-s2", self.acceleration_m_s2);
        require(["acceleration", "m/s^2"], now.acceleration.xyz().norm(), acceleration)?;
        // Fed forward: the prediction of positions alone would pass any jerk that is valid for a short time.
        let jerk = ("10 x reference.acceleration-limit-m-s2", JERK_FACTOR * self.acceleration_m_s2);
        require(["jerk", "m/s^3"], reference.jerk.norm(), jerk)?;
        let end_speed = ("2 x reference.speed-limit-m-s", END_SPEED * self.speed_m_s);
        require(["speed at the end of its validity", "m/s"], end.rate.xyz().norm(), end_speed)?;
        self.require_heading(&now, present)?;
        let both = [now, end];
        if !both.iter().all(|motion| room.contains(&motion.value.xyz())) {
            return Err(SetpointRefusal::Invalid(NO_ROOM));
        }
        // A planner's acceleration may be wrong: the stop must not depend on it.
        let has_stop =
            |motion| room.has_stop(motion) && room.has_stop(&without_acceleration(motion));
        both.iter().all(has_stop).then_some(()).ok_or(SetpointRefusal::Invalid(NO_STOP))
    }

    /// Requires that the heading of the motion `now` does not jump: a law would lose the tilt over a large turn.
    fn require_heading(
        &self,
        now: &ReferenceMotion,
        present: &ReferenceMotion,
    ) -> Result<(), SetpointRefusal> {
        require_turn(TURN, now.value.w - present.value.w)?;
        let rate = ("the yaw of vehicle.rate-authority-rad-s", self.rate_rad_s[2]);
        require(["yaw rate", "rad/s"], now.rate.w.abs(), rate)
    }

    /// The attitude of `message`, of a vehicle with the heading `yaw_rad`.
    ///
    /// # Errors
    /// It is not a rotation, is tilted or turned beyond a limit, or its rate is beyond that of the vehicle.
    fn attitude(
        &self,
        message: &ReferenceV1,
        yaw_rad: f64,
    ) -> Result<AttitudeReference, SetpointRefusal> {
        let norm = message.attitude.iter().map(|part| part * part).sum::<f64>().sqrt();
        let rate = Vector3::from(message.rate);
        let is_rotation = (norm - 1.0).abs() <= NORM_TOLERANCE;
        if !is_rotation || !rate.iter().all(|part| part.is_finite()) {
            return Err(INVALID_ATTITUDE);
        }
        let attitude = Attitude::from_xyzw(message.attitude).ok_or(INVALID_ATTITUDE)?;
        if !is_upright(&attitude, self.cosine_of_tilt) {
            let degrees = |cosine: f64| cosine.clamp(-1.0, 1.0).acos().to_degrees();
            let value = degrees(attitude.to_world(&Vector3::z()).z);
            let limit = ("position.tilt-limit-deg", degrees(self.cosine_of_tilt));
            return Err(SetpointRefusal::Beyond { quantity: ["tilt", "deg"], value, limit });
        }
        require_turn(TURN, EulerAngles::from_attitude(&attitude).yaw - yaw_rad)?;
        for (rate, limit) in rate.iter().zip(self.rate_rad_s) {
            let limit = ("vehicle.rate-authority-rad-s", limit);
            require(["rate about an axis", "rad/s"], rate.abs(), limit)?;
        }
        Ok(AttitudeReference { rate: BodyRate(rate), ..AttitudeReference::at_rest(attitude) })
    }
}

#[cfg(test)]
mod tests;
