//! Physical quantities that are easily confused, each with a separate type.
//!
//! All values are SI, radians, `f64`. The vector inside is public: the types separate meanings without hiding numbers.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Angular velocity `omega = [p, q, r]` of the body with respect to the world \[rad/s, body axes\].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BodyRate(pub Vector3<f64>);

/// Time derivative of [`BodyRate`], components in body axes \[rad/s^2, body axes\].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AngularAcceleration(pub Vector3<f64>);

/// Rates of the 3-2-1 Euler angles `[phi_dot, theta_dot, psi_dot]` \[rad/s\]. Not a [`BodyRate`]: Eq. (1) relates the two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EulerRates(pub Vector3<f64>);

/// Torque about the centre of mass \[N m, body axes\]: the input of the spacecraft.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Torque(pub Vector3<f64>);

/// The attitude sticks `[delta_r, delta_p, delta_y]` of Eq. (61) \[-1..1, body axes\]: fractions of the body rate at
/// full stick. The input of the quadrotor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StickCommand(pub Vector3<f64>);
