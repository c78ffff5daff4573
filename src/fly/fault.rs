//! The flags `--fault` and `--disturb`: their help, and faults of processes in real time.

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_config::{ClockKind, Config, Fault, FaultKind};
use oqtal_runtime::faults::ArmingWatch;
use oqtal_runtime::faults::outage::role_of;

/// The help of the flag.
pub const HELP: &str = "Inject a fault, TIME seconds after arming, as in pose:off@5+0.1 or mocap-emu:stop@5+0.5; repeatable. \
     A wrong one lists the targets and kinds";

/// The help of the flag `--disturb`.
pub const DISTURB_HELP: &str = "Disturb the simulated vehicle, TIME seconds after arming, as in force@5+1=0.3,0,0N, torque@5+0.1=0.002,0,0Nm, \
     gust@5+2=1.5,0,0m/s or mass@5=0.05kg; repeatable. A wrong one lists the kinds";

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
