//! Values common to `[vehicle]` and `[plant]`, and their rules.

use nalgebra::Matrix3;
use oqtal_control::options::{OptionError, Rule, check_options};
use oqtal_control::rigid_body::{Inertia, InertiaError};
use serde::{Deserialize, Serialize};

/// Kind of command that a vehicle takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interface {
    /// Body rates as sticks, Eq. (61), and thrust; the vehicle's own loop follows the rates.
    Rate,
    /// Torque and thrust.
    Torque,
    /// An attitude and thrust; the vehicle's own loops hold the attitude.
    Attitude,
}

impl Interface {
    /// Whether the vehicle has its own attitude loop: it then stays level without the daemon's attitude law, and without new
    /// poses.
    pub const fn holds_attitude(self) -> bool {
        matches!(self, Self::Attitude)
    }
}

/// Values of one section, for their check.
pub(crate) struct Airframe<'a> {
    /// `vehicle` or `plant`.
    pub(crate) section: &'static str,
    /// Mass \[kg\].
    pub(crate) mass_kg: f64,
    /// Gravity \[m/s^2\], along -z of the world.
    pub(crate) gravity_m_s2: f64,
    /// Moment of inertia \[kg m^2, body\], rows.
    pub(crate) inertia_kg_m2: &'a [[f64; 3]; 3],
    /// Collective thrust at full stick \[N\].
    pub(crate) max_thrust_n: f64,
    /// Body rate at full stick \[rad/s, body\].
    pub(crate) rate_authority_rad_s: [f64; 3],
    /// Greatest torque \[N m, body\].
    pub(crate) max_torque_nm: f64,
    /// Time constant of the on-board rate loop \[ms\].
    pub(crate) rate_lag_ms: f64,
    /// Gain of the on-board attitude loop \[1/s\].
    pub(crate) attitude_gain_per_s: f64,
    /// Time constant of the thrust \[ms\].
    pub(crate) thrust_lag_ms: f64,
    /// Time from the receipt of a command to its effect \[ms\].
    pub(crate) command_delay_ms: f64,
    /// Linear drag per mass \[1/s\].
    pub(crate) drag_per_s: f64,
}

impl Airframe<'_> {
    /// Checks all values.
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        self.check_numbers().map_err(|error| error.within(self.section))?;
        if let Err(error) = inertia(self.inertia_kg_m2) {
            let allowed = format!("symmetric positive definite: {error}");
            let key = format!("{}.inertia-kg-m2", self.section);
            return Err(OptionError::new(key, "unusable", allowed));
        }
        let weight = self.mass_kg * self.gravity_m_s2;
        if self.max_thrust_n > weight {
            return Ok(());
        }
        let allowed = format!("above the weight of {weight:.2} N");
        let key = format!("{}.max-thrust-n", self.section);
        Err(OptionError::new(key, self.max_thrust_n, allowed))
    }

    fn check_numbers(&self) -> Result<(), OptionError> {
        let [roll, pitch, yaw] = self.rate_authority_rad_s;
        check_options([
            ("mass-kg", self.mass_kg, Rule::Positive),
            ("gravity-m-s2", self.gravity_m_s2, Rule::NotNegative),
            ("max-thrust-n", self.max_thrust_n, Rule::Positive),
            ("max-torque-nm", self.max_torque_nm, Rule::Positive),
            ("rate-authority-rad-s", roll, Rule::Positive),
            ("rate-authority-rad-s", pitch, Rule::Positive),
            ("rate-authority-rad-s", yaw, Rule::Positive),
            ("rate-lag-ms", self.rate_lag_ms, A_STEP),
            ("attitude-gain-per-s", self.attitude_gain_per_s, Rule::Positive),
            ("thrust-lag-ms", self.thrust_lag_ms, Rule::NotNegative),
            ("command-delay-ms", self.command_delay_ms, Rule::NotNegative),
            ("drag-per-s", self.drag_per_s, Rule::NotNegative),
        ])
    }
}

/// Rule of a time constant \[ms\]: at least the integration step of the plant.
pub(crate) const A_STEP: Rule = Rule::Between(A_STEP_MS, f64::MAX);
/// Integration step of the plant \[ms\].
pub(crate) const A_STEP_MS: f64 = 1.0;

/// Inertia with these rows \[kg m^2, body\], as a type of the control crate.
pub(crate) fn inertia(rows: &[[f64; 3]; 3]) -> Result<Inertia, InertiaError> {
    Inertia::new(Matrix3::from_fn(|row, column| rows[row][column]))
}
