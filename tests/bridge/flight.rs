//! A bridge in front of an emulated vehicle, with test commands in place of a daemon.

use oqtal_bus::bus::Bus;
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, Stamps, VehicleV1};
use oqtal_bus::port::{Reader, Writer};
use oqtal_bus::time::Time;
use oqtal_bus::topic::{COMMAND, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_wire::asctec::ControlInput;

use super::vehicle::{Manner, PtyVehicle};
use crate::common::{Running, Testbed, WAIT_TIMEOUT, wait_for};

/// Control period at 60 Hz.
pub const PERIOD: std::time::Duration = std::time::Duration::from_nanos(16_666_667);

/// Configuration of a vehicle that acts by itself.
pub const TIME_OUT: [&str; 2] = ["--set", "bridge.vehicle-time-out-ms=1000"];

/// A bridge, the vehicle at its link, and the bus of the test.
pub struct BridgeFlight {
    pub testbed: Testbed,
    pub vehicle: PtyVehicle,
    pub bridge: Running,
    pub bus: Bus,
    pub reports: Reader<VehicleV1>,
}

impl BridgeFlight {
    pub fn new(name: &str, manner: Manner) -> Self {
        let testbed = Testbed::new(name);
        let vehicle = PtyVehicle::new(&testbed.path("port"), manner);
        let bus = testbed.bus();
        let reports = bus.observer(&VEHICLE).unwrap();
        let link = vehicle.link();
        let bridge = testbed.start(&[&["bridge", "run", "--link", &link], &TIME_OUT[..]].concat());
        wait_for("frames", || (vehicle.log().setpoints.len() > 3).then_some(()));
        Self { testbed, vehicle, bridge, bus, reports }
    }

    /// Waits for the next report of the vehicle.
    pub fn next(&mut self) -> (Header, VehicleV1) {
        wait_for("a report of the bridge", || self.reports.receive().unwrap())
    }

    /// Waits for a report for which `holds` is true.
    pub fn until(&mut self, what: &str, holds: impl Fn(&VehicleV1) -> bool) -> VehicleV1 {
        wait_for(what, || self.reports.receive().unwrap().map(|(_, v)| v).filter(&holds))
    }

    /// Waits for `count` more set-points on the wire.
    pub fn setpoints(&self, count: usize) -> Vec<ControlInput> {
        self.vehicle.clear_log();
        wait_for("setpoints", || {
            let setpoints = self.vehicle.log().setpoints;
            (setpoints.len() >= count).then_some(setpoints)
        })
    }
}

/// Source of commands in place of a daemon.
pub struct Commander {
    pub commands: Writer<CommandV1>,
}

impl Commander {
    pub fn new(bus: &Bus) -> Self {
        Self { commands: bus.writer(&COMMAND).unwrap() }
    }

    pub fn send(&mut self, command: CommandV1, published_at: Time) -> u64 {
        let stamps = Stamps { command_published_at: published_at, ..Stamps::default() };
        let sequence = self.commands.send(1, stamps, command).unwrap();
        self.commands.notify().unwrap();
        sequence
    }

    /// Sends `command` at the loop's rate until `done` returns a value.
    pub fn until<T>(
        &mut self,
        what: &str,
        command: CommandV1,
        mut done: impl FnMut() -> Option<T>,
    ) -> T {
        let began = std::time::Instant::now();
        loop {
            self.send(command, Time::now());
            std::thread::sleep(PERIOD);
            if let Some(found) = done() {
                return found;
            }
            assert!(began.elapsed() < WAIT_TIMEOUT, "timed out: {what}");
        }
    }
}

pub fn stick(roll: f64) -> CommandV1 {
    let actuation = Actuation::Sticks.code();
    CommandV1 { actuation, sticks: [roll, 0.0, 0.0], thrust: 0.25, ..CommandV1::default() }
}

pub fn is_zero(setpoint: &ControlInput) -> bool {
    *setpoint == ControlInput::ZERO_SETPOINT
}

/// Flight with running motors, whose vehicle follows commands.
pub fn airborne(name: &str) -> (BridgeFlight, Commander) {
    let mut flight = BridgeFlight::new(name, Manner::Answering);
    let mut commander = Commander::new(&flight.bus);
    flight.until("an answer", |vehicle| vehicle.link == 1);
    let vehicle = &flight.vehicle;
    commander.until("motors", stick(0.1), || vehicle.log().motors_run.then_some(()));
    commander.until("a command on the wire", stick(0.1), || {
        vehicle.log().setpoints.last().filter(|setpoint| setpoint.thrust > 0).map(drop)
    });
    (flight, commander)
}
