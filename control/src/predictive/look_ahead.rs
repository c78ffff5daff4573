//! A prescribed attitude, led on from now to the instant at which a command sent now acts.

use nalgebra::Vector3;

use crate::quantity::{AngularAcceleration, BodyRate};
use crate::tracking_error::AttitudeReference;

/// A reference further than this from where the last one led to is another reference \[rad\].
const CONTINUES_RAD: f64 = 0.01;

/// The last reference, from which the next tells how the acceleration changes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LookAhead {
    last: Option<AttitudeReference>,
}

impl LookAhead {
    /// There is no reference now.
    pub fn reset(&mut self) {
        self.last = None;
    }

    /// `reference`, `dt_s` \[s\] after the last one, at `delay_s` \[s\] from now.
    ///
    /// Its acceleration is that of another half of `dt_s` later: a command is held so long, and what
    /// it must bring about on average is what is needed in the middle.
    pub fn lead(
        &mut self,
        reference: &AttitudeReference,
        dt_s: f64,
        delay_s: f64,
    ) -> AttitudeReference {
        let continued = |last: &AttitudeReference| {
            let expected = ahead(last, &Vector3::zeros(), dt_s).attitude;
            expected.angle_to(&reference.attitude) < CONTINUES_RAD
        };
        let jerk = match self.last.filter(continued) {
            Some(last) => (reference.acceleration.0 - last.acceleration.0) / dt_s,
            None => Vector3::zeros(),
        };
        self.last = Some(*reference);
        let led = ahead(reference, &jerk, delay_s);
        let acceleration = AngularAcceleration(led.acceleration.0 + jerk * (dt_s / 2.0));
        AttitudeReference { acceleration, ..led }
    }
}

/// Where a turning reference is after `t_s` \[s\] if its `jerk` \[rad/s^3\] stays.
fn ahead(reference: &AttitudeReference, jerk: &Vector3<f64>, t_s: f64) -> AttitudeReference {
    let AttitudeReference { attitude, rate: BodyRate(rate), acceleration } = reference;
    let acceleration = acceleration.0;
    let turn = (rate + (acceleration + jerk * (t_s / 3.0)) * (t_s / 2.0)) * t_s;
    AttitudeReference {
        attitude: attitude.turned_by(turn),
        rate: BodyRate(rate + (acceleration + jerk * (t_s / 2.0)) * t_s),
        acceleration: AngularAcceleration(acceleration + jerk * t_s),
    }
}
