//! An instance of the bus: joins, opens ports, leaves.

use iceoryx2::config::Config;
use iceoryx2::node::{NodeCreationFailure, NodeView};
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::prelude::{
    CallbackProgression, Node, NodeBuilder, NodeState, ServiceName, SignalHandlingMode, ipc,
};
use iceoryx2::service::{Service, port_factory};

use crate::control::{ControlClient, ControlServer};
use crate::error::{BusError, system};
use crate::message::{ControlRequestV1, ControlResponseV1, Header, Message};
use crate::mismatch::OpenError;
use crate::paths::InstancePaths;
use crate::port::{Reader, Writer};
use crate::topic::{CONTROL, Topic};
use crate::transport::Transport;
use crate::wake::{EventPorts, Listener};

/// How many processes may touch one instance at once.
const MAX_NODES: usize = 24;

/// The ports of the daemon, the greatest of all processes, take this much shared memory \[KiB\], rounded up.
const ROOM_KIB: u64 = 6 * 1024;

/// A process's (or a thread's) access to one instance. Ports stay with the thread that opened them.
#[derive(Debug)]
pub struct Bus {
    bells: EventPorts,
    node: Node<ipc::Service>,
    place: InstancePaths,
}

impl Bus {
    /// Joins the instance at `place`; what dead processes left there is cleaned up.
    ///
    /// # Errors
    /// The place belongs to another user, shared memory is full, or the operating system refuses.
    pub fn open(place: &InstancePaths) -> Result<Self, BusError> {
        let mut config = place.prepare()?;
        check_room()?;
        // The bells first: remains of a dead listener are gone for good only if who removes them knows its kind.
        let bells = EventPorts::open(&config, place, MAX_NODES)?;
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        Ok(Self { bells, node: join(&config, place)?, place: place.clone() })
    }

    /// Paths and names of the instance.
    #[must_use]
    pub fn paths(&self) -> &InstancePaths {
        &self.place
    }

    /// Leaves the instance and removes what nobody needs any more: the remains of processes that died without a word, and,
    /// if this was the last process, the instance's counter of nodes, which iceoryx2 leaves behind in shared memory.
    pub fn leave(self) {
        self.bells.remove_the_dead();
        drop(self.bells);
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
        let prefix = self.node.config().global.prefix;
        drop(self.node);
        if listed.is_ok() && !others {
            remove_node_counter(&prefix.to_string());
        }
    }

    /// What wakes a process when the topic is notified.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn listener<M: Message>(&self, topic: &Topic<M>) -> Result<Listener, BusError> {
        self.bells.listener(topic.name)
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
            .map_err(|error| error.explain(&self.place.root, "topic", topic.name))
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
            .map_err(|error| error.explain(&self.place.root, "service", CONTROL))
    }
}

impl Transport for Bus {
    type Writer<M: Message> = Writer<M>;
    type Reader<M: Message> = Reader<M>;

    fn writer<M: Message>(&self, topic: &Topic<M>) -> Result<Writer<M>, BusError> {
        let publisher = self.topic_service(topic)?.publisher_builder().create().map_err(
            |error| match error {
                PublisherCreateError::ExceedsMaxSupportedPublishers => {
                    BusError::Held { topic: topic.name, instance: self.place.instance.clone() }
                }
                other => system(format!("writing topic `{}`", topic.name), &other),
            },
        )?;
        Ok(Writer::new(publisher, self.bells.ringer(topic.name)?, topic.name))
    }

    fn reader<M: Message>(&self, topic: &Topic<M>) -> Result<Reader<M>, BusError> {
        self.reader_with_buffer(topic, 1)
    }

    fn observer<M: Message>(&self, topic: &Topic<M>) -> Result<Reader<M>, BusError> {
        self.reader_with_buffer(topic, topic.buffer)
    }
}

/// A node at `place`: a process's presence there.
///
/// # Errors
/// As [`Bus::open`].
pub(crate) fn join<S: Service>(
    config: &Config,
    place: &InstancePaths,
) -> Result<Node<S>, BusError> {
    NodeBuilder::new()
        .config(config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create()
        .map_err(|error| match error {
            NodeCreationFailure::InsufficientPermissions => {
                BusError::Permission { path: place.root.clone() }
            }
            other => system(format!("joining {}", place.root.display()), &other),
        })
}

/// All memory of a port is reserved when it is opened; what is not there then is missed by a signal, not by an error.
fn check_room() -> Result<(), BusError> {
    let Ok(space) = rustix::fs::statvfs("/dev/shm") else {
        // iceoryx2 says more about a system without shared memory.
        return Ok(());
    };
    let free_kib = space.f_bavail.saturating_mul(space.f_frsize) / 1024;
    if free_kib >= ROOM_KIB {
        Ok(())
    } else {
        Err(BusError::Full { free_kib, needed_kib: ROOM_KIB })
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

#[cfg(test)]
mod tests {
    use iceoryx2::prelude::EventId;

    use super::*;
    use crate::topic::COMMAND;

    fn place(root: &std::path::Path) -> InstancePaths {
        InstancePaths::new("test", Some(root)).unwrap()
    }

    fn counters(place: &InstancePaths) -> usize {
        let prefix = place.prepare().unwrap().global.prefix.to_string();
        let entries = std::fs::read_dir("/dev/shm").unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name.starts_with(&prefix) && name.ends_with(".global_mgmt")).count()
    }

    #[test]
    fn who_leaves_last_takes_the_counter_of_its_own_root_alone() {
        let (one, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let (one, other) = (place(one.path()), place(other.path()));
        let (first, second) = (Bus::open(&one).unwrap(), Bus::open(&other).unwrap());
        first.leave();
        assert_eq!((counters(&one), counters(&other)), (0, 1));
        second.leave();
        assert_eq!(counters(&other), 0);
    }

    #[test]
    fn a_root_is_the_same_by_whichever_path_it_is_named() {
        let root = tempfile::tempdir().unwrap();
        let link = root.path().join("link");
        std::os::unix::fs::symlink(root.path(), &link).unwrap();
        let prefix = |root: &std::path::Path| place(root).prepare().unwrap().global.prefix;
        assert_eq!(prefix(root.path()), prefix(&link));
    }

    #[test]
    fn f26_a_service_built_otherwise_is_another_version_not_a_fault_of_the_system() {
        let root = tempfile::tempdir().unwrap();
        let bus = Bus::open(&place(root.path())).unwrap();
        let named = |name| bus.node.service_builder(&service_name(name).unwrap());
        let _event = named("command/futex").event().notifier_dead_event(EventId::new(4)).create();
        let _control = named(CONTROL).request_response::<u64, u64>().create();
        let _topic = named("health/daemon").publish_subscribe::<u64>().create();
        let version = |error: BusError| matches!(error, BusError::Version { .. });
        assert!(version(bus.listener(&COMMAND).unwrap_err()));
        assert!(version(bus.control_client().unwrap_err()));
        assert!(version(bus.reader(&crate::topic::Role::Daemon.health()).unwrap_err()));
        bus.leave();
    }

    #[test]
    fn a_root_that_cannot_be_made_is_a_fault_of_the_system() {
        let error = Bus::open(&place(std::path::Path::new("/dev/null/oqtal"))).unwrap_err();
        assert!(matches!(error, BusError::System { .. }), "{error}");
    }
}
