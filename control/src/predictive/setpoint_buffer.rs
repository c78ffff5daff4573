//! Set-points by the time for which they are valid: the time at which their command takes effect. The set-point for now was
//! therefore computed one delay ago.

use super::ring::Ring;
use crate::position::PositionCommand;
use crate::quantity::{AngularAcceleration, BodyRate};
use crate::tracking_error::AttitudeReference;

/// Buffer of the newest set-points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetpointBuffer(Ring<(f64, PositionCommand)>);

impl SetpointBuffer {
    /// An empty buffer.
    pub fn new() -> Self {
        Self(Ring::new())
    }

    /// Adds a set-point for the time `t_s` \[s\].
    pub fn push(&mut self, t_s: f64, setpoint: PositionCommand) {
        self.0.push((t_s, setpoint));
    }

    /// The set-point for `t_s` \[s\], interpolated between two set-points; before the first one, the first. `None` if
    /// the buffer is empty.
    pub fn at(&self, t_s: f64) -> Option<PositionCommand> {
        let mut later: Option<&(f64, PositionCommand)> = None;
        for decision in self.0.newest_first() {
            if decision.0 <= t_s {
                return Some(later.map_or(decision.1, |later| between(decision, later, t_s)));
            }
            later = Some(decision);
        }
        later.map(|(_, setpoint)| *setpoint)
    }
}

fn between(
    (from_s, from): &(f64, PositionCommand),
    (to_s, to): &(f64, PositionCommand),
    t_s: f64,
) -> PositionCommand {
    let share = (t_s - from_s) / (to_s - from_s);
    let (a, b) = (&from.attitude, &to.attitude);
    PositionCommand {
        attitude: AttitudeReference {
            attitude: a.attitude.turned_by(a.attitude.rotation_to(&b.attitude) * share),
            rate: BodyRate(a.rate.0.lerp(&b.rate.0, share)),
            acceleration: AngularAcceleration(a.acceleration.0.lerp(&b.acceleration.0, share)),
        },
        thrust_n: from.thrust_n + (to.thrust_n - from.thrust_n) * share,
        velocity: from.velocity.lerp(&to.velocity, share),
    }
}
