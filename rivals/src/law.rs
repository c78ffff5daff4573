//! The interface of the laws.

use nalgebra::Vector3;
use oqtal_control::predictive::{Bias, ModelInput, Motion, Rotation, VehicleModel};
use oqtal_control::trajectory::Reference;

/// Shortest lag with which a law reckons \[s\]: a rate or thrust that follows at once has this one.
const SHORTEST_LAG_S: f64 = 1e-3;

/// Vehicle commanded by body rates and thrust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateVehicle {
    /// Time constant of the body rate \[s\].
    pub rate_lag_s: f64,
    /// Time constant of the thrust \[s\].
    pub thrust_lag_s: f64,
    /// Mass \[kg\].
    pub mass_kg: f64,
    /// Gravity \[m/s^2\], along -z of the world.
    pub gravity_m_s2: f64,
    /// Linear drag per mass \[1/s\].
    pub drag_per_s: f64,
    /// Greatest rate that can be commanded about each axis \[rad/s, body\].
    pub greatest_rate: Vector3<f64>,
    /// Greatest thrust \[N\].
    pub greatest_thrust_n: f64,
}

impl RateVehicle {
    /// The vehicle of `model` with these greatest commands \[rad/s, body; N\]; `None` if it is not commanded by rates.
    pub fn new(
        model: &VehicleModel,
        greatest_rate: Vector3<f64>,
        greatest_thrust_n: f64,
    ) -> Option<Self> {
        let Rotation::RateLoop { lag_s } = model.rotation else { return None };
        Some(Self {
            rate_lag_s: lag_s.max(SHORTEST_LAG_S),
            thrust_lag_s: model.thrust_lag_s.max(SHORTEST_LAG_S),
            mass_kg: model.mass_kg,
            gravity_m_s2: model.gravity_m_s2,
            drag_per_s: model.drag_per_s,
            greatest_rate,
            greatest_thrust_n,
        })
    }

    /// The command nearest to `command` that the vehicle can follow.
    pub fn limited(&self, command: &ModelInput) -> ModelInput {
        ModelInput {
            demand: command
                .demand
                .zip_map(&self.greatest_rate, |rate, most| rate.clamp(-most, most)),
            thrust_n: command.thrust_n.clamp(0.0, self.greatest_thrust_n),
            ..*command
        }
    }
}

/// Knowledge of a law in one tick.
#[derive(Clone, Copy)]
pub struct RivalTick<'a> {
    /// The vehicle.
    pub vehicle: &'a RateVehicle,
    /// Motion that the command is computed for: that of now, or that predicted for the instant at which the command takes effect.
    pub motion: &'a Motion,
    /// Disturbances, zero unless the law is given those that the daemon estimates.
    pub bias: Bias,
    /// Motion estimated for now.
    pub measured: &'a Motion,
    /// Input in effect now.
    pub acting: ModelInput,
    /// Time since the last tick \[s\].
    pub dt_s: f64,
    /// Reference as a function of the time after the instant of `motion` \[s\].
    pub reference: &'a dyn Fn(f64) -> Reference,
}

/// A position law.
pub trait Rival {
    /// Restarts integrals and filters: a flight begins.
    fn reset(&mut self);

    /// The command of a tick: `demand` is the body rate, `thrust_n` the thrust, within the limits of the vehicle; `attitude` is not used.
    fn command(&mut self, tick: &RivalTick) -> ModelInput;
}
