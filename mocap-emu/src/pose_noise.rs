//! The simple model of a camera system: the true pose with noise, outliers and quantisation.

use nalgebra::Vector3;
use oqtal_bus::message::{PoseV1, TruthV1};
use oqtal_config::MocapOptions;
use oqtal_control::quaternion::Attitude;
use oqtal_runtime::random::{Generator, normal3};
use rand::RngExt;

use crate::body::BODY;
use crate::drift::UnitError;

/// Draws the pose of a frame. `drift` is added to its noise, `scale` multiplies both.
pub fn measure(
    mocap: &MocapOptions,
    truth: &TruthV1,
    (drift, scale): (UnitError, f64),
    generator: &mut Generator,
) -> PoseV1 {
    let ratio = mocap.room.pose_coupling_ratio;
    let (white, drift) = (UnitError::white(generator).coupled(ratio), drift.coupled(ratio));
    let position_noise = white.position * (scale * mocap.position_noise_mm * 1e-3)
        + drift.position * (scale * mocap.room.position_drift_mm * 1e-3);
    let attitude_noise = white.attitude * (scale * mocap.attitude_noise_deg.to_radians())
        + drift.attitude * (scale * mocap.room.attitude_drift_deg.to_radians());
    let mut position = Vector3::from(truth.position) + position_noise;
    let wrong: f64 = generator.random();
    let direction = normal3(generator);
    if wrong < mocap.outlier_probability && direction.norm() > 0.0 {
        position += direction.normalize() * mocap.outlier_m;
    }
    let position = position.map(|x| quantised(x, mocap.position_quantum_mm * 1e-3));
    let attitude = Attitude::from_xyzw(truth.attitude).map(|attitude| {
        let rotation = Attitude::LEVEL.rotation_to(&attitude.turned_by(attitude_noise));
        let step = mocap.attitude_quantum_deg.to_radians();
        Attitude::from_rotation_vector(rotation.map(|angle| quantised(angle, step)))
    });
    PoseV1 {
        position: position.into(),
        attitude: attitude.map_or([f64::NAN; 4], |attitude| attitude.xyzw()),
        // The scatter of the markers about the fitted body has the same size as the error of the fit.
        residual_m: position_noise.norm(),
        body: BODY,
        tracked: u8::from(attitude.is_some()),
        simulated: 1,
        ..PoseV1::default()
    }
}

/// Rounds `value` to the nearest multiple of `step`; unchanged if `step` is zero.
fn quantised(value: f64, step: f64) -> f64 {
    if step > 0.0 { (value / step).round() * step } else { value }
}
