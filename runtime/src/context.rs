//! Context of a running process: configuration, role, stop flag, health, and functions that open ports and clocks.

use std::path::PathBuf;

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::Message;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::stop::SignalFlags;
use oqtal_bus::time::Span;
use oqtal_bus::topic::{Role, Topic};
use oqtal_config::{ClockKind, Config, InstanceOptions};
use oqtal_control::options::OptionError;

use crate::awake::AwakeInterval;
use crate::exit::{Exit, Failure};
use crate::health::{Health, Heartbeat};
use crate::loop_clock::LoopClock;
use crate::realtime;
use crate::stop::StopFlag;
use crate::watches::Watches;

/// Context of a running process.
#[derive(Clone, Debug)]
pub struct ProcessContext {
    /// The effective configuration.
    pub config: Config,
    /// Stop flag of the process.
    pub stop: StopFlag,
    /// Operators' requests by signal.
    pub signals: SignalFlags,
    /// Role of this process.
    pub role: Role,
    /// Files of the configuration.
    pub files: Vec<PathBuf>,
    /// Whether another command of oqtal started this process for its flight.
    pub is_child: bool,
    /// Health record, from which the service manager is notified.
    pub health: Health,
    pub(crate) watches: Watches,
}

impl ProcessContext {
    /// Joins the instance; its files are watched until the process ends.
    ///
    /// # Errors
    /// See [`Bus::open`].
    pub fn bus(&self) -> Result<Bus, BusError> {
        Ok(self.join(&self.paths()?)?.with_signals(self.signals.clone()))
    }

    /// Joins the instance at `paths`, which may be another one than that of the configuration; its files are watched until the process
    /// ends.
    ///
    /// # Errors
    /// See [`Bus::open`].
    pub fn join(&self, paths: &InstancePaths) -> Result<Bus, BusError> {
        let bus = Bus::open(paths)?;
        self.watches.add(paths, bus.watch()?);
        Ok(bus)
    }

    /// This context for a part of the process that has the role and the health of another one. The watchdog also checks the polls of
    /// the part's background thread.
    pub fn of_part(&self, role: Role) -> Self {
        Self { role, health: self.health.of_part(), ..self.clone() }
    }

    /// The heartbeat of this process.
    ///
    /// # Errors
    /// The process is already running, or the bus refuses.
    pub fn heartbeat(&self, bus: &Bus) -> Result<Heartbeat, BusError> {
        Heartbeat::new(bus, self.role, self.config.hash(), self.health.clone())
    }

    /// Paths and names of the instance.
    ///
    /// # Errors
    /// The instance name is invalid.
    pub fn paths(&self) -> Result<InstancePaths, BusError> {
        instance_paths(&self.config)
    }

    /// Applies `[realtime]` to the calling thread; has no effect in virtual time. Settings refused by the operating system are
    /// logged with their remedy. Threads that are already running keep their scheduling.
    pub fn enter_realtime(&self) {
        self.enter_realtime_as(self.role);
    }

    /// Like [`Self::enter_realtime`], with the priority of the loop of `role`.
    pub fn enter_realtime_as(&self, role: Role) {
        if self.config.clock.kind != ClockKind::Real {
            return;
        }
        let granted = realtime::enter(&self.config.realtime, role);
        for refusal in &granted.refused {
            tracing::warn!("{refusal}");
        }
        let realtime::GrantedSettings { policy, priority, cpu, locked, .. } = granted;
        tracing::debug!(policy, priority, ?cpu, locked, "loop is ready");
    }

    /// Loop clock of this process: real time, woken by `wakes_on`, or virtual time. The plant leads virtual time; during playback
    /// of a recording there is no plant, and the motion capture leads.
    ///
    /// # Errors
    /// The bus refuses.
    pub fn loop_clock<M: Message>(
        &self,
        bus: &Bus,
        wakes_on: &Topic<M>,
    ) -> Result<LoopClock, BusError> {
        let (stop, roles) = (self.stop.clone(), roles(&self.config));
        let clock = if self.config.clock.kind == ClockKind::Real {
            LoopClock::real(bus, wakes_on, stop)
        } else if self.role == roles[0] {
            LoopClock::leader(bus, roles, &self.config, stop)
        } else {
            LoopClock::follower(bus, self.role, stop)
        };
        let period = Span::period_of(self.config.control.rate_hz);
        let awake = AwakeInterval::of(&self.config, self.role);
        Ok(clock?.counted_in(self.health.clone(), period).awake_in(awake))
    }
}

/// The roles that take part in the loop; the first leads virtual time.
pub fn roles(config: &Config) -> &'static [Role] {
    if config.is_replay() { &Role::ALL[1..] } else { &Role::ALL }
}

/// Checks the name of the instance of a configuration.
///
/// # Errors
/// The name is invalid; the error names its origin (exit code 78, or 64 if the flag `--instance` sets it).
pub fn check_instance(config: &Config) -> Result<(), Failure> {
    let Err(BusError::Name { value, .. }) = instance_paths(config) else { return Ok(()) };
    let name = format!("`{}`", value.escape_debug());
    let error = OptionError::new("instance.name", name, "1 to 32 of a-z, 0-9 and -");
    let located = config.locate(&error);
    let exit = if located.origin == "--instance" { Exit::Usage } else { Exit::Config };
    Err(Failure::new(exit, located.to_string()))
}

/// Paths and names of the instance of a configuration.
///
/// # Errors
/// The instance name is invalid.
pub fn instance_paths(config: &Config) -> Result<InstancePaths, BusError> {
    paths_of(&config.instance)
}

/// Paths and names of an instance.
///
/// # Errors
/// The instance name is invalid.
pub fn paths_of(instance: &InstanceOptions) -> Result<InstancePaths, BusError> {
    let root = Some(&instance.root).filter(|root| !root.is_empty());
    InstancePaths::new(&instance.name, root.map(std::path::Path::new))
}
