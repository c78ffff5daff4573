//! `[vehicle]`: the controller's model of the vehicle. Laws, estimators, predictor and tuning are designed for it.

use oqtal_control::options::OptionError;
use oqtal_control::rigid_body::{Inertia, InertiaError};
use serde::{Deserialize, Serialize};

use crate::airframe::{Airframe, Interface, inertia};
use crate::preset;

/// `[vehicle]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct VehicleOptions {
    /// Name of the preset on which these values are based.
    pub preset: String,
    /// Kind of command that the vehicle takes.
    pub interface: Interface,
    /// Mass \[kg\].
    pub mass_kg: f64,
    /// Gravity \[m/s^2\], along -z of the world.
    pub gravity_m_s2: f64,
    /// Moment of inertia \[kg m^2, body\], rows.
    pub inertia_kg_m2: [[f64; 3]; 3],
    /// Collective thrust at full stick, `K_T` of Eq. (61) \[N\].
    pub max_thrust_n: f64,
    /// Body rate at full stick, `K_phi, K_theta, K_psi` of Eq. (61) \[rad/s, body\].
    pub rate_authority_rad_s: [f64; 3],
    /// Greatest torque about each axis, for torque input \[N m, body\].
    pub max_torque_nm: f64,
    /// Time constant of the on-board rate loop \[ms\].
    pub rate_lag_ms: f64,
    /// Gain of the on-board attitude loop, from an attitude error to a body rate \[1/s\]; for `interface = "attitude"`.
    pub attitude_gain_per_s: f64,
    /// Time constant of the thrust \[ms\]; 0 for none.
    pub thrust_lag_ms: f64,
    /// Time from the receipt of a command by the vehicle to its effect \[ms\]; initial value of the predictor's measured delay.
    pub command_delay_ms: f64,
    /// Linear drag per mass \[1/s\].
    pub drag_per_s: f64,
}

impl VehicleOptions {
    /// Inertia for the laws.
    ///
    /// # Errors
    /// The inertia is not symmetric positive definite.
    pub fn inertia(&self) -> Result<Inertia, InertiaError> {
        inertia(&self.inertia_kg_m2)
    }

    pub(crate) fn check(&self) -> Result<(), OptionError> {
        preset::check("vehicle.preset", &self.preset)?;
        Airframe {
            section: "vehicle",
            mass_kg: self.mass_kg,
            gravity_m_s2: self.gravity_m_s2,
            inertia_kg_m2: &self.inertia_kg_m2,
            max_thrust_n: self.max_thrust_n,
            rate_authority_rad_s: self.rate_authority_rad_s,
            max_torque_nm: self.max_torque_nm,
            rate_lag_ms: self.rate_lag_ms,
            attitude_gain_per_s: self.attitude_gain_per_s,
            thrust_lag_ms: self.thrust_lag_ms,
            command_delay_ms: self.command_delay_ms,
            drag_per_s: self.drag_per_s,
        }
        .check()
    }
}
