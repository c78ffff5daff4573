//! The interface between the [`BusObserver`](crate::observer::BusObserver) and whatever uses the samples it receives: the
//! flight recorder, the latency monitor, the status overview.

use std::fmt;

use oqtal_bus::message::{CommandV1, Header, HealthV1, PoseV1, TelemetryV1, TruthV1, VehicleV1};
use oqtal_bus::time::Time;
use oqtal_bus::topic::{COMMAND, POSE, Role, TELEMETRY, TRUTH, VEHICLE};

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

    /// Takes a sample of topic `health/NAME` of the process `role`.
    fn health(&mut self, _reception: &Reception, _role: Role, _health: &HealthV1) {}

    /// Takes note that `count` samples of `topic` were lost: they were overwritten before the observer polled. Has no default,
    /// because no sink may lose samples without saying so.
    fn lost(&mut self, topic: ObservedTopic, count: u64);
}
