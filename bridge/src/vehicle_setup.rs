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
        LinkSpec::Asctec(_) | LinkSpec::Crtp(_) => {
            let message = format!(
                "{spec}: only vehicles of MAVLink and Betaflight have parameters that are set up; those of a Crazyflie are set by the bridge whenever it connects"
            );
            Err(Failure::new(Exit::Usage, message))
        }
    }
}
