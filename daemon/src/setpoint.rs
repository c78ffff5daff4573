//! The check of the reference: an absurd one is replaced by the last valid one.

use oqtal_control::trajectory::Reference;

use crate::fence::Fence;

/// Turn of the reference from one tick to the next above which it is absurd \[rad\].
const LARGEST_TURN_RAD: f64 = 2.4;

/// The check of the reference.
#[derive(Clone, Debug)]
pub struct SetpointGuard {
    fence: Fence,
    last: Option<Reference>,
}

impl SetpointGuard {
    /// The check of references that must stay inside `fence`.
    #[must_use]
    pub fn new(fence: Fence) -> Self {
        Self { fence, last: None }
    }

    /// Forgets the last reference: a flight begins.
    pub fn reset(&mut self) {
        self.last = None;
    }

    /// The reference to fly: `reference` if it is finite, inside the fence, and does not turn round at once, otherwise the last
    /// valid one. `None` if there was none. The second value tells whether it was refused.
    pub fn pass(&mut self, reference: &Reference) -> (Option<Reference>, bool) {
        let is_valid = reference.is_finite()
            && self.fence.inside_m(&reference.position) > 0.0
            && self.last.is_none_or(|last| !turns_round(&last, reference));
        if is_valid {
            self.last = Some(*reference);
        }
        (self.last, !is_valid)
    }
}

fn turns_round(last: &Reference, next: &Reference) -> bool {
    match (&last.attitude, &next.attitude) {
        (Some(last), Some(next)) => last.attitude.angle_to(&next.attitude) > LARGEST_TURN_RAD,
        (None, None) => {
            let turn = next.yaw_rad - last.yaw_rad;
            turn.sin().atan2(turn.cos()).abs() > LARGEST_TURN_RAD
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use oqtal_config::Config;
    use oqtal_control::trajectory::Phase;

    fn at(x: f64, yaw_rad: f64) -> Reference {
        Reference { yaw_rad, ..Reference::rest(Vector3::new(x, 0.0, 1.0), Phase::Trajectory) }
    }

    #[test]
    fn f35_an_absurd_set_point_leaves_the_last_valid_one_in_force() {
        let mut guard = SetpointGuard::new(Fence::new(&Config::default().fence));
        assert_eq!(guard.pass(&at(f64::NAN, 0.0)), (None, true));
        assert_eq!(guard.pass(&at(0.5, 0.1)), (Some(at(0.5, 0.1)), false));
        for wrong in [at(f64::NAN, 0.1), at(1e9, 0.1), at(0.5, f64::INFINITY), at(0.5, 3.2)] {
            assert_eq!(guard.pass(&wrong), (Some(at(0.5, 0.1)), true), "{wrong:?}");
        }
        assert_eq!(guard.pass(&at(1.8, 0.1)), (Some(at(1.8, 0.1)), false), "corners may jump");
        guard.reset();
        assert_eq!(guard.pass(&at(0.0, -3.0)), (Some(at(0.0, -3.0)), false));
    }
}
