//! The program's own excitation flight, in virtual time, from which the parameters of a vehicle are identified.

use oqtal_bus::code::Cause;
use oqtal_config::Config;
use oqtal_control::controller::ControllerName;
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_observe::crash::Crash;
use oqtal_observe::flight::{Flight, Outcome};
use oqtal_runtime::process::{Exit, Failure};

use crate::mission::Mission;
use crate::simulation;

/// Time at rest before the manoeuvres \[s\]; keeps the flight shorter than a minute.
const SETTLE_S: f64 = 1.0;

/// Masses assumed by the controller in successive attempts after a failed flight, over the configured mass \[-\]: a vehicle that does not
/// take off, or that sinks to the floor, is heavier or has less thrust than configured; one that leaves the fence or its reference is
/// lighter or has more.
const HEAVIER: &[f64] = &[1.3, 1.7, 2.2];
const LIGHTER: &[f64] = &[0.8, 0.6];

/// The excitation flight, with the configuration that was asked for.
#[derive(Debug)]
pub struct ExcitationFlight {
    /// The flight. Its mass is the configured one, also if another was assumed.
    pub flight: Flight,
    /// The mass that the controller assumed in place of the configured one, and why, as text; `None` if it flew as configured.
    pub assumption: Option<String>,
}

/// Flies the excitation with the law of `config`; the law uses `[vehicle]` only.
///
/// # Errors
/// A setting is invalid, or the flight did not end as planned (exit code 1).
pub fn fly(config: &Config) -> Result<ExcitationFlight, Failure> {
    let mut config = config.clone();
    config.trajectory.kind = TrajectoryKind::Excitation;
    config.trajectory.duration_s = None;
    config.trajectory.settle_s = SETTLE_S;
    let configured = config.vehicle.mass_kg;
    let mut flight = simulation::fly(&Mission::new(config.clone())?)?;
    let first_failure = failure(&flight);
    let others = if is_too_heavy(&flight) { HEAVIER } else { LIGHTER };
    for assumed in others {
        if failure(&flight).is_none() {
            break;
        }
        config.vehicle.mass_kg = configured * assumed;
        // A mass with which the check before the flight refuses it is not that of this vehicle.
        let Ok(mission) = Mission::new(config.clone()) else { continue };
        flight = simulation::fly(&mission)?;
    }
    if failure(&flight).is_none() {
        let assumption = first_failure.map(|reason| {
            let assumed = config.vehicle.mass_kg;
            format!(
                "with the configured mass of {configured} kg the excitation failed: {reason}; flown with a controller that assumes {assumed:.3} kg"
            )
        });
        // Findings are compared with, and thrust is computed for, the configured mass.
        flight.config.vehicle.mass_kg = configured;
        return Ok(ExcitationFlight { flight, assumption });
    }
    let (law, reason) = (config.control.controller, first_failure.unwrap_or_default());
    let masses: Vec<String> =
        others.iter().map(|share| format!("{:.3}", configured * share)).collect();
    let other_law = match law {
        ControllerName::OqtalDt => "",
        _ => "another law (--set control.controller=oqtal-dt), ",
    };
    Err(Failure::new(
        Exit::Flight,
        format!(
            "the excitation flight under the law `{law}` failed: {reason}; with assumed masses of {} kg it failed, too. Correct [vehicle], or try {other_law}smaller motions (--set trajectory.excitation.tilt-deg=5)",
            masses.join(", ")
        ),
    ))
}

/// Reason why `flight` is incomplete; `None` for a complete flight.
fn failure(flight: &Flight) -> Option<String> {
    let is_landed = flight.outcome == Outcome::Landed;
    let otherwise = (!is_landed).then(|| format!("the flight ended as {}", flight.outcome));
    flight.shortfall().or(otherwise)
}

fn is_too_heavy(flight: &Flight) -> bool {
    let last = flight.samples.last();
    matches!(flight.crash, Some((_, Crash::Floor | Crash::Hard { .. })))
        || last.is_some_and(|sample| sample.telemetry.cause == Cause::NoLift.code())
}
