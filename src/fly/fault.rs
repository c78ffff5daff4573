//! The flags `--fault` and `--disturb`: checks against the flight, and faults of processes in real time.

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_config::{ClockKind, Config, Fault, FaultKind, FaultTarget};
use oqtal_runtime::faults::ArmingWatch;
use oqtal_runtime::faults::outage::role_of;
use oqtal_runtime::process::{Exit, Failure};

/// The help of the flag.
pub const HELP: &str = "Inject a fault, TIME seconds after arming, as in pose:off@5+0.1 or mocap-emu:stop@5+0.5; repeatable. \
     A wrong one lists the targets and kinds";

/// The help of the flag `--disturb`.
pub const DISTURB_HELP: &str = "Disturb the simulated vehicle, TIME seconds after arming, as in force@5+1=0.3,0,0N, torque@5+0.1=0.002,0,0Nm, \
     gust@5+2=1.5,0,0m/s or mass@5=0.05kg; repeatable. A wrong one lists the kinds";

/// Checks that a flight with the processes `roles` supports its faults and disturbances.
///
/// # Errors
/// The unsupported fault and the reason, exit code 64.
pub fn check(config: &Config, roles: &[Role]) -> Result<(), Failure> {
    let is_simulated = roles.contains(&Role::Plant)
        && !config.plant.shadow
        && !config.plant.truth.starts_with("mavlink");
    if let Some(load) = config.plant.disturb.first().filter(|_| !is_simulated || config.is_replay())
    {
        let reason = "only a vehicle that this program simulates can be disturbed";
        return Err(Failure::new(Exit::Usage, format!("--disturb {load}: {reason}")));
    }
    let refused = config.fault.inject.iter().find_map(|fault| {
        let reason = obstacle(fault, config, roles)?;
        Some(Failure::new(Exit::Usage, format!("--fault {fault}: {reason}")))
    });
    refused.map_or(Ok(()), Err)
}

/// Reason why the flight does not support `fault`; `None` if it does.
fn obstacle(fault: &Fault, config: &Config, roles: &[Role]) -> Option<&'static str> {
    if config.is_replay() {
        return Some("a recording is never armed; leave out --mocap replay");
    }
    if fault.kind == FaultKind::Kill && config.clock.kind == ClockKind::Lockstep {
        return Some(
            "in lockstep time waits for every process; use --clock real or in-process, or `stop`",
        );
    }
    if fault.target == FaultTarget::Files && config.clock.kind != ClockKind::Real {
        return Some("files are removed in real time only; use --clock real");
    }
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

/// Action of a fault in real time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultAction {
    /// An action on the process of a role.
    Process(Role, ProcessAction),
    /// The files of the instance are removed.
    RemoveFiles,
}

/// Action of a fault on a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProcessAction {
    /// The process is killed; if it is to be restarted, its end is not a failure.
    Kill {
        /// Whether [`ProcessAction::Start`] follows.
        is_restarted: bool,
    },
    /// The process is started again.
    Start,
    /// The process is stopped by SIGSTOP.
    Stop,
    /// The process is continued.
    Continue,
}

/// Faults of processes and files in a flight in real time, as actions at instants after arming.
#[derive(Debug)]
pub struct ProcessFaults {
    /// Actions in reverse order of time \[time after arming\].
    actions: Vec<(Span, FaultAction)>,
    arming: ArmingWatch<Bus>,
    armed_at: Option<Time>,
}

impl ProcessFaults {
    /// Faults of `config` that kill or stop processes, or remove files, in real time. In virtual time the turn scheduler executes them.
    ///
    /// # Errors
    /// The bus failed.
    pub fn open(bus: &Bus, config: &Config) -> Result<Self, BusError> {
        let is_real = config.clock.kind == ClockKind::Real;
        let all = config.fault.inject.iter().filter(|_| is_real);
        let mut actions: Vec<_> = all.flat_map(actions_of).collect();
        actions.sort_by_key(|(at, ..)| std::cmp::Reverse(*at));
        let arming = ArmingWatch::open(bus, !actions.is_empty())?;
        Ok(Self { actions, arming, armed_at: None })
    }

    /// The next action that is due at `now`; `None` if there is none.
    ///
    /// # Errors
    /// The bus failed.
    pub fn due(&mut self, now: Time) -> Result<Option<FaultAction>, BusError> {
        self.armed_at = self.arming.armed_at()?;
        let is_due = self.next().is_some_and(|next| next <= now);
        let action = if is_due { self.actions.pop() } else { None };
        Ok(action.map(|(_, action)| action))
    }

    /// The instant of the next action; `None` before arming.
    pub fn next(&self) -> Option<Time> {
        let (at, ..) = self.actions.last()?;
        Some(self.armed_at? + *at)
    }
}

/// Actions of a fault: its beginning, and its end if it has one.
fn actions_of(fault: &Fault) -> Vec<(Span, FaultAction)> {
    let at = Span::from_seconds(fault.at_s);
    let is_restarted = fault.duration_s.is_some();
    let (begin, end) = match fault.kind {
        FaultKind::Kill => (ProcessAction::Kill { is_restarted }, ProcessAction::Start),
        FaultKind::Stop => (ProcessAction::Stop, ProcessAction::Continue),
        FaultKind::Removed => return vec![(at, FaultAction::RemoveFiles)],
        _ => return Vec::new(),
    };
    let Some(role) = role_of(fault.target) else { return Vec::new() };
    let end = is_restarted.then(|| (Span::from_seconds(fault.end_s()), end));
    let actions = std::iter::once((at, begin)).chain(end);
    actions.map(|(at, action)| (at, FaultAction::Process(role, action))).collect()
}
