//! Motions that show the parameters of a vehicle: doublets and sines about roll and pitch, steps of the height with a swing of
//! the heading, travel to and fro. Not in the paper.
//!
//! About roll and pitch the attitude is prescribed, as by [`AttitudeDoublet`](super::AttitudeDoublet); each such motion is short
//! and begins and ends at rest, so that the vehicle stays close to the hover point, to which it flies back in between. The heading
//! swings without steps: rotors turn a vehicle about z by their drag alone, and a step of the heading saturates them.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::reference::{Phase, Reference};
use crate::options::{OptionError, Rule, check_options};
use crate::quaternion::Attitude;
use crate::tracking_error::AttitudeReference;

/// Time at either side of a doublet \[s\].
const HOLD_S: f64 = 0.4;
/// Duration of a doublet: to one side, twice as long to the other, and to the first \[s\].
const DOUBLET_S: f64 = 4.0 * HOLD_S;
/// Time to fly back after a doublet \[s\].
const RETURN_S: f64 = 1.4;
/// Duration of a sine of rising frequency \[s\].
const SINE_S: f64 = 3.4;
/// Frequency at its start and at its end \[Hz\].
const SINE_HZ: [f64; 2] = [0.8, 4.5];
/// Amplitude of the sine over the angle of the doublets \[-\].
const SINE_SHARE: f64 = 0.3;
/// Time to fly back after the sine \[s\].
const REST_S: f64 = 2.0;
/// Duration of the motions about one axis \[s\].
const AXIS_S: f64 = 2.0 * (DOUBLET_S + RETURN_S) + SINE_S + REST_S;
/// Time between two steps of the height \[s\].
const STEP_S: f64 = 1.1;
/// Number of steps of the height \[-\].
const STEPS: u32 = 9;
/// Duration of the steps of the height, with a time to settle \[s\].
const CLIMB_S: f64 = STEP_S * STEPS as f64 + 0.6;
/// Frequency of the heading at the start and at the end \[Hz\].
const YAW_HZ: [f64; 2] = [0.3, 0.8];
/// Duration of one way of the travel \[s\].
const WAY_S: f64 = 2.6;
/// Number of ways \[-\].
const WAYS: u32 = 5;

/// Motions about each axis, of the height and along x and y, one after another.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Excitation {
    /// Angle of the doublets about roll and pitch \[deg\].
    pub tilt_deg: f64,
    /// Amplitude of the swing of the heading \[deg\].
    pub yaw_deg: f64,
    /// Steps of the height, to either side of the hover point \[m\].
    pub climb_m: f64,
    /// Way to and fro along x, and half of it along y \[m\].
    pub travel_m: f64,
}

impl Default for Excitation {
    fn default() -> Self {
        Self { tilt_deg: 10.0, yaw_deg: 15.0, climb_m: 0.3, travel_m: 1.6 }
    }
}

impl Excitation {
    /// Duration of all motions \[s\].
    pub(super) const DURATION_S: f64 = 2.0 * AXIS_S + CLIMB_S + WAY_S * WAYS as f64;

    pub(super) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("tilt-deg", self.tilt_deg, Rule::Between(0.0, 30.0)),
            ("yaw-deg", self.yaw_deg, Rule::Between(0.0, 90.0)),
            ("climb-m", self.climb_m, Rule::Between(0.0, 2.0)),
            ("travel-m", self.travel_m, Rule::Between(0.0, 20.0)),
        ])
    }

    pub(super) fn sample(&self, t_s: f64) -> Reference {
        let climb_s = t_s - 2.0 * AXIS_S;
        if climb_s < 0.0 {
            let (axis, since_s) =
                if t_s < AXIS_S { (Vector3::x(), t_s) } else { (Vector3::y(), t_s - AXIS_S) };
            let mut reference = Reference::rest(Vector3::zeros(), Phase::Trajectory);
            reference.attitude = tilt_share(since_s).map(|share| {
                let angle = share * self.tilt_deg.to_radians();
                AttitudeReference::at_rest(Attitude::from_rotation_vector(axis * angle))
            });
            return reference;
        }
        if climb_s < CLIMB_S { self.climb(climb_s) } else { self.travel(climb_s - CLIMB_S) }
    }

    /// Height and heading at `t_s` after the start of the climbs.
    fn climb(&self, t_s: f64) -> Reference {
        // The cast rounds down.
        let step = (t_s / STEP_S) as u32;
        let side = match step {
            STEPS.. => 0.0,
            _ if step.is_multiple_of(2) => 1.0,
            _ => -1.0,
        };
        let position = Vector3::z() * (side * self.climb_m);
        // The swing grows from zero and decays again: a heading that jumped would saturate the rotors.
        let growth = (PI * t_s / CLIMB_S).sin();
        let yaw_rad = growth * chirp(t_s, CLIMB_S, YAW_HZ) * self.yaw_deg.to_radians();
        Reference { yaw_rad, ..Reference::rest(position, Phase::Trajectory) }
    }

    /// Position at `t_s` after the start of the travel, which ends at the hover point.
    fn travel(&self, t_s: f64) -> Reference {
        // The cast rounds down.
        let way = ((t_s / WAY_S) as u32).min(WAYS - 1);
        let [x, y] =
            [[0.5, 0.25], [-0.5, -0.25], [0.5, -0.25], [-0.5, 0.25], [0.0, 0.0]][way as usize];
        Reference::rest(Vector3::new(x, y, 0.0) * self.travel_m, Phase::Trajectory)
    }
}

/// The prescribed angle over [`Excitation::tilt_deg`] at `t_s` after the start of the motions about an axis; `None` while the
/// vehicle flies back.
fn tilt_share(t_s: f64) -> Option<f64> {
    let doublet = |t_s: f64, sign: f64| {
        // The cast rounds down.
        (t_s < DOUBLET_S).then(|| sign * [1.0, -1.0, -1.0, 1.0][(t_s / HOLD_S) as usize])
    };
    let second_s = t_s - DOUBLET_S - RETURN_S;
    let sine_s = second_s - DOUBLET_S - RETURN_S;
    if second_s < 0.0 {
        doublet(t_s, 1.0)
    } else if sine_s < 0.0 {
        doublet(second_s, -1.0)
    } else {
        (sine_s < SINE_S).then(|| SINE_SHARE * chirp(sine_s, SINE_S, SINE_HZ))
    }
}

/// A sine whose frequency rises evenly between two \[Hz\] over `duration_s`, at `t_s` \[-\].
fn chirp(t_s: f64, duration_s: f64, [from_hz, to_hz]: [f64; 2]) -> f64 {
    let growth = (to_hz - from_hz) / duration_s;
    (TAU * (from_hz + growth * t_s / 2.0) * t_s).sin()
}
