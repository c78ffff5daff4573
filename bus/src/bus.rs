//! An instance of the bus: joins, opens ports, leaves.

use std::time::Duration;

use iceoryx2::node::{NodeCreationFailure, NodeView};
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::prelude::{
    CallbackProgression, Node, NodeBuilder, NodeState, ServiceName, SignalHandlingMode, ipc,
};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory;

use crate::control::{ControlClient, ControlServer};
use crate::error::{BusError, system};
use crate::message::{ControlRequestV1, ControlResponseV1, Header, Message};
use crate::place::Place;
use crate::port::{Reader, Writer};
use crate::topic::{CONTROL, Topic};
use crate::wake::{Bells, Doorbell};

/// How many processes may touch one instance at once.
const MAX_NODES: usize = 24;

/// A process's (or a thread's) access to one instance. Ports stay with the thread that opened them.
#[derive(Debug)]
pub struct Bus {
    bells: Bells,
    node: Node<ipc::Service>,
    place: Place,
}

impl Bus {
    /// Joins the instance at `place`; what dead processes left there is cleaned up.
    ///
    /// # Errors
    /// The place belongs to another user, or the operating system refuses.
    pub fn open(place: &Place) -> Result<Self, BusError> {
        let config = place.config()?;
        let permission = || BusError::Permission { path: place.root.clone() };
        std::fs::create_dir_all(&place.root).map_err(|error| match error.kind() {
            std::io::ErrorKind::PermissionDenied => permission(),
            _ => system(format!("creating {}", place.root.display()), &error),
        })?;
        let node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|error| match error {
                NodeCreationFailure::InsufficientPermissions => permission(),
                other => system(format!("joining {}", place.root.display()), &other),
            })?;
        Ok(Self { bells: Bells::open(&config, place.events)?, node, place: place.clone() })
    }

    /// The place this bus lives at.
    #[must_use]
    pub fn place(&self) -> &Place {
        &self.place
    }

    /// Leaves the instance and removes what nobody needs any more: the remains of processes that died without a word, and,
    /// if this was the last process, the instance's counter of nodes, which iceoryx2 leaves behind in shared memory.
    pub fn leave(self) {
        drop(self.bells);
        self.node.blocking_cleanup_dead_nodes(Duration::from_millis(500));
        let mut others = false;
        let own = *self.node.id();
        let listed = Node::<ipc::Service>::list(self.node.config(), |state| {
            others |= match state {
                NodeState::Alive(view) => *view.id() != own,
                NodeState::Dead(_) => false,
                NodeState::Inaccessible(_) | NodeState::Undefined(_) => true,
            };
            CallbackProgression::Continue
        });
        let prefix = self.place.prefix();
        drop(self.node);
        if listed.is_ok() && !others {
            remove_node_counter(&prefix);
        }
    }

    /// The one writer of a topic.
    ///
    /// # Errors
    /// The topic has a writer already, or speaks another version.
    pub fn writer<M: Message>(&self, topic: &Topic<M>) -> Result<Writer<M>, BusError> {
        let publisher = self.topic_service(topic)?.publisher_builder().create().map_err(
            |error| match error {
                PublisherCreateError::ExceedsMaxSupportedPublishers => {
                    BusError::Held { topic: topic.name, instance: self.place.instance.clone() }
                }
                other => system(format!("writing topic `{}`", topic.name), &other),
            },
        )?;
        Ok(Writer::new(publisher, self.bells.ringer(topic.name, MAX_NODES)?, topic.name))
    }

    /// A reader that keeps the newest sample only: for the loop.
    ///
    /// # Errors
    /// The topic speaks another version, or the operating system refuses.
    pub fn reader<M: Message>(&self, topic: &Topic<M>) -> Result<Reader<M>, BusError> {
        self.reader_with_buffer(topic, 1)
    }

    /// A reader that keeps as many samples as the topic allows: for those who must not miss one.
    ///
    /// # Errors
    /// The topic speaks another version, or the operating system refuses.
    pub fn observer<M: Message>(&self, topic: &Topic<M>) -> Result<Reader<M>, BusError> {
        self.reader_with_buffer(topic, topic.buffer)
    }

    /// What wakes a process when the topic is notified.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn doorbell<M: Message>(&self, topic: &Topic<M>) -> Result<Doorbell, BusError> {
        self.bells.doorbell(topic.name, MAX_NODES)
    }

    /// The daemon's end of the control service.
    ///
    /// # Errors
    /// Another daemon serves this instance.
    pub fn control_server(&self) -> Result<ControlServer, BusError> {
        let server = self.control_service()?.server_builder().create();
        Ok(ControlServer::new(server.map_err(|e| system(format!("serving `{CONTROL}`"), &e))?))
    }

    /// An operator's end of the control service.
    ///
    /// # Errors
    /// The operating system refuses, or too many operators speak at once.
    pub fn control_client(&self) -> Result<ControlClient, BusError> {
        let client = self.control_service()?.client_builder().create();
        Ok(ControlClient::new(client.map_err(|e| system(format!("asking `{CONTROL}`"), &e))?))
    }

    fn reader_with_buffer<M: Message>(
        &self,
        topic: &Topic<M>,
        buffer: usize,
    ) -> Result<Reader<M>, BusError> {
        let subscriber =
            self.topic_service(topic)?.subscriber_builder().buffer_size(buffer).create();
        Ok(Reader::new(
            subscriber.map_err(|e| system(format!("reading topic `{}`", topic.name), &e))?,
            topic.name,
        ))
    }

    fn topic_service<M: Message>(
        &self,
        topic: &Topic<M>,
    ) -> Result<port_factory::publish_subscribe::PortFactory<ipc::Service, M, Header>, BusError>
    {
        self.node
            .service_builder(&service_name(topic.name)?)
            .publish_subscribe::<M>()
            .user_header::<Header>()
            .history_size(topic.history)
            .subscriber_max_buffer_size(topic.buffer)
            .enable_safe_overflow(true)
            .max_publishers(1)
            .max_subscribers(topic.readers)
            .max_nodes(MAX_NODES)
            .open_or_create()
            .map_err(|error| self.explain_topic(topic.name, error))
    }

    fn control_service(
        &self,
    ) -> Result<
        port_factory::request_response::PortFactory<
            ipc::Service,
            ControlRequestV1,
            (),
            ControlResponseV1,
            (),
        >,
        BusError,
    > {
        self.node
            .service_builder(&service_name(CONTROL)?)
            .request_response::<ControlRequestV1, ControlResponseV1>()
            .max_servers(1)
            .max_clients(8)
            .max_nodes(MAX_NODES)
            .open_or_create()
            .map_err(|e| system(format!("opening service `{CONTROL}`"), &e))
    }

    fn explain_topic(&self, topic: &str, error: PublishSubscribeOpenOrCreateError) -> BusError {
        use PublishSubscribeOpenError as Open;
        match error {
            PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
                Open::IncompatibleTypes | Open::VersionMismatch | Open::ServiceInCorruptedState,
            ) => BusError::Version { topic: topic.to_owned() },
            PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
                Open::InsufficientPermissions,
            ) => BusError::Permission { path: self.place.root.clone() },
            other => system(format!("opening topic `{topic}`"), &other),
        }
    }
}

fn service_name(name: &str) -> Result<ServiceName, BusError> {
    ServiceName::new(name).map_err(|e| system(format!("naming `{name}`"), &e))
}

fn remove_node_counter(prefix: &str) {
    let Ok(entries) = std::fs::read_dir("/dev/shm") else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name.starts_with(prefix) && name.ends_with(".global_mgmt") {
            // Somebody else may have removed it: all the same.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}
