//! The command `setup`: reads the relevant parameters of an autopilot, reports wrong ones with the reason, and sets them on
//! request. `exchange.rs` has what every protocol needs.

mod exchange;
mod mavlink;
mod msp;

use oqtal_config::Config;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::link::LinkSpec;

/// Reads the parameters of the vehicle at `spec`, and sets the wrong ones if `apply` is set. Returns the table to print, and
/// whether all are correct.
///
/// # Errors
/// The link has no parameters, the port cannot be opened, the vehicle does not answer, or its motors run and it is to be changed.
pub fn set_up(config: &Config, spec: &LinkSpec, apply: bool) -> Result<(String, bool), Failure> {
    match spec {
        LinkSpec::Mavlink(link) => mavlink::set_up(config, (spec, link), apply),
        LinkSpec::Msp(_) => msp::set_up(config, spec, apply),
        LinkSpec::Asctec(_) => {
            let message = format!(
                "{spec}: a vehicle of AscTec has no parameters to set up; measure its time-out without set-points on the bench and set `bridge.vehicle-time-out-ms`, as docs/operations.md describes"
            );
            Err(Failure::new(Exit::Usage, message))
        }
        LinkSpec::Crtp(_) => {
            let message = format!(
                "{spec}: the bridge sets the parameters of a Crazyflie whenever it connects"
            );
            Err(Failure::new(Exit::Usage, message))
        }
    }
}
