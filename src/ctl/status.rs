//! How the processes of an instance are, as they say themselves.

use std::fmt;
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::error::BusError;
use oqtal_bus::message::{Header, HealthV1, VehicleV1};
use oqtal_bus::port::Reader;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{Role, TELEMETRY, VEHICLE};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_runtime::health::HEALTH_PERIOD;
use serde::Serialize;

use super::word;

/// Who is listened for. Of plant and bridge one runs at most.
const PROCESSES: [Role; 4] = [Role::Plant, Role::Mocap, Role::Daemon, Role::Bridge];
/// A process that is not heard for so many periods is silent.
const SILENT_PERIODS: f64 = 3.0;

/// How one process is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProcessHealth {
    name: &'static str,
    /// What it said; `None` if it is silent: not started, ended, hung, or waiting for virtual time.
    heard: Option<Heard>,
    /// Another process was heard that does the same: this one is not meant to run.
    #[serde(skip)]
    is_replaced: bool,
}

/// What a process says of itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Heard {
    pid: u64,
    age_ms: f64,
    config_hash: String,
    /// Of the daemon only.
    #[serde(skip_serializing_if = "Option::is_none")]
    daemon: Option<Condition>,
    /// Of the bridge only: whether the vehicle answers.
    #[serde(skip_serializing_if = "Option::is_none")]
    vehicle_answers: Option<bool>,
}

/// What only the daemon has to say.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Condition {
    mode: String,
    state: String,
    cause: String,
    unlogged: u64,
}

/// What the vehicle says of itself; JSON has no number for what is not known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Vehicle {
    simulated: bool,
    link: bool,
    armed: bool,
    starting: bool,
    battery_v: Option<f64>,
    link_quality: Option<f64>,
}

/// What an instance says of itself while it is listened to.
#[derive(Clone, Debug, Default)]
pub struct Overview {
    /// The processes.
    pub processes: Vec<ProcessHealth>,
    /// The vehicle; `None` if nobody speaks for it.
    pub vehicle: Option<Vehicle>,
    /// Where the daemon believes the vehicle is \[m, world\]; `None` before it has seen it.
    pub position_m: Option<[f64; 3]>,
}

/// Listens until every process was heard, or must be silent.
///
/// # Errors
/// A process speaks another version.
pub fn listen(bus: &Bus) -> Result<Overview, BusError> {
    let mut vehicles = bus.reader(&VEHICLE)?;
    let mut telemetry = bus.reader(&TELEMETRY)?;
    let (mut vehicle, mut tick) = (None, None);
    let mut readers = Vec::new();
    for role in PROCESSES {
        readers.push((role, bus.reader(&role.health())?, None));
    }
    let give_up = Time::now() + patience();
    while (vehicle.is_none() || is_someone_missing(&readers)) && Time::now() < give_up {
        for (_, reader, heard) in &mut readers {
            hear(reader, heard)?;
        }
        vehicle = vehicles.latest()?.map(|(_, vehicle)| Vehicle::new(&vehicle)).or(vehicle);
        tick = telemetry.latest()?.map(|(_, tick)| tick).or(tick);
        std::thread::sleep(Duration::from_millis(5));
    }
    let now = Time::now();
    let processes = readers.iter().map(|(role, _, said)| ProcessHealth {
        name: role.name(),
        heard: said.as_ref().map(|said| Heard::new(*role, said, now)),
        is_replaced: is_replaced(&readers, *role),
    });
    let position_m = tick.filter(|tick| tick.pose_age_s.is_finite()).map(|tick| tick.position);
    Ok(Overview { processes: processes.collect(), vehicle, position_m })
}

impl Overview {
    /// Whether all who are heard run with one configuration; `None` if nobody was listened for.
    pub fn config_agrees(&self) -> Option<bool> {
        let mut hashes = self.processes.iter().filter_map(|p| Some(&p.heard.as_ref()?.config_hash));
        let first = hashes.next();
        (!self.processes.is_empty()).then(|| hashes.all(|hash| Some(hash) == first))
    }

    /// One line each.
    pub fn lines(&self) -> Vec<String> {
        let mut lines: Vec<String> = self.processes.iter().map(ToString::to_string).collect();
        lines.extend(self.vehicle.as_ref().map(ToString::to_string));
        lines.extend(
            self.position_m.map(|[x, y, z]| format!("{:<10} {x:.2} {y:.2} {z:.2} m", "position")),
        );
        if self.config_agrees() == Some(false) {
            lines.push("configurations differ: restart the processes with one --config".to_owned());
        }
        lines
    }
}

type Ear = (Role, Reader<HealthV1>, Option<(Header, HealthV1)>);

fn is_someone_missing(readers: &[Ear]) -> bool {
    readers.iter().any(|(role, _, heard)| heard.is_none() && !is_replaced(readers, *role))
}

/// Whether who does the same as `role` was heard.
fn is_replaced(readers: &[Ear], role: Role) -> bool {
    let heard = |other| readers.iter().any(|(role, _, said)| *role == other && said.is_some());
    replacement(role).is_some_and(heard)
}

/// Who is there in place of `role`: a vehicle is simulated or real.
fn replacement(role: Role) -> Option<Role> {
    match role {
        Role::Plant => Some(Role::Bridge),
        Role::Bridge => Some(Role::Plant),
        _ => None,
    }
}

/// Takes what was said, unless it is so old that the process has fallen silent since.
fn hear(
    reader: &mut Reader<HealthV1>,
    heard: &mut Option<(Header, HealthV1)>,
) -> Result<(), BusError> {
    let recent = |health: &HealthV1| Time::now().since(health.time) <= patience();
    if let Some(said) = reader.latest()?.filter(|(_, health)| recent(health)) {
        *heard = Some(said);
    }
    Ok(())
}

/// A process that is not heard for so long is silent.
fn patience() -> Span {
    HEALTH_PERIOD.scaled(SILENT_PERIODS)
}

impl Vehicle {
    fn new(said: &VehicleV1) -> Self {
        let known = |number: f64| number.is_finite().then_some(number);
        Self {
            simulated: said.simulated != 0,
            link: said.link != 0,
            armed: said.armed != 0,
            starting: said.starting != 0,
            battery_v: known(said.battery_v),
            link_quality: known(said.link_quality),
        }
    }
}

impl fmt::Display for Vehicle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.simulated { "simulated" } else { "real" };
        let link = if self.link { "answers" } else { "silent" };
        let motors = match (self.starting, self.armed) {
            (true, _) => "motors starting",
            (false, true) => "motors running",
            (false, false) => "motors off",
        };
        write!(f, "{:<10} {kind}, {link}, {motors}", "vehicle")?;
        if let Some(volts) = self.battery_v {
            write!(f, ", battery {volts:.1} V")?;
        }
        match self.link_quality {
            Some(share) => write!(f, ", link quality {:.0} %", share * 100.0),
            None => Ok(()),
        }
    }
}

impl Heard {
    fn new(role: Role, (header, health): &(Header, HealthV1), now: Time) -> Self {
        let daemon = (role == Role::Daemon).then(|| Condition {
            mode: word(Mode::from_code(health.mode)),
            state: word(SafetyState::from_code(health.state)),
            cause: word(Cause::from_code(health.cause)),
            unlogged: health.unlogged,
        });
        Self {
            pid: u64::from(header.origin().process()),
            age_ms: now.since(health.time).max(Span::ZERO).seconds() * 1e3,
            config_hash: format!("{:016x}", health.config_hash),
            daemon,
            vehicle_answers: (role == Role::Bridge).then_some(health.cause == Cause::None.code()),
        }
    }

    /// How it is, in a word.
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
            let missing = if self.is_replaced { "not started" } else { "silent" };
            return write!(f, "{:<10} {missing}", self.name);
        };
        let Heard { pid, age_ms, config_hash, daemon, .. } = heard;
        let (name, state) = (self.name, heard.state());
        write!(f, "{name:<10} {state:<8} {age_ms:>4.0} ms ago  config {config_hash}  pid {pid}")?;
        match daemon {
            Some(daemon) if daemon.unlogged > 0 => {
                write!(f, "  {} changes not logged", daemon.unlogged)
            }
            _ => Ok(()),
        }
    }
}
