//! Channels of a recording: one for each topic, and further channels for viewers.

use std::collections::BTreeMap;

use oqtal_bus::message::Message;
use oqtal_bus::topic::{ObservedTopic, Sample, Topic, TopicVisitor};

use super::{scene, schema};

/// Metadata key of a channel for the hash of the message definition, in hexadecimal.
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
    /// Transform from the world to the vehicle, for viewers.
    Transform,
    /// Events as text.
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
        let others = [Self::Measured, Self::Estimate, Self::Reference, Self::True];
        let topics = ObservedTopic::all().map(Self::Topic);
        topics.chain(others).chain([Self::Transform, Self::Events, Self::Clock])
    }

    /// Name of the channel's topic in the file.
    pub fn name(self) -> String {
        match self {
            Self::Topic(topic) => return topic.to_string(),
            Self::Measured => "scene/measured",
            Self::Estimate => "scene/estimate",
            Self::Reference => "scene/reference",
            Self::True => "scene/truth",
            Self::Transform => "scene/transform",
            Self::Events => "events",
            Self::Clock => "clock_offset",
        }
        .to_owned()
    }

    /// Schema of the channel's messages.
    pub fn schema(self) -> ChannelSchema {
        let (name, text) = match self {
            Self::Topic(topic) => return topic.visit(MessageSchema),
            Self::Measured | Self::Estimate | Self::Reference | Self::True => scene::POSE,
            Self::Transform => scene::TRANSFORM,
            Self::Events => scene::LOG,
            Self::Clock => scene::CLOCK,
        };
        let (name, text) = (name.to_owned(), text.to_owned());
        ChannelSchema { name, text, metadata: BTreeMap::new() }
    }
}

/// Schema of the messages of a topic.
struct MessageSchema;

impl TopicVisitor for MessageSchema {
    type Output = ChannelSchema;

    fn visit<M: Message>(
        self,
        _: &Topic<M>,
        _: impl for<'a> Fn(&'a M) -> Sample<'a> + 'static,
    ) -> ChannelSchema {
        let metadata = BTreeMap::from([(SCHEMA_KEY.to_owned(), schema_id::<M>())]);
        ChannelSchema { name: schema::name::<M>(), text: schema::text::<M>(), metadata }
    }
}

/// Hash of a message definition in the format of a channel's metadata.
pub fn schema_id<M: Message>() -> String {
    format!("{:016x}", M::SCHEMA)
}
