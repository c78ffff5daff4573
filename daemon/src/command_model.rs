//! The effect of commands on the vehicle, by the model of `[vehicle]`, and the tracker of its motion.

use nalgebra::Vector3;
use oqtal_config::{Config, Interface, VehicleOptions};
use oqtal_control::options::OptionError;
use oqtal_control::predictive::{Integration, ModelInput, MotionTracker, Rotation, VehicleModel};
use oqtal_control::rigid_body::Inertia;

use crate::command::{RotationCommand, VehicleCommand, collective};

/// The model of the vehicle, with the conversion of commands to its inputs.
#[derive(Clone, Copy, Debug)]
pub struct CommandModel {
    /// Model of the vehicle.
    pub model: VehicleModel,
    rate_authority: Vector3<f64>,
    max_thrust_n: f64,
}

impl CommandModel {
    /// The model of `config`.
    ///
    /// # Errors
    /// The inertia is not positive definite.
    pub fn new(config: &Config) -> Result<Self, OptionError> {
        let vehicle = &config.vehicle;
        let lag_s = vehicle.rate_lag_ms * 1e-3;
        let rotation = match vehicle.interface {
            Interface::Rate => Rotation::RateLoop { lag_s },
            Interface::Attitude => Rotation::AttitudeLoop {
                gain_per_s: vehicle.attitude_gain_per_s,
                greatest_rate: vehicle.rate_authority_rad_s.into(),
                lag_s,
            },
            Interface::Torque => Rotation::RigidBody { inertia: inertia(vehicle)? },
        };
        Ok(Self {
            model: VehicleModel {
                rotation,
                mass_kg: vehicle.mass_kg,
                gravity_m_s2: vehicle.gravity_m_s2,
                drag_per_s: vehicle.drag_per_s,
                thrust_lag_s: vehicle.thrust_lag_ms * 1e-3,
                integration: Integration::Fine,
            },
            rate_authority: vehicle.rate_authority_rad_s.into(),
            max_thrust_n: vehicle.max_thrust_n,
        })
    }

    /// The input of the model under `command`. The thrust is that of the message, a fraction of maximum thrust.
    pub fn input(&self, command: &VehicleCommand) -> ModelInput {
        let VehicleCommand::Armed { rotation, thrust_n, attitude } = command else {
            return ModelInput::default();
        };
        let demand = match (rotation, &self.model.rotation) {
            (RotationCommand::Torque(torque), Rotation::RigidBody { inertia }) => {
                inertia.inverse() * torque.0
            }
            _ => rotation.vector().component_mul(&self.rate_authority),
        };
        let thrust_n = collective(*thrust_n, self.max_thrust_n) * self.max_thrust_n;
        ModelInput { demand, attitude: *attitude, thrust_n }
    }
}

/// The tracker of the motion of a vehicle with the model `model`, for the law of `config`.
pub(crate) fn motion_tracker(config: &Config, model: VehicleModel) -> MotionTracker {
    let delay_s = config.vehicle.command_delay_ms * 1e-3;
    if config.control.is_predictive() || config.control.fallback.is_some() {
        return MotionTracker::new(model, config.safety.filter, delay_s)
            .predictive(&config.control.predictive);
    }
    // Only gate and limits use the prediction.
    let model = VehicleModel { integration: Integration::Coarse, ..model };
    MotionTracker::new(model, config.safety.filter, delay_s)
}

/// The inertia of `[vehicle]`.
///
/// # Errors
/// The inertia is not symmetric positive definite.
pub fn inertia(vehicle: &VehicleOptions) -> Result<Inertia, OptionError> {
    vehicle.inertia().map_err(|error| {
        OptionError::new("vehicle.inertia-kg-m2", "unusable", format!("an inertia: {error}"))
    })
}
