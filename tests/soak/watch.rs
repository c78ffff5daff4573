//! Observer of the soak test: counts, and violations of the invariants.

use nalgebra::Vector3;
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Actuation, Cause, Mode, SafetyState};
use oqtal_bus::message::{CommandV1, TelemetryV1, TruthV1};
use oqtal_bus::port::Reader;
use oqtal_bus::topic::{COMMAND, TELEMETRY, TRUTH};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_config::Config;
use oqtal_daemon::Fence;

use super::laboratory::Laboratory;

/// Number of successive ticks with new poses after which the daemon must no longer coast: one second.
const RECOVERY_TICKS: u64 = 60;

pub struct Watch {
    commands_in: Reader<CommandV1>,
    telemetry_in: Reader<TelemetryV1>,
    truth_in: Reader<TruthV1>,
    fence: Fence,
    position: Vector3<f64>,
    pub commands: u64,
    pub ticks: u64,
    pub refused: u64,
    pub mode: u8,
    pub state: u8,
    pub is_fresh: bool,
    pub height_m: f64,
    /// Number of successive ticks with new poses in which the daemon still coasted.
    recovering: u64,
    last_refused: u64,
    violations: Vec<String>,
}

impl Watch {
    pub fn new(laboratory: &Laboratory) -> Self {
        let bus: &Bus = &laboratory.bus;
        Self {
            commands_in: bus.observer(&COMMAND).unwrap(),
            telemetry_in: bus.observer(&TELEMETRY).unwrap(),
            truth_in: bus.observer(&TRUTH).unwrap(),
            fence: Fence::new(&Config::default().fence),
            position: Vector3::zeros(),
            commands: 0,
            ticks: 0,
            refused: 0,
            mode: 0,
            state: 0,
            is_fresh: false,
            height_m: 0.0,
            recovering: 0,
            last_refused: 0,
            violations: Vec::new(),
        }
    }

    /// Reads the published messages.
    pub fn poll(&mut self) {
        while let Some((_, command)) = self.commands_in.receive().unwrap() {
            self.commands += 1;
            if !is_sound(&command) {
                self.violations.push(format!("{command:?}"));
            }
        }
        while let Some((_, tick)) = self.telemetry_in.receive().unwrap() {
            self.tick(&tick);
        }
        if let Some((_, truth)) = self.truth_in.latest().unwrap() {
            self.position = truth.position.into();
            self.height_m = self.position.z;
        }
    }

    fn tick(&mut self, tick: &TelemetryV1) {
        self.ticks += 1;
        self.refused += tick.poses_refused.saturating_sub(self.last_refused);
        self.last_refused = tick.poses_refused;
        (self.mode, self.state, self.is_fresh) = (tick.mode, tick.state, tick.fresh != 0);
        let is_powered = tick.mode != Mode::Disarmed.code() && tick.thrust > 0.0;
        if is_powered && self.fence.inside_m(&self.position) <= 0.0 {
            self.violations.push(format!("under power at {}: {tick:?}", self.position));
        }
        let waits_for_the_vehicle = tick.cause == Cause::NoVehicle.code();
        let coasts = tick.state == SafetyState::Coast.code() && !waits_for_the_vehicle;
        self.recovering = if coasts && self.is_fresh { self.recovering + 1 } else { 0 };
        if self.recovering == RECOVERY_TICKS {
            self.violations.push(format!("poses for a second, and still Coast: {tick:?}"));
        }
    }

    pub fn assert_sound(&self) {
        assert!(self.violations.is_empty(), "{}", self.violations.join("\n"));
    }
}

/// Whether every number of a command is finite and within its range.
fn is_sound(command: &CommandV1) -> bool {
    let sticks = command.sticks.iter().all(|stick| (-1.0..=1.0).contains(stick));
    let finite = command.torque.iter().chain(&command.attitude).all(|number| number.is_finite());
    let thrust = (0.0..=1.0).contains(&command.thrust);
    sticks && finite && thrust && Actuation::from_code(command.actuation).is_some()
}
