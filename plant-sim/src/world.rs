//! What the world does to a vehicle: gusts, drift, the battery, the floor. All randomness is drawn from streams named by
//! (seed, source), so that one source never shifts another.

use nalgebra::Vector3;
use oqtal_config::{Battery, Vehicle};
use oqtal_runtime::random::{Generator, RandomSource, normal3, stream};

use crate::state::State;

/// A stationary Ornstein-Uhlenbeck process per world axis, constant over each millisecond.
#[derive(Clone, Debug)]
pub struct Gust {
    generator: Generator,
    keep: f64,
    kick: f64,
    acceleration: Vector3<f64>,
}

impl Gust {
    /// The gusts of `vehicle`'s room, advancing by `step_s` seconds.
    #[must_use]
    pub fn new(vehicle: &Vehicle, seed: u64, step_s: f64) -> Self {
        // The exact discretisation, begun with a draw from the distribution that it keeps.
        let keep = (-step_s / vehicle.gust_time_s).exp();
        let kick = vehicle.gust_sd_m_s2 * (1.0 - keep * keep).sqrt();
        let mut generator = stream(seed, RandomSource::Gust);
        let acceleration = normal3(&mut generator) * vehicle.gust_sd_m_s2;
        Self { generator, keep, kick, acceleration }
    }

    /// Goes on by one step.
    pub fn advance(&mut self) {
        if self.kick > 0.0 {
            self.acceleration =
                self.acceleration * self.keep + normal3(&mut self.generator) * self.kick;
        }
    }

    /// Acceleration now \[m/s^2, world\].
    #[must_use]
    pub fn acceleration(&self) -> Vector3<f64> {
        self.acceleration
    }
}

/// This vehicle's constant imperfections, drawn once per seed: (rate drift \[rad/s, body\], acceleration \[m/s^2, world\]).
#[must_use]
pub fn imperfections(vehicle: &Vehicle, seed: u64) -> (Vector3<f64>, Vector3<f64>) {
    let mut generator = stream(seed, RandomSource::Imperfection);
    let mut spread = |nominal: [f64; 3]| {
        let factor = normal3(&mut generator) * vehicle.disturbance_spread + Vector3::repeat(1.0);
        Vector3::from(nominal).component_mul(&factor)
    };
    let drift = spread(vehicle.rate_drift_deg_s).map(f64::to_radians);
    let force = spread(vehicle.force_n);
    (drift, force / vehicle.mass_kg)
}

/// A battery whose open-circuit voltage falls linearly with the charge drawn.
#[derive(Clone, Debug)]
pub struct Cell {
    battery: Battery,
    /// Hover's share of thrust in one newton; 0 without weight.
    per_weight: f64,
    /// Share of the charge in one ampere second.
    per_ampere_second: f64,
    /// Share of the charge that is left.
    charge: f64,
    voltage: f64,
}

impl Cell {
    /// A full battery for `vehicle`.
    #[must_use]
    pub fn new(vehicle: &Vehicle) -> Self {
        let weight = vehicle.mass_kg * vehicle.gravity_m_s2;
        Self {
            battery: vehicle.battery.clone(),
            per_weight: if weight > 0.0 { weight.recip() } else { 0.0 },
            per_ampere_second: (3600.0 * vehicle.battery.capacity_ah).recip(),
            charge: 1.0,
            voltage: vehicle.battery.full_v,
        }
    }

    /// Draws the current of `thrust` newtons for `step_s` seconds.
    pub fn draw(&mut self, thrust: f64, step_s: f64) {
        let load = (thrust * self.per_weight).max(0.0);
        // Momentum theory: a rotor's power goes with thrust^(3/2).
        let current = self.battery.hover_current_a * load * load.sqrt();
        self.charge = (self.charge - current * step_s * self.per_ampere_second).max(0.0);
        let open =
            self.battery.empty_v + self.charge * (self.battery.full_v - self.battery.empty_v);
        self.voltage = (open - current * self.battery.resistance_ohm).max(0.0);
    }

    /// Voltage under load \[V\].
    #[must_use]
    pub fn voltage(&self) -> f64 {
        self.voltage
    }

    /// Voltage over the nominal one, or 1 where thrust does not depend on it.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        if self.battery.sag { self.voltage / self.battery.nominal_v } else { 1.0 }
    }
}

/// Keeps a vehicle above the floor, z = 0: it lands without bouncing, and stays where it stood `before` until lifted.
pub fn rest_on_floor(before: &State, state: &mut State) {
    if state.position.z > 0.0 || state.velocity.z > 0.0 {
        return;
    }
    if before.position.z <= 0.0 {
        state.position = before.position;
        state.attitude = before.attitude;
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
        let vehicle = Config::default().vehicle;
        let first = |seed| Gust::new(&vehicle, seed, 1e-3).acceleration();
        let squares: f64 = (0..2000).map(|seed| first(seed).norm_squared()).sum();
        let deviation = (squares / 6000.0).sqrt();
        assert!((deviation / vehicle.gust_sd_m_s2 - 1.0).abs() < 0.03, "{deviation}");
    }
}
