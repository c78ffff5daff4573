//! Calibration from thrust to counts: the "nonlinear" post-processing of the paper (section VII.A, figure 15: delta to eta).
//!
//! In the paper, thrust is first modelled as linear, Eq. (61), and then post-processed with a nonlinear characteristic, without
//! figures. Here the characteristic is a table with linear interpolation. The default is that of rotors whose speed is proportional
//! to the counts: thrust grows with the square of the speed. Replace it by a calibration of the vehicle.

use serde::{Deserialize, Serialize};

use super::FULL_THRUST;
use super::invalid_scale::InvalidScale;
use crate::interpolation::interpolate;

/// Greatest number of points \[-\].
const MAX_POINTS: usize = 256;

/// Points `[delta_c, counts]`, both rising: thrust as a fraction of maximum \[-\], and the counts that give it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ThrustTable(pub Vec<[f64; 2]>);

impl Default for ThrustTable {
    fn default() -> Self {
        let point = |tenth: u8| {
            let speed = f64::from(tenth) / 10.0;
            [(speed * speed * 100.0).round() / 100.0, (speed * f64::from(FULL_THRUST)).round()]
        };
        Self((0..=10).map(point).collect())
    }
}

impl ThrustTable {
    /// Checks the points.
    ///
    /// # Errors
    /// Fewer than two points, a point outside -1..1 and 0..4095, or points that do not rise.
    pub fn check(&self) -> Result<(), InvalidScale> {
        let wrong = |rule: &str| Err(InvalidScale::new("thrust-table", rule));
        if !(2..=MAX_POINTS).contains(&self.0.len()) {
            return wrong("must have 2 to 256 points");
        }
        for &[delta, counts] in &self.0 {
            if !(-1.0..=1.0).contains(&delta) || !(0.0..=f64::from(FULL_THRUST)).contains(&counts) {
                return wrong(
                    "must hold [delta, counts] with delta in -1..1 and counts in 0..4095",
                );
            }
        }
        let rises = |axis: usize| self.0.windows(2).all(|pair| pair[0][axis] < pair[1][axis]);
        if rises(0) && rises(1) { Ok(()) } else { wrong("must rise from point to point") }
    }

    /// Counts \[counts\] for the thrust `delta_c` \[-\]; beyond the table, the counts at its nearer end.
    pub fn counts(&self, delta: f64) -> f64 {
        interpolate(&self.0, delta, [0, 1])
    }

    /// Thrust `delta_c` \[-\] for `counts` \[counts\]; beyond the table, the thrust at its nearer end.
    pub fn delta(&self, counts: f64) -> f64 {
        interpolate(&self.0, counts, [1, 0])
    }
}
