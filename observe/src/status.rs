//! Status of an instance, as text and as JSON: its processes, its vehicle and the estimated position.

use std::fmt;
use std::path::PathBuf;

use oqtal_bus::code::{
    Cause, ControlHolder, EstimatorState, Mode, SafetyState, VehicleLink, VehicleRefusal,
};
use oqtal_bus::message::VehicleV1;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use serde::Serialize;

use crate::observed_process::ObservedProcess;

/// Status of an instance.
#[derive(Clone, Debug, Default)]
pub struct InstanceStatus {
    /// The processes.
    pub processes: Vec<ProcessHealth>,
    /// The vehicle; `None` if no process publishes its state.
    pub vehicle: Option<VehicleStatus>,
    /// Estimated position \[m, world\], and the time since its pose \[s\]; `None` before the first pose.
    pub position: Option<([f64; 3], f64)>,
    /// Whether an operator's stop is in force that the vehicle's process does not obey yet.
    pub awaits_stop: bool,
    /// File with the configuration of the daemon.
    pub daemon_config: PathBuf,
}

/// Age of a pose above which its position is shown as old \[s\].
pub const OLD_POSITION_S: f64 = 1.0;

impl InstanceStatus {
    /// Whether all observed processes run with one configuration; `None` if none was observed.
    pub fn config_agrees(&self) -> Option<bool> {
        let first = self.config_hashes().next();
        (!self.processes.is_empty()).then(|| self.config_hashes().all(|hash| Some(hash) == first))
    }

    /// Hash of the configuration with which the process of `role` runs; `None` if it was not observed, or has a separate configuration.
    pub fn config_of(&self, role: Role) -> Option<&str> {
        let process = self.processes.iter().find(|process| process.name == role.name())?;
        process.report.as_ref()?.config_hash.as_deref()
    }

    fn config_hashes(&self) -> impl Iterator<Item = &str> {
        self.processes.iter().filter_map(|process| process.report.as_ref()?.config_hash.as_deref())
    }

    /// The present position \[m, world\]; `None` if its pose is too old.
    pub fn position_m(&self) -> Option<[f64; 3]> {
        self.position.filter(|(_, age_s)| *age_s <= OLD_POSITION_S).map(|(position, _)| position)
    }

    /// Whether a daemon publishes its health.
    pub fn has_daemon(&self) -> bool {
        self.has(&[Role::Daemon])
    }

    /// Whether a process of one of these roles publishes its health.
    fn has(&self, roles: &[Role]) -> bool {
        let is_meant =
            |process: &ProcessHealth| roles.iter().any(|role| role.name() == process.name);
        self.processes.iter().any(|process| process.report.is_some() && is_meant(process))
    }

    /// Status as text: one line per process, the vehicle and the position.
    pub fn lines(&self) -> Vec<String> {
        let mut lines: Vec<String> = self.processes.iter().map(ToString::to_string).collect();
        let unknown = "unknown: its state was not published during this observation";
        let vehicle = self.vehicle.as_ref().map(ToString::to_string);
        let vehicle =
            vehicle.or_else(|| self.has(&[Role::Plant, Role::Bridge]).then(|| unknown.to_owned()));
        lines.extend(vehicle.map(|vehicle| format!("{:<10} {vehicle}", "vehicle")));
        if let Some((position, age_s)) = self.position {
            let [x, y, z] = position.map(centimetres);
            let is_old = age_s > OLD_POSITION_S;
            let age = if is_old { format!(", {age_s:.0} s ago") } else { String::new() };
            lines.push(format!("{:<10} {x:.2} {y:.2} {z:.2} m{age}", "position"));
        }
        if self.awaits_stop {
            let is_withheld = self.vehicle.as_ref().is_some_and(VehicleStatus::control_is_taken);
            let reason = match is_withheld {
                true => {
                    "not sent while another has control: only the remote control stops the motors"
                }
                false => "not yet obeyed by the vehicle's process",
            };
            lines.push(format!("{:<10} raised by an operator, {reason}", "stop"));
        }
        if self.config_agrees() == Some(false) {
            // The link may have been given by a flag, which the file of the daemon lacks.
            let link = match self.has(&[Role::Bridge, Role::Receiver]) {
                true => ", bridge and receiver with their --link or --set as before",
                false => "",
            };
            lines.push(format!(
                "configurations differ: restart the processes with one --config{link}; that of the daemon, which may be the wrong one, is {}",
                self.daemon_config.display()
            ));
        }
        lines
    }
}

/// `value` rounded to the centimetre, without a negative zero \[m\].
fn centimetres(value: f64) -> f64 {
    (value * 100.0).round() / 100.0 + 0.0
}

/// Health of one process.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProcessHealth {
    /// Name of its role.
    pub name: &'static str,
    /// Newest health message; `None` if the process is not started or silent: killed, hung, or waiting for virtual time.
    #[serde(rename = "heard")]
    report: Option<HealthReport>,
    /// Name and id of a process that is silent although it runs; `None` if the process is not silent, or not running.
    #[serde(skip_serializing_if = "Option::is_none")]
    silent: Option<String>,
}

/// Content of a health message.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct HealthReport {
    pid: u32,
    age_ms: f64,
    /// Hash of the configuration; `None` for an emulated vehicle behind a radio, which has a separate configuration.
    config_hash: Option<String>,
    /// Set for the daemon only.
    #[serde(skip_serializing_if = "Option::is_none")]
    daemon: Option<DaemonHealth>,
    /// Set for the bridge only: whether the vehicle answers.
    #[serde(skip_serializing_if = "Option::is_none")]
    vehicle_answers: Option<bool>,
    /// Set for the receiver only: whether the camera system sends frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    cameras_answer: Option<bool>,
    /// Trouble of a receiver with its cameras or its body; absent if it receives the body, and for other processes.
    #[serde(skip_serializing_if = "Option::is_none")]
    trouble: Option<&'static str>,
    /// Whether three turns in a row were late, the last one less than a second ago.
    runs_late: bool,
    /// Turns that ended more than a period after they were due \[-\].
    late_turns: u64,
}

/// Fields of a health message that only the daemon sets.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct DaemonHealth {
    mode: String,
    state: String,
    cause: String,
    unlogged: u64,
}

/// State of the vehicle, as published by plant or bridge; `None` for unknown numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VehicleStatus {
    simulated: bool,
    link: bool,
    /// Whether the motors run; `None` if a real vehicle does not report it, or is silent.
    armed: Option<bool>,
    starting: bool,
    #[serde(skip)]
    is_being_stopped: bool,
    stopped: bool,
    battery_v: Option<f64>,
    link_quality: Option<f64>,
    /// Time without set-points after which the vehicle acts by itself \[s\].
    time_out_s: Option<f64>,
    /// Holder of control over the vehicle; `None` if it is not reported while the motors run.
    control: Option<String>,
    /// Reason why the last request was refused; empty for none.
    refusal: String,
    /// State of the vehicle's own estimator.
    estimator: String,
    /// Position by the vehicle's own estimator \[m, world\].
    estimate_m: Option<[f64; 3]>,
    /// Last warning of the vehicle; empty for none.
    text: String,
}

impl VehicleStatus {
    /// Whether the vehicle is simulated, and commanded over the bus.
    pub fn is_simulated(&self) -> bool {
        self.simulated
    }

    /// Whether the motors are known to be off.
    pub fn motors_are_off(&self) -> bool {
        self.armed == Some(false) && !self.starting
    }

    /// Whether a pilot or the vehicle itself has control.
    fn control_is_taken(&self) -> bool {
        self.control == Some(ControlHolder::Another.to_string())
    }

    /// State of the vehicle in its newest message.
    pub fn new(vehicle: &VehicleV1) -> Self {
        let known = |number: f64| number.is_finite().then_some(number);
        let control = ControlHolder::from_code(vehicle.control);
        let armed = reported_motors(vehicle);
        let is_told = |it: &ControlHolder| *it != ControlHolder::Nobody || armed == Some(false);
        Self {
            simulated: vehicle.simulated != 0,
            link: vehicle.answers(),
            armed,
            starting: vehicle.is_starting(),
            is_being_stopped: vehicle.is_being_stopped(),
            stopped: vehicle.stopped != 0,
            battery_v: known(vehicle.battery_v),
            link_quality: known(vehicle.link_quality),
            time_out_s: known((vehicle.time_out_s * 1e3).round() * 1e-3).filter(|s| *s > 0.0),
            control: control.filter(is_told).map(|holder| holder.to_string()),
            refusal: word(VehicleRefusal::from_code(vehicle.refusal)),
            estimator: word(EstimatorState::from_code(vehicle.estimator)),
            estimate_m: Some(vehicle.estimate_position)
                .filter(|position| position.iter().all(|number| number.is_finite())),
            text: vehicle.text.as_str().to_owned(),
        }
    }
}

/// Whether the motors of `vehicle` run; `None` if it does not report it, or is silent.
pub(crate) fn reported_motors(vehicle: &VehicleV1) -> Option<bool> {
    let reports = vehicle.link == VehicleLink::Answers.code() || vehicle.simulated != 0;
    (reports || vehicle.armed != 0).then_some(vehicle.armed != 0)
}

impl fmt::Display for VehicleStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.simulated { "simulated" } else { "real" };
        let link = if self.link { "answers" } else { "silent" };
        let motors = match (self.starting, self.armed) {
            _ if self.is_being_stopped => "motors being stopped",
            (true, _) => "motors starting",
            (false, Some(true)) => "motors running",
            (false, Some(false)) => "motors off",
            (false, None) => "motors unknown",
        };
        let stop = if self.stopped { ", stopped by an operator" } else { "" };
        write!(f, "{kind}, {link}, {motors}{stop}")?;
        if let Some(volts) = self.battery_v {
            write!(f, ", battery {volts:.1} V")?;
        }
        if let Some(share) = self.link_quality {
            write!(f, ", link quality {:.0} %", share * 100.0)?;
        }
        match self.time_out_s {
            Some(seconds) => write!(f, ", acts by itself {seconds} s after the last set-point")?,
            None if self.simulated => {}
            None => write!(f, ", its time-out without set-points is unknown")?,
        }
        if self.control_is_taken() {
            write!(f, ", control: {}", ControlHolder::Another)?;
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

impl ProcessHealth {
    /// Health of the process `role`, observed as `process`, at the instant `now`.
    pub fn new(role: Role, process: Option<&ObservedProcess>, now: Time) -> Self {
        let report = process.map(|process| HealthReport::new(process, now));
        Self { name: role.name(), report, silent: None }
    }

    /// Whether it publishes its health, or is known to be silent.
    pub fn is_seen(&self) -> bool {
        self.report.is_some() || self.silent.is_some()
    }

    /// Records the name and id of the process that has this place in the instance; `None` if there is none.
    pub fn note_holder(&mut self, holder: Option<String>) {
        self.silent = holder.filter(|_| self.report.is_none());
    }
}

impl HealthReport {
    fn new(process: &ObservedProcess, now: Time) -> Self {
        let ObservedProcess { role, health, .. } = *process;
        let is_well = health.cause == Cause::None.code();
        let daemon = (role == Role::Daemon).then(|| DaemonHealth {
            mode: word(Mode::from_code(health.mode)),
            state: word(SafetyState::from_code(health.state)),
            cause: word(Cause::from_code(health.cause)),
            unlogged: health.unlogged,
        });
        Self {
            pid: process.pid(),
            age_ms: now.since(health.time).max(Span::ZERO).seconds() * 1e3,
            config_hash: health.compared_config().map(|hash| format!("{hash:016x}")),
            daemon,
            vehicle_answers: (role == Role::Bridge).then_some(is_well),
            cameras_answer: (role == Role::Receiver)
                .then_some(health.cause != Cause::NoPose.code()),
            trouble: trouble_of_receiver(role, health.cause),
            runs_late: health.runs_late != 0,
            late_turns: health.late_turns,
        }
    }

    /// The state of the process in one or two words.
    fn state(&self) -> &str {
        match (&self.daemon, self.vehicle_answers) {
            (Some(daemon), _) => &daemon.state,
            (None, Some(false)) => "vehicle silent",
            (None, _) => self.trouble.unwrap_or("well"),
        }
    }
}

impl fmt::Display for ProcessHealth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(report) = &self.report else {
            return match &self.silent {
                Some(holder) => write!(
                    f,
                    "{:<10} silent: {holder} runs, but hangs, or virtual time stands still",
                    self.name
                ),
                None => write!(f, "{:<10} not started, or ended", self.name),
            };
        };
        let HealthReport { pid, age_ms, config_hash, daemon, .. } = report;
        let (name, state) = (self.name, report.state());
        let config = config_hash.as_deref().unwrap_or("of its own");
        write!(f, "{name:<10} {state:<8} {age_ms:>4.0} ms ago  config {config}  pid {pid}")?;
        if report.runs_late {
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

/// Trouble of a receiver whose health has this `cause`; `None` if it receives its body, and for another `role`.
pub fn trouble_of_receiver(role: Role, cause: u8) -> Option<&'static str> {
    match Cause::from_code(cause).filter(|_| role == Role::Receiver)? {
        Cause::NoPose => Some("cameras silent"),
        Cause::NoBody => Some("the server has no such body"),
        Cause::NoStamps => Some("frames have no usable stamps: receiver.stamps = \"arrival\""),
        Cause::Untracked => Some("body not seen"),
        _ => None,
    }
}

/// Name of a code; empty for a code unknown to this version.
pub fn word(code: Option<impl ToString>) -> String {
    code.map_or_else(String::new, |code| code.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn f72_the_time_out_of_a_real_vehicle_is_told() {
        let told = |simulated, time_out_s| {
            let vehicle = VehicleV1 { simulated, time_out_s, ..VehicleV1::default() };
            VehicleStatus::new(&vehicle).to_string()
        };
        assert!(told(0, 0.5).contains("acts by itself 0.5 s after the last set-point"));
        assert!(told(0, 0.0).contains("time-out without set-points is unknown"));
        assert!(!told(1, 0.0).contains("set-point"));
    }

    #[test]
    fn nobody_has_control_only_while_the_motors_are_off() {
        let control = |armed, holder: ControlHolder| {
            let known = VehicleV1 { link: VehicleLink::Answers.code(), ..VehicleV1::default() };
            let vehicle = VehicleV1 { armed, control: holder.code(), ..known };
            VehicleStatus::new(&vehicle).control
        };
        assert_eq!(control(0, ControlHolder::Nobody).as_deref(), Some("nobody"));
        assert_eq!(control(1, ControlHolder::Nobody), None);
        assert_eq!(control(1, ControlHolder::Bridge).as_deref(), Some("the bridge"));
    }
}
