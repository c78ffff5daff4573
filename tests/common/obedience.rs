//! Execution of operator commands, counted in commands at the vehicle and ticks of the daemon: no bound depends on the speed of
//! the machine.

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{InputKind, Mode, OperatorCommand};
use oqtal_bus::message::{CommandV1, InputV1, TelemetryV1, VehicleV1};
use oqtal_bus::port::Reader;
use oqtal_bus::time::Time;
use oqtal_bus::topic::{COMMAND, INPUT, TELEMETRY, VEHICLE};
use oqtal_bus::transport::{Subscribe, Transport};

use super::wait_for;

/// Number of commands, and of ticks, within which an operator command must be executed \[-\].
pub const PERIODS: u64 = 3;

/// Reports of the vehicle since an operator command.
pub struct MotorWatch {
    commands: Reader<CommandV1>,
    vehicles: Reader<VehicleV1>,
}

impl MotorWatch {
    pub fn open(bus: &Bus) -> Self {
        let commands = bus.observer(&COMMAND).unwrap();
        Self { commands, vehicles: bus.observer(&VEHICLE).unwrap() }
    }

    /// Executes `order` and waits until the vehicle reports that its motors are off. No command published more than [`PERIODS`]
    /// after the order may keep them running.
    pub fn obeys(&mut self, order: impl FnOnce()) {
        let newest = wait_for("a command", || self.commands.latest().unwrap());
        while self.vehicles.receive().unwrap().is_some() {}
        order();
        // Read after the order was given, which is at the latest at this command.
        let newest = self.commands.latest().unwrap().unwrap_or(newest).0.sequence;
        wait_for("motors off", || {
            while let Some((_, vehicle)) = self.vehicles.receive().unwrap() {
                let late = vehicle.command_sequence.saturating_sub(newest);
                assert!(
                    vehicle.armed == 0 || late <= PERIODS,
                    "{late} commands later: {vehicle:?}"
                );
                if vehicle.armed == 0 {
                    return Some(());
                }
            }
            None
        });
    }
}

/// Ticks of the daemon around a landing request.
pub struct LandingWatch {
    inputs: Reader<InputV1>,
    telemetry: Reader<TelemetryV1>,
}

impl LandingWatch {
    pub fn open(bus: &Bus) -> Self {
        Self { inputs: bus.observer(&INPUT).unwrap(), telemetry: bus.observer(&TELEMETRY).unwrap() }
    }

    /// Waits for the requested landing: at most [`PERIODS`] ticks after the daemon received the request.
    pub fn lands(&mut self) {
        let taken_at: Time = wait_for("the request", || {
            let (_, input) = self.inputs.receive().unwrap()?;
            let is_landing = input.kind == InputKind::Request.code()
                && input.request == OperatorCommand::Land.code();
            is_landing.then_some(input.time)
        });
        let mut ticks = 0;
        wait_for("the landing", || {
            let (_, tick) = self.telemetry.receive().unwrap()?;
            ticks += u64::from(tick.time > taken_at);
            assert!(ticks <= PERIODS, "{ticks} ticks later: {tick:?}");
            (tick.time > taken_at && tick.mode == Mode::Landing.code()).then_some(())
        });
    }
}
