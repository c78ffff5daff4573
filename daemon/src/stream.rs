//! References of a planner, topic `reference`: their check, the reference between two of them, and their end.
//!
//! The newest accepted reference is followed until its validity ends; between two it is extrapolated. The end of a flight, or an
//! operator's request that changes one, ends the stream: further references of the same planner are ignored until it pauses.

mod followed;
mod limits;

use oqtal_bus::message::ReferenceV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::trajectory::{Reference, ReferenceMotion};

use crate::room::StoppingRoom;
use crate::setpoint::SetpointRefusal;
use followed::{FollowedReference, without_acceleration};
use limits::StreamLimits;

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
        self.followed.map(|followed| followed.reference(now, self.limits.least_upright))
    }

    /// The motion of the reference at `now`, with its acceleration only if that is fed forward; `None` if none is followed.
    pub fn motion(&self, now: Time) -> Option<ReferenceMotion> {
        self.followed.map(|followed| {
            let motion = followed.motion(now, self.limits.least_upright);
            if followed.is_smooth { motion } else { without_acceleration(&motion) }
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

#[cfg(test)]
mod tests;
