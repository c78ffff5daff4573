//! Check of the reference: an invalid reference is replaced by the last valid one.

use std::fmt;

use nalgebra::Vector3;
use oqtal_control::euler::shorter_turn;
use oqtal_control::trajectory::{Phase, Reference};

use crate::fence::Fence;

/// Greatest turn of a planner's references at once \[deg\].
const MOST_TURN_DEG: f64 = 45.0;

/// Turn of the reference from one tick to the next above which it is invalid \[rad\].
pub(crate) const LARGEST_TURN_RAD: f64 = 2.4;

/// The check of the reference.
#[derive(Clone, Debug)]
pub struct SetpointGuard {
    fence: Fence,
    last: Option<Reference>,
    /// The change of the plan to which it belongs.
    plan: u32,
}

/// Reason why a reference was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SetpointRefusal {
    /// The reference is invalid; the text names the invalid part.
    Invalid(&'static str),
    /// The reference is beyond a limit.
    Beyond {
        /// The quantity, and its unit.
        quantity: [&'static str; 2],
        /// Value of the quantity \[its unit\].
        value: f64,
        /// The key of the limit, and its value \[unit of the quantity\].
        limit: (&'static str, f64),
    },
}

impl SetpointRefusal {
    /// Kind of the reason, whatever the values.
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Invalid(what) => what,
            Self::Beyond { quantity: [name, _], .. } => name,
        }
    }
}

impl fmt::Display for SetpointRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Invalid(what) => f.write_str(what),
            Self::Beyond { quantity: [name, _], value, .. } if value.is_nan() => {
                write!(f, "{name} is not a number")
            }
            Self::Beyond { quantity: [name, unit], value, limit: (key, limit) } => {
                // Limits are configured in units of their own; rounded, they read as in the file.
                let limit = (limit * 1e6).round() / 1e6;
                write!(f, "{name} {value:.2} {unit} exceeds {key} = {limit}")
            }
        }
    }
}

/// A reference that was checked.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CheckedSetpoint {
    /// The reference to fly; `None` if there was no valid one yet.
    pub reference: Option<Reference>,
    /// Why another reference was refused; `None` if none was.
    pub refusal: Option<SetpointRefusal>,
}

impl CheckedSetpoint {
    /// The reference at rest at `point` \[m, world\], with the heading and in the phase of this one.
    pub fn at(&self, point: Vector3<f64>) -> Reference {
        let (yaw_rad, phase) = self
            .reference
            .map_or((0.0, Phase::TakeOff), |reference| (reference.yaw_rad, reference.phase));
        Reference { yaw_rad, ..Reference::rest(point, phase) }
    }

    /// The reference with its heading turned by `offset_rad` \[rad\].
    pub fn turned(&self, offset_rad: f64) -> Option<Reference> {
        let turned = |reference: Reference| Reference {
            yaw_rad: reference.yaw_rad + offset_rad,
            ..reference
        };
        self.reference.map(turned)
    }
}

impl SetpointGuard {
    /// The check of references that must stay inside `fence`.
    pub fn new(fence: Fence) -> Self {
        Self { fence, last: None, plan: 0 }
    }

    /// Discards the last reference, at the beginning of a flight.
    pub fn reset(&mut self) {
        self.last = None;
    }

    /// The reference to fly: `reference` if it is finite, inside the fence and without a sudden reversal of heading, otherwise
    /// the last valid one. If only the heading is invalid, the new position is flown with the last heading. The check applies
    /// within one `plan`, numbered by its changes: the first reference of a landing or of a hold may turn.
    pub fn pass(&mut self, plan: u32, reference: &Reference) -> CheckedSetpoint {
        let is_new = std::mem::replace(&mut self.plan, plan) != plan;
        let is_sound = reference.is_finite() && self.fence.inside_m(&reference.position) > 0.0;
        if !is_sound {
            let refusal = SetpointRefusal::Invalid("it is not finite, or outside the fence");
            return CheckedSetpoint { reference: self.last, refusal: Some(refusal) };
        }
        let turned = self.last.filter(|last| !is_new && turns_round(last, reference));
        let valid = match turned {
            // A turn that lasts must not keep a landing from its way down.
            Some(Reference { yaw_rad, attitude, .. }) => {
                let [yaw_rate_rad_s, yaw_acceleration_rad_s2] = [0.0; 2];
                Reference {
                    yaw_rad,
                    yaw_rate_rad_s,
                    yaw_acceleration_rad_s2,
                    attitude,
                    ..*reference
                }
            }
            None => *reference,
        };
        self.last = Some(valid);
        let refusal = turned
            .map(|_| SetpointRefusal::Invalid("its heading or attitude reverses in one tick"));
        CheckedSetpoint { reference: self.last, refusal }
    }
}

/// Requires that `turn_rad` \[rad\], named `turn`, is at most [`MOST_TURN_DEG`].
pub(crate) fn require_turn(turn: &'static str, turn_rad: f64) -> Result<(), SetpointRefusal> {
    let turn_deg = shorter_turn(turn_rad).abs().to_degrees();
    let limit = ("the greatest turn that laws follow", MOST_TURN_DEG);
    require([turn, "deg"], turn_deg, limit)
}

/// Requires that the `value` of `quantity` does not exceed the value of the key `limit`. NaN does.
pub(crate) fn require(
    quantity: [&'static str; 2],
    value: f64,
    limit: (&'static str, f64),
) -> Result<(), SetpointRefusal> {
    match value <= limit.1 {
        true => Ok(()),
        false => Err(SetpointRefusal::Beyond { quantity, value, limit }),
    }
}

/// Whether heading or attitude reverse between two references in successive ticks.
pub(crate) fn turns_round(last: &Reference, next: &Reference) -> bool {
    match (&last.attitude, &next.attitude) {
        (Some(last), Some(next)) => last.attitude.angle_to(&next.attitude) > LARGEST_TURN_RAD,
        (None, None) => {
            let turn_rad = next.yaw_rad - last.yaw_rad;
            // `shorter_turn` costs more, and never exceeds the plain difference.
            turn_rad.abs() > LARGEST_TURN_RAD && shorter_turn(turn_rad).abs() > LARGEST_TURN_RAD
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_config::Config;

    fn at(x: f64, yaw_rad: f64) -> Reference {
        Reference { yaw_rad, ..Reference::rest(Vector3::new(x, 0.0, 1.0), Phase::Trajectory) }
    }

    /// The reference that is flown, and whether `next` was refused.
    fn pass(guard: &mut SetpointGuard, plan: u32, next: &Reference) -> (Option<Reference>, bool) {
        let CheckedSetpoint { reference, refusal } = guard.pass(plan, next);
        (reference, refusal.is_some())
    }

    #[test]
    fn f35_an_absurd_set_point_leaves_the_last_valid_one_in_force() {
        let mut guard = SetpointGuard::new(Fence::new(&Config::default().fence));
        assert_eq!(pass(&mut guard, 0, &at(f64::NAN, 0.0)), (None, true));
        assert_eq!(pass(&mut guard, 0, &at(0.5, 0.1)), (Some(at(0.5, 0.1)), false));
        for wrong in [at(f64::NAN, 0.1), at(1e9, 0.1), at(0.5, f64::INFINITY), at(0.5, 3.2)] {
            assert_eq!(pass(&mut guard, 0, &wrong), (Some(at(0.5, 0.1)), true), "{wrong:?}");
        }
        let jumped = (Some(at(1.8, 0.1)), false);
        assert_eq!(pass(&mut guard, 0, &at(1.8, 0.1)), jumped, "corners may jump");
        guard.reset();
        assert_eq!(pass(&mut guard, 0, &at(0.0, -3.0)), (Some(at(0.0, -3.0)), false));
    }

    #[test]
    fn f35_a_turn_is_refused_within_a_plan_and_a_lasting_one_is_flown_with_the_last_heading() {
        let mut guard = SetpointGuard::new(Fence::new(&Config::default().fence));
        pass(&mut guard, 0, &at(0.5, 0.0));
        assert_eq!(pass(&mut guard, 0, &at(0.5, 3.1)), (Some(at(0.5, 0.0)), true));
        assert_eq!(pass(&mut guard, 0, &at(0.9, 3.1)), (Some(at(0.9, 0.0)), true));
        assert_eq!(pass(&mut guard, 1, &at(0.9, 3.1)), (Some(at(0.9, 3.1)), false), "a new plan");
        assert_eq!(pass(&mut guard, 2, &at(f64::NAN, 3.1)), (Some(at(0.9, 3.1)), true));
    }
}
