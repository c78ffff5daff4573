//! A flying firmware: the processes that fly it, the relay between them, and an observer of both.

use std::path::Path;
use std::time::{Duration, Instant};

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Cause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::control::ControlClient;
use oqtal_bus::message::{ControlRequestV1, Stamps, TelemetryV1, TruthV1, VehicleV1};
use oqtal_bus::port::Reader;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{TELEMETRY, TRUTH, VEHICLE};
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::process::Signal;

use super::program::{Firmware, FirmwareProcess};
use super::relay::Relay;
use crate::common::{Running, Testbed, wait_for};

/// Processes, in start order.
pub const PROCESSES: [&str; 4] = ["plant-sim", "mocap-emu", "daemon", "bridge"];
pub const CAMERAS: usize = 1;
pub const DAEMON: usize = 2;
pub const BRIDGE: usize = 3;
const POLL: Duration = Duration::from_millis(2);

/// Observations since the fault.
#[derive(Default)]
pub struct Seen {
    pub truths: Vec<TruthV1>,
    pub reports: Vec<(Time, VehicleV1)>,
    pub ticks: Vec<TelemetryV1>,
    /// Stamps of every command handed to the port.
    pub stamps: Vec<Stamps>,
}

pub struct FirmwareFlight {
    pub relay: Relay,
    pub firmware: &'static Firmware,
    pub process: FirmwareProcess,
    running: [Option<Running>; 4],
    truths: Reader<TruthV1>,
    reports: Reader<VehicleV1>,
    ticks: Reader<TelemetryV1>,
    client: ControlClient,
    _bus: Bus,
    testbed: Testbed,
}

impl FirmwareFlight {
    /// Starts `firmware` and all processes, with these additional lines of configuration.
    pub fn start(firmware: &'static Firmware, path: &Path, lines: &[&str]) -> Self {
        let testbed = Testbed::new("firmware");
        let directory = testbed.path("firmware");
        let mut process = firmware.prepare(path, &directory);
        let relay = Relay::start(&firmware.ports, process.network());
        process.run();
        let text = format!(
            "vehicle.preset = \"{}\"\nbridge.link = \"{}\"\nplant.truth = \"{}\"\n\
             safety.allow-emulated-poses = true\n\
             trajectory.kind = \"hover\"\ntrajectory.duration-s = 600.0\n{}\n",
            firmware.preset,
            firmware.relayed_link,
            firmware.truth,
            lines.join("\n")
        );
        let config = testbed.write("flight.toml", &text).display().to_string();
        let running = PROCESSES.map(|name| {
            let command = testbed.oqtal(&[name, "run", "--config", &config]);
            let log = std::fs::File::create(testbed.path(&format!("{name}.log"))).unwrap();
            Some(Running::start_with_stderr(&mut process.beside(&command), log.into()))
        });
        let bus = testbed.bus();
        Self {
            relay,
            firmware,
            process,
            running,
            truths: bus.observer(&TRUTH).unwrap(),
            reports: bus.observer(&VEHICLE).unwrap(),
            ticks: bus.observer(&TELEMETRY).unwrap(),
            client: bus.control_client().unwrap(),
            _bus: bus,
            testbed,
        }
    }

    /// Requests a flight until it is accepted, and waits until the vehicle hovers.
    pub fn take_off(&mut self) {
        wait_for("a vehicle", || self.newest_report().filter(|vehicle| vehicle.link == 1));
        std::thread::sleep(self.firmware.boot);
        wait_for("a flight that is granted", || {
            let granted = self.ask(OperatorCommand::Arm);
            std::thread::sleep(Duration::from_millis(if granted { 0 } else { 500 }));
            granted.then_some(())
        });
        wait_for("a hover", || {
            let truth = self.truths.latest().unwrap()?.1;
            self.assert_flight();
            (truth.position[2] > 0.9 && truth.velocity[2].abs() < 0.1).then_some(())
        });
        self.watch(Duration::from_secs(1));
    }

    /// Fails with the logs if the flight has ended.
    fn assert_flight(&mut self) {
        let Some((_, tick)) = self.ticks.latest().unwrap() else { return };
        let is_stopped = tick.state == SafetyState::Stop.code();
        assert!(!is_stopped, "{:?}", Cause::from_code(tick.cause));
    }

    pub fn ask(&self, command: OperatorCommand) -> bool {
        let request = ControlRequestV1::of(command);
        let answer = self.client.ask(request, Span::from_millis(1000)).unwrap();
        answer.is_some_and(|answer| answer.answer != Answer::Refused.code())
    }

    pub fn newest_report(&mut self) -> Option<VehicleV1> {
        self.reports.latest().unwrap().map(|(_, vehicle)| vehicle)
    }

    pub fn signal(&self, process: usize, signal: Signal) {
        self.running[process].as_ref().unwrap().signal(signal);
    }

    /// Collects observations for `duration`.
    pub fn watch(&mut self, duration: Duration) -> Seen {
        let (began, mut seen) = (Instant::now(), Seen::default());
        while began.elapsed() < duration {
            let now = Time::now();
            while let Some((_, truth)) = self.truths.receive().unwrap() {
                seen.truths.push(truth);
            }
            while let Some((header, report)) = self.reports.receive().unwrap() {
                seen.reports.push((now, report));
                if header.stamps.applied_at.is_set() {
                    seen.stamps.push(header.stamps);
                }
            }
            while let Some((_, tick)) = self.ticks.receive().unwrap() {
                seen.ticks.push(tick);
            }
            std::thread::sleep(POLL);
        }
        seen
    }

    /// Last lines of every process.
    pub fn logs(&self) -> String {
        let tail = |name: &&str| {
            let log = std::fs::read_to_string(self.testbed.path(&format!("{name}.log")));
            let log = log.unwrap_or_default();
            let lines: Vec<&str> = log.lines().collect();
            format!("{name}:\n{}\n", lines[lines.len().saturating_sub(12)..].join("\n"))
        };
        PROCESSES.iter().map(tail).collect()
    }
}

impl Drop for FirmwareFlight {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("{}: {}", self.firmware.name, self.logs());
        }
    }
}

impl Seen {
    /// First instant at which the daemon was in a state of at least this severity, and the cause.
    pub fn state(&self, at_least: SafetyState) -> Option<(Time, Cause)> {
        let tick = self.ticks.iter().find(|tick| tick.state >= at_least.code())?;
        Some((tick.time, Cause::from_code(tick.cause).unwrap_or(Cause::None)))
    }

    /// First instant at which the daemon was in this mode.
    pub fn mode(&self, mode: Mode) -> Option<Time> {
        self.ticks.iter().find(|tick| tick.mode == mode.code()).map(|tick| tick.time)
    }

    /// First instant of a fall: downward acceleration of half of gravity over 50 ms.
    pub fn fall(&self) -> Option<Time> {
        let window = Span::from_millis(50);
        let falls = |truth: &&TruthV1| {
            let before = self.truths.iter().find(|b| truth.time.since(b.time) <= window);
            let Some(before) = before else { return false };
            let seconds = truth.time.since(before.time).seconds();
            let lost = before.velocity[2] - truth.velocity[2];
            seconds > 0.04 && lost > 0.5 * 9.81 * seconds
        };
        self.truths.iter().find(falls).map(|truth| truth.time)
    }

    /// First instant at which the vehicle was on the floor.
    pub fn floor(&self) -> Option<Time> {
        self.truths.iter().find(|truth| truth.position[2] < 0.06).map(|truth| truth.time)
    }

    pub fn last_height(&self) -> f64 {
        self.truths.last().map_or(f64::NAN, |truth| truth.position[2])
    }

    /// First instant of a report for which `holds` is true.
    pub fn report(&self, holds: impl Fn(&VehicleV1) -> bool) -> Option<Time> {
        self.reports.iter().find(|(_, vehicle)| holds(vehicle)).map(|(at, _)| *at)
    }
}
