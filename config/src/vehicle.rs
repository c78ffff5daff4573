//! `[vehicle]`: what flies. The plant integrates it; the daemon's loops are designed for it.

use nalgebra::Matrix3;
use oqtal_control::rigid_body::{Inertia, InertiaError};
use serde::{Deserialize, Serialize};

use crate::{Violation, Wire, not_negative, positive};

/// Which vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VehicleKind {
    /// The AscTec Hummingbird of the paper's testbed: sticks in, Eq. (61).
    Hummingbird,
    /// The lander of Table I: torque in.
    Spacecraft,
}

/// How finely the Hummingbird is modelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fidelity {
    /// Eq. (61): the rate follows the sticks with a first-order lag.
    Eq61,
    /// Four rotors and the on-board rate loop.
    Rotors,
}

/// `[vehicle]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Vehicle {
    /// Which vehicle.
    pub kind: VehicleKind,
    /// How finely modelled.
    pub fidelity: Fidelity,
    /// Mass \[kg\].
    pub mass_kg: f64,
    /// Gravity \[m/s^2\], along -z of the world.
    pub gravity_m_s2: f64,
    /// Moment of inertia \[kg m^2, body\], rows.
    pub inertia_kg_m2: [[f64; 3]; 3],
    /// Collective thrust at full stick, `K_T` of Eq. (61) \[N\].
    pub max_thrust_n: f64,
    /// Body rate at full stick, `K_phi, K_theta, K_psi` of Eq. (61) \[rad/s\].
    pub rate_authority_rad_s: [f64; 3],
    /// Greatest torque, for torque input \[N m\].
    pub max_torque_nm: f64,
    /// Time constant of the on-board rate loop \[ms\].
    pub rate_lag_ms: f64,
    /// Time constant of the thrust \[ms\]; 0 for none.
    pub thrust_lag_ms: f64,
    /// From a command received to its effect \[ms\], without a wire.
    pub radio_delay_ms: f64,
    /// Linear drag per mass \[1/s\].
    pub drag_per_s: f64,
    /// Standard deviation of the gusts' acceleration per axis \[m/s^2\].
    pub gust_sd_m_s2: f64,
    /// Correlation time of the gusts \[s\].
    pub gust_time_s: f64,
    /// Bias of the on-board rate loop \[deg/s, body\].
    pub rate_drift_deg_s: [f64; 3],
    /// Constant disturbance force \[N, world\].
    pub force_n: [f64; 3],
    /// Relative spread of drift and force over seeds.
    pub disturbance_spread: f64,
    /// Whether the simulated vehicle only stands in for the truth that cameras see, while another is behind the bridge: it flies by
    /// the commands on the bus and says nothing of itself.
    pub shadow: bool,
    /// `[vehicle.rotors]`.
    pub rotors: Rotors,
    /// `[vehicle.battery]`.
    pub battery: Battery,
    /// `[vehicle.wire]`.
    pub wire: Wire,
}

/// `[vehicle.rotors]`: the Hummingbird's four rotors, plus configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Rotors {
    /// Centre of mass to rotor axis \[m\].
    pub arm_m: f64,
    /// Thrust per squared speed \[N/(rad/s)^2\].
    pub thrust_coefficient: f64,
    /// Drag torque per squared speed \[N m/(rad/s)^2\].
    pub torque_coefficient: f64,
    /// Time constant of a rotor's speed \[ms\].
    pub lag_ms: f64,
    /// Greatest speed at the nominal voltage \[rad/s\].
    pub max_speed_rad_s: f64,
}

/// `[vehicle.battery]`: open-circuit voltage falling linearly with charge, and an internal resistance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Battery {
    /// Whether thrust falls with the voltage.
    pub sag: bool,
    /// Voltage at which the rotors do what they are told \[V\].
    pub nominal_v: f64,
    /// Open-circuit voltage when full \[V\].
    pub full_v: f64,
    /// Open-circuit voltage when empty \[V\].
    pub empty_v: f64,
    /// Capacity \[A h\].
    pub capacity_ah: f64,
    /// Internal resistance \[ohm\].
    pub resistance_ohm: f64,
    /// Current in hover \[A\].
    pub hover_current_a: f64,
}

impl Vehicle {
    /// The inertia as the laws take it.
    ///
    /// # Errors
    /// It is not symmetric positive definite.
    pub fn inertia(&self) -> Result<Inertia, InertiaError> {
        Inertia::new(Matrix3::from_fn(|row, column| self.inertia_kg_m2[row][column]))
    }

    pub(crate) fn check(&self) -> Result<(), Violation> {
        positive("vehicle.mass-kg", self.mass_kg)?;
        not_negative("vehicle.gravity-m-s2", self.gravity_m_s2)?;
        if let Err(error) = self.inertia() {
            let rule = format!("must be symmetric positive definite: {error}");
            return Err(Violation::new("vehicle.inertia-kg-m2", rule));
        }
        positive("vehicle.max-thrust-n", self.max_thrust_n)?;
        positive("vehicle.max-torque-nm", self.max_torque_nm)?;
        for authority in self.rate_authority_rad_s {
            positive("vehicle.rate-authority-rad-s", authority)?;
        }
        at_least_a_step("vehicle.rate-lag-ms", self.rate_lag_ms)?;
        not_negative("vehicle.thrust-lag-ms", self.thrust_lag_ms)?;
        not_negative("vehicle.radio-delay-ms", self.radio_delay_ms)?;
        not_negative("vehicle.drag-per-s", self.drag_per_s)?;
        not_negative("vehicle.gust-sd-m-s2", self.gust_sd_m_s2)?;
        positive("vehicle.gust-time-s", self.gust_time_s)?;
        not_negative("vehicle.disturbance-spread", self.disturbance_spread)?;
        if self.max_thrust_n <= self.mass_kg * self.gravity_m_s2 {
            let weight = self.mass_kg * self.gravity_m_s2;
            let rule = format!("must exceed the weight of {weight:.2} N, is {}", self.max_thrust_n);
            return Err(Violation::new("vehicle.max-thrust-n", rule));
        }
        if self.kind != VehicleKind::Hummingbird && !self.wire.link.is_empty() {
            let rule = "speaks to a Hummingbird: it goes with vehicle.kind = \"hummingbird\" only";
            return Err(Violation::new("vehicle.wire.link", rule));
        }
        self.rotors.check()?;
        self.battery.check()?;
        self.wire.check()
    }
}

impl Rotors {
    fn check(&self) -> Result<(), Violation> {
        positive("vehicle.rotors.arm-m", self.arm_m)?;
        positive("vehicle.rotors.thrust-coefficient", self.thrust_coefficient)?;
        positive("vehicle.rotors.torque-coefficient", self.torque_coefficient)?;
        at_least_a_step("vehicle.rotors.lag-ms", self.lag_ms)?;
        positive("vehicle.rotors.max-speed-rad-s", self.max_speed_rad_s)
    }
}

impl Battery {
    fn check(&self) -> Result<(), Violation> {
        positive("vehicle.battery.nominal-v", self.nominal_v)?;
        positive("vehicle.battery.empty-v", self.empty_v)?;
        positive("vehicle.battery.capacity-ah", self.capacity_ah)?;
        not_negative("vehicle.battery.resistance-ohm", self.resistance_ohm)?;
        not_negative("vehicle.battery.hover-current-a", self.hover_current_a)?;
        if self.full_v > self.empty_v {
            Ok(())
        } else {
            Err(Violation::new("vehicle.battery.full-v", "must exceed empty-v"))
        }
    }
}

/// A lag shorter than an integration step cannot be integrated.
fn at_least_a_step(key: &str, lag_ms: f64) -> Result<(), Violation> {
    if lag_ms.is_finite() && lag_ms >= 1.0 {
        Ok(())
    } else {
        Err(Violation::new(key, format!("must be at least 1, the integration step, is {lag_ms}")))
    }
}
