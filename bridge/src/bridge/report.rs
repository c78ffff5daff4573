//! Report of the bridge: the vehicle's state, and the command that was forwarded with its stamps.

use oqtal_bus::code::{VehicleLink, VehicleRefusal};
use oqtal_bus::message::{Stamps, VehicleV1};
use oqtal_bus::time::{Span, Time};

use super::{Bridge, VehicleReport};
use crate::protocol::ReportedMotors;
use crate::safety::ForwardedCommand;

impl Bridge {
    /// Report of the vehicle's state, with the command that a set-point forwarded and the time that the set-point needs until it
    /// has left.
    pub fn report(
        &mut self,
        now: Time,
        forwarded: Option<ForwardedCommand>,
        on_wire: Span,
    ) -> VehicleReport {
        if let Some(forwarded) = &forwarded {
            self.last_command = forwarded.command;
        }
        let (wire, air) = self.on_its_way(on_wire);
        let answers = self.is_answering(now);
        let state = self.monitor.state(now);
        let motors_run = answers && self.motors_run();
        // Also if a pilot or another station has armed the vehicle.
        let spools_up = answers && self.gate.last_motors() == Some(ReportedMotors::SpoolingUp);
        let is_in_sequence = motors_run && self.gate.is_in_sequence();
        let knows_motors = self.gate.knows_motors(now, self.monitor.silence());
        let is_pending = answers && !(self.protocol.is_set_up() && knows_motors);
        let link = if !(answers && (self.gate.is_ready() || self.gate.is_released())) {
            VehicleLink::Silent
        } else if knows_motors {
            VehicleLink::Answers
        } else {
            VehicleLink::MotorsUnknown
        };
        let vehicle = VehicleV1 {
            command_sequence: self.last_command,
            lost: self.commands_lost,
            wire_ns: wire.nanos(),
            air_ns: air.nanos(),
            time_out_s: self.protocol.time_out().map_or(0.0, Span::seconds),
            armed: u8::from(motors_run),
            starting: u8::from(self.gate.is_starting() || is_in_sequence || spools_up),
            stopped: u8::from(self.stopped_since.is_some() && !self.is_released()),
            link: link.code(),
            control: self.gate.control().code(),
            refusal: match is_pending && state.refusal == VehicleRefusal::None.code() {
                true => VehicleRefusal::NotSetUp.code(),
                false => state.refusal,
            },
            ..state
        };
        let stamps = forwarded
            .map_or_else(Stamps::default, |command| Stamps { applied_at: now, ..command.stamps });
        (forwarded.map_or(0, |command| command.pose), stamps, vehicle)
    }

    /// Whether motors run, or still may: a flight begins when they do, and a vehicle that is being stopped is not off.
    fn motors_run(&self) -> bool {
        match self.gate.last_motors() {
            Some(ReportedMotors::Running) => true,
            Some(ReportedMotors::SpoolingUp) => {
                self.gate.is_in_sequence() && !self.gate.is_starting()
            }
            Some(ReportedMotors::Off) | None => false,
        }
    }

    /// Time of a set-point on the wire, and from there to its effect. A network has no byte rate: the time on it is measured, and is part
    /// of the configured latency.
    fn on_its_way(&self, on_wire: Span) -> (Span, Span) {
        match self.monitor.one_way().filter(|_| self.transport.byte_rate().is_none()) {
            Some(measured) => (measured, (self.air - measured).max(Span::ZERO)),
            None => (on_wire, self.air),
        }
    }
}
