//! All topics of the system, in one table.

use std::marker::PhantomData;

mod observed;

pub use observed::{ObservedTopic, Sample, TopicVisitor};

use crate::message::{
    CommandV1, EventV1, ExternalV1, HealthV1, InputV1, Message, PoseV1, ReferenceV1, StateV1,
    TelemetryV1, TimeAdvanceV1, TruthV1, TurnDoneV1, VehicleV1,
};

/// Number of samples by which an observer may lag before it loses the oldest.
pub const OBSERVER_BUFFER: usize = 1024;

/// Quality of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quality {
    /// Number of samples that a late reader receives: 1, or 0 if an old sample must not take effect \[-\].
    pub history: usize,
    /// Longest buffer of a reader \[samples\].
    pub buffer: usize,
    /// Maximum number of readers \[-\].
    pub readers: usize,
    /// Maximum number of observers among them \[-\]. The other places belong to the loop, the recorder of a flight, and operators.
    pub observers: usize,
}

/// Maximum number of observers of a topic: `oqtal record`, `monitor`, `view`, `latency`.
const OBSERVERS: usize = 4;

/// Samples of a loop: readers in the loop keep the newest, observers receive all.
const STREAM: Quality =
    Quality { history: 1, buffer: OBSERVER_BUFFER, readers: 8, observers: OBSERVERS };
/// Like [`STREAM`], with a place for the daemon's background thread, which compares the rate of the poses.
const POSES: Quality = Quality { readers: 9, ..STREAM };
/// Like [`STREAM`], for topics that processes with injected faults read, too.
const WATCHED: Quality = Quality { readers: 12, ..STREAM };
/// Like [`WATCHED`] without history: a late reader does not receive an old command.
const COMMANDS: Quality = Quality { history: 0, ..WATCHED };
/// Samples for observers only.
const RECORDED: Quality = Quality { buffer: OBSERVER_BUFFER / 4, ..STREAM };
/// State described completely by the newest sample; observers receive all.
const STATE: Quality = Quality { buffer: 16, ..STREAM };
/// Request or reply between two processes.
const EXCHANGE: Quality = Quality { history: 1, buffer: 1, readers: 1, observers: 0 };

/// A publish-subscribe topic: name, message type and quality.
#[derive(Debug)]
pub struct Topic<M> {
    /// Name, unique within an instance.
    pub name: &'static str,
    /// Quality.
    pub quality: Quality,
    message: PhantomData<M>,
}

/// Description of a topic without its message type.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TopicSpec {
    pub(crate) name: &'static str,
    pub(crate) quality: Quality,
    /// See [`Message::SCHEMA`].
    pub(crate) schema: u64,
    /// See [`Message::SIZE`] \[bytes\].
    pub(crate) size: usize,
}

impl<M: Message> Topic<M> {
    const fn new(name: &'static str, quality: Quality) -> Self {
        Self { name, quality, message: PhantomData }
    }

    pub(crate) const fn spec(&self) -> TopicSpec {
        TopicSpec { name: self.name, quality: self.quality, schema: M::SCHEMA, size: M::SIZE }
    }
}

/// Plant to mocap and observers: every integration millisecond; notifies at camera instants only.
pub const TRUTH: Topic<TruthV1> = Topic::new("truth", STREAM);
/// Mocap or receiver to daemon and observers, at the cameras' rate.
pub const POSE: Topic<PoseV1> = Topic::new("pose", POSES);
/// Daemon to plant or bridge and observers, at the loop's rate. The limit of one writer locks out a second controller.
pub const COMMAND: Topic<CommandV1> = Topic::new("command", COMMANDS);
/// Plant or bridge to daemon and observers, once per applied command.
pub const VEHICLE: Topic<VehicleV1> = Topic::new("vehicle", WATCHED);
/// Daemon to observers, once per tick.
pub const TELEMETRY: Topic<TelemetryV1> = Topic::new("telemetry", STREAM);

/// Daemon to observers: state and reference as passed to an external law, once per tick in flight.
pub const LAW_STATE: Topic<StateV1> = Topic::new("state", RECORDED);
/// Daemon to observers: the external law's answer, once per question.
pub const EXTERNAL: Topic<ExternalV1> = Topic::new("external", RECORDED);

/// Daemon to recorders, once per turn that received a message or a request.
pub const INPUT: Topic<InputV1> = Topic::new("input", RECORDED);

/// Daemon to observers: poses as read by the daemon, published if an injected fault (`[fault]`) alters them.
pub const POSE_READ: Topic<PoseV1> = Topic::new("read/pose", RECORDED);
/// Daemon to observers: messages of the vehicle as read by the daemon, published if an injected fault alters them.
pub const VEHICLE_READ: Topic<VehicleV1> = Topic::new("read/vehicle", RECORDED);

/// A planner to daemon and observers, at any rate. The limit of one writer locks out a second planner.
pub const REFERENCE: Topic<ReferenceV1> =
    Topic::new("reference", Quality { buffer: 64, ..COMMANDS });
/// Daemon to observers: requests that change a flight or its settings. A late observer receives no request of an earlier flight.
pub const EVENT: Topic<EventV1> = Topic::new("event", Quality { history: 0, ..STATE });

/// Name of the request-response service of the daemon.
pub const CONTROL: &str = "control";

/// Processes of the loop, in their order of execution at equal virtual times; the last two do not take part in virtual time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// The vehicle: plant-sim.
    Plant,
    /// The cameras: mocap-emu.
    Mocap,
    /// The controller: daemon.
    Daemon,
    /// The recorder, in the process of `oqtal fly`.
    Recorder,
    /// The link to a real vehicle: bridge.
    Bridge,
    /// The link to a real camera system: receiver.
    Receiver,
}

impl Role {
    /// Processes that publish their health, in the order in which they are listed.
    pub const PROCESSES: [Self; 5] =
        [Self::Plant, Self::Mocap, Self::Daemon, Self::Bridge, Self::Receiver];

    /// Roles that take part in virtual time, in order.
    pub const ALL: [Self; 4] = [Self::Plant, Self::Mocap, Self::Daemon, Self::Recorder];

    /// Name of the process.
    pub const fn name(self) -> &'static str {
        self.names().process
    }

    /// Topic of this process's health.
    pub const fn health(self) -> Topic<HealthV1> {
        Topic::new(self.names().health, STATE)
    }

    /// Topic on which the leader advances the virtual time of this process.
    pub const fn time_advance(self) -> Topic<TimeAdvanceV1> {
        Topic::new(self.names().advance, EXCHANGE)
    }

    /// Topic on which this process reports the end of a turn.
    pub const fn turn_done(self) -> Topic<TurnDoneV1> {
        Topic::new(self.names().done, EXCHANGE)
    }

    const fn names(self) -> RoleNames {
        match self {
            Self::Plant => role_names!("plant-sim"),
            Self::Mocap => role_names!("mocap-emu"),
            Self::Daemon => role_names!("daemon"),
            Self::Recorder => role_names!("recorder"),
            Self::Bridge => role_names!("bridge"),
            Self::Receiver => role_names!("receiver"),
        }
    }
}

/// Names of a process and of its topics.
struct RoleNames {
    process: &'static str,
    health: &'static str,
    advance: &'static str,
    done: &'static str,
}

/// The [`RoleNames`] of the process with this name.
macro_rules! role_names {
    ($name:literal) => {
        RoleNames {
            process: $name,
            health: concat!("health/", $name),
            advance: concat!("clock/", $name, "/advance"),
            done: concat!("clock/", $name, "/done"),
        }
    };
}
use role_names;
