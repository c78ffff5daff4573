//! The tenant of the port, for the loop of the bridge: another process, which writes the flight set-points while the port is lent to it.

use std::os::fd::OwnedFd;

use oqtal_bus::lease::{ClosedPort, PortLease};
use oqtal_bus::time::{Span, Time};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Signal, pidfd_send_signal};

use crate::link::VehicleLink;
use crate::note::Note;

/// Period at which a port that the tenant is writing to is checked.
const RETRY: Span = Span::from_millis(1);
/// Time for which a set-point that must replace flight commands waits for a tenant that is writing, and then again for the end of the
/// killed tenant. A frame takes microseconds, and no thread of a killed process executes another instruction of its own.
const LONGEST_FRAME: Span = Span::from_millis(2);

/// Part of the bridge that the background thread opens, and closes when it is lost.
#[derive(Debug)]
pub enum PortPart {
    /// The port.
    Link(Box<dyn VehicleLink>),
    /// A tenant of the port, boxed so that no part is much larger than the others.
    Tenant(Box<PortTenant>),
    /// The tenant has left.
    NoTenant,
}

/// A tenant. No call blocks.
#[derive(Debug)]
pub struct PortTenant {
    /// The lease.
    pub lease: PortLease,
    /// Handle of the process.
    process: OwnedFd,
    /// Whether the bridge waits for the port, and since when for a set-point that must replace flight commands.
    is_awaited: bool,
    urgent_since: Option<Time>,
    killed_at: Option<Time>,
    /// Whether the tenant has left: the port is not offered again.
    pub has_left: bool,
}

impl PortTenant {
    /// The tenant with this lease and this handle of its process.
    pub fn new(lease: PortLease, process: OwnedFd) -> Self {
        Self {
            lease,
            process,
            is_awaited: false,
            urgent_since: None,
            killed_at: None,
            has_left: false,
        }
    }

    /// Closes the port to the tenant; `None` while the bridge has to wait for it. If it `is_urgent`, a tenant that hangs in a frame is
    /// killed, so that it does not write the frame later.
    pub fn close(
        &mut self,
        now: Time,
        is_urgent: bool,
        note: &mut dyn FnMut(Note),
    ) -> Option<ClosedPort> {
        let closed = self.lease.close().or_else(|| self.has_ended(now).then(|| self.lease.seize()));
        self.is_awaited = closed.is_none();
        if closed.is_some() || !is_urgent {
            self.urgent_since = None;
            return closed;
        }
        let since = *self.urgent_since.get_or_insert(now);
        if now.since(since) >= LONGEST_FRAME && self.killed_at.is_none() {
            // It fails only if the process has ended: it is of the same user.
            let _ = pidfd_send_signal(&self.process, Signal::KILL);
            self.killed_at = Some(now);
            note(Note::TenantKilled);
        }
        None
    }

    /// Instant of the next turn: `event`, or the next check of a port that the tenant is writing to.
    pub fn next_turn(&self, now: Time, event: Time) -> Time {
        if self.is_awaited { event.max(now + RETRY) } else { event }
    }

    /// Whether the process cannot write any more: none of its threads is left, or the longest time of a frame has passed since it was
    /// killed.
    fn has_ended(&self, now: Time) -> bool {
        let mut handle = [PollFd::new(&self.process, PollFlags::IN)];
        self.killed_at.is_some_and(|at| now.since(at) >= LONGEST_FRAME)
            || poll(&mut handle, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })) == Ok(1)
    }
}
