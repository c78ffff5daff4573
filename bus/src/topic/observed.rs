//! Topics that observers can receive, derived from one list: an identifier and a sample type for each, and generic code over all.

use std::fmt;

use super::{
    COMMAND, EVENT, EXTERNAL, INPUT, LAW_STATE, POSE, POSE_READ, REFERENCE, Role, TELEMETRY, TRUTH,
    Topic, VEHICLE, VEHICLE_READ,
};
use crate::message::{
    AnyMessage, CommandV1, EventV1, ExternalV1, Field, HealthV1, InputV1, Message, PoseV1,
    ReferenceV1, StateV1, TelemetryV1, TruthV1, VehicleV1,
};

/// Operation on any topic, such as opening a reader or decoding a body.
pub trait TopicVisitor {
    /// Result of the operation.
    type Output;

    /// Executes the operation on `topic`; `wrap` makes a [`Sample`] of a body.
    fn visit<M: Message>(
        self,
        topic: &Topic<M>,
        wrap: impl for<'a> Fn(&'a M) -> Sample<'a> + 'static,
    ) -> Self::Output;
}

/// Defines [`ObservedTopic`] and [`Sample`] from lines `variant(message) = topic`. Topics of one process are added by hand.
macro_rules! observed_topics {
    ($($(#[doc = $doc:literal])* $variant:ident($message:ty) = $topic:ident,)*) => {
        /// Identifier of an observable topic.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum ObservedTopic {
            $($(#[doc = $doc])* $variant,)*
            /// Topic `health/NAME` of one process.
            Health(Role),
        }

        /// Body of one message of an observed topic.
        #[derive(Clone, Copy, Debug)]
        pub enum Sample<'a> {
            $($(#[doc = $doc])* $variant(&'a $message),)*
            /// Topic `health/NAME` of one process.
            Health(Role, &'a HealthV1),
        }

        impl ObservedTopic {
            /// All topics, in the order in which an observer reads them.
            pub fn all() -> impl Iterator<Item = Self> {
                [$(Self::$variant),*].into_iter().chain(Role::PROCESSES.map(Self::Health))
            }

            /// Name of the topic.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $topic.name,)*
                    Self::Health(role) => role.health().name,
                }
            }

            /// Fields of the topic's messages.
            pub const fn fields(self) -> &'static [Field] {
                match self {
                    $(Self::$variant => <$message>::FIELDS,)*
                    Self::Health(_) => HealthV1::FIELDS,
                }
            }

            /// Calls `visitor` with the typed topic.
            pub fn visit<V: TopicVisitor>(self, visitor: V) -> V::Output {
                match self {
                    $(Self::$variant => visitor.visit(&$topic, |body| Sample::$variant(body)),)*
                    Self::Health(role) => {
                        visitor.visit(&role.health(), move |body| Sample::Health(role, body))
                    }
                }
            }
        }

        impl Sample<'_> {
            /// Topic of the sample.
            pub const fn topic(&self) -> ObservedTopic {
                match self {
                    $(Self::$variant(_) => ObservedTopic::$variant,)*
                    Self::Health(role, _) => ObservedTopic::Health(*role),
                }
            }

            /// Body of the sample, as a trait object.
            pub fn body(&self) -> &dyn AnyMessage {
                match self {
                    $(Self::$variant(body) => *body,)*
                    Self::Health(_, body) => *body,
                }
            }
        }
    };
}

observed_topics! {
    /// Topic `telemetry`.
    Telemetry(TelemetryV1) = TELEMETRY,
    /// Topic `truth`.
    Truth(TruthV1) = TRUTH,
    /// Topic `pose`.
    Pose(PoseV1) = POSE,
    /// Topic `command`.
    Command(CommandV1) = COMMAND,
    /// Topic `vehicle`.
    Vehicle(VehicleV1) = VEHICLE,
    /// Topic `read/pose`.
    PoseRead(PoseV1) = POSE_READ,
    /// Topic `read/vehicle`.
    VehicleRead(VehicleV1) = VEHICLE_READ,
    /// Topic `state`.
    State(StateV1) = LAW_STATE,
    /// Topic `external`.
    External(ExternalV1) = EXTERNAL,
    /// Topic `reference`.
    Reference(ReferenceV1) = REFERENCE,
    /// Topic `event`.
    Event(EventV1) = EVENT,
    /// Topic `input`, after the topics whose messages it refers to.
    Input(InputV1) = INPUT,
}

impl fmt::Display for ObservedTopic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Name;

    impl TopicVisitor for Name {
        type Output = (&'static str, ObservedTopic);

        fn visit<M: Message>(
            self,
            topic: &Topic<M>,
            wrap: impl for<'a> Fn(&'a M) -> Sample<'a> + 'static,
        ) -> Self::Output {
            let body = M::default();
            let sample = wrap(&body);
            assert_eq!(sample.body().fields(), M::FIELDS);
            (topic.name, sample.topic())
        }
    }

    #[test]
    fn a_topic_and_its_samples_name_each_other() {
        for topic in ObservedTopic::all() {
            let name = topic.to_string();
            assert_eq!(topic.visit(Name), (name.as_str(), topic));
        }
    }
}
