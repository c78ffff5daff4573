//! Limits of a planner's references, and the check of each.

use std::f64::consts::{PI, TAU};

use nalgebra::{Vector3, Vector4};
use oqtal_bus::code::ReferenceKind;
use oqtal_bus::message::ReferenceV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::euler::shorter_turn;
use oqtal_control::quantity::BodyRate;
use oqtal_control::quaternion::Attitude;
use oqtal_control::tracking_error::AttitudeReference;
use oqtal_control::trajectory::ReferenceMotion;

use super::followed::{FollowedReference, is_upright, without_acceleration};
use crate::room::StoppingRoom;
use crate::setpoint::{SetpointRefusal, require, require_turn};

/// Least pause after which a planner's references count as a new stream; the longest validity if that is longer.
const PAUSE: Span = Span::from_millis(500);
/// Deviation of the norm of a quaternion from 1 above which it is invalid \[-\].
const NORM_TOLERANCE: f64 = 1e-3;
/// Limit of the speed at the end of the validity over that at the beginning \[-\]: most references are replaced earlier.
const END_SPEED: f64 = 2.0;
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

/// Limits of a planner's references.
#[derive(Clone, Copy, Debug)]
pub(super) struct StreamLimits {
    speed_m_s: f64,
    acceleration_m_s2: f64,
    jump_m: f64,
    rate_rad_s: [f64; 3],
    /// Cosine of the greatest tilt of a prescribed attitude \[-\].
    pub(super) least_upright: f64,
    longest_validity: Span,
    /// Pause after which references are of another stream: within one validity, they are of one.
    pub(super) pause: Span,
}

impl StreamLimits {
    pub(super) fn new(config: &Config) -> Self {
        let options = &config.reference;
        let longest_validity = Span::from_seconds(options.longest_validity_ms * 1e-3);
        Self {
            speed_m_s: options.speed_limit_m_s,
            acceleration_m_s2: options.acceleration_limit_m_s2,
            jump_m: options.jump_limit_m,
            rate_rad_s: config.vehicle.rate_authority_rad_s,
            least_upright: config.position.tilt_limit_deg.to_radians().cos(),
            longest_validity,
            pause: PAUSE.max(longest_validity),
        }
    }

    /// The reference of `message`.
    ///
    /// # Errors
    /// It is invalid, too old, or beyond a limit.
    pub(super) fn check(
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
        let valid_until = message.valid_until.min(now + self.longest_validity);
        let mut reference = FollowedReference {
            time: message.time,
            valid_until,
            motion: motion_of(message, present.value.w),
            jerk: message.jerk.into(),
            is_smooth: false,
            attitude: None,
        };
        if kind == ReferenceKind::Attitude {
            reference.attitude = Some(self.attitude(message)?);
            // Horizontal position is not controlled.
            let (value, [x, y]) = (reference.motion.value, present.value.xy().into());
            reference.motion.value = Vector4::new(x, y, value.z, value.w);
            for derivative in [&mut reference.motion.rate, &mut reference.motion.acceleration] {
                *derivative = Vector4::z() * derivative.z;
            }
            reference.jerk = Vector3::z() * reference.jerk.z;
        }
        let flown = reference.motion(now, self.least_upright);
        self.require_allowed(&flown, &reference, (present, room))?;
        // Derivatives do not bound the heading: the vehicle may not follow it.
        let turn_rad = flown.value.w - heading_rad;
        require_turn("difference of its heading from that of the vehicle", turn_rad)?;
        Ok(reference)
    }

    /// Requires that `reference` is within the limits, in its motion `now` and at the end of its validity.
    fn require_allowed(
        &self,
        now: &ReferenceMotion,
        reference: &FollowedReference,
        (present, room): (&ReferenceMotion, &StoppingRoom),
    ) -> Result<(), SetpointRefusal> {
        let end = &reference.motion(reference.valid_until, self.least_upright);
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
        self.require_heading(now, present)?;
        let both = [now, end];
        if !both.iter().all(|motion| room.contains(&motion.value.xyz())) {
            return Err(SetpointRefusal::Invalid(NO_ROOM));
        }
        // A planner's acceleration may be wrong: the stop must not depend on it.
        let has_stop = |motion: &ReferenceMotion| {
            room.has_stop(motion) && room.has_stop(&without_acceleration(motion))
        };
        both.into_iter().all(has_stop).then_some(()).ok_or(SetpointRefusal::Invalid(NO_STOP))
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

    /// The attitude of `message`.
    ///
    /// # Errors
    /// It is not a rotation, is tilted beyond the limit, or its rate is beyond that of the vehicle.
    fn attitude(&self, message: &ReferenceV1) -> Result<AttitudeReference, SetpointRefusal> {
        let norm = message.attitude.iter().map(|part| part * part).sum::<f64>().sqrt();
        let rate = Vector3::from(message.rate);
        let is_rotation = (norm - 1.0).abs() <= NORM_TOLERANCE;
        if !is_rotation || !rate.iter().all(|part| part.is_finite()) {
            return Err(INVALID_ATTITUDE);
        }
        let attitude = Attitude::from_xyzw(message.attitude).ok_or(INVALID_ATTITUDE)?;
        if !is_upright(&attitude, self.least_upright) {
            let degrees = |cosine: f64| cosine.clamp(-1.0, 1.0).acos().to_degrees();
            let value = degrees(attitude.to_world(&Vector3::z()).z);
            let limit = ("position.tilt-limit-deg", degrees(self.least_upright));
            return Err(SetpointRefusal::Beyond { quantity: ["tilt", "deg"], value, limit });
        }
        for (rate, limit) in rate.iter().zip(self.rate_rad_s) {
            let limit = ("vehicle.rate-authority-rad-s", limit);
            require(["rate about an axis", "rad/s"], rate.abs(), limit)?;
        }
        Ok(AttitudeReference { rate: BodyRate(rate), ..AttitudeReference::at_rest(attitude) })
    }
}

/// The motion that `message` gives, near the heading `present_rad` \[rad\].
fn motion_of(message: &ReferenceV1, present_rad: f64) -> ReferenceMotion {
    let [position, velocity, acceleration] =
        [message.position, message.velocity, message.acceleration].map(Vector3::from);
    ReferenceMotion {
        value: position.push(near_heading(message.yaw, present_rad)),
        rate: velocity.push(message.yaw_rate),
        acceleration: acceleration.push(0.0),
    }
}

/// `yaw_rad`, or the same heading within half a turn of `present_rad` \[rad\]: a number of many turns has no digits left for the heading.
fn near_heading(yaw_rad: f64, present_rad: f64) -> f64 {
    match (yaw_rad - present_rad).abs() <= PI {
        true => yaw_rad,
        false => present_rad + shorter_turn(yaw_rad % TAU - present_rad),
    }
}
