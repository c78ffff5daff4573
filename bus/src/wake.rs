//! Sleeping until a topic is notified or an instant has come.
//!
//! iceoryx2 wakes a listener through a Unix datagram, which costs two or three times what the kernel's own wake-up costs, and
//! its timed wait counts in ticks of the kernel (4 ms at 250 Hz). iceoryx2 lets a service variant bring a wake-up of its own:
//! [`FutexService`] is its `ipc::Service` but for events, which end in a futex on a word in the listener's shared memory. Data
//! is untouched. Stock events stay selectable ([`Events::Socket`]); there the socket is polled, which keeps to the microsecond.
//!
//! What can be lost when a process is killed between two instructions is one wake-up, never the event itself: every sleep is
//! bounded, and whoever wakes looks at every port.

use std::fmt::Debug;
use std::mem::MaybeUninit;
use std::os::fd::BorrowedFd;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::port::listener::{Listener as IceListener, ListenerWaitError};
use iceoryx2::port::notifier::Notifier as IceNotifier;
use iceoryx2::prelude::{
    EventId, FileDescriptorBased, FileName, Node, Path, ServiceName, ZeroCopySend, ipc,
};
use iceoryx2::service::Service;
use iceoryx2::service::internal::ServiceInternal;
use iceoryx2::service::port_factory::event::PortFactory;
use iceoryx2_bb_elementary_traits::testing::abandonable::Abandonable;
use iceoryx2_bb_lock_free::mpmc::counting_bit_set::RelocatableCountingBitSet;
use iceoryx2_cal::dynamic_storage::posix_shared_memory::Storage;
use iceoryx2_cal::event::common::EventImpl;
use iceoryx2_cal::event::trigger::{Configuration, HandlerInterface, State, WaiterInterface};
use iceoryx2_cal::event::{ListenerCreateError, NotifierNotifyError, NotifierOpenError};
use iceoryx2_cal::named_concept::{NamedConceptPathHintRemoveError, NamedConceptRemoveError};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::thread::futex;
use serde::{Deserialize, Serialize};

use crate::bus::join;
use crate::error::{BusError, system};
use crate::mismatch::OpenError;
use crate::paths::InstancePaths;
use crate::time::{Span, Time};

/// Sent to a listener when a notifier's process died: it wakes up, which is all that is wanted of it.
const DEAD_WRITER: EventId = EventId::new(3);

/// Somebody else may be removing the same remains: for so long they are waited for.
const PATIENCE: Duration = Duration::from_millis(500);

/// What wakes a sleeping process. All processes of an instance use the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Events {
    /// A futex in shared memory: nearest to what the kernel can do.
    #[default]
    Futex,
    /// iceoryx2's own: a Unix datagram socket.
    Socket,
}

/// Where events are opened.
#[derive(Debug)]
pub(crate) struct EventPorts {
    node: EventNode,
    place: InstancePaths,
    max_nodes: usize,
}

#[derive(Debug)]
enum EventNode {
    Futex(Node<FutexService>),
    Socket(Node<ipc::Service>),
}

impl EventPorts {
    /// # Errors
    /// The operating system refuses.
    pub(crate) fn open(
        config: &Config,
        place: &InstancePaths,
        max_nodes: usize,
    ) -> Result<Self, BusError> {
        let node = match place.events {
            Events::Futex => EventNode::Futex(join(config, place)?),
            Events::Socket => EventNode::Socket(join(config, place)?),
        };
        Ok(Self { node, place: place.clone(), max_nodes })
    }

    /// Removes what processes left behind that died without a word.
    pub(crate) fn remove_the_dead(&self) {
        match &self.node {
            EventNode::Futex(node) => drop(node.blocking_cleanup_dead_nodes(PATIENCE)),
            EventNode::Socket(node) => drop(node.blocking_cleanup_dead_nodes(PATIENCE)),
        }
    }

    /// What rings the bell `name`.
    ///
    /// # Errors
    /// The bell was made by another version, or the operating system refuses.
    pub(crate) fn ringer(&self, name: &str) -> Result<Notifier, BusError> {
        let failed = |e| system(format!("notifying `{name}`"), &e);
        Ok(match &self.node {
            EventNode::Futex(node) => {
                let event = self.event(node, &futex_name(name))?;
                Notifier::Futex(event.notifier_builder().create().map_err(failed)?)
            }
            EventNode::Socket(node) => {
                let event = self.event(node, name)?;
                Notifier::Socket(event.notifier_builder().create().map_err(failed)?)
            }
        })
    }

    /// What hears the bell `name`.
    ///
    /// # Errors
    /// As [`EventPorts::ringer`].
    pub(crate) fn listener(&self, name: &str) -> Result<Listener, BusError> {
        let failed = |e| system(format!("listening to `{name}`"), &e);
        Ok(match &self.node {
            EventNode::Futex(node) => {
                let event = self.event(node, &futex_name(name))?;
                Listener::Futex(event.listener_builder().create().map_err(failed)?)
            }
            EventNode::Socket(node) => {
                let event = self.event(node, name)?;
                Listener::Socket(event.listener_builder().create().map_err(failed)?)
            }
        })
    }

    fn event<S: Service>(&self, node: &Node<S>, name: &str) -> Result<PortFactory<S>, BusError> {
        let service =
            ServiceName::new(name).map_err(|e| system(format!("naming event `{name}`"), &e))?;
        node.service_builder(&service)
            .event()
            .notifier_dead_event(DEAD_WRITER)
            .max_nodes(self.max_nodes)
            .open_or_create()
            .map_err(|error| error.explain(&self.place.root, "event", name))
    }
}

/// The two kinds of events never meet: a listener of one kind cannot be woken by a notifier of the other.
fn futex_name(name: &str) -> String {
    format!("{name}/futex")
}

/// Wakes whoever listens.
#[derive(Debug)]
pub(crate) enum Notifier {
    Futex(IceNotifier<FutexService>),
    Socket(IceNotifier<ipc::Service>),
}

impl Notifier {
    pub(crate) fn ring(&self) -> Result<(), iceoryx2::port::notifier::NotifierNotifyError> {
        match self {
            Self::Futex(notifier) => notifier.notify().map(drop),
            Self::Socket(notifier) => notifier.notify().map(drop),
        }
    }
}

/// Wakes a process when its topic is notified.
#[derive(Debug)]
pub enum Listener {
    #[doc(hidden)]
    Futex(IceListener<FutexService>),
    #[doc(hidden)]
    Socket(IceListener<ipc::Service>),
}

impl Listener {
    /// Sleeps until the bell rings or `deadline` has passed, at most `longest`. Returns at once if it rang meanwhile, and
    /// may return early: whoever wakes looks at every port.
    ///
    /// # Errors
    /// The event's shared memory is gone.
    pub fn wait(&self, deadline: Option<Time>, longest: Span) -> Result<(), BusError> {
        let left = deadline.map_or(longest, |deadline| deadline.since(Time::now()).min(longest));
        let left = Duration::from_nanos(u64::try_from(left.nanos()).unwrap_or(0));
        let rung = match self {
            Self::Futex(listener) => listener.timed_wait(|_| {}, left),
            Self::Socket(listener) => {
                if !left.is_zero() {
                    sleep_on_socket(listener, left)?;
                }
                listener.try_wait(|_| {})
            }
        };
        match rung {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(error) => Err(system("waiting", &error)),
        }
    }
}

#[allow(unsafe_code)]
fn sleep_on_socket(
    listener: &IceListener<ipc::Service>,
    longest: Duration,
) -> Result<(), BusError> {
    let descriptor = listener.file_descriptor();
    // SAFETY: the listener owns the descriptor and outlives this borrow of it, which ends with the poll below; polling
    // neither reads from the descriptor nor closes it.
    let socket = unsafe { BorrowedFd::borrow_raw(descriptor.native_handle()) };
    match poll(&mut [PollFd::new(&socket, PollFlags::IN)], Some(&timespec(longest))) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => Err(system("waiting", &error)),
    }
}

fn timespec(duration: Duration) -> Timespec {
    Timespec {
        tv_sec: i64::try_from(duration.as_secs()).unwrap_or(i64::MAX),
        tv_nsec: duration.subsec_nanos().into(),
    }
}

/// iceoryx2's inter-process service with events by futex.
#[derive(Clone, Debug)]
pub struct FutexService;

/// What the stock service has.
type Stock = ipc::Service;

impl Service for FutexService {
    type StaticStorage = <Stock as Service>::StaticStorage;
    type ConfigSerializer = <Stock as Service>::ConfigSerializer;
    type PersistentDynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> =
        <Stock as Service>::PersistentDynamicStorage<T>;
    type Bag = <Stock as Service>::Bag;
    type DynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> =
        <Stock as Service>::DynamicStorage<T>;
    type ServiceNameHasher = <Stock as Service>::ServiceNameHasher;
    type SharedMemory = <Stock as Service>::SharedMemory;
    type ResizableSharedMemory = <Stock as Service>::ResizableSharedMemory;
    type Connection = <Stock as Service>::Connection;
    type Event = EventImpl<Activations, Word, WordStorage, Hand, Ear>;
    type Monitoring = <Stock as Service>::Monitoring;
    type Reactor = <Stock as Service>::Reactor;
    type ArcThreadSafetyPolicy<T: Send + Debug + Abandonable> =
        <Stock as Service>::ArcThreadSafetyPolicy<T>;
    type BlackboardMgmt<T: Send + Sync + Debug + ZeroCopySend + 'static> =
        <Stock as Service>::BlackboardMgmt<T>;
    type BlackboardPayload = <Stock as Service>::BlackboardPayload;
    type UniqueId = <Stock as Service>::UniqueId;
}

impl ServiceInternal<Self> for FutexService {}

type Activations = RelocatableCountingBitSet;
type WordStorage = Storage<State<Activations, Word>>;

const SILENT: u32 = 0;
const RUNG: u32 = 1;

/// The word that a listener sleeps on, in its shared memory.
#[derive(Debug)]
#[repr(C)]
#[doc(hidden)]
pub struct Word(AtomicU32);

// SAFETY: one atomic integer, which means the same in every process.
#[allow(unsafe_code)]
unsafe impl ZeroCopySend for Word {}

impl Word {
    /// # Safety
    /// The word must live as long as the reference is used.
    #[allow(unsafe_code)]
    unsafe fn outliving(word: *const Self) -> &'static Self {
        // SAFETY: the caller's promise; the word is only ever accessed atomically.
        unsafe { &*word }
    }

    fn ring(&self) -> Result<(), Errno> {
        self.0.store(RUNG, Ordering::Release);
        // Always, even if it was rung before: whoever rang may have been killed before this line.
        futex::wake(&self.0, futex::Flags::empty(), 1).map(drop)
    }

    fn silence(&self) {
        self.0.store(SILENT, Ordering::Release);
    }

    /// Sleeps while the bell is silent, on the monotonic clock.
    fn sleep(&self, longest: Option<Duration>) -> Result<(), ListenerWaitError> {
        let longest = longest.map(timespec);
        match futex::wait(&self.0, futex::Flags::empty(), SILENT, longest.as_ref()) {
            Ok(()) | Err(Errno::AGAIN | Errno::TIMEDOUT) => Ok(()),
            Err(Errno::INTR) => Err(ListenerWaitError::InterruptSignal),
            Err(_) => Err(ListenerWaitError::InternalFailure),
        }
    }
}

/// The listener's end of a word.
#[derive(Debug)]
#[doc(hidden)]
pub struct Ear(&'static Word);

impl Abandonable for Ear {
    #[allow(unsafe_code)]
    unsafe fn abandon_in_place(_: NonNull<Self>) {}
}

impl WaiterInterface<Activations, Word, WordStorage> for Ear {
    const IS_FILE_DESCRIPTOR_BASED: bool = false;

    #[allow(unsafe_code)]
    unsafe fn remove(_: &FileName, _: &Configuration) -> Result<bool, NamedConceptRemoveError> {
        // The word goes with the storage that it lives in.
        Ok(true)
    }

    fn remove_path_hint(_: &Path) -> Result<(), NamedConceptPathHintRemoveError> {
        Ok(())
    }

    #[allow(unsafe_code)]
    fn create(
        _: &FileName,
        _: &Configuration,
        word: &mut MaybeUninit<Word>,
    ) -> Result<Self, ListenerCreateError> {
        let word: *const Word = word.write(Word(AtomicU32::new(SILENT)));
        // SAFETY: the word lies in the shared memory of the listener's storage, which does not move, and which the listener
        // drops after its `Ear` (fields drop in the order of their declaration in `iceoryx2_cal::event::common::Waiter`).
        Ok(Self(unsafe { Word::outliving(word) }))
    }

    fn try_wait(&self) -> Result<(), ListenerWaitError> {
        self.empty_buffer()
    }

    fn timed_wait(&self, longest: Duration) -> Result<(), ListenerWaitError> {
        if !longest.is_zero() {
            self.0.sleep(Some(longest))?;
        }
        self.empty_buffer()
    }

    fn blocking_wait(&self) -> Result<(), ListenerWaitError> {
        self.0.sleep(None)?;
        self.empty_buffer()
    }

    fn empty_buffer(&self) -> Result<(), ListenerWaitError> {
        self.0.silence();
        Ok(())
    }
}

/// The notifier's end of a word.
#[derive(Debug)]
#[doc(hidden)]
pub struct Hand(&'static Word);

impl Abandonable for Hand {
    #[allow(unsafe_code)]
    unsafe fn abandon_in_place(_: NonNull<Self>) {}
}

impl HandlerInterface<Activations, Word, WordStorage> for Hand {
    #[allow(unsafe_code)]
    fn open(_: &FileName, _: &Configuration, word: &Word) -> Result<Self, NotifierOpenError> {
        // SAFETY: as in `Ear::create`: the storage stays mapped, even if its listener is gone, as long as the notifier's
        // handle, which holds it. `open` is the only way to make a `Hand`, and the handle the only place where one is kept;
        // nothing rings while the handle is dropped.
        Ok(Self(unsafe { Word::outliving(word) }))
    }

    fn notify(&self) -> Result<(), NotifierNotifyError> {
        self.0.ring().map_err(|_| NotifierNotifyError::InternalFailure)
    }
}
