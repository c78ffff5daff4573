//! The status overview of an instance: a sink that keeps the newest health message of every process, the newest vehicle
//! message and the newest tick.

use std::fmt;

use oqtal_bus::code::{Cause, ControlHolder, EstimatorState, Mode, SafetyState, VehicleRefusal};
use oqtal_bus::message::{Header, HealthV1, TelemetryV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Role, Sample};
use serde::Serialize;

use crate::sink::{Reception, Sink};

/// The processes of an instance. Either the plant or the bridge runs, or both; either emulated cameras or a receiver.
const PROCESSES: [Role; 5] = Role::PROCESSES;

/// Collects what the processes of one instance publish about themselves.
#[derive(Debug)]
pub struct StatusMonitor {
    /// Health messages older than this are ignored: the process is silent.
    timeout: Span,
    health: [Option<(Header, HealthV1)>; PROCESSES.len()],
    vehicle: Option<VehicleV1>,
    tick: Option<TelemetryV1>,
}

impl StatusMonitor {
    /// The topics that carry the status of an instance.
    pub const TOPICS: [ObservedTopic; 7] = [
        ObservedTopic::Telemetry,
        ObservedTopic::Vehicle,
        ObservedTopic::Health(PROCESSES[0]),
        ObservedTopic::Health(PROCESSES[1]),
        ObservedTopic::Health(PROCESSES[2]),
        ObservedTopic::Health(PROCESSES[3]),
        ObservedTopic::Health(PROCESSES[4]),
    ];

    /// A monitor that counts a process as silent after `timeout` without a health message.
    #[must_use]
    pub fn new(timeout: Span) -> Self {
        Self { timeout, health: [None; PROCESSES.len()], vehicle: None, tick: None }
    }

    /// Whether every process that is expected to run, and the vehicle, has been received.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        let known = |role| self.has(role) || self.is_replaced(role);
        self.vehicle.is_some() && PROCESSES.into_iter().all(known)
    }

    /// The status at `now`.
    #[must_use]
    pub fn status(&self, now: Time) -> InstanceStatus {
        let processes = PROCESSES.into_iter().zip(&self.health).map(|(role, health)| {
            let heard = health.as_ref().map(|health| HealthReport::new(role, health, now));
            ProcessHealth { name: role.name(), heard, is_replaced: self.is_replaced(role) }
        });
        let seen = self.tick.filter(|tick| tick.pose_age_s.is_finite());
        InstanceStatus {
            processes: processes.collect(),
            vehicle: self.vehicle.as_ref().map(VehicleStatus::new),
            position_m: seen.map(|tick| tick.position),
        }
    }

    fn has(&self, role: Role) -> bool {
        PROCESSES.into_iter().zip(&self.health).any(|(other, said)| other == role && said.is_some())
    }

    /// Whether the process that runs in place of `role` was received: a vehicle is simulated or real.
    fn is_replaced(&self, role: Role) -> bool {
        match role {
            Role::Plant => self.has(Role::Bridge),
            Role::Bridge => self.has(Role::Plant),
            Role::Mocap => self.has(Role::Receiver),
            Role::Receiver => self.has(Role::Mocap),
            _ => false,
        }
    }
}

impl StatusMonitor {
    fn health(&mut self, reception: &Reception, role: Role, health: &HealthV1) {
        let slots = PROCESSES.into_iter().zip(&mut self.health);
        let slot = slots.filter(|(other, _)| *other == role).map(|(_, slot)| slot).next();
        if reception.received_at.since(health.time) <= self.timeout
            && let Some(slot) = slot
        {
            *slot = Some((reception.header, *health));
        }
    }
}

impl Sink for StatusMonitor {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        match sample {
            Sample::Telemetry(telemetry) => self.tick = Some(*telemetry),
            Sample::Vehicle(vehicle) => self.vehicle = Some(*vehicle),
            Sample::Health(role, health) => self.health(reception, role, health),
            _ => {}
        }
    }

    /// Ignores losses: the newest sample of each topic is all that a status needs.
    fn lost(&mut self, _: ObservedTopic, _: u64) {}
}

/// Status of an instance: its processes, its vehicle and the estimated position.
#[derive(Clone, Debug, Default)]
pub struct InstanceStatus {
    /// The processes.
    pub processes: Vec<ProcessHealth>,
    /// The vehicle; `None` if no process publishes its state.
    pub vehicle: Option<VehicleStatus>,
    /// Estimated position \[m, world\]; `None` before the first pose.
    pub position_m: Option<[f64; 3]>,
}

impl InstanceStatus {
    /// Whether all processes received run with one configuration; `None` if none was listened for.
    #[must_use]
    pub fn config_agrees(&self) -> Option<bool> {
        let hashes = self.processes.iter().filter_map(|p| p.heard.as_ref()?.config_hash.as_ref());
        let mut hashes = hashes.peekable();
        let first = hashes.peek().copied();
        (!self.processes.is_empty()).then(|| hashes.all(|hash| Some(hash) == first))
    }

    /// The status as text: one line for each process, the vehicle and the position.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines: Vec<String> = self.processes.iter().map(ToString::to_string).collect();
        lines.extend(self.vehicle.as_ref().map(ToString::to_string));
        lines.extend(
            self.position_m
                .map(|at| at.map(centimetres))
                .map(|[x, y, z]| format!("{:<10} {x:.2} {y:.2} {z:.2} m", "position")),
        );
        if self.config_agrees() == Some(false) {
            lines.push("configurations differ: restart the processes with one --config".to_owned());
        }
        lines
    }
}

/// `value` \[m\] to the centimetre, without a minus in front of zero \[m\].
fn centimetres(value: f64) -> f64 {
    (value * 100.0).round() / 100.0 + 0.0
}

/// Health of one process.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProcessHealth {
    name: &'static str,
    /// Newest health message; `None` if the process is silent: not started, ended, hung, or waiting for virtual time.
    heard: Option<HealthReport>,
    /// Whether another process runs in place of this one, so that it is not expected.
    #[serde(skip)]
    is_replaced: bool,
}

/// Content of a health message.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct HealthReport {
    pid: u64,
    age_ms: f64,
    /// `None` for an emulated vehicle behind a radio, whose configuration is its own.
    config_hash: Option<String>,
    /// Of the daemon only.
    #[serde(skip_serializing_if = "Option::is_none")]
    daemon: Option<DaemonHealth>,
    /// Of the bridge only: whether the vehicle answers.
    #[serde(skip_serializing_if = "Option::is_none")]
    vehicle_answers: Option<bool>,
    /// Whether three turns in a row were late, the last less than a second ago.
    runs_late: bool,
    /// Turns that ended more than a period after they were due \[-\].
    late_turns: u64,
}

/// The fields of a health message that only the daemon sets.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct DaemonHealth {
    mode: String,
    state: String,
    cause: String,
    unlogged: u64,
}

/// State of the vehicle, as plant or bridge publish it; `None` for unknown numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VehicleStatus {
    simulated: bool,
    link: bool,
    armed: bool,
    starting: bool,
    stopped: bool,
    battery_v: Option<f64>,
    link_quality: Option<f64>,
    /// Who has control of it.
    control: String,
    /// Why it did not do what was asked last; empty for nothing.
    refusal: String,
    /// What it knows of its own motion.
    estimator: String,
    /// Position as it estimates it \[m, world\].
    estimate_m: Option<[f64; 3]>,
    /// What it last said of a trouble; empty for nothing.
    text: String,
}

impl VehicleStatus {
    fn new(vehicle: &VehicleV1) -> Self {
        let known = |number: f64| number.is_finite().then_some(number);
        Self {
            simulated: vehicle.simulated != 0,
            link: vehicle.link != 0,
            armed: vehicle.armed != 0,
            starting: vehicle.starting != 0,
            stopped: vehicle.stopped != 0,
            battery_v: known(vehicle.battery_v),
            link_quality: known(vehicle.link_quality),
            control: word(ControlHolder::from_code(vehicle.control)),
            refusal: word(VehicleRefusal::from_code(vehicle.refusal)),
            estimator: word(EstimatorState::from_code(vehicle.estimator)),
            estimate_m: Some(vehicle.estimate_position)
                .filter(|position| position.iter().all(|number| number.is_finite())),
            text: vehicle.text.as_str().to_owned(),
        }
    }
}

impl fmt::Display for VehicleStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.simulated { "simulated" } else { "real" };
        let link = if self.link { "answers" } else { "silent" };
        let motors = match (self.starting, self.armed) {
            (true, _) => "motors starting",
            (false, true) => "motors running",
            (false, false) => "motors off",
        };
        let stop = if self.stopped { ", stopped by an operator" } else { "" };
        write!(f, "{:<10} {kind}, {link}, {motors}{stop}", "vehicle")?;
        if let Some(volts) = self.battery_v {
            write!(f, ", battery {volts:.1} V")?;
        }
        if let Some(share) = self.link_quality {
            write!(f, ", link quality {:.0} %", share * 100.0)?;
        }
        if self.control == ControlHolder::Another.to_string() {
            write!(f, ", control: {}", self.control)?;
        }
        if self.estimator == EstimatorState::NotReady.to_string() {
            write!(f, ", its estimate is not ready")?;
        }
        if !self.refusal.is_empty() {
            write!(f, ", {}", self.refusal)?;
        }
        if self.text.is_empty() { Ok(()) } else { write!(f, ", it says: {}", self.text) }
    }
}

impl HealthReport {
    fn new(role: Role, (header, health): &(Header, HealthV1), now: Time) -> Self {
        let daemon = (role == Role::Daemon).then(|| DaemonHealth {
            mode: word(Mode::from_code(health.mode)),
            state: word(SafetyState::from_code(health.state)),
            cause: word(Cause::from_code(health.cause)),
            unlogged: health.unlogged,
        });
        Self {
            pid: u64::from(header.origin().process()),
            age_ms: now.since(health.time).max(Span::ZERO).seconds() * 1e3,
            config_hash: health.compared_config().map(|hash| format!("{hash:016x}")),
            daemon,
            vehicle_answers: (role == Role::Bridge).then_some(health.cause == Cause::None.code()),
            runs_late: health.runs_late != 0,
            late_turns: health.late_turns,
        }
    }

    /// The state of the process in one or two words.
    fn state(&self) -> &str {
        match (&self.daemon, self.vehicle_answers) {
            (Some(daemon), _) => &daemon.state,
            (None, Some(false)) => "vehicle silent",
            (None, _) => "well",
        }
    }
}

impl fmt::Display for ProcessHealth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(heard) = &self.heard else {
            let missing =
                if self.is_replaced { "not started" } else { "silent: not running, or hung" };
            return write!(f, "{:<10} {missing}", self.name);
        };
        let HealthReport { pid, age_ms, config_hash, daemon, .. } = heard;
        let (name, state) = (self.name, heard.state());
        let config = config_hash.as_deref().unwrap_or("of its own");
        write!(f, "{name:<10} {state:<8} {age_ms:>4.0} ms ago  config {config}  pid {pid}")?;
        if heard.runs_late {
            write!(f, "  runs late")?;
        }
        match daemon {
            Some(daemon) if daemon.unlogged > 0 => {
                write!(f, "  {} changes not logged", daemon.unlogged)
            }
            _ => Ok(()),
        }
    }
}

/// The name of a code; empty for a code that this version does not know.
#[must_use]
pub fn word(code: Option<impl ToString>) -> String {
    code.map_or_else(String::new, |code| code.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A monitor at 1 s that received a health message of each of `roles`, `age` old.
    fn monitor(roles: &[Role], age: Span) -> StatusMonitor {
        let received_at = Time::VIRTUAL_START;
        let mut monitor = StatusMonitor::new(Span::from_millis(100));
        for role in roles {
            let health = HealthV1 { time: received_at - age, ..HealthV1::default() };
            let reception = Reception { received_at, ..Reception::default() };
            monitor.health(&reception, *role, &health);
        }
        monitor
    }

    #[test]
    fn a_bridge_stands_in_for_a_plant_and_old_messages_do_not_count() {
        let roles = [Role::Mocap, Role::Daemon, Role::Bridge];
        let mut fresh = monitor(&roles, Span::from_millis(20));
        assert!(!fresh.is_complete());
        fresh.sample(&Reception::default(), Sample::Vehicle(&VehicleV1::default()));
        assert!(fresh.is_complete());
        let lines = fresh.status(Time::VIRTUAL_START).lines();
        assert_eq!(lines[0], "plant-sim  not started");
        assert!(lines[1].contains("20 ms ago"), "{lines:?}");
        let late = HealthV1 { time: Time::VIRTUAL_START, runs_late: 1, ..HealthV1::default() };
        fresh.health(&Reception::default(), Role::Mocap, &late);
        assert!(fresh.status(Time::VIRTUAL_START).lines()[1].ends_with("runs late"));
        let stale = monitor(&roles, Span::from_millis(101));
        assert_eq!(
            stale.status(Time::VIRTUAL_START).lines()[1],
            "mocap-emu  silent: not running, or hung"
        );
    }

    #[test]
    fn processes_with_different_configurations_are_reported() {
        let mut monitor = monitor(&[Role::Mocap, Role::Daemon], Span::ZERO);
        let reception = Reception { received_at: Time::VIRTUAL_START, ..Reception::default() };
        let runs_with = |config_hash| HealthV1 {
            time: Time::VIRTUAL_START,
            config_hash,
            ..HealthV1::default()
        };
        monitor.health(&reception, Role::Daemon, &runs_with(5));
        monitor.health(&reception, Role::Mocap, &runs_with(5));
        assert_eq!(monitor.status(Time::VIRTUAL_START).config_agrees(), Some(true));
        monitor.health(&reception, Role::Mocap, &runs_with(HealthV1::OWN_CONFIG));
        assert_eq!(monitor.status(Time::VIRTUAL_START).config_agrees(), Some(true));
        monitor.health(&reception, Role::Mocap, &runs_with(7));
        let status = monitor.status(Time::VIRTUAL_START);
        assert_eq!(status.config_agrees(), Some(false));
        assert!(status.lines().last().unwrap().contains("configurations differ"));
    }
}
