//! The pose of a rigid body from its markers: the rotation and translation with the least sum of squared distances.
//!
//! Singular value decomposition of the cross-covariance (Kabsch, *Acta Cryst.* A32, 1976; Arun, Huang and Blostein, *IEEE
//! PAMI* 9, 1987), with the sign of the determinant corrected as by Umeyama (*IEEE PAMI* 13, 1991), so that a reflection is
//! never fitted.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use oqtal_control::quaternion::Attitude;

/// Iterations of the decomposition, at most; it takes fewer than ten.
const MOST_ITERATIONS: usize = 100;

/// Least ratio of the second singular value to the first \[-\]. Below it the markers are on a line, and the rotation about that
/// line is not observable.
const LEAST_WIDTH: f64 = 1e-4;

/// A body fitted to its markers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyFit {
    /// Origin of the body \[m, world\].
    pub position: Vector3<f64>,
    /// Attitude, body to world.
    pub attitude: Attitude,
    /// Root mean square distance between measured and modelled marker positions \[m\].
    pub residual_m: f64,
}

/// Fits a body to pairs of a marker's place on the body \[m, body\] and its position \[m, world\]. `None` with fewer than three
/// pairs, or with markers on a line.
pub fn fit(pairs: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> + Clone) -> Option<BodyFit> {
    let count = pairs.clone().count();
    if count < 3 {
        return None;
    }
    let share = 1.0 / count as f64;
    let sums = pairs.clone().fold((Vector3::zeros(), Vector3::zeros()), |(a, b), (m, p)| {
        (a + m * share, b + p * share)
    });
    let (body_centre, world_centre) = sums;
    let covariance = pairs.clone().fold(Matrix3::zeros(), |sum, (m, p)| {
        sum + (p - world_centre) * (m - body_centre).transpose()
    });
    let rotation = nearest_rotation(&covariance)?;
    let position = world_centre - rotation * body_centre;
    let squares = pairs.map(|(m, p)| (rotation * m + position - p).norm_squared());
    let residual_m = (squares.sum::<f64>() * share).sqrt();
    let attitude = UnitQuaternion::from_rotation_matrix(&rotation);
    let fitted =
        BodyFit { position, attitude: Attitude::from_unit_quaternion(attitude), residual_m };
    (residual_m.is_finite() && fitted.attitude.is_finite()).then_some(fitted)
}

/// The rotation `R` with the greatest trace of `R^T covariance`.
fn nearest_rotation(covariance: &Matrix3<f64>) -> Option<Rotation3<f64>> {
    let svd = covariance.try_svd(true, true, f64::EPSILON, MOST_ITERATIONS)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let [first, second, _] = svd.singular_values.into();
    // A comparison with NaN is false.
    let is_wide = second > LEAST_WIDTH * first;
    if !is_wide {
        return None;
    }
    let sign = (u.determinant() * v_t.determinant()).signum();
    let upright = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign));
    Some(Rotation3::from_matrix_unchecked(u * upright * v_t))
}
