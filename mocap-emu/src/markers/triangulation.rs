//! Triangulation: the point whose projections are nearest to the observed image points.
//!
//! The point nearest to all rays, in closed form, is the start of two Gauss-Newton steps on the image points, which are the
//! maximum-likelihood estimate for equal noise in every image (Hartley and Zisserman, *Multiple View Geometry*, 2nd ed.,
//! section 12.2).

use nalgebra::{Matrix3, Vector2, Vector3};

use super::camera::PinholeCamera;

/// Gauss-Newton steps: the start is accurate to a millimetre, and a second step changes less than a micrometre.
const STEPS: u32 = 2;

/// Greatest standard error of a point per pixel of noise \[m/pixel\]; above it the rays count as parallel.
const GREATEST_ERROR_M_PER_PX: f64 = 0.03;

/// An image point and the camera that saw it.
#[derive(Clone, Copy, Debug)]
pub struct Sighting<'a> {
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// The image point \[pixels\].
    pub pixel: Vector2<f64>,
}

/// A triangulated marker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarkerPoint {
    /// Position of the marker \[m, world\].
    pub position: Vector3<f64>,
    /// Number of cameras that saw the marker \[-\].
    pub cameras: usize,
    /// Sum of the squared distances between observed and projected image points \[pixels^2\].
    pub squared_px: f64,
}

impl MarkerPoint {
    /// Root mean square distance of the image points along one image axis, corrected for the three numbers fitted: an estimate
    /// of the pixel noise \[pixels\].
    pub fn reprojection_px(&self) -> f64 {
        let freedom = (2 * self.cameras).saturating_sub(3);
        (self.squared_px / freedom.max(1) as f64).sqrt()
    }
}

/// Triangulates `sightings`. `None` with fewer than two sightings, with nearly parallel rays, or for a point behind a camera.
pub fn triangulate<'a>(
    sightings: impl Iterator<Item = Sighting<'a>> + Clone,
) -> Option<MarkerPoint> {
    let mut position = nearest_to_rays(sightings.clone())?;
    let mut error_m_per_px = 0.0;
    for _ in 0..STEPS {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for Sighting { camera, pixel } in sightings.clone() {
            let (expected, slope) = camera.project(&position)?;
            normal += slope.tr_mul(&slope);
            right += slope.tr_mul(&(pixel - expected));
        }
        let inverse = normal.cholesky()?.inverse();
        error_m_per_px = inverse.trace().sqrt();
        position += inverse * right;
    }
    let (mut cameras, mut squared_px) = (0, 0.0);
    for Sighting { camera, pixel } in sightings {
        squared_px += (pixel - camera.project(&position)?.0).norm_squared();
        cameras += 1;
    }
    let is_sharp = cameras >= 2 && error_m_per_px <= GREATEST_ERROR_M_PER_PX;
    is_sharp.then_some(MarkerPoint { position, cameras, squared_px })
}

/// The point with the least sum of squared distances from the rays.
fn nearest_to_rays<'a>(sightings: impl Iterator<Item = Sighting<'a>>) -> Option<Vector3<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for Sighting { camera, pixel } in sightings {
        let direction = camera.direction(&pixel);
        let across = Matrix3::identity() - direction * direction.transpose();
        normal += across;
        right += across * camera.position();
    }
    Some(normal.cholesky()?.solve(&right))
}
