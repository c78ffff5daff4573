//! The flag `--fault`: which faults a flight can have, and those of processes in real time.

use oqtal_bus::topic::Role;
use oqtal_config::{ClockKind, Config, Fault, FaultKind, FaultTarget};
use oqtal_runtime::faults::outage::role_of;
use oqtal_runtime::process::{Exit, Failure};

use super::vehicle::CommandLink;

/// The help of the flag.
pub const HELP: &str = "Inject a fault, TIME seconds after arming, as in pose:off@5+0.1 or mocap-emu:stop@5+0.5; repeatable. \
     A wrong one lists the targets and kinds";

/// Checks that the flight can have its faults.
///
/// # Errors
/// The fault and the reason, exit code 64.
pub fn check(config: &Config, link: &CommandLink) -> Result<(), Failure> {
    let refused = config.fault.inject.iter().find_map(|fault| {
        let reason = obstacle(fault, config, link)?;
        Some(Failure::new(Exit::Usage, format!("--fault {fault}: {reason}")))
    });
    refused.map_or(Ok(()), Err)
}

/// Why the flight cannot have `fault`; `None` if it can.
fn obstacle(fault: &Fault, config: &Config, link: &CommandLink) -> Option<&'static str> {
    if config.is_replay() {
        return Some("a recording is never armed; leave out --mocap replay");
    }
    if fault.kind == FaultKind::Kill && config.clock.kind == ClockKind::Lockstep {
        return Some(
            "in lockstep time waits for every process; use --clock real or in-process, or `stop`",
        );
    }
    let roles = link.roles(config);
    let is_there = match fault.target {
        FaultTarget::Radio => roles.contains(&Role::Plant) && !config.plant.shadow,
        target => role_of(target).is_none_or(|role| roles.contains(&role)),
    };
    match (is_there, fault.target) {
        (true, _) => None,
        (false, FaultTarget::Bridge) => {
            Some("the flight has no bridge; add --vehicle bridge:asctec, or name another process")
        }
        (false, _) => Some("the flight does not start that process; name another target"),
    }
}
