//! Every topic of the system, in one table.

use std::marker::PhantomData;

use crate::message::{
    CommandV1, HealthV1, Message, PoseV1, TelemetryV1, TimeAdvanceV1, TruthV1, TurnDoneV1,
    VehicleV1,
};

/// Samples an observer may fall behind before it loses the oldest.
pub const OBSERVER_BUFFER: usize = 1024;

/// A publish-subscribe topic: its name, its type and its quality.
#[derive(Debug)]
pub struct Topic<M> {
    /// Name, unique within an instance.
    pub name: &'static str,
    /// Samples a late joiner gets: 1, or 0 where an old sample must never act.
    pub history: usize,
    /// The longest buffer a reader may ask for.
    pub buffer: usize,
    /// Readers at most.
    pub readers: usize,
    message: PhantomData<M>,
}

impl<M: Message> Topic<M> {
    const fn new(name: &'static str, history: usize, buffer: usize, readers: usize) -> Self {
        Self { name, history, buffer, readers, message: PhantomData }
    }
}

/// Plant to mocap and observers: every integration millisecond; notifies at camera instants only.
pub const TRUTH: Topic<TruthV1> = Topic::new("truth", 1, OBSERVER_BUFFER, 8);
/// Mocap to daemon and observers, at the cameras' rate.
pub const POSE: Topic<PoseV1> = Topic::new("pose", 1, OBSERVER_BUFFER, 8);
/// Daemon to plant or bridge and observers, at the loop's rate. Its single writer is the lock against a second controller.
pub const COMMAND: Topic<CommandV1> = Topic::new("command", 0, OBSERVER_BUFFER, 8);
/// Plant or bridge to daemon and observers, once per command applied.
pub const VEHICLE: Topic<VehicleV1> = Topic::new("vehicle", 1, OBSERVER_BUFFER, 8);
/// Daemon to observers, once per tick.
pub const TELEMETRY: Topic<TelemetryV1> = Topic::new("telemetry", 1, OBSERVER_BUFFER, 8);

/// Name of the request-response service of the daemon.
pub const CONTROL: &str = "control";

/// The processes of the loop, in the order in which they act at equal virtual times; the last takes no part in virtual time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// The vehicle: plant-sim.
    Plant,
    /// The cameras: mocap-emu.
    Mocap,
    /// The controller: daemon.
    Daemon,
    /// Whoever records the flight: the front door.
    Recorder,
    /// The way to a real vehicle: bridge.
    Bridge,
}

impl Role {
    /// Those who take part in virtual time, in order.
    pub const ALL: [Self; 4] = [Self::Plant, Self::Mocap, Self::Daemon, Self::Recorder];

    /// The name of the process.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plant => "plant-sim",
            Self::Mocap => "mocap-emu",
            Self::Daemon => "daemon",
            Self::Recorder => "recorder",
            Self::Bridge => "bridge",
        }
    }

    /// Where this process says whether it is well.
    #[must_use]
    pub const fn health(self) -> Topic<HealthV1> {
        let name = match self {
            Self::Plant => "health/plant-sim",
            Self::Mocap => "health/mocap-emu",
            Self::Daemon => "health/daemon",
            Self::Recorder => "health/recorder",
            Self::Bridge => "health/bridge",
        };
        Topic::new(name, 1, 1, 8)
    }

    /// The topic on which the leader advances the virtual time of this process.
    #[must_use]
    pub const fn time_advance(self) -> Topic<TimeAdvanceV1> {
        let name = match self {
            Self::Plant => "clock/plant-sim/advance",
            Self::Mocap => "clock/mocap-emu/advance",
            Self::Daemon => "clock/daemon/advance",
            Self::Recorder => "clock/recorder/advance",
            Self::Bridge => "clock/bridge/advance",
        };
        Topic::new(name, 1, 1, 1)
    }

    /// The topic on which this process reports the end of a turn.
    #[must_use]
    pub const fn turn_done(self) -> Topic<TurnDoneV1> {
        let name = match self {
            Self::Plant => "clock/plant-sim/done",
            Self::Mocap => "clock/mocap-emu/done",
            Self::Daemon => "clock/daemon/done",
            Self::Recorder => "clock/recorder/done",
            Self::Bridge => "clock/bridge/done",
        };
        Topic::new(name, 1, 1, 1)
    }
}
