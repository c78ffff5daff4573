//! Motions by which the parameters of a vehicle can be identified: doublets and sines about roll and pitch, steps of the height with a
//! swing of the heading, back-and-forth travel. Not in the paper.
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
/// Time between two steps of the height \[s\].
const STEP_S: f64 = 1.1;
/// Time to settle after the steps of the height \[s\].
const SETTLE_S: f64 = 0.6;
/// Frequency of the heading at the start and at the end \[Hz\].
const YAW_HZ: [f64; 2] = [0.3, 0.8];
/// Duration of one way of the travel \[s\].
const WAY_S: f64 = 2.6;
/// The ways of the travel, along x and y, over its length \[-\].
const WAYS: [[f64; 2]; 5] = [[0.5, 0.25], [-0.5, -0.25], [0.5, -0.25], [-0.5, 0.25], [0.0, 0.0]];

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
    /// Length of the back-and-forth travel along x; half of it along y \[m\].
    pub travel_m: f64,
}

impl Default for Excitation {
    fn default() -> Self {
        Self { tilt_deg: 10.0, yaw_deg: 15.0, climb_m: 0.3, travel_m: 1.6 }
    }
}

/// An excitation with the number of its motions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ExcitationCourse {
    options: Excitation,
    /// Doublets about each axis \[-\].
    doublets: u32,
    /// Time to fly back after the sine \[s\].
    rest_s: f64,
    /// Steps of the height \[-\].
    steps: u32,
    /// Ways of the travel \[-\].
    ways: usize,
}

impl Excitation {
    /// All motions.
    pub(super) fn whole(self) -> ExcitationCourse {
        ExcitationCourse { options: self, doublets: 2, rest_s: 2.0, steps: 9, ways: WAYS.len() }
    }

    /// The motions that show delays, lags, rate gains and thrust, in 20 s.
    pub(super) fn brief(self) -> ExcitationCourse {
        ExcitationCourse { options: self, doublets: 1, rest_s: 1.6, steps: 3, ways: 0 }
    }

    pub(super) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("tilt-deg", self.tilt_deg, Rule::Between(0.0, 30.0)),
            ("yaw-deg", self.yaw_deg, Rule::Between(0.0, 90.0)),
            ("climb-m", self.climb_m, Rule::Between(0.0, 2.0)),
            ("travel-m", self.travel_m, Rule::Between(0.0, 20.0)),
        ])
    }
}

impl ExcitationCourse {
    /// Duration of the motions about one axis \[s\].
    fn axis_s(&self) -> f64 {
        f64::from(self.doublets) * (DOUBLET_S + RETURN_S) + SINE_S + self.rest_s
    }

    /// Duration of the steps of the height \[s\].
    fn climb_s(&self) -> f64 {
        STEP_S * f64::from(self.steps) + SETTLE_S
    }

    /// Duration of all motions \[s\].
    pub(super) fn duration_s(&self) -> f64 {
        2.0 * self.axis_s() + self.climb_s() + WAY_S * self.ways as f64
    }

    pub(super) fn sample(&self, t_s: f64) -> Reference {
        let (axis_s, climb_s) = (self.axis_s(), self.climb_s());
        let since_climb_s = t_s - 2.0 * axis_s;
        if since_climb_s < 0.0 {
            let (axis, since_s) =
                if t_s < axis_s { (Vector3::x(), t_s) } else { (Vector3::y(), t_s - axis_s) };
            let mut reference = Reference::rest(Vector3::zeros(), Phase::Trajectory);
            reference.attitude = self.tilt_share(since_s).map(|share| {
                let angle = share * self.options.tilt_deg.to_radians();
                AttitudeReference::at_rest(Attitude::from_rotation_vector(axis * angle))
            });
            return reference;
        }
        if since_climb_s < climb_s {
            self.climb(since_climb_s)
        } else {
            self.travel(since_climb_s - climb_s)
        }
    }

    /// The prescribed angle over [`Excitation::tilt_deg`] at `t_s` after the start of the motions about an axis; `None` while the
    /// vehicle flies back.
    fn tilt_share(&self, t_s: f64) -> Option<f64> {
        // The cast rounds down.
        let doublet = (t_s / (DOUBLET_S + RETURN_S)) as u32;
        let since_s = t_s - f64::from(doublet.min(self.doublets)) * (DOUBLET_S + RETURN_S);
        if doublet < self.doublets {
            let sign = if doublet.is_multiple_of(2) { 1.0 } else { -1.0 };
            let side = || sign * [1.0, -1.0, -1.0, 1.0][(since_s / HOLD_S) as usize];
            return (since_s < DOUBLET_S).then(side);
        }
        (since_s < SINE_S).then(|| SINE_SHARE * chirp(since_s, SINE_S, SINE_HZ))
    }

    /// Height and heading at `t_s` after the start of the climbs.
    fn climb(&self, t_s: f64) -> Reference {
        // The cast rounds down.
        let step = (t_s / STEP_S) as u32;
        let side = match step {
            step if step >= self.steps => 0.0,
            step if step.is_multiple_of(2) => 1.0,
            _ => -1.0,
        };
        let position = Vector3::z() * (side * self.options.climb_m);
        // The swing grows from zero and decays again: a heading that jumped would saturate the rotors.
        let growth = (PI * t_s / self.climb_s()).sin();
        let swing = chirp(t_s, self.climb_s(), YAW_HZ) * self.options.yaw_deg.to_radians();
        Reference { yaw_rad: growth * swing, ..Reference::rest(position, Phase::Trajectory) }
    }

    /// Position at `t_s` after the start of the travel, which ends at the hover point.
    fn travel(&self, t_s: f64) -> Reference {
        // The cast rounds down.
        let way = (t_s / WAY_S) as usize;
        let [x, y] = if way < self.ways { WAYS[way] } else { [0.0; 2] };
        let position = Vector3::new(x, y, 0.0) * self.options.travel_m;
        Reference::rest(position, Phase::Trajectory)
    }
}

/// A sine whose frequency rises evenly between two \[Hz\] over `duration_s`, at `t_s` \[-\].
fn chirp(t_s: f64, duration_s: f64, [from_hz, to_hz]: [f64; 2]) -> f64 {
    let growth = (to_hz - from_hz) / duration_s;
    (TAU * (from_hz + growth * t_s / 2.0) * t_s).sin()
}
