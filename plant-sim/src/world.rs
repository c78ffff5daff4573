//! Environment and imperfections of a vehicle: gusts, drift, battery, floor. Each random source has a separate stream, named by
//! (seed, source), so that a change of one source does not shift another.

use nalgebra::{Quaternion, Vector3};
use oqtal_config::{BatteryOptions, PlantOptions};
use oqtal_runtime::random::{Generator, RandomSource, normal3, stream};

use crate::state::State;

/// Gusts: a stationary Ornstein-Uhlenbeck process per world axis, constant over each millisecond.
#[derive(Clone, Debug)]
pub struct Gust {
    generator: Generator,
    keep: f64,
    kick: f64,
    acceleration: Vector3<f64>,
}

impl Gust {
    /// The gusts of `plant`, advancing by `step_s` \[s\] at a time.
    pub fn new(plant: &PlantOptions, seed: u64, step_s: f64) -> Self {
        // Exact discretisation, started from the stationary distribution.
        let keep = (-step_s / plant.gust_time_s).exp();
        let kick = plant.gust_sd_m_s2 * (1.0 - keep * keep).sqrt();
        let mut generator = stream(seed, RandomSource::Gust);
        let acceleration = normal3(&mut generator) * plant.gust_sd_m_s2;
        Self { generator, keep, kick, acceleration }
    }

    /// Advances by one step.
    pub fn advance(&mut self) {
        if self.kick > 0.0 {
            self.acceleration =
                self.acceleration * self.keep + normal3(&mut self.generator) * self.kick;
        }
    }

    /// Present acceleration \[m/s^2, world\].
    pub fn acceleration(&self) -> Vector3<f64> {
        self.acceleration
    }
}

/// Constant imperfections of the vehicle, drawn once per seed: (rate drift \[rad/s, body\], acceleration \[m/s^2, world\]).
pub fn imperfections(plant: &PlantOptions, seed: u64) -> (Vector3<f64>, Vector3<f64>) {
    let mut generator = stream(seed, RandomSource::Imperfection);
    let mut spread = |nominal: [f64; 3]| {
        let factor = normal3(&mut generator) * plant.disturbance_spread + Vector3::repeat(1.0);
        Vector3::from(nominal).component_mul(&factor)
    };
    let drift = spread(plant.rate_drift_deg_s).map(f64::to_radians);
    let force = spread(plant.force_n);
    (drift, force / plant.mass_kg)
}

/// A battery whose open-circuit voltage falls linearly with the charge drawn.
#[derive(Clone, Debug)]
pub struct BatteryModel {
    battery: BatteryOptions,
    /// One newton over the weight \[1/N\]; 0 without weight.
    per_weight: f64,
    /// One ampere second over the capacity \[1/(A s)\].
    per_ampere_second: f64,
    /// Remaining charge over the capacity \[-\].
    charge: f64,
    voltage: f64,
}

impl BatteryModel {
    /// A full battery of `plant`.
    pub fn new(plant: &PlantOptions) -> Self {
        let weight = plant.mass_kg * plant.gravity_m_s2;
        Self {
            battery: plant.battery.clone(),
            per_weight: if weight > 0.0 { weight.recip() } else { 0.0 },
            per_ampere_second: (3600.0 * plant.battery.capacity_ah).recip(),
            charge: 1.0,
            voltage: plant.battery.full_v,
        }
    }

    /// Draws the current for `thrust` \[N\] during `step_s` \[s\].
    pub fn draw(&mut self, thrust: f64, step_s: f64) {
        let load = (thrust * self.per_weight).max(0.0);
        // Momentum theory: the power of a rotor is proportional to thrust^(3/2).
        let current = self.battery.hover_current_a * load * load.sqrt();
        self.charge = (self.charge - current * step_s * self.per_ampere_second).max(0.0);
        let open =
            self.battery.empty_v + self.charge * (self.battery.full_v - self.battery.empty_v);
        self.voltage = (open - current * self.battery.resistance_ohm).max(0.0);
    }

    /// Voltage under load \[V\].
    pub fn voltage(&self) -> f64 {
        self.voltage
    }

    /// Voltage over the nominal one \[-\]; 1 where thrust does not depend on the voltage.
    pub fn ratio(&self) -> f64 {
        if self.battery.sag { self.voltage / self.battery.nominal_v } else { 1.0 }
    }
}

/// Keeps a vehicle above the floor, z = 0. The vehicle lands without bouncing and rests at `position` \[m, world\] and `attitude`
/// \[body to world\], the pose before the step, until it lifts off.
pub fn rest_on_floor((position, attitude): (Vector3<f64>, Quaternion<f64>), state: &mut State) {
    if state.position.z > 0.0 || state.velocity.z > 0.0 {
        return;
    }
    if position.z <= 0.0 {
        state.position = position;
        state.attitude = attitude;
    }
    state.position.z = 0.0;
    state.velocity = Vector3::zeros();
    state.rate = Vector3::zeros();
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_config::Config;

    #[test]
    fn gusts_are_as_strong_at_first_as_ever() {
        let plant = Config::default().plant;
        let first = |seed| Gust::new(&plant, seed, 1e-3).acceleration();
        let squares: f64 = (0..2000).map(|seed| first(seed).norm_squared()).sum();
        let deviation = (squares / 6000.0).sqrt();
        assert!((deviation / plant.gust_sd_m_s2 - 1.0).abs() < 0.03, "{deviation}");
    }
}
