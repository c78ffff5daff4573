//! Node of iceoryx2: opens services and their ports under the lock of the instance.

use std::fmt;
use std::rc::Rc;
use std::time::Duration;

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::node::NodeCreationFailure;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::prelude::{
    AttributeVerifier, CallbackProgression, Node, NodeBuilder, PortFactory, PortName, ServiceName,
    SignalHandlingMode, ipc,
};
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use iceoryx2::service::port_factory::{publish_subscribe, request_response};

use crate::control::{CONTROL_SCHEMA, CONTROL_SIZES, RawClient, RawServer};
use crate::error::{BusError, of_iceoryx};
use crate::membership::{InstanceLock, Membership};
use crate::message::Header;
use crate::mismatch::{OpenError, Trouble};
use crate::paths::InstancePaths;
use crate::port::{RawReader, RawWriter};
use crate::ports::Port;
use crate::time::{Span, Time};
use crate::topic::{CONTROL, TopicSpec};

/// Maximum number of processes (nodes of iceoryx2) in one instance.
const MAX_NODES: usize = 24;
/// Maximum number of connected operators.
const MAX_CLIENTS: usize = 8;
/// Time-out of the clean-up after a dead process; the next process that joins completes it.
const CLEANUP_TIMEOUT: Duration = Duration::from_millis(500);
/// Longest time from the loss of a killed process's memory to that of its locks.
const LONGEST_END: Span = Span::from_millis(1000);
/// Period of the checks whether a killed process has ended.
const END_POLL_PERIOD: Duration = Duration::from_millis(5);

type TopicService = publish_subscribe::PortFactory<ipc::Service, [u8], Header>;
type ControlService = request_response::PortFactory<ipc::Service, [u8], (), [u8], ()>;

/// Place of a reader at a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ReaderPlace {
    /// A place reserved for the loop, the recorder of a flight, and operators.
    Reserved,
    /// A place reserved for observers.
    Observer,
}

impl ReaderPlace {
    /// Name of the reader's port, by which observers are counted.
    const fn name(self) -> &'static str {
        match self {
            Self::Reserved => "reserved",
            Self::Observer => "observer",
        }
    }
}

/// Opens the ports of an instance. This trait keeps the code of iceoryx2 in one place, so that it is compiled once, including its
/// destructors.
pub(crate) trait OpenPorts: fmt::Debug {
    fn writer(&self, topic: &TopicSpec) -> Result<Box<dyn RawWriter>, BusError>;
    fn holder(&self, topic: &TopicSpec) -> Result<Option<String>, BusError>;
    fn observers(&self, topic: &TopicSpec) -> Result<Vec<String>, BusError>;
    fn reader(
        &self,
        topic: &TopicSpec,
        buffer: usize,
        place: ReaderPlace,
    ) -> Result<Box<dyn RawReader>, BusError>;
    fn server(&self) -> Result<Box<dyn RawServer>, BusError>;
    fn client(&self) -> Result<Box<dyn RawClient>, BusError>;
}

/// Node of a process in an instance.
#[derive(Debug)]
pub(crate) struct InstanceNode {
    /// The iceoryx2 node; `None` only while this value is being dropped.
    node: Option<Node<ipc::Service>>,
    paths: InstancePaths,
    membership: Rc<Membership>,
}

impl InstanceNode {
    /// Adds a node to the instance; files of dead nodes are removed.
    ///
    /// # Errors
    /// The instance belongs to another user, or the operating system refuses.
    pub(crate) fn join(
        paths: &InstancePaths,
        membership: &Rc<Membership>,
    ) -> Result<Self, BusError> {
        let mut config = membership.config()?;
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        let lock = membership.lock()?;
        let created = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create();
        let node = created.map_err(|error| match error {
            NodeCreationFailure::InsufficientPermissions => {
                BusError::Permission { path: paths.root.clone() }
            }
            other => of_iceoryx(format!("joining {}", paths.directory().display()), &other),
        })?;
        clean_up(&node, &lock);
        lock.remove_half_made();
        lock.make_private();
        Ok(Self { node: Some(node), paths: paths.clone(), membership: Rc::clone(membership) })
    }

    fn node(&self) -> &Node<ipc::Service> {
        self.node.as_ref().expect("a node exists until it is dropped")
    }

    /// Opens the service `name` using `open`. The caller holds the lock, so incomplete files were left by a dead process: they
    /// are removed, and `open` is tried again.
    fn open<S, E: OpenError>(
        &self,
        lock: &InstanceLock<'_>,
        name: &str,
        open: impl Fn() -> Result<S, E>,
    ) -> Result<S, BusError> {
        match open() {
            Err(error) if matches!(error.trouble(), Trouble::Corrupted | Trouble::System) => {
                clean_up(self.node(), lock);
                lock.remove_half_made();
                open().map_err(|error| error.explain(&self.paths, name))
            }
            other => other.map_err(|error| error.explain(&self.paths, name)),
        }
    }

    /// Port of a newly opened service, with its memory allocated.
    fn port<P>(
        &self,
        lock: &InstanceLock<'_>,
        port: P,
        name: &'static str,
    ) -> Result<Box<Port<P>>, BusError> {
        let port = Box::new(Port::new(port, name, &self.membership));
        lock.reserve_memory()?;
        Ok(port)
    }

    /// Process id of the writer of a topic; `None` without one. The end of a killed process is awaited for [`LONGEST_END`].
    fn lasting_writer(&self, lock: &InstanceLock<'_>, service: &TopicService) -> Option<u32> {
        let began = Time::now();
        loop {
            let pid = writer(service)?;
            if !is_ending(pid) || Time::now().since(began) > LONGEST_END {
                return Some(pid);
            }
            clean_up(self.node(), lock);
            std::thread::sleep(END_POLL_PERIOD);
        }
    }

    fn topic(&self, lock: &InstanceLock<'_>, topic: &TopicSpec) -> Result<TopicService, BusError> {
        let (name, verifier) = (service_name(topic.name)?, schema_attribute(topic.schema)?);
        self.open(lock, topic.name, || {
            self.node()
                .service_builder(&name)
                .publish_subscribe::<[u8]>()
                .user_header::<Header>()
                .history_size(topic.quality.history)
                .subscriber_max_buffer_size(topic.quality.buffer)
                .enable_safe_overflow(true)
                .max_publishers(1)
                .max_subscribers(topic.quality.readers)
                .max_nodes(MAX_NODES)
                .open_or_create_with_attributes(&verifier)
        })
    }

    fn control(&self, lock: &InstanceLock<'_>) -> Result<ControlService, BusError> {
        let (name, verifier) = (service_name(CONTROL)?, schema_attribute(CONTROL_SCHEMA)?);
        self.open(lock, CONTROL, || {
            self.node()
                .service_builder(&name)
                .request_response::<[u8], [u8]>()
                .max_servers(1)
                .max_clients(MAX_CLIENTS)
                .max_nodes(MAX_NODES)
                .open_or_create_with_attributes(&verifier)
        })
    }
}

impl OpenPorts for InstanceNode {
    fn writer(&self, topic: &TopicSpec) -> Result<Box<dyn RawWriter>, BusError> {
        let lock = self.membership.lock()?;
        let service = self.topic(&lock, topic)?;
        let create = || service.publisher_builder().initial_max_slice_len(topic.size).create();
        let created = match create() {
            Err(PublisherCreateError::ExceedsMaxSupportedPublishers)
                if self.lasting_writer(&lock, &service).is_none() =>
            {
                create()
            }
            created => created,
        };
        let publisher = created.map_err(|error| match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => BusError::Held {
                topic: topic.name,
                instance: self.paths.instance.clone(),
                holder: writer(&service).map_or_else(|| "another process".to_owned(), command_of),
            },
            other => of_iceoryx(format!("writing topic `{}`", topic.name), &other),
        })?;
        Ok(self.port(&lock, publisher, topic.name)?)
    }

    fn holder(&self, topic: &TopicSpec) -> Result<Option<String>, BusError> {
        let lock = self.membership.lock()?;
        let writer = writer(&self.topic(&lock, topic)?);
        Ok(writer.filter(|pid| !is_ending(*pid)).map(command_of))
    }

    fn observers(&self, topic: &TopicSpec) -> Result<Vec<String>, BusError> {
        let lock = self.membership.lock()?;
        let living =
            observers(&self.topic(&lock, topic)?).into_iter().filter(|pid| !is_ending(*pid));
        Ok(living.map(command_of).collect())
    }

    fn reader(
        &self,
        topic: &TopicSpec,
        buffer: usize,
        place: ReaderPlace,
    ) -> Result<Box<dyn RawReader>, BusError> {
        let lock = self.membership.lock()?;
        let service = self.topic(&lock, topic)?;
        if place == ReaderPlace::Observer {
            admit_observer(&service, topic)?;
        }
        let failed = |e: &dyn fmt::Debug| of_iceoryx(format!("reading topic `{}`", topic.name), e);
        let name = PortName::new(place.name()).map_err(|e| failed(&e))?;
        let created = service.subscriber_builder().buffer_size(buffer).name(&name).create();
        Ok(self.port(&lock, created.map_err(|e| failed(&e))?, topic.name)?)
    }

    fn server(&self) -> Result<Box<dyn RawServer>, BusError> {
        let lock = self.membership.lock()?;
        let builder = self.control(&lock)?;
        let created = builder.server_builder().initial_max_slice_len(CONTROL_SIZES.1).create();
        let server = created.map_err(|e| of_iceoryx(format!("serving `{CONTROL}`"), &e))?;
        Ok(self.port(&lock, server, CONTROL)?)
    }

    fn client(&self) -> Result<Box<dyn RawClient>, BusError> {
        let lock = self.membership.lock()?;
        let builder = self.control(&lock)?;
        let created = builder.client_builder().initial_max_slice_len(CONTROL_SIZES.0).create();
        let client = created.map_err(|e| of_iceoryx(format!("asking `{CONTROL}`"), &e))?;
        Ok(self.port(&lock, client, CONTROL)?)
    }
}

impl Drop for InstanceNode {
    fn drop(&mut self) {
        let lock = self.membership.lock_to_close();
        // Without the lock, the next process that joins cleans up.
        let (Some(node), Some(lock)) = (self.node.take(), lock) else { return };
        clean_up(&node, &lock);
        // The files of the node, too, are removed under the lock.
        drop(node);
    }
}

/// Removes what dead processes left.
fn clean_up(node: &Node<ipc::Service>, lock: &InstanceLock<'_>) {
    lock.remove_empty();
    node.blocking_cleanup_dead_nodes(CLEANUP_TIMEOUT);
}

/// Refuses another observer of a topic that has its maximum number of them. The caller holds the lock, under which readers are
/// opened and closed.
fn admit_observer(service: &TopicService, topic: &TopicSpec) -> Result<(), BusError> {
    let holders: Vec<String> = observers(service).into_iter().map(command_of).collect();
    if holders.len() < topic.quality.observers {
        return Ok(());
    }
    Err(BusError::Crowded { topic: topic.name, count: holders.len(), holders: holders.join(", ") })
}

/// Process ids of the observers of a topic.
fn observers(service: &TopicService) -> Vec<u32> {
    let mut pids = Vec::new();
    service.dynamic_config().list_subscribers(|reader| {
        if reader.subscriber_name.as_str() == ReaderPlace::Observer.name() {
            pids.push(pid_of(&reader.node_id));
        }
        CallbackProgression::Continue
    });
    pids
}

/// Process id of the writer of a topic; `None` without one.
fn writer(service: &TopicService) -> Option<u32> {
    let mut pid = None;
    service.dynamic_config().list_publishers(|writer| {
        pid = Some(pid_of(&writer.node_id));
        CallbackProgression::Stop
    });
    pid
}

/// Process id of a node; 0 if it is unknown.
fn pid_of(node: &UniqueNodeId) -> u32 {
    node.pid::<ipc::Service>().map_or(0, |pid| pid.value()).unsigned_abs()
}

/// Process id, program and first argument of a process, as in "`oqtal record` (123)".
fn command_of(pid: u32) -> String {
    let words = command_line(pid).map(|word| word.rsplit('/').next().unwrap_or("").to_owned());
    if words[0].is_empty() {
        return format!("a process that is ending ({pid})");
    }
    format!("`{}` ({pid})", words.join(" ").trim_end())
}

/// Whether a process has been killed but has not ended yet.
fn is_ending(pid: u32) -> bool {
    command_line(pid)[0].is_empty()
}

/// Program and first argument of a process; empty if there are none.
fn command_line(pid: u32) -> [String; 2] {
    let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let mut words = line.split(|byte| *byte == 0).map(String::from_utf8_lossy);
    [(); 2].map(|()| words.next().unwrap_or_default().into_owned())
}

fn service_name(name: &str) -> Result<ServiceName, BusError> {
    ServiceName::new(name).map_err(|e| of_iceoryx(format!("naming `{name}`"), &e))
}

/// Attribute with which both ends of a service verify that they were built from the same definitions.
fn schema_attribute(schema: u64) -> Result<AttributeVerifier, BusError> {
    let failed = |e: &dyn fmt::Debug| of_iceoryx("naming a schema", e);
    let key = AttributeKey::try_from("schema").map_err(|e| failed(&e))?;
    let value = AttributeValue::try_from(format!("{schema:016x}").as_str());
    let value = value.map_err(|e| failed(&e))?;
    AttributeVerifier::new().require(&key, &value).map_err(|e| failed(&e))
}
