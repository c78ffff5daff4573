//! Pinhole camera: projects a point of the world into the image.

use nalgebra::{Matrix2x3, Matrix3, Vector2, Vector3};
use oqtal_config::CameraOptions;

/// Least distance of a visible point in front of the camera \[m\].
const NEAREST_M: f64 = 0.05;

/// A camera without lens distortion; its image is level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PinholeCamera {
    position: Vector3<f64>,
    /// Rows: the image's right, the image's down, the viewing direction, each \[world\].
    axes: Matrix3<f64>,
    /// Focal length \[pixels\].
    focal_px: f64,
    /// Width and height of the image \[pixels\].
    size_px: Vector2<f64>,
}

impl PinholeCamera {
    /// The cameras of a room, in the order of the configuration.
    pub fn all(options: &CameraOptions) -> Vec<Self> {
        let pairs = options.positions_m.iter().zip(&options.aims_m);
        pairs.map(|(at, aim)| Self::new(options, Vector3::from(*at), Vector3::from(*aim))).collect()
    }

    fn new(options: &CameraOptions, position: Vector3<f64>, aim: Vector3<f64>) -> Self {
        let forward = (aim - position).normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        let down = forward.cross(&right);
        let [width, height] = options.resolution_px.map(f64::from);
        let half_view = (options.field_of_view_deg / 2.0).to_radians();
        Self {
            position,
            axes: Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]),
            focal_px: width / 2.0 / half_view.tan(),
            size_px: Vector2::new(width, height),
        }
    }

    /// Position of the camera \[m, world\].
    pub fn position(&self) -> &Vector3<f64> {
        &self.position
    }

    /// The image point of `point` \[m, world\] from the upper left corner \[pixels\]; `None` if it is out of view.
    pub fn image(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let pixel = self.project(point)?.0;
        let is_inside = (0..2).all(|axis| (0.0..=self.size_px[axis]).contains(&pixel[axis]));
        is_inside.then_some(pixel)
    }

    /// The image point, within or beyond the edges of the image \[pixels\], and its derivative \[pixels/m\]; `None` behind the
    /// camera.
    pub fn project(&self, point: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let q = self.axes * (point - self.position);
        if q.z < NEAREST_M {
            return None;
        }
        let (x, y, scale) = (q.x / q.z, q.y / q.z, self.focal_px / q.z);
        let pixel = Vector2::new(x, y) * self.focal_px + self.size_px / 2.0;
        let slope = Matrix2x3::new(scale, 0.0, -scale * x, 0.0, scale, -scale * y);
        Some((pixel, slope * self.axes))
    }

    /// The direction of unit length in which the image point `pixel` is seen \[world\].
    pub fn direction(&self, pixel: &Vector2<f64>) -> Vector3<f64> {
        let offset = (pixel - self.size_px / 2.0) / self.focal_px;
        self.axes.tr_mul(&Vector3::new(offset.x, offset.y, 1.0)).normalize()
    }
}
