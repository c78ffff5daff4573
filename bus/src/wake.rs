//! Wake-up of sleeping processes: one event count in shared memory for each topic.
//!
//! `Notifier::notify` increments the count and wakes all sleepers. A [`Listener`] stores the last count that it saw and sleeps
//! only while the count is unchanged; the kernel compares both before the thread sleeps. A notification between two waits is
//! therefore never lost, and a process that dies at any instruction leaves a consistent state.

use std::cell::Cell;
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::event::Timespec;
use rustix::io::Errno;
use rustix::thread::futex;

use crate::error::{BusError, system};
use crate::membership::Membership;
use crate::shared::SharedWords;
use crate::suspend::ClockReadings;
use crate::time::Time;

mod event_count;

/// Number of words of an event \[-\].
pub(crate) const WORDS: usize = 1;

/// Matches every waker.
const ANY: NonZeroU32 = NonZeroU32::MAX;

/// Path of the event of `topic`.
pub(crate) fn path(membership: &Membership, topic: &str) -> PathBuf {
    membership.words_file(&format!("{}.count", topic.replace('/', ".")))
}

/// Opens the event of `topic`.
fn open(membership: &Membership, topic: &str) -> Result<SharedWords, BusError> {
    let _lock = membership.lock()?;
    let path = path(membership, topic);
    SharedWords::open(&path, WORDS).map_err(|error| BusError::of_shared_file(topic, path, &error))
}

/// Sleeps while `count` is `seen`, until `deadline` at the latest.
fn sleep(count: &AtomicU32, seen: u32, deadline: Time) -> Result<(), Errno> {
    if Time::now() >= deadline {
        return Ok(());
    }
    let deadline = timespec(ClockReadings::now().on_monotonic(deadline));
    match futex::wait_bitset(count, futex::Flags::empty(), seen, Some(&deadline), ANY) {
        Ok(()) | Err(Errno::AGAIN | Errno::TIMEDOUT | Errno::INTR) => Ok(()),
        Err(error) => Err(error),
    }
}

/// Instant of `CLOCK_MONOTONIC` as an absolute deadline for the kernel.
fn timespec(instant: Time) -> Timespec {
    const NANOS_PER_SECOND: u64 = 1_000_000_000;
    Timespec {
        tv_sec: (instant.nanos() / NANOS_PER_SECOND).cast_signed(),
        tv_nsec: (instant.nanos() % NANOS_PER_SECOND).cast_signed(),
    }
}

/// Wakes the processes that listen to a topic.
#[derive(Debug)]
pub(crate) struct Notifier {
    count: SharedWords,
    topic: &'static str,
    _membership: Rc<Membership>,
}

impl Notifier {
    /// Opens the notifier of `topic`.
    ///
    /// # Errors
    /// The event belongs to another user or another version, or shared memory is full.
    pub(crate) fn open(membership: &Rc<Membership>, topic: &'static str) -> Result<Self, BusError> {
        Ok(Self { count: open(membership, topic)?, topic, _membership: Rc::clone(membership) })
    }

    pub(crate) fn notify(&self) -> Result<(), BusError> {
        let notified = event_count::notify(&self.count[0], |count| {
            // The futex is not private: the sleepers are in other processes.
            futex::wake(count, futex::Flags::empty(), i32::MAX.unsigned_abs()).map(drop)
        });
        notified.map_err(|e| system(format!("notifying `{}`", self.topic), &e))
    }
}

/// Waits for notifications of a topic.
#[derive(Debug)]
pub struct Listener {
    count: SharedWords,
    seen: Cell<u32>,
    topic: &'static str,
    _membership: Rc<Membership>,
}

impl Listener {
    /// Opens the listener of `topic`. Earlier notifications do not count.
    ///
    /// # Errors
    /// Like [`Notifier::open`].
    pub(crate) fn open(membership: &Rc<Membership>, topic: &'static str) -> Result<Self, BusError> {
        let count = open(membership, topic)?;
        let seen = Cell::new(count[0].load(Ordering::Acquire));
        Ok(Self { count, seen, topic, _membership: Rc::clone(membership) })
    }

    /// Sleeps until the topic is notified or until `deadline`; returns whether it was notified, at once if it was since the last call.
    /// May return early; the caller checks every port after each return.
    ///
    /// # Errors
    /// The kernel refuses to wait.
    pub fn wait(&self, deadline: Time) -> Result<bool, BusError> {
        event_count::wait(&self.count[0], &self.seen, |count, seen| sleep(count, seen, deadline))
            .map_err(|e| system(format!("waiting for `{}`", self.topic), &e))
    }
}
