//! Conversion of a share of the vehicle's greatest thrust to the thrust or throttle of a set-point.

use crate::interpolation::interpolate;

/// Greatest number of points \[-\].
const MAX_POINTS: usize = 64;

/// Points `[delta_c, thrust]`, both rising from 0 to 1: thrust as a fraction of maximum, and the number that yields it \[-\].
#[derive(Clone, Debug, PartialEq)]
pub struct ThrustCurve(Vec<[f64; 2]>);

/// Error: the points are not a thrust curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("must be 2 to 64 points [delta_c, thrust] that rise within 0..1")]
pub struct InvalidThrustCurve;

impl ThrustCurve {
    /// Curve through `points`, straight in between.
    ///
    /// # Errors
    /// Too few or too many points, a point outside 0..1, or points that do not rise.
    pub fn new(points: &[[f64; 2]]) -> Result<Self, InvalidThrustCurve> {
        let is_inside = points.iter().flatten().all(|number| (0.0..=1.0).contains(number));
        let rises = |axis: usize| points.windows(2).all(|pair| pair[0][axis] < pair[1][axis]);
        let fits = (2..=MAX_POINTS).contains(&points.len()) && is_inside && rises(0) && rises(1);
        if fits { Ok(Self(points.to_vec())) } else { Err(InvalidThrustCurve) }
    }

    /// Thrust of a set-point \[0..1\] for the share `delta` of greatest thrust; 0 for zero, negative numbers and NaN.
    pub fn thrust(&self, delta: f64) -> f64 {
        // Zero is the zero set-point, independent of the start of the curve.
        if delta > 0.0 { interpolate(&self.0, delta, [0, 1]) } else { 0.0 }
    }

    /// Share of greatest thrust \[0..1\] that `thrust` of a set-point stands for.
    pub fn delta(&self, thrust: f64) -> f64 {
        if thrust > 0.0 { interpolate(&self.0, thrust, [1, 0]) } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_is_inverted_and_zero_is_zero() {
        let curve = ThrustCurve::new(&[[0.0, 0.05], [0.25, 0.4], [1.0, 0.9]]).unwrap();
        for delta in [0.01, 0.25, 0.5, 1.0] {
            assert!((curve.delta(curve.thrust(delta)) - delta).abs() < 1e-12);
        }
        assert_eq!(
            (curve.thrust(0.0), curve.thrust(-1.0), curve.thrust(f64::NAN)),
            (0.0, 0.0, 0.0)
        );
        assert_eq!(curve.thrust(7.0), 0.9);
        for wrong in [&[[0.0, 0.0]][..], &[[0.0, 0.0], [0.5, 2.0]], &[[0.0, 0.5], [1.0, 0.5]]] {
            assert!(ThrustCurve::new(wrong).is_err(), "{wrong:?}");
        }
    }
}
