//! Fits of a vehicle: first the rotation, then the translation.

use nalgebra::Vector3;
use oqtal_config::VehicleOptions;

use super::data::FlightData;
use super::lifting::{CURVATURE, LiftingFit, TurnedFlights, lifting};
use super::rotation::RotationModel;
use super::translation::TranslationModel;
use super::turning::{TurningFit, turning};

/// Least number of poses in the air per flight: two seconds at 60 Hz.
const LEAST_POSES: usize = 120;

/// Standard deviations of the curvature beyond which the thrust is curved \[-\].
const CURVED_SD: f64 = 3.0;

/// The fits of an identification.
#[derive(Clone, Debug)]
pub struct VehicleFit {
    /// The rotation.
    pub turning: TurningFit,
    /// The translation, with a curved thrust if [`Self::has_curved_thrust`], and else with one that is linear in its command.
    pub lifting: LiftingFit,
    /// The translation, with a curved thrust.
    pub curved: LiftingFit,
    /// Whether the flights show that the thrust is curved over its command. A straight line through it would have the slope of the curve
    /// and a push along z in place of the rest.
    pub has_curved_thrust: bool,
}

/// Fits the model to `flights`, starting from the parameters `configured`.
pub fn estimate(flights: &[FlightData], configured: &VehicleOptions) -> Option<VehicleFit> {
    if flights.is_empty() || flights.iter().any(|data| data.air.len() < LEAST_POSES) {
        return None;
    }
    let start = RotationModel {
        delay_s: configured.command_delay_ms * 1e-3,
        lag_s: configured.rate_lag_ms * 1e-3,
        fast_s: 0.0,
        authority: Vector3::from(configured.rate_authority_rad_s),
        bias: Vector3::zeros(),
    };
    let turning = turning(flights, &start)?;
    let start = TranslationModel {
        gravity_m_s2: configured.gravity_m_s2,
        thrust_m_s2: configured.max_thrust_n / configured.mass_kg,
        thrust_lag_s: configured.thrust_lag_ms * 1e-3,
        drag_per_s: configured.drag_per_s,
        bias: Vector3::zeros(),
        curvature_ratio: 0.0,
        hover_share: mean_share(flights)?,
    };
    let delayed = turning.delayed(flights);
    let turned = TurnedFlights { flights, rotations: &turning.passes, delayed: &delayed };
    let curved = lifting(turned, &start, true)?;
    let (bend, sd) = curved.fit.of(CURVATURE);
    let has_curved_thrust = bend.abs() > CURVED_SD * sd;
    let lifting = if has_curved_thrust { curved.clone() } else { lifting(turned, &start, false)? };
    Some(VehicleFit { turning, lifting, curved, has_curved_thrust })
}

/// Mean commanded thrust in the air, as a fraction of the maximum \[0..1\].
fn mean_share(flights: &[FlightData]) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for data in flights {
        let (from_s, to_s) = (data.air.first()?.captured_s, data.air.last()?.captured_s);
        let in_air = data.commands.iter().filter(|c| (from_s..to_s).contains(&c.sent_s));
        for command in in_air {
            sum += command.thrust;
            count += 1.0;
        }
    }
    Some(sum / count).filter(|share: &f64| share.is_finite() && *share > 0.0)
}
