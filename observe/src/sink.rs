//! The interface between the [`BusObserver`](crate::observer::BusObserver) and whatever uses the samples it receives: the
//! flight recorder, the latency monitor, the status overview.

use std::fmt;

use oqtal_bus::message::{
    CommandV1, Header, HealthV1, InputV1, PoseV1, TelemetryV1, TruthV1, VehicleV1,
};
use oqtal_bus::time::Time;
use oqtal_bus::topic::{
    COMMAND, INPUT, POSE, POSE_READ, Role, TELEMETRY, TRUTH, VEHICLE, VEHICLE_READ,
};

/// A topic that can be observed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObservedTopic {
    /// Topic `truth`.
    Truth,
    /// Topic `pose`.
    Pose,
    /// Topic `command`.
    Command,
    /// Topic `vehicle`.
    Vehicle,
    /// Topic `telemetry`.
    Telemetry,
    /// Topic `input`.
    Input,
    /// Topic `read/pose`.
    PoseRead,
    /// Topic `read/vehicle`.
    VehicleRead,
    /// Topic `health/NAME` of one process.
    Health(Role),
}

impl fmt::Display for ObservedTopic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Truth => TRUTH.name,
            Self::Pose => POSE.name,
            Self::Command => COMMAND.name,
            Self::Vehicle => VEHICLE.name,
            Self::Telemetry => TELEMETRY.name,
            Self::Input => INPUT.name,
            Self::PoseRead => POSE_READ.name,
            Self::VehicleRead => VEHICLE_READ.name,
            Self::Health(role) => role.health().name,
        })
    }
}

/// How a sample arrived.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reception {
    /// Header of the sample, as its writer sent it.
    pub header: Header,
    /// Instant at which the observer took the sample off the bus, in the clock of the caller of
    /// [`BusObserver::poll`](crate::observer::BusObserver::poll).
    pub received_at: Time,
}

/// Receives the samples of the observed topics. A sink implements the callbacks of the topics it uses; the others ignore
/// their sample.
pub trait Sink {
    /// Takes a sample of topic `truth`.
    fn truth(&mut self, _reception: &Reception, _truth: &TruthV1) {}

    /// Takes a sample of topic `pose`.
    fn pose(&mut self, _reception: &Reception, _pose: &PoseV1) {}

    /// Takes a sample of topic `command`.
    fn command(&mut self, _reception: &Reception, _command: &CommandV1) {}

    /// Takes a sample of topic `vehicle`.
    fn vehicle(&mut self, _reception: &Reception, _vehicle: &VehicleV1) {}

    /// Takes a sample of topic `telemetry`.
    fn telemetry(&mut self, _reception: &Reception, _telemetry: &TelemetryV1) {}

    /// Takes a sample of topic `input`.
    fn input(&mut self, _reception: &Reception, _input: &InputV1) {}

    /// Takes a sample of topic `read/pose`.
    fn pose_read(&mut self, _reception: &Reception, _pose: &PoseV1) {}

    /// Takes a sample of topic `read/vehicle`.
    fn vehicle_read(&mut self, _reception: &Reception, _vehicle: &VehicleV1) {}

    /// Takes a sample of topic `health/NAME` of the process `role`.
    fn health(&mut self, _reception: &Reception, _role: Role, _health: &HealthV1) {}

    /// Takes note that `count` samples of `topic` were lost: they were overwritten before the observer polled. Has no default,
    /// because no sink may lose samples without saying so.
    fn lost(&mut self, topic: ObservedTopic, count: u64);
}

/// Two sinks that both receive every sample, the first one first.
#[derive(Debug)]
pub struct Tee<'a, A, B>(pub &'a mut A, pub &'a mut B);

impl<A: Sink, B: Sink> Sink for Tee<'_, A, B> {
    fn truth(&mut self, reception: &Reception, truth: &TruthV1) {
        self.0.truth(reception, truth);
        self.1.truth(reception, truth);
    }

    fn pose(&mut self, reception: &Reception, pose: &PoseV1) {
        self.0.pose(reception, pose);
        self.1.pose(reception, pose);
    }

    fn command(&mut self, reception: &Reception, command: &CommandV1) {
        self.0.command(reception, command);
        self.1.command(reception, command);
    }

    fn vehicle(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        self.0.vehicle(reception, vehicle);
        self.1.vehicle(reception, vehicle);
    }

    fn telemetry(&mut self, reception: &Reception, telemetry: &TelemetryV1) {
        self.0.telemetry(reception, telemetry);
        self.1.telemetry(reception, telemetry);
    }

    fn input(&mut self, reception: &Reception, input: &InputV1) {
        self.0.input(reception, input);
        self.1.input(reception, input);
    }

    fn pose_read(&mut self, reception: &Reception, pose: &PoseV1) {
        self.0.pose_read(reception, pose);
        self.1.pose_read(reception, pose);
    }

    fn vehicle_read(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        self.0.vehicle_read(reception, vehicle);
        self.1.vehicle_read(reception, vehicle);
    }

    fn health(&mut self, reception: &Reception, role: Role, health: &HealthV1) {
        self.0.health(reception, role, health);
        self.1.health(reception, role, health);
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        self.0.lost(topic, count);
        self.1.lost(topic, count);
    }
}
