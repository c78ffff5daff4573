//! Euler angles in the sequence 3-2-1 (yaw, pitch, roll), used by the classic regulator. Eqs. (1), (2), (6), (16).

use nalgebra::{Matrix3, Vector3};

use crate::quantity::{BodyRate, EulerRates};
use crate::quaternion::Attitude;

/// Cosine of the pitch below which roll and yaw cannot be distinguished in double precision \[-\].
const GIMBAL_LOCK: f64 = 1e-9;

/// `Theta = [phi, theta, psi]`: yaw about z, then pitch about the new y, then roll about the new x
/// \[rad\].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EulerAngles {
    /// `phi`, -pi..pi when taken from an attitude \[rad\].
    pub roll: f64,
    /// `theta`, -pi/2..pi/2 when taken from an attitude \[rad\].
    pub pitch: f64,
    /// `psi`, -pi..pi when taken from an attitude \[rad\].
    pub yaw: f64,
}

/// The turn by `angle_rad` the shorter way, -pi..pi \[rad\].
pub fn shorter_turn(angle_rad: f64) -> f64 {
    angle_rad.sin().atan2(angle_rad.cos())
}

impl EulerAngles {
    /// The angles of an attitude. At a pitch of 90 degrees, where only the sum of roll and yaw is defined, roll is 0.
    pub fn from_attitude(attitude: &Attitude) -> Self {
        // The world-to-body matrix of Eq. (16), solved for the angles.
        let r = attitude.unit_quaternion().to_rotation_matrix().transpose();
        let cos_pitch = r[(0, 0)].hypot(r[(0, 1)]);
        let (roll, yaw) = if cos_pitch < GIMBAL_LOCK {
            (0.0, f64::atan2(-r[(1, 0)], r[(1, 1)]))
        } else {
            (f64::atan2(r[(1, 2)], r[(2, 2)]), f64::atan2(r[(0, 1)], r[(0, 0)]))
        };
        Self { roll, pitch: f64::atan2(-r[(0, 2)], cos_pitch), yaw }
    }

    /// The angles in the order `[phi, theta, psi]` \[rad\].
    pub fn from_vector(theta: &Vector3<f64>) -> Self {
        Self { roll: theta.x, pitch: theta.y, yaw: theta.z }
    }

    /// `[phi, theta, psi]` \[rad\].
    pub fn vector(&self) -> Vector3<f64> {
        Vector3::new(self.roll, self.pitch, self.yaw)
    }

    /// The quaternion `[q1 q2 q3 eta]` of these angles, scalar last, body to world \[-\].
    pub fn xyzw(&self) -> [f64; 4] {
        let ((s_phi, c_phi), (s_theta, c_theta)) =
            ((self.roll / 2.0).sin_cos(), (self.pitch / 2.0).sin_cos());
        let (s_psi, c_psi) = (self.yaw / 2.0).sin_cos();
        // Eq. (6), erratum E-06
        [
            c_psi * c_theta * s_phi - s_psi * s_theta * c_phi,
            c_psi * s_theta * c_phi + s_psi * c_theta * s_phi,
            s_psi * c_theta * c_phi - c_psi * s_theta * s_phi,
            c_psi * c_theta * c_phi + s_psi * s_theta * s_phi,
        ]
    }

    /// `R`: takes world components to body components \[-\].
    pub fn rotation(&self) -> Matrix3<f64> {
        let ((s_phi, c_phi), (s_theta, c_theta)) = (self.roll.sin_cos(), self.pitch.sin_cos());
        let (s_psi, c_psi) = self.yaw.sin_cos();
        // Eq. (16)
        #[rustfmt::skip]
        let r = Matrix3::new(
            c_psi * c_theta, s_psi * c_theta, -s_theta,
            c_psi * s_theta * s_phi - s_psi * c_phi, s_psi * s_theta * s_phi + c_psi * c_phi, c_theta * s_phi,
            c_psi * s_theta * c_phi + s_psi * s_phi, s_psi * s_theta * c_phi - c_psi * s_phi, c_theta * c_phi,
        );
        r
    }

    /// `H^-1`: takes the body rate to the rates of the angles \[-\]. The matrix grows without bound towards a pitch
    /// of 90 degrees.
    pub fn rate_matrix(&self) -> Matrix3<f64> {
        let ((s_phi, c_phi), (s_theta, c_theta)) = (self.roll.sin_cos(), self.pitch.sin_cos());
        let t_theta = s_theta / c_theta;
        // Eq. (2)
        #[rustfmt::skip]
        let h_inverse = Matrix3::new(
            1.0, s_phi * t_theta, c_phi * t_theta,
            0.0, c_phi, -s_phi,
            0.0, s_phi / c_theta, c_phi / c_theta,
        );
        h_inverse
    }

    /// The rates of the angles \[rad/s\] of a body that turns at `omega`.
    pub fn rates(&self, omega: BodyRate) -> EulerRates {
        // Eq. (1)
        EulerRates(self.rate_matrix() * omega.0)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    #[test]
    fn an_attitude_pitched_straight_up_or_down_still_has_angles() {
        for pitch in [FRAC_PI_2, -FRAC_PI_2, FRAC_PI_2 - 1e-10] {
            for (roll, yaw) in [(0.0, 0.0), (0.7, -1.1), (-3.0, 2.0)] {
                let theta = EulerAngles { roll, pitch, yaw };
                let attitude = Attitude::from_xyzw(theta.xyzw()).unwrap();
                let again = EulerAngles::from_attitude(&attitude);
                assert_eq!(again.roll, 0.0);
                assert!((again.rotation() - theta.rotation()).amax() < 1e-9);
            }
        }
    }
}
