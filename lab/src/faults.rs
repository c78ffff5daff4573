//! Check of injected faults and disturbances against the processes of a flight.

use oqtal_bus::topic::Role;
use oqtal_config::{ClockKind, Config, Fault, FaultKind, FaultTarget};
use oqtal_runtime::faults::outage::role_of;
use oqtal_runtime::process::{Exit, Failure};

/// Checks that a flight with the processes `roles` supports its faults and disturbances. `fault` and `disturbance` are the words of
/// the caller's interface before them, such as `--fault` and `--disturb`.
///
/// # Errors
/// The unsupported fault and the reason, exit code 64.
pub fn check(
    config: &Config,
    roles: &[Role],
    [fault, disturbance]: [&str; 2],
) -> Result<(), Failure> {
    let is_simulated = roles.contains(&Role::Plant)
        && !config.plant.shadow
        && !config.plant.truth.starts_with("mavlink");
    if let Some(load) = config.plant.disturb.first().filter(|_| !is_simulated || config.is_replay())
    {
        let reason = "only a vehicle that this program simulates can be disturbed";
        return Err(Failure::new(Exit::Usage, format!("{disturbance} {load}: {reason}")));
    }
    let refused = config.fault.inject.iter().find_map(|injected| {
        let reason = obstacle(injected, config, roles)?;
        Some(Failure::new(Exit::Usage, format!("{fault} {injected}: {reason}")))
    });
    refused.map_or(Ok(()), Err)
}

/// Reason why the flight does not support `fault`; `None` if it does.
fn obstacle(fault: &Fault, config: &Config, roles: &[Role]) -> Option<&'static str> {
    if config.is_replay() {
        return Some("a recording is never armed; fly without the replay");
    }
    if fault.kind == FaultKind::Kill && config.clock.kind == ClockKind::Lockstep {
        return Some(
            "in lockstep time waits for every process; use --clock real or in-process, or `stop`",
        );
    }
    if fault.target == FaultTarget::Files && config.clock.kind != ClockKind::Real {
        return Some("files are removed in real time only, by `oqtal fly --clock real`");
    }
    let is_there = match fault.target {
        FaultTarget::Radio => roles.contains(&Role::Plant) && !config.plant.shadow,
        target => role_of(target).is_none_or(|role| roles.contains(&role)),
    };
    match (is_there, fault.target) {
        (true, _) => None,
        (false, FaultTarget::Bridge) => Some(
            "the flight has no bridge; use `oqtal fly --vehicle bridge:asctec`, or name another process",
        ),
        (false, _) => Some("the flight does not start that process; name another target"),
    }
}

#[cfg(test)]
mod tests {
    use oqtal_config::Setting;

    use super::*;

    #[test]
    fn faults_of_processes_that_a_flight_does_not_have_are_refused() {
        let refused = |fault: &str| {
            let settings = [
                Setting::flag("test", "clock.kind", "in-process"),
                Setting::flag("test", "fault.inject", vec![fault.to_owned()]),
            ];
            let config = Config::load(&[], &settings).unwrap();
            let roles = [Role::Plant, Role::Mocap, Role::Daemon];
            check(&config, &roles, ["faults:", "disturb:"]).err().map(|failure| failure.message)
        };
        for fault in ["bridge:stop@1", "receiver:stop@1", "files:removed@1"] {
            let message = refused(fault).unwrap();
            assert!(message.starts_with(&format!("faults: {fault}: ")), "{message}");
        }
        assert_eq!(refused("mocap-emu:stop@1+1"), None);
        assert_eq!(refused("radio:off@1+1"), None);
    }
}
