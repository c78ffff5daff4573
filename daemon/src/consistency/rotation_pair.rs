//! Rotation seen by the cameras beside that of the vehicle.

use nalgebra::Vector3;

/// Rotations of the vehicle over one interval.
#[derive(Clone, Copy, Debug)]
pub(super) struct RotationPair {
    /// The rotation seen by the cameras \[rad, body axes\].
    pub(super) seen: Vector3<f64>,
    /// The rotation by the gyroscope or the commands \[rad, body axes\].
    pub(super) driven: Vector3<f64>,
    /// End of the interval \[s\].
    pub(super) t_s: f64,
    /// Length of the interval \[s\].
    pub(super) dt_s: f64,
}
