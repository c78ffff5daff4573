//! Look-ahead of a prescribed attitude: from now to the time at which a command sent now takes effect.

use nalgebra::Vector3;

use crate::quantity::{AngularAcceleration, BodyRate};
use crate::tracking_error::AttitudeReference;

/// Greatest angle between a reference and the extrapolation of the last one \[rad\]; beyond it the reference counts
/// as a new one.
const CONTINUES_RAD: f64 = 0.01;

/// State of the look-ahead: the last reference, from which the change of the acceleration is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LookAhead {
    last: Option<AttitudeReference>,
}

impl LookAhead {
    /// Discards the last reference.
    pub fn reset(&mut self) {
        self.last = None;
    }

    /// Extrapolates `reference`, which follows the last one by `dt_s` \[s\], by `delay_s` \[s\].
    ///
    /// The acceleration is extrapolated by another half of `dt_s`: a command is held for `dt_s`, and its mean effect
    /// is that of the middle.
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

/// Extrapolates a turning reference by `t_s` \[s\] with constant `jerk` \[rad/s^3, desired-body axes\].
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
