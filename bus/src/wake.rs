//! Sleeping until a topic is notified or an instant has come.
//!
//! iceoryx2's own timed wait leaves the time-out to the socket, which counts in ticks of the kernel (4 ms at 250 Hz).
//! Polling the same socket keeps to the microsecond.

use std::os::fd::BorrowedFd;

use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::prelude::{FileDescriptorBased, ipc};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::error::{BusError, system};
use crate::time::{Span, Time};

/// Wakes a process when its topic is notified.
#[derive(Debug)]
pub struct Doorbell {
    listener: Listener<ipc::Service>,
}

impl Doorbell {
    pub(crate) fn new(listener: Listener<ipc::Service>) -> Self {
        Self { listener }
    }

    /// Sleeps until the bell rings or `deadline` has passed, at most `longest`. Returns at once if it rang meanwhile, and
    /// early if a signal came.
    ///
    /// # Errors
    /// The event's shared memory is gone.
    pub fn wait(&self, deadline: Option<Time>, longest: Span) -> Result<(), BusError> {
        let left = deadline.map_or(longest, |deadline| deadline.since(Time::now()).min(longest));
        if left > Span::ZERO {
            self.sleep(left)?;
        }
        match self.listener.try_wait(|_| {}) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(error) => Err(system("waiting", &error)),
        }
    }

    #[allow(unsafe_code)]
    fn sleep(&self, longest: Span) -> Result<(), BusError> {
        let descriptor = self.listener.file_descriptor();
        // SAFETY: the listener owns the descriptor and outlives this borrow of it, which ends with the poll below; polling
        // neither reads from the descriptor nor closes it.
        let socket = unsafe { BorrowedFd::borrow_raw(descriptor.native_handle()) };
        let time_out = Timespec {
            tv_sec: longest.nanos() / 1_000_000_000,
            tv_nsec: longest.nanos() % 1_000_000_000,
        };
        match poll(&mut [PollFd::new(&socket, PollFlags::IN)], Some(&time_out)) {
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(error) => Err(system("waiting", &error)),
        }
    }
}
