//! Writers, readers, doorbells and the control service: iceoryx2 behind the few operations that the processes use.

use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::node::NodeCreationFailure;
use iceoryx2::port::client::Client;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::server::Server;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    Config, EventId, FileName, Node, NodeBuilder, SemanticString, ServiceName, SignalHandlingMode, ipc,
};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};

use crate::message::{ControlRequestV1, ControlResponseV1, Header, Message, Stamps};
use crate::time::{Span, Time};
use crate::topic::{CONTROL, Topic};

/// How many processes may touch one instance at once.
const MAX_NODES: usize = 24;
/// Sent to a listener when a notifier's process died.
const DEAD_WRITER: EventId = EventId::new(3);

/// What can go wrong on the bus, each with the object and the remedy in its message.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// The topic has its one writer already.
    #[error(
        "topic `{topic}` of instance `{instance}` already has a writer; stop that process first, or use another --instance"
    )]
    Held {
        /// The topic.
        topic: &'static str,
        /// The instance.
        instance: String,
    },
    /// The other side was built from another version of the messages.
    #[error(
        "topic `{topic}` is spoken in another version by a running process; stop it and start all processes from one build"
    )]
    Version {
        /// The topic.
        topic: String,
    },
    /// The instance belongs to another user.
    #[error("no permission for {}; run as the user that owns it, or give another --root", path.display())]
    Permission {
        /// The root path of the instance.
        path: PathBuf,
    },
    /// A name that cannot be part of the file names behind an instance.
    #[error("{what} `{value}` cannot be used: {rule}")]
    Name {
        /// What is named.
        what: &'static str,
        /// The name.
        value: String,
        /// What a name may be.
        rule: &'static str,
    },
    /// The operating system refused.
    #[error("{action} failed: {reason}")]
    System {
        /// What was tried.
        action: String,
        /// What came back.
        reason: String,
    },
}

/// Where a bus lives: two buses with different places never hear each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The instance, `[a-z0-9-]{1,32}`.
    pub instance: String,
    /// The directory of its service files.
    pub root: PathBuf,
}

impl Place {
    /// A place for `instance`; the root is `root` if given, else `/run/oqtal` if writable, else `$XDG_RUNTIME_DIR/oqtal`,
    /// else `/tmp/oqtal-UID`.
    ///
    /// # Errors
    /// The instance name is not `[a-z0-9-]{1,32}`.
    pub fn new(instance: &str, root: Option<&Path>) -> Result<Self, BusError> {
        let legal = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'-';
        if !(1..=32).contains(&instance.len()) || !instance.bytes().all(legal) {
            return Err(BusError::Name {
                what: "instance",
                value: instance.to_owned(),
                rule: "use 1 to 32 of a-z, 0-9 and -",
            });
        }
        let root = root.map_or_else(default_root, Path::to_path_buf);
        Ok(Self { instance: instance.to_owned(), root })
    }

    fn config(&self) -> Result<Config, BusError> {
        let mut root = self.root.to_string_lossy().into_owned();
        if !root.ends_with('/') {
            root.push('/');
        }
        let bad_root = || BusError::Name {
            what: "root",
            value: root.clone(),
            rule: "use an absolute path of plain characters, at most 200 long",
        };
        let path = iceoryx2::prelude::Path::new(root.as_bytes()).map_err(|_| bad_root())?;
        if !self.root.is_absolute() || root.len() > 200 {
            return Err(bad_root());
        }
        let prefix = format!("oqtal_{}_", self.instance);
        let mut config = Config::default();
        // Shared memory ignores the root path and files ignore the prefix: an instance needs both.
        config.global.set_root_path(&path);
        config.global.prefix = FileName::new(prefix.as_bytes()).map_err(|_| bad_root())?;
        Ok(config)
    }
}

fn default_root() -> PathBuf {
    let writable = |path: &Path| rustix::fs::access(path, rustix::fs::Access::WRITE_OK).is_ok();
    let run = Path::new("/run/oqtal");
    if writable(run) || (!run.exists() && writable(Path::new("/run"))) {
        return run.to_path_buf();
    }
    match std::env::var_os("XDG_RUNTIME_DIR") {
        Some(directory) if writable(Path::new(&directory)) => Path::new(&directory).join("oqtal"),
        _ => PathBuf::from(format!("/tmp/oqtal-{}", rustix::process::getuid().as_raw())),
    }
}

/// A process's (or a thread's) access to one instance. Ports stay with the thread that opened them.
#[derive(Debug)]
pub struct Bus {
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
        Ok(Self { node, place: place.clone() })
    }

    /// The place this bus lives at.
    #[must_use]
    pub fn place(&self) -> &Place {
        &self.place
    }

    /// Removes what processes that died without a word left behind.
    pub fn clean_up_dead(&self) {
        self.node.blocking_cleanup_dead_nodes(Duration::from_millis(500));
    }

    /// The one writer of a topic.
    ///
    /// # Errors
    /// The topic has a writer already, or speaks another version.
    pub fn writer<M: Message>(&self, topic: &Topic<M>) -> Result<Writer<M>, BusError> {
        let publisher = self.topic_service(topic)?.publisher_builder().create().map_err(|error| match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => {
                BusError::Held { topic: topic.name, instance: self.place.instance.clone() }
            }
            other => system(format!("writing topic `{}`", topic.name), &other),
        })?;
        Ok(Writer {
            publisher,
            bell: self.ringer(topic.name)?,
            topic: topic.name,
            source: u64::from(std::process::id()),
            sequence: 0,
        })
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
        let listener = self.event_service(topic.name)?.listener_builder().create();
        Ok(Doorbell { listener: listener.map_err(|e| system(format!("listening to `{}`", topic.name), &e))? })
    }

    /// The daemon's end of the control service.
    ///
    /// # Errors
    /// Another daemon serves this instance.
    pub fn control_server(&self) -> Result<ControlServer, BusError> {
        let server = self.control_service()?.server_builder().create();
        Ok(ControlServer { server: server.map_err(|e| system(format!("serving `{CONTROL}`"), &e))? })
    }

    /// An operator's end of the control service.
    ///
    /// # Errors
    /// The operating system refuses, or too many operators speak at once.
    pub fn control_client(&self) -> Result<ControlClient, BusError> {
        let client = self.control_service()?.client_builder().create();
        Ok(ControlClient { client: client.map_err(|e| system(format!("asking `{CONTROL}`"), &e))? })
    }

    fn reader_with_buffer<M: Message>(&self, topic: &Topic<M>, buffer: usize) -> Result<Reader<M>, BusError> {
        let subscriber = self.topic_service(topic)?.subscriber_builder().buffer_size(buffer).create();
        Ok(Reader {
            subscriber: subscriber.map_err(|e| system(format!("reading topic `{}`", topic.name), &e))?,
            topic: topic.name,
            last_sequence: 0,
            lost: 0,
        })
    }

    fn ringer(&self, name: &'static str) -> Result<Notifier<ipc::Service>, BusError> {
        let notifier = self.event_service(name)?.notifier_builder().create();
        notifier.map_err(|e| system(format!("notifying `{name}`"), &e))
    }

    fn topic_service<M: Message>(
        &self,
        topic: &Topic<M>,
    ) -> Result<iceoryx2::service::port_factory::publish_subscribe::PortFactory<ipc::Service, M, Header>, BusError>
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

    fn event_service(
        &self,
        name: &str,
    ) -> Result<iceoryx2::service::port_factory::event::PortFactory<ipc::Service>, BusError> {
        self.node
            .service_builder(&service_name(name)?)
            .event()
            .notifier_dead_event(DEAD_WRITER)
            .max_nodes(MAX_NODES)
            .open_or_create()
            .map_err(|e| system(format!("opening event `{name}`"), &e))
    }

    fn control_service(
        &self,
    ) -> Result<
        iceoryx2::service::port_factory::request_response::PortFactory<
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
            PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(Open::InsufficientPermissions) => {
                BusError::Permission { path: self.place.root.clone() }
            }
            other => system(format!("opening topic `{topic}`"), &other),
        }
    }
}

fn service_name(name: &str) -> Result<ServiceName, BusError> {
    ServiceName::new(name).map_err(|e| system(format!("naming `{name}`"), &e))
}

fn system(action: String, reason: &dyn std::fmt::Debug) -> BusError {
    BusError::System { action, reason: format!("{reason:?}") }
}

/// The writing end of a topic.
#[derive(Debug)]
pub struct Writer<M: Message> {
    publisher: Publisher<ipc::Service, M, Header>,
    bell: Notifier<ipc::Service>,
    topic: &'static str,
    source: u64,
    sequence: u64,
}

impl<M: Message> Writer<M> {
    /// Publishes `body` about the pose `pose_sequence`; returns the sequence it got. Wakes nobody.
    ///
    /// # Errors
    /// The shared memory is gone.
    pub fn send(&mut self, pose_sequence: u64, stamps: Stamps, body: M) -> Result<u64, BusError> {
        let failed = |reason: &dyn std::fmt::Debug| system(format!("publishing on `{}`", self.topic), reason);
        let mut sample = self.publisher.loan_uninit().map_err(|e| failed(&e))?;
        let sequence = self.sequence + 1;
        *sample.user_header_mut() =
            Header { sequence, pose_sequence, schema: M::SCHEMA, source: self.source, stamps };
        sample.write_payload(body).send().map_err(|e| failed(&e))?;
        self.sequence = sequence;
        Ok(sequence)
    }

    /// The sequence that the next [`Writer::send`] gives out.
    #[must_use]
    pub fn next_sequence(&self) -> u64 {
        self.sequence + 1
    }

    /// Wakes whoever holds a [`Doorbell`] of this topic.
    ///
    /// # Errors
    /// The event's shared memory is gone.
    pub fn notify(&self) -> Result<(), BusError> {
        self.bell.notify().map(drop).map_err(|e| system(format!("notifying `{}`", self.topic), &e))
    }
}

/// The reading end of a topic.
#[derive(Debug)]
pub struct Reader<M: Message> {
    subscriber: Subscriber<ipc::Service, M, Header>,
    topic: &'static str,
    last_sequence: u64,
    lost: u64,
}

impl<M: Message> Reader<M> {
    /// The next sample, oldest first; `None` when there is none.
    ///
    /// # Errors
    /// The writer speaks another version, or the connection broke.
    pub fn next(&mut self) -> Result<Option<(Header, M)>, BusError> {
        let sample = self.subscriber.receive();
        let Some(sample) = sample.map_err(|e| system(format!("reading `{}`", self.topic), &e))? else {
            return Ok(None);
        };
        let header = *sample.user_header();
        if header.schema != M::SCHEMA {
            return Err(BusError::Version { topic: self.topic.to_owned() });
        }
        // A writer that restarted counts from 1 again; that is not a loss.
        if self.last_sequence > 0 && header.sequence > self.last_sequence {
            self.lost += header.sequence - self.last_sequence - 1;
        }
        self.last_sequence = header.sequence;
        Ok(Some((header, *sample.payload())))
    }

    /// The newest sample; older ones are passed over. `None` when nothing came since the last call.
    ///
    /// # Errors
    /// As [`Reader::next`].
    pub fn latest(&mut self) -> Result<Option<(Header, M)>, BusError> {
        let mut newest = None;
        while let Some(sample) = self.next()? {
            newest = Some(sample);
        }
        Ok(newest)
    }

    /// Samples missed so far, by the gaps in their sequence.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

/// Wakes a process when its topic is notified.
#[derive(Debug)]
pub struct Doorbell {
    listener: Listener<ipc::Service>,
}

impl Doorbell {
    /// Sleeps until the bell rings or `deadline` has passed, at most `longest`. Returns at once if it rang meanwhile.
    ///
    /// # Errors
    /// The event's shared memory is gone.
    pub fn wait(&self, deadline: Option<Time>, longest: Span) -> Result<(), BusError> {
        let left = deadline.map_or(longest, |deadline| deadline.since(Time::now()).min(longest));
        let waited = if left <= Span::ZERO {
            self.listener.try_wait(|_| {})
        } else {
            self.listener.timed_wait(|_| {}, left.to_duration())
        };
        waited.map(drop).map_err(|e| system("waiting".to_owned(), &e))
    }
}

/// The daemon's end of the control service.
#[derive(Debug)]
pub struct ControlServer {
    server: Server<ipc::Service, ControlRequestV1, (), ControlResponseV1, ()>,
}

impl ControlServer {
    /// Answers every request that waits, by `answer`.
    ///
    /// # Errors
    /// The connection broke; an operator who went away before the answer is no error.
    pub fn serve(
        &self,
        mut answer: impl FnMut(ControlRequestV1) -> ControlResponseV1,
    ) -> Result<(), BusError> {
        let failed = |e: &dyn std::fmt::Debug| system(format!("serving `{CONTROL}`"), e);
        while let Some(request) = self.server.receive().map_err(|e| failed(&e))? {
            let response = answer(*request.payload());
            if let Ok(loan) = request.loan_uninit() {
                // An error here means that the operator hung up: nobody is left to tell.
                let _ = loan.write_payload(response).send();
            }
        }
        Ok(())
    }
}

/// An operator's end of the control service.
#[derive(Debug)]
pub struct ControlClient {
    client: Client<ipc::Service, ControlRequestV1, (), ControlResponseV1, ()>,
}

impl ControlClient {
    /// Asks, and waits for the answer; `None` if nobody answers within `patience`.
    ///
    /// # Errors
    /// The connection broke.
    pub fn ask(
        &self,
        request: ControlRequestV1,
        patience: Span,
    ) -> Result<Option<ControlResponseV1>, BusError> {
        let failed = |e: &dyn std::fmt::Debug| system(format!("asking `{CONTROL}`"), e);
        let give_up = Time::now() + patience;
        loop {
            let pending = self.client.send_copy(request).map_err(|e| failed(&e))?;
            while pending.number_of_server_connections() > 0 && Time::now() < give_up {
                if let Some(response) = pending.receive().map_err(|e| failed(&e))? {
                    return Ok(Some(*response));
                }
                std::thread::sleep(Duration::from_millis(2));
            }
            if Time::now() >= give_up {
                return Ok(None);
            }
            // No daemon was there to hear the request: ask again when one may be.
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}
