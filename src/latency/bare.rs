//! What the machine gives bare: ways to hand a message to another process and wake it, without the bus.
//!
//! Each carries as many bytes as a pose with its header, is stamped before it is given and after it is taken, and is given
//! at the rate of the chain. The giving end of all of them is one process, [`super::camera`], which also feeds the chain;
//! each taking end is a process of its own, set up like the daemon.

mod eventfd;
mod futex;
mod iceoryx;
mod shared;
mod unix_datagram;

use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use iceoryx2::prelude::ZeroCopySend;
use oqtal_bus::message::{Header, Message, PoseV1};
use oqtal_bus::time::Time;
use oqtal_runtime::process::{Exit, Failure, Job, ProcessContext};
use rustix::event::EventfdFlags;
use rustix::process::Signal;

use super::record::Record;

pub use iceoryx::beside;

/// Words of a message: as many as a pose and its header have.
const WORDS: usize = (size_of::<Header>() + PoseV1::SIZE).div_ceil(8);

/// A message of the size of a pose with its header.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[type_name("oqtal.Parcel.v1")]
#[repr(C)]
pub struct Parcel {
    /// When it was given; [`Time::UNSET`] in the last one.
    given_at: Time,
    filling: [u64; WORDS - 1],
}

impl Parcel {
    /// A message given now.
    #[must_use]
    pub fn now() -> Self {
        Self { given_at: Time::now(), filling: [1; WORDS - 1] }
    }

    /// The message after which nothing comes.
    pub const LAST: Self = Self { given_at: Time::UNSET, filling: [0; WORDS - 1] };

    fn words(&self) -> [u64; WORDS] {
        let mut words = [0; WORDS];
        words[0] = self.given_at.nanos();
        words[1..].copy_from_slice(&self.filling);
        words
    }

    fn of_words(words: &[u64; WORDS]) -> Self {
        let mut filling = [0; WORDS - 1];
        filling.copy_from_slice(&words[1..]);
        Self { given_at: Time::from_nanos(words[0]), filling }
    }
}

/// The giving end.
pub trait Giver {
    /// Hands `parcel` over and wakes the taker.
    ///
    /// # Errors
    /// The operating system refuses.
    fn give(&mut self, parcel: &Parcel) -> Result<(), Failure>;
}

/// The taking end.
pub trait Taker {
    /// Sleeps until there is a message, as long as it takes, and takes it.
    ///
    /// # Errors
    /// The operating system refuses.
    fn take(&mut self) -> Result<Parcel, Failure>;
}

/// The mechanisms measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mechanism {
    /// A word in shared memory that one waits on and the other wakes: the floor.
    Futex,
    /// A counter of the kernel, and shared memory.
    Eventfd,
    /// A Unix datagram socket.
    UnixDatagram,
    /// Publish-subscribe and events of iceoryx2 as it comes.
    Iceoryx2Listener,
}

impl Mechanism {
    /// All of them.
    pub const ALL: [Self; 4] =
        [Self::Futex, Self::Eventfd, Self::UnixDatagram, Self::Iceoryx2Listener];

    /// Its name in figures and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Futex => "futex",
            Self::Eventfd => "eventfd",
            Self::UnixDatagram => "unix_datagram",
            Self::Iceoryx2Listener => "iceoryx2_listener",
        }
    }

    /// What its taking process does.
    #[must_use]
    pub fn job(self) -> Job {
        match self {
            Self::Futex => |context| take_all(context, Self::Futex),
            Self::Eventfd => |context| take_all(context, Self::Eventfd),
            Self::UnixDatagram => |context| take_all(context, Self::UnixDatagram),
            Self::Iceoryx2Listener => |context| take_all(context, Self::Iceoryx2Listener),
        }
    }

    /// The giving end; the taking one is there.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn giver(self, context: &ProcessContext) -> Result<Box<dyn Giver>, Failure> {
        let file = file(context, self, "port");
        Ok(match self {
            Self::Futex => Box::new(futex::Futex::open(&file)?),
            Self::Eventfd => Box::new(eventfd::Eventfd::open(&file)?),
            Self::UnixDatagram => Box::new(unix_datagram::Giver::open(&file)?),
            Self::Iceoryx2Listener => Box::new(iceoryx::Giver::open(&context.paths()?)?),
        })
    }

    fn taker(self, context: &ProcessContext) -> Result<Box<dyn Taker>, Failure> {
        let file = file(context, self, "port");
        Ok(match self {
            Self::Futex => Box::new(futex::Futex::create(&file)?),
            Self::Eventfd => Box::new(eventfd::Eventfd::create(&file)?),
            Self::UnixDatagram => Box::new(unix_datagram::Taker::create(&file)?),
            Self::Iceoryx2Listener => Box::new(iceoryx::Taker::create(&context.paths()?)?),
        })
    }
}

/// Where the stand-ins of an instance meet and leave their records: in memory, so that no disk is waited for.
#[must_use]
pub fn directory(instance: &str) -> PathBuf {
    Path::new("/dev/shm").join(format!("oqtal-{instance}"))
}

/// The file of a mechanism: its `port`, its sign that it is `ready`, its `record`.
#[must_use]
pub fn file(context: &ProcessContext, mechanism: Mechanism, kind: &str) -> PathBuf {
    directory(&context.config.instance.name).join(format!("{}.{kind}", mechanism.name()))
}

/// The counter that the givers and the taker of [`Mechanism::Eventfd`] are started with as standard input: it has no name by
/// which they could find it.
///
/// # Errors
/// The operating system refuses.
pub fn counter() -> Result<OwnedFd, Failure> {
    rustix::event::eventfd(0, EventfdFlags::CLOEXEC)
        .map_err(|error| system(Mechanism::Eventfd, "opening", &error))
}

/// Takes messages until the last, and leaves a record of how long each was under way.
fn take_all(context: &ProcessContext, mechanism: Mechanism) -> Result<(), Failure> {
    // It may be asleep in the kernel when whoever started it dies: asking would not be heard.
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))
        .map_err(|error| system(mechanism, "binding to the parent's life", &error))?;
    let mut record = Record::with_room();
    let mut taker = mechanism.taker(context)?;
    context.enter_realtime();
    Record::default().save(&file(context, mechanism, "ready"))?;
    loop {
        let parcel = taker.take()?;
        let taken_at = Time::now();
        if parcel == Parcel::LAST {
            return record.save(&file(context, mechanism, "record"));
        }
        record.add(parcel.given_at, taken_at);
    }
}

fn system(mechanism: Mechanism, what: &str, error: &dyn std::fmt::Display) -> Failure {
    Failure::new(Exit::System, format!("{}: {what} failed: {error}", mechanism.name()))
}
