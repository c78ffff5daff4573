//! The channels of a recording: one for each topic, and those for viewers.

use std::collections::BTreeMap;

use oqtal_bus::message::{
    CommandV1, HealthV1, InputV1, Message, PoseV1, TelemetryV1, TruthV1, VehicleV1,
};
use oqtal_bus::topic::Role;

use super::{scene, schema};
use crate::sink::ObservedTopic;

/// Processes whose health is recorded, in the order of their channels.
pub const HEALTH: [Role; 5] =
    [Role::Plant, Role::Mocap, Role::Daemon, Role::Bridge, Role::Receiver];

/// Key of a channel's metadata that holds the hash of the message definition, in hexadecimal.
pub const SCHEMA_KEY: &str = "oqtal_schema";

/// A channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// A topic.
    Topic(ObservedTopic),
    /// Measured poses, for viewers.
    Measured,
    /// Estimated poses, for viewers.
    Estimate,
    /// References, for viewers.
    Reference,
    /// True poses, for viewers.
    True,
    /// The transform from the world to the vehicle, for viewers.
    Transform,
    /// Events in words.
    Events,
    /// Offsets of the clocks.
    Clock,
}

/// The schema of a channel.
#[derive(Clone, Debug)]
pub struct ChannelSchema {
    /// Name.
    pub name: String,
    /// Text in the message definition language of ROS 2.
    pub text: String,
    /// Metadata of the channel.
    pub metadata: BTreeMap<String, String>,
}

impl Channel {
    /// All channels in the order of their numbers.
    pub fn all() -> impl Iterator<Item = Self> {
        use ObservedTopic::{
            Command, Health, Input, Pose, PoseRead, Telemetry, Truth, Vehicle, VehicleRead,
        };
        let topics = [Telemetry, Truth, Pose, Command, Vehicle, Input, PoseRead, VehicleRead];
        let topics = topics.into_iter().chain(HEALTH.into_iter().map(Health)).map(Self::Topic);
        let others = [Self::Measured, Self::Estimate, Self::Reference, Self::True];
        topics.chain(others).chain([Self::Transform, Self::Events, Self::Clock])
    }

    /// Name of the channel's topic in the file.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Topic(topic) => topic.to_string(),
            Self::Measured => "scene/measured".to_owned(),
            Self::Estimate => "scene/estimate".to_owned(),
            Self::Reference => "scene/reference".to_owned(),
            Self::True => "scene/truth".to_owned(),
            Self::Transform => "scene/transform".to_owned(),
            Self::Events => "events".to_owned(),
            Self::Clock => "clock_offset".to_owned(),
        }
    }

    /// Schema of the channel's messages.
    #[must_use]
    pub fn schema(self) -> ChannelSchema {
        let (name, text) = match self {
            Self::Topic(topic) => return of_topic(topic),
            Self::Measured | Self::Estimate | Self::Reference | Self::True => scene::POSE,
            Self::Transform => scene::TRANSFORM,
            Self::Events => scene::LOG,
            Self::Clock => scene::CLOCK,
        };
        let (name, text) = (name.to_owned(), text.to_owned());
        ChannelSchema { name, text, metadata: BTreeMap::new() }
    }
}

fn of_topic(topic: ObservedTopic) -> ChannelSchema {
    match topic {
        ObservedTopic::Truth => of::<TruthV1>(),
        ObservedTopic::Pose | ObservedTopic::PoseRead => of::<PoseV1>(),
        ObservedTopic::Command => of::<CommandV1>(),
        ObservedTopic::Vehicle | ObservedTopic::VehicleRead => of::<VehicleV1>(),
        ObservedTopic::Telemetry => of::<TelemetryV1>(),
        ObservedTopic::Input => of::<InputV1>(),
        ObservedTopic::Health(_) => of::<HealthV1>(),
    }
}

fn of<M: Message>() -> ChannelSchema {
    let metadata = BTreeMap::from([(SCHEMA_KEY.to_owned(), schema_id::<M>())]);
    ChannelSchema { name: schema::name::<M>(), text: schema::text::<M>(), metadata }
}

/// The hash of a message definition as a channel's metadata has it.
#[must_use]
pub fn schema_id<M: Message>() -> String {
    format!("{:016x}", M::SCHEMA)
}
