//! `[plant]`: the simulated vehicle and its environment. Keys that are not set follow `[vehicle]`.

use oqtal_control::options::{OptionError, Rule, check_options};
use oqtal_control::rigid_body::{Inertia, InertiaError};
use serde::{Deserialize, Serialize};

use crate::airframe::{A_STEP, A_STEP_MS, Airframe, Interface, inertia};
use crate::disturbance::{DisturbanceKind, TimedDisturbance};
use crate::plant_wire::PlantWireOptions;

/// Greatest fraction of the vehicle's mass that disturbances may remove \[-\].
const MOST_TAKEN: f64 = 0.9;

/// Fidelity of the model of a vehicle with an on-board rate loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fidelity {
    /// Eq. (61): the rate follows the sticks with a first-order lag.
    Eq61,
    /// Four rotors and the on-board rate loop.
    Rotors,
}

/// `[plant]`, with all keys that follow another section resolved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct PlantOptions {
    /// Kind of command of the simulated vehicle; it ignores commands of another interface.
    pub interface: Interface,
    /// Fidelity of the model, unless the vehicle is commanded by torque.
    pub fidelity: Fidelity,
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
    /// Factor of the lag of each axis \[-, body\].
    pub rate_lag_ratio: [f64; 3],
    /// Gain of the on-board attitude loop, from an attitude error to a body rate \[1/s\]; for `interface = "attitude"`.
    pub attitude_gain_per_s: f64,
    /// Time constant of the thrust \[ms\]; 0 for none.
    pub thrust_lag_ms: f64,
    /// Exponent of thrust over command \[-\]; 1 is the straight line of Eq. (61).
    pub thrust_exponent: f64,
    /// Time from the receipt of a command over the bus to its effect \[ms\]; the delay of a wire is in `[plant.wire]`.
    pub command_delay_ms: f64,
    /// Time from the reported to the real effect of a command \[ms\]: a delay hidden from the stamps.
    pub hidden_delay_ms: f64,
    /// Greatest addition to that delay, drawn uniformly per command \[ms\]; commands keep their order.
    pub command_jitter_ms: f64,
    /// Fraction of the commands over the bus that are lost \[-\]; the losses of a wire are in `[plant.wire]`.
    pub command_loss_probability: f64,
    /// Mean number of consecutive lost commands \[-\], geometric.
    pub command_loss_burst: f64,
    /// Linear drag per mass \[1/s\].
    pub drag_per_s: f64,
    /// Greatest relative deviation \[-\], drawn once per seed, uniformly in both directions, of mass, inertia (as a whole), `max_*`, `rate_authority_rad_s`, `rate_lag_ms`, `attitude_gain_per_s`, `thrust_lag_ms`, `command_delay_ms` and
    /// `drag_per_s`, and of the rotors' arm, thrust and torque coefficients, lag and greatest speed.
    pub spread: f64,
    /// Standard deviation of the gusts' acceleration per axis \[m/s^2, world\].
    pub gust_sd_m_s2: f64,
    /// Correlation time of the gusts \[s\].
    pub gust_time_s: f64,
    /// Bias of the on-board rate loop \[deg/s, body\].
    pub rate_drift_deg_s: [f64; 3],
    /// Constant disturbance force \[N, world\].
    pub force_n: [f64; 3],
    /// Relative standard deviation of drift and force over seeds \[-\].
    pub disturbance_spread: f64,
    /// Timed disturbances, each as `KIND@TIME[+DURATION]=VALUE`, in seconds after arming.
    pub disturb: Vec<TimedDisturbance>,
    /// Whether the vehicle reports the body rate by its gyroscope, with noise and a bias drawn per seed.
    pub gyroscope: bool,
    /// Rate at which the truth is sampled for cameras \[Hz\].
    pub frame_rate_hz: f64,
    /// Whether the simulated vehicle only provides the truth for the cameras, while another vehicle is behind the bridge: the
    /// plant then executes the commands on the bus and does not publish `vehicle`.
    pub shadow: bool,
    /// Source of the truth if the vehicle is a firmware executed as a program, `crazyflie-sitl:udp:HOST:PORT[,crtp=HOST:PORT]`,
    /// `betaflight-sitl:udp:HOST:PORT[,state=HOST:PORT]` or `mavlink:udpin:HOST:PORT`; empty for the simulated vehicle. Parsed by plant-sim.
    pub truth: String,
    /// `[plant.rotors]`.
    pub rotors: RotorOptions,
    /// `[plant.battery]`.
    pub battery: BatteryOptions,
    /// `[plant.probe]`.
    pub probe: ProbeOptions,
    /// `[plant.wire]`.
    pub wire: PlantWireOptions,
}

/// Arrangement of the rotors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RotorLayout {
    /// On body x and y: front, left, back, right.
    Plus,
    /// Between body x and y: front right, back right, back left, front left.
    Cross,
}

/// `[plant.rotors]`: four rotors, for `fidelity = "rotors"` and for a firmware executed as a program. Aerodynamic forces, but not
/// torques, also act on a vehicle by Eq. (61).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RotorOptions {
    /// Arrangement of the rotors. The first and the third turn counter-clockwise, seen from above.
    pub layout: RotorLayout,
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
    /// Thrust and torque of each rotor over those of an intact one at the same speed \[-\].
    pub strength: [f64; 4],
    /// Drag in a rotor's plane, per speed of the rotor and of the air \[N s^2/(rad m)\]; 0 for none.
    pub drag_coefficient: f64,
    /// Loss of thrust by inflow along a rotor's axis, per speed of the rotor and of the air \[N s^2/(rad m)\]; 0 for none.
    pub inflow_coefficient: f64,
    /// Radius of a rotor \[m\].
    pub radius_m: f64,
    /// Whether the thrust increases close to the floor.
    pub ground_effect: bool,
    /// Fraction of a rotor's thrust that grows with the square of the commanded power; the rest grows linearly \[0..1\].
    pub quadratic_thrust: f64,
}

/// `[plant.battery]`: an open-circuit voltage that falls linearly with the charge, and an internal resistance.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct BatteryOptions {
    /// Whether thrust decreases with the voltage.
    pub sag: bool,
    /// Voltage at which the rotors reach the commanded speed \[V\].
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

/// `[plant.probe]`: a sine added to a stick of every command as it takes effect, for measuring the response of a loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ProbeOptions {
    /// Number of the stick: 1 roll, 2 pitch, 3 yaw \[-\].
    pub stick: usize,
    /// Amplitude \[-\]; 0 for no sine.
    pub amplitude: f64,
    /// Frequency \[Hz\].
    pub frequency_hz: f64,
}

impl ProbeOptions {
    fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("stick", self.stick as f64, Rule::Between(1.0, 3.0)),
            ("amplitude", self.amplitude, Rule::Between(0.0, 1.0)),
            ("frequency-hz", self.frequency_hz, Rule::Between(0.0, 1000.0)),
        ])
    }
}

impl PlantOptions {
    /// Inertia for the equations of motion.
    ///
    /// # Errors
    /// The inertia is not symmetric positive definite.
    pub fn inertia(&self) -> Result<Inertia, InertiaError> {
        inertia(&self.inertia_kg_m2)
    }

    /// Whether a bridge commands the vehicle, which is simulated nevertheless: an emulated one at a wire, or a firmware executed as a
    /// program.
    pub fn is_simulated_behind_bridge(&self) -> bool {
        !self.wire.link.is_empty() || !self.truth.is_empty()
    }

    pub(crate) fn check(&self) -> Result<(), OptionError> {
        self.airframe().check()?;
        // The plant's integrator is stable with a lag above 0.36 steps; a spread halves it at most.
        let lag_ratio = Rule::Between((A_STEP_MS / self.rate_lag_ms).max(0.1), 10.0);
        let own = check_options([
            ("spread", self.spread, Rule::Between(0.0, 0.5)),
            ("hidden-delay-ms", self.hidden_delay_ms, Rule::Between(0.0, 500.0)),
            ("command-jitter-ms", self.command_jitter_ms, Rule::Between(0.0, 500.0)),
            ("command-loss-probability", self.command_loss_probability, Rule::Between(0.0, 0.5)),
            ("command-loss-burst", self.command_loss_burst, Rule::Between(1.0, 1000.0)),
            ("thrust-exponent", self.thrust_exponent, Rule::Between(0.5, 2.0)),
            ("rate-lag-ratio", self.rate_lag_ratio[0], lag_ratio),
            ("rate-lag-ratio", self.rate_lag_ratio[1], lag_ratio),
            ("rate-lag-ratio", self.rate_lag_ratio[2], lag_ratio),
            ("gust-sd-m-s2", self.gust_sd_m_s2, Rule::NotNegative),
            ("gust-time-s", self.gust_time_s, Rule::Positive),
            ("disturbance-spread", self.disturbance_spread, Rule::NotNegative),
            ("frame-rate-hz", self.frame_rate_hz, Rule::Between(1.0, 1000.0)),
        ]);
        own.map_err(|error| error.within("plant"))?;
        self.rotors.check().map_err(|error| error.within("plant.rotors"))?;
        self.battery.check().map_err(|error| error.within("plant.battery"))?;
        self.probe.check().map_err(|error| error.within("plant.probe"))?;
        self.wire.check().map_err(|error| error.within("plant.wire"))?;
        self.check_mass()?;
        self.check_links()
    }

    /// Checks that disturbances leave some of the vehicle's mass.
    fn check_mass(&self) -> Result<(), OptionError> {
        let taken = self.disturb.iter().map(|disturbance| match disturbance.kind {
            DisturbanceKind::Mass(mass_kg) => (-mass_kg).max(0.0),
            _ => 0.0,
        });
        let (taken_kg, least_kg) = (taken.sum::<f64>(), self.mass_kg * (1.0 - self.spread));
        if taken_kg <= MOST_TAKEN * least_kg {
            return Ok(());
        }
        let allowed = format!("not below -{:.3} kg in all", MOST_TAKEN * least_kg);
        Err(OptionError::new("plant.disturb", format!("-{taken_kg} kg in all"), allowed))
    }

    /// Checks that the vehicle has one command path, and that torque commands come over the bus.
    fn check_links(&self) -> Result<(), OptionError> {
        if !self.truth.is_empty() && !self.wire.link.is_empty() {
            let link = format!("`{}`", self.wire.link);
            let allowed = "empty where plant.truth names a source of the truth";
            return Err(OptionError::new("plant.wire.link", link, allowed));
        }
        let links = [("plant.wire.link", &self.wire.link), ("plant.truth", &self.truth)];
        let torque = self.interface == Interface::Torque;
        match links.into_iter().find(|(_, link)| torque && !link.is_empty()) {
            None => Ok(()),
            Some((key, link)) => Err(OptionError::new(
                key,
                format!("`{link}`"),
                "empty for a vehicle that is commanded by torque (plant.interface = \"torque\")",
            )),
        }
    }

    fn airframe(&self) -> Airframe<'_> {
        Airframe {
            section: "plant",
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
    }
}

impl RotorOptions {
    fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("arm-m", self.arm_m, Rule::Positive),
            ("thrust-coefficient", self.thrust_coefficient, Rule::Positive),
            ("torque-coefficient", self.torque_coefficient, Rule::Positive),
            ("lag-ms", self.lag_ms, A_STEP),
            ("max-speed-rad-s", self.max_speed_rad_s, Rule::Positive),
            ("drag-coefficient", self.drag_coefficient, Rule::Between(0.0, 1.0)),
            ("inflow-coefficient", self.inflow_coefficient, Rule::Between(0.0, 1.0)),
            ("radius-m", self.radius_m, Rule::Positive),
            ("quadratic-thrust", self.quadratic_thrust, Rule::Between(0.0, 1.0)),
        ])?;
        check_options(self.strength.map(|share| ("strength", share, Rule::Between(0.0, 2.0))))
    }
}

impl BatteryOptions {
    fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("nominal-v", self.nominal_v, Rule::Positive),
            ("empty-v", self.empty_v, Rule::Positive),
            ("capacity-ah", self.capacity_ah, Rule::Positive),
            ("resistance-ohm", self.resistance_ohm, Rule::NotNegative),
            ("hover-current-a", self.hover_current_a, Rule::NotNegative),
        ])?;
        if self.full_v > self.empty_v {
            return Ok(());
        }
        let allowed = format!("above empty-v, {}", self.empty_v);
        Err(OptionError::new("full-v", self.full_v, allowed))
    }
}
