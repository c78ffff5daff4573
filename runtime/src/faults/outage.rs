//! Outages of processes in virtual time (stopped, killed or slow): the scheduler omits or delays their turns.

use oqtal_bus::error::BusError;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_bus::transport::Transport;
use oqtal_config::{Config, Fault, FaultKind, FaultTarget};

use super::clock::{ArmingWatch, interval, is_within};

/// Interval in which a process does not act, or acts late.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outage {
    /// The process.
    pub role: Role,
    /// Beginning of the interval.
    pub from: Time,
    /// End of the interval; `None` for an unlimited one.
    pub until: Option<Time>,
    /// Delay of each turn; `None` if the process does not run at all.
    pub lateness: Option<Span>,
    /// Whether the process is killed and must be restarted at the end.
    pub is_kill: bool,
}

impl Outage {
    /// Outage caused by `fault` in a flight armed at `armed_at`; `None` if the target is not a process.
    pub fn of(fault: &Fault, armed_at: Time) -> Option<Self> {
        let (from, until) = interval(fault.at_s, fault.duration_s, armed_at);
        Some(Self {
            role: role_of(fault.target)?,
            from,
            until,
            lateness: (fault.kind == FaultKind::Slow)
                .then(|| Span::from_seconds(fault.value() * 1e-3)),
            is_kill: fault.kind == FaultKind::Kill,
        })
    }

    /// Instant at which a turn of the role due `at` is executed; `None` for never.
    pub fn postpone(&self, at: Time) -> Option<Time> {
        match (is_within((self.from, self.until), at), self.lateness) {
            (false, _) => Some(at),
            (true, Some(lateness)) => Some(at + lateness),
            (true, None) => self.until,
        }
    }
}

/// Process that is the target of a fault; `None` if the target is not a process.
pub const fn role_of(target: FaultTarget) -> Option<Role> {
    match target {
        FaultTarget::Daemon => Some(Role::Daemon),
        FaultTarget::PlantSim => Some(Role::Plant),
        FaultTarget::MocapEmu => Some(Role::Mocap),
        FaultTarget::Bridge => Some(Role::Bridge),
        FaultTarget::Receiver => Some(Role::Receiver),
        FaultTarget::Pose
        | FaultTarget::Command
        | FaultTarget::Vehicle
        | FaultTarget::Radio
        | FaultTarget::Files => None,
    }
}

/// The faults of processes in one flight in virtual time.
#[derive(Debug)]
pub struct TurnFaults<T: Transport> {
    /// Watch for arming; `None` once armed.
    arming: Option<ArmingWatch<T>>,
    faults: Vec<Fault>,
}

impl<T: Transport> TurnFaults<T> {
    /// The faults of processes in `config`.
    ///
    /// # Errors
    /// The transport failed.
    pub fn open(bus: &T, config: &Config) -> Result<Self, BusError> {
        let all = config.fault.inject.iter();
        let faults: Vec<Fault> = all.filter(|fault| fault.target.is_process()).cloned().collect();
        Ok(Self { arming: Some(ArmingWatch::open(bus, !faults.is_empty())?), faults })
    }

    /// Outages of the flight, returned once, as soon as it is armed; to be called after each turn of the daemon.
    ///
    /// # Errors
    /// The transport failed.
    pub fn begin(&mut self) -> Result<Option<Vec<Outage>>, BusError> {
        let armed_at = self.arming.as_mut().map_or(Ok(None), ArmingWatch::armed_at)?;
        let Some(armed_at) = armed_at else { return Ok(None) };
        self.arming = None;
        Ok(Some(self.faults.iter().filter_map(|fault| Outage::of(fault, armed_at)).collect()))
    }
}
