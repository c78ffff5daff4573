//! Table of faults in the hover of each firmware: action, observation time, expected observation.

use std::path::Path;
use std::time::Duration;

use oqtal_bus::code::{Cause, ControlHolder, Mode, OperatorCommand, SafetyState, VehicleRefusal};
use oqtal_bus::time::{Span, Time};
use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::{
    CommandKind, MavlinkAddress, MavlinkContent, MavlinkEncoder, ParameterName, ParameterValue,
    VehicleCommandLong,
};
use rustix::process::Signal;

use super::flight::{BRIDGE, CAMERAS, DAEMON, FirmwareFlight, Seen};
use super::program::Firmware;
use crate::common::wait_for;

/// Maximum number of set-points with thrust that may reach a vehicle after its source of commands has ended \[-\].
const MOST_OLD: usize = 4;
/// Ground station of a pilot.
const STATION: MavlinkAddress = MavlinkAddress { system: 250, component: 190 };

/// Action on a flight.
type Action = fn(&mut FirmwareFlight);

/// A fault.
pub struct Fault {
    pub name: &'static str,
    pub begin: Action,
    /// End of the fault: time and action.
    pub end: Option<(Duration, Action)>,
    pub watch: Duration,
    pub shows: fn(&Observation),
}

/// Observation of a fault that began at `since`.
pub struct Observation {
    pub since: Time,
    pub seen: Seen,
    /// Number of set-points with thrust that reached the vehicle since then \[-\], and the time of the last one.
    pub flying: usize,
    pub last_flying: Option<Time>,
}

/// Faults of every firmware.
pub const FAULTS: [Fault; 6] = [
    Fault {
        name: "daemon killed",
        begin: |flight| flight.signal(DAEMON, Signal::KILL),
        end: None,
        watch: Duration::from_secs(3),
        shows: |observed| {
            let flying = observed.flying;
            assert!(flying <= MOST_OLD, "{flying} set-points with thrust after the last command");
            assert!(observed.seen.fall().is_some() || observed.seen.floor().is_some());
        },
    },
    Fault {
        name: "bridge killed",
        begin: |flight| flight.signal(BRIDGE, Signal::KILL),
        end: None,
        watch: Duration::from_secs(6),
        shows: |observed| {
            assert!(observed.flying <= 1, "{} set-points without a sender", observed.flying);
            observed.stops(&[Cause::NoVehicle]);
        },
    },
    Fault {
        name: "radio silent",
        begin: |flight| flight.relay.state().is_silent = true,
        end: None,
        watch: Duration::from_secs(6),
        shows: |observed| {
            assert!(observed.flying <= 1, "{} set-points in silence", observed.flying);
            // A vehicle that falls by its own failsafe before it counts as silent is stopped for its motion.
            let silent_at = observed.since + Span::from_millis(1000);
            match observed.seen.fall().is_some_and(|at| at < silent_at) {
                true => observed.stops(&[Cause::Fence, Cause::Speed, Cause::Relabel]),
                false => observed.stops(&[Cause::NoVehicle]),
            }
        },
    },
    Fault {
        name: "autopilot rebooted",
        begin: |flight| flight.process.run(),
        end: None,
        watch: Duration::from_secs(5),
        shows: |observed| assert!(observed.seen.state(SafetyState::Stop).is_some()),
    },
    Fault {
        name: "poses stop for 1 s",
        begin: |flight| flight.signal(CAMERAS, Signal::STOP),
        end: Some((Duration::from_secs(1), |flight| flight.signal(CAMERAS, Signal::CONT))),
        watch: Duration::from_secs(3),
        shows: |observed| observed.stops(&[Cause::NoPose]),
    },
    Fault {
        name: "poses stop for 10 s",
        begin: |flight| flight.signal(CAMERAS, Signal::STOP),
        end: Some((Duration::from_secs(10), |flight| flight.signal(CAMERAS, Signal::CONT))),
        watch: Duration::from_secs(2),
        shows: |observed| observed.stops(&[Cause::NoPose]),
    },
];

/// A pilot changes the mode; autopilots of MAVLink only.
pub const TAKEN_OVER: Fault = Fault {
    name: "pilot takes over",
    begin: |flight| {
        // Modes without sticks: landing of ArduCopter, hold of PX4.
        let (mode, sub_mode) = match kind(flight.firmware) {
            Some(AutopilotKind::ArduPilot) => (9, 0),
            _ => (4, 3),
        };
        send(flight, |target| command(target, CommandKind::SetMode { mode, sub_mode }));
    },
    end: None,
    watch: Duration::from_secs(4),
    shows: |observed| {
        let another = ControlHolder::Another.code();
        let taken = observed.seen.report(|vehicle| vehicle.control == another).expect("taken over");
        let later = |at: Time| at > taken + Span::from_millis(100);
        assert!(!observed.last_flying.is_some_and(later), "set-points after the pilot took over");
        observed.stops(&[Cause::ControlTaken]);
    },
};

/// The battery becomes empty: the daemon lands.
pub const BATTERY: Fault = Fault {
    name: "battery empty",
    begin: |flight| match kind(flight.firmware) {
        Some(AutopilotKind::ArduPilot) => set(flight, "SIM_BATT_VOLTAGE", 11.3),
        Some(AutopilotKind::Px4) => {
            set(flight, "SIM_BAT_MIN_PCT", 0.0);
            set(flight, "SIM_BAT_DRAIN", 1.0);
        }
        None => {}
    },
    end: None,
    watch: Duration::from_secs(12),
    shows: |observed| {
        let landing = observed.seen.mode(Mode::Landing).expect("a landing");
        // An autopilot with its own failsafe takes over and lands.
        let another = ControlHolder::Another.code();
        let taken = observed.seen.report(|vehicle| vehicle.control == another);
        let end = taken.or(observed.seen.floor()).expect("a landing that ends");
        assert!(end > landing);
    },
};

impl Observation {
    /// Checks that the daemon stopped for one of these causes.
    fn stops(&self, causes: &[Cause]) {
        let (_, cause) = self.seen.state(SafetyState::Stop).expect("a Stop");
        assert!(causes.contains(&cause), "{cause:?}");
    }

    /// Row of the table.
    pub fn row(&self, firmware: &Firmware, fault: &str) -> String {
        let after = |at: Option<Time>| {
            at.map_or("–".to_owned(), |at| format!("{:.2}", at.since(self.since).seconds()))
        };
        let seen = &self.seen;
        let stop = seen.state(SafetyState::Stop);
        let cause = stop.map_or(String::new(), |(_, cause)| cause.to_string());
        format!(
            "| {} | {fault} | {} | {} | {} {cause} | {} | {} | {} | {:.2} |",
            firmware.name,
            self.flying,
            after(self.last_flying),
            after(stop.map(|(at, _)| at)),
            after(seen.report(|vehicle| vehicle.armed == 0)),
            after(seen.fall()),
            after(seen.floor()),
            seen.last_height(),
        )
    }
}

/// Head of the table.
pub const HEAD: &str = "| firmware | fault | set-points with thrust after it | last of them [s] | Stop [s] | reported off [s] | falls [s] | floor [s] | height in the end [m] |\n|---|---|---|---|---|---|---|---|---|";

/// Flies `firmware` with the fault, prints the row of the table, and checks the observation.
pub fn observe(firmware: &'static Firmware, path: &Path, fault: &Fault) {
    let lines = if fault.name == BATTERY.name { firmware.battery } else { &[] };
    let mut flight = FirmwareFlight::start(firmware, path, lines);
    flight.take_off();
    flight.relay.state().setpoints.clear();
    let since = Time::now();
    (fault.begin)(&mut flight);
    let mut seen = Seen::default();
    if let Some((after, end)) = fault.end {
        seen = flight.watch(after);
        end(&mut flight);
    }
    let rest = flight.watch(fault.watch);
    seen.truths.extend(rest.truths);
    seen.reports.extend(rest.reports);
    seen.ticks.extend(rest.ticks);
    let passed = flight.relay.state().setpoints.clone();
    // Set-points sent before the fault may reach the relay after it.
    let flying: Vec<Time> =
        passed.iter().filter(|s| s.flies && s.sent_at > since).map(|s| s.passed_at).collect();
    let (count, last_flying) = (flying.len(), flying.last().copied());
    let observed = Observation { since, seen, flying: count, last_flying };
    let row = observed.row(firmware, fault.name);
    eprintln!("{row}");
    (fault.shows)(&observed);
}

/// Checks that a vehicle that is not ready refuses to arm, with a reason.
pub fn refuses_to_arm(firmware: &'static Firmware, path: &Path) {
    let mut flight = FirmwareFlight::start(firmware, path, &[]);
    wait_for("a vehicle", || flight.newest_report().filter(|v| v.link == 1));
    flight.ask(OperatorCommand::Fly);
    let refused = wait_for("a refusal", || {
        flight.ask(OperatorCommand::Fly);
        let report = flight.newest_report()?;
        let none = VehicleRefusal::None.code();
        (report.refusal != none && !report.text.is_empty()).then_some(report)
    });
    let refusal = VehicleRefusal::from_code(refused.refusal).unwrap();
    eprintln!("| {} | arming refused | {refusal}: {} |", firmware.name, refused.text.as_str());
    assert_eq!(refused.armed, 0);
}

fn kind(firmware: &Firmware) -> Option<AutopilotKind> {
    match firmware.preset {
        "ardupilot-quad" => Some(AutopilotKind::ArduPilot),
        "px4-quad" => Some(AutopilotKind::Px4),
        _ => None,
    }
}

fn command(target: MavlinkAddress, kind: CommandKind) -> MavlinkContent {
    MavlinkContent::Command(VehicleCommandLong { target, kind, confirmation: 0 })
}

/// Sends a message of another ground station to the autopilot.
fn send(flight: &FirmwareFlight, content: impl Fn(MavlinkAddress) -> MavlinkContent) {
    let target = MavlinkAddress { system: 1, component: MavlinkAddress::AUTOPILOT };
    let wire = MavlinkEncoder::new(STATION).encode(&content(target)).unwrap();
    flight.relay.state().injected.push(wire.as_bytes().to_vec());
}

fn set(flight: &FirmwareFlight, name: &str, value: f32) {
    let name = ParameterName::new(name).unwrap();
    let value = ParameterValue { raw: value, is_real: true, code: ParameterValue::REAL32 };
    send(flight, |target| MavlinkContent::ParameterSet { target, name, value });
}
