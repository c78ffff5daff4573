//! Inputs of the equations of motion, constant over an integration step: command and disturbance.

use nalgebra::{Quaternion, Vector3, Vector4};

/// The command in effect.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlantInput {
    /// Sticks `[delta_r, delta_p, delta_y]` of Eq. (61) \[-1..1, body\].
    pub sticks: Vector3<f64>,
    /// Torque \[N m, body\].
    pub torque: Vector3<f64>,
    /// Attitude to be held \[body to world\]; zero for none.
    pub attitude: Quaternion<f64>,
    /// Collective thrust `delta_c` of Eq. (61) \[0..1\].
    pub thrust: f64,
    /// Motor power of each rotor, commanded by a firmware in place of the rate loop \[0..1\]; `None` without a firmware.
    pub motors: Option<Vector4<f64>>,
}

/// External disturbances, constant over an integration step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disturbance {
    /// Acceleration by gusts and constant forces \[m/s^2, world\].
    pub acceleration: Vector3<f64>,
    /// Bias of the on-board rate loop \[rad/s, body\].
    pub rate_drift: Vector3<f64>,
    /// Angular acceleration by external torques \[rad/s^2, body\].
    pub angular_acceleration: Vector3<f64>,
    /// Air velocity at the rotors \[m/s, world\].
    pub wind: Vector3<f64>,
    /// Nominal mass over the mass with payload \[-\].
    pub mass_ratio: f64,
    /// Battery voltage over its nominal value \[-\]; 1 if thrust does not depend on the voltage.
    pub voltage_ratio: f64,
}

impl Disturbance {
    /// No disturbance.
    pub const NONE: Self = Self {
        acceleration: Vector3::new(0.0, 0.0, 0.0),
        rate_drift: Vector3::new(0.0, 0.0, 0.0),
        angular_acceleration: Vector3::new(0.0, 0.0, 0.0),
        wind: Vector3::new(0.0, 0.0, 0.0),
        mass_ratio: 1.0,
        voltage_ratio: 1.0,
    };
}
