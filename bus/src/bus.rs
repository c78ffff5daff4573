//! An instance of the bus: joining, opening ports, leaving.

use std::rc::Rc;

use rustix::process::{Resource, getrlimit};

use crate::control::{ControlClient, ControlServer};
use crate::error::{BusError, free_kib, system};
use crate::membership::Membership;
use crate::message::Message;
use crate::node::{InstanceNode, OpenPorts, ReaderPlace};
use crate::paths::InstancePaths;
use crate::port::{Reader, Writer};
use crate::stop::{self, SignalFlags, StopSwitch};
use crate::topic::Topic;
use crate::transport::Transport;
use crate::wake::{Listener, Notifier};
use crate::watch::InstanceWatch;

/// Maximum shared memory for the ports of one process \[KiB\], rounded up; the daemon needs most. No process joins with less.
pub const NEEDED_KIB: u64 = 7 * 1024;
/// Maximum shared memory that the processes of one flight have in use together \[KiB\], rounded up.
pub const FLIGHT_KIB: u64 = 21 * 1024;

/// Maximum number of open files of a process \[-\]; the daemon has about a hundred, receiver and daemon in one process 165.
const NEEDED_FILES: u64 = 200;

/// Access of a process (or a thread) to one instance. Ports stay on the thread that opened them. The process leaves the instance
/// when the bus and its ports are dropped; the last process to leave removes the files of the instance.
#[derive(Debug)]
pub struct Bus {
    node: Box<dyn OpenPorts>,
    paths: InstancePaths,
    membership: Rc<Membership>,
    signals: SignalFlags,
    place: ReaderPlace,
}

impl Bus {
    /// Joins the instance at `paths`; files left there by dead processes are removed.
    ///
    /// # Errors
    /// The instance belongs to another user, shared memory is full, or the operating system refuses.
    pub fn open(paths: &InstancePaths) -> Result<Self, BusError> {
        check_descriptors()?;
        paths.prepare()?;
        check_free_memory()?;
        let membership = Membership::join(paths)?;
        let node = Box::new(InstanceNode::join(paths, &membership)?);
        let signals = SignalFlags::default();
        let place = ReaderPlace::Reserved;
        Ok(Self { node, paths: paths.clone(), membership, signals, place })
    }

    /// Joins the instance at `paths` if it has members; `None` otherwise. Creates no directory, and removes nothing of an instance
    /// without members. If this process is the last to leave, the configuration of the daemon remains: it may have been killed.
    ///
    /// # Errors
    /// Like [`Bus::open`].
    pub fn open_running(paths: &InstancePaths) -> Result<Option<Self>, BusError> {
        match std::fs::symlink_metadata(&paths.root) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) if error.kind() == std::io::ErrorKind::PermissionDenied => {
                Err(BusError::Permission { path: paths.root.clone() })
            }
            Err(error) => Err(system(format!("opening {}", paths.root.display()), &error)),
            Ok(_) => {
                paths.prepare()?;
                Membership::exists(paths).then(|| Self::open(paths).map(Self::visiting)).transpose()
            }
        }
    }

    /// Watch over the files of the instance, for a thread that may block.
    ///
    /// # Errors
    /// The process has too many open files.
    pub fn watch(&self) -> Result<InstanceWatch, BusError> {
        let files = self.membership.files();
        let (home, run, members) = files.map_err(|e| system("watching the instance", &e))?;
        Ok(InstanceWatch::new(home, run, members))
    }

    /// Whether files of the run of the instance in which this process takes part were removed or moved: other processes join the next
    /// run.
    pub fn is_lost(&self) -> bool {
        self.membership.is_lost()
    }

    /// This bus for a process whose signal handlers set `signals`.
    pub fn with_signals(self, signals: SignalFlags) -> Self {
        Self { signals, ..self }
    }

    /// This bus for an observer, whose readers take the places for observers: [`BusError::Crowded`] if there is none. The configuration
    /// of the daemon remains as for [`Bus::open_running`].
    pub fn for_observer(self) -> Self {
        Self { place: ReaderPlace::Observer, ..self.visiting() }
    }

    fn visiting(self) -> Self {
        self.membership.keep_config();
        self
    }

    /// Paths and names of the instance.
    pub fn paths(&self) -> &InstancePaths {
        &self.paths
    }

    /// Name and id of the process that writes a topic, such as "`oqtal daemon` (123)"; `None` if no process does, or its writer is ending.
    ///
    /// # Errors
    /// The operating system refuses, or the topic was made by another version.
    pub fn holder<M: Message>(&self, topic: &Topic<M>) -> Result<Option<String>, BusError> {
        self.node.holder(&topic.spec())
    }

    /// Names and ids of the processes that observe a topic: recorders, pages, monitors.
    ///
    /// # Errors
    /// Like [`Bus::holder`].
    pub fn observers<M: Message>(&self, topic: &Topic<M>) -> Result<Vec<String>, BusError> {
        self.node.observers(&topic.spec())
    }

    /// Opens a listener for notifications of a topic.
    ///
    /// # Errors
    /// The operating system refuses, or the event was made by another version.
    pub fn listener<M: Message>(&self, topic: &Topic<M>) -> Result<Listener, BusError> {
        Listener::open(&self.membership, topic.name)
    }

    /// Opens the daemon's side of the control service.
    ///
    /// # Errors
    /// Another daemon is serving this instance.
    pub fn control_server(&self) -> Result<ControlServer, BusError> {
        Ok(ControlServer::new(self.node.server()?))
    }

    /// Opens an operator's side of the control service.
    ///
    /// # Errors
    /// The operating system refuses, or too many operators are connected.
    pub fn control_client(&self) -> Result<ControlClient, BusError> {
        Ok(ControlClient::new(self.node.client()?))
    }
}

impl Transport for Bus {
    type Writer<M: Message> = Writer<M>;
    type Reader<M: Message> = Reader<M>;

    fn writer<M: Message>(&self, topic: &Topic<M>) -> Result<Writer<M>, BusError> {
        let raw = self.node.writer(&topic.spec())?;
        Ok(Writer::new(raw, Notifier::open(&self.membership, topic.name)?))
    }

    fn reader<M: Message>(&self, topic: &Topic<M>) -> Result<Reader<M>, BusError> {
        Ok(Reader::new(self.node.reader(&topic.spec(), 1, self.place)?, topic.name))
    }

    fn stop_switch(&self) -> Result<StopSwitch, BusError> {
        let _lock = self.membership.lock()?;
        let path = self.membership.words_file(stop::FILE);
        Ok(StopSwitch::open(path)?.with_signals(self.signals.clone()))
    }

    fn observer<M: Message>(&self, topic: &Topic<M>) -> Result<Reader<M>, BusError> {
        let reader = self.node.reader(&topic.spec(), topic.quality.buffer, self.place)?;
        Ok(Reader::new(reader, topic.name))
    }
}

/// Checks that the process may open all files of its ports: otherwise iceoryx2 would report an internal error.
fn check_descriptors() -> Result<(), BusError> {
    match getrlimit(Resource::Nofile).current {
        Some(allowed) if allowed < NEEDED_FILES => {
            Err(BusError::Descriptors { allowed, needed: NEEDED_FILES })
        }
        _ => Ok(()),
    }
}

/// Checks that the ports of a process fit into shared memory, before iceoryx2 maps files that have no memory allocated.
fn check_free_memory() -> Result<(), BusError> {
    match free_kib() {
        Some(free_kib) if free_kib < NEEDED_KIB => {
            Err(BusError::Full { free_kib, needed_kib: NEEDED_KIB })
        }
        // An unknown size: the error is reported when the first file is opened there.
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests;
