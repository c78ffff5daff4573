//! The tenant of the port, as the loop of the bridge sees it: another process, which writes the flight set-points while the port is lent
//! to it.

use std::os::fd::OwnedFd;

use oqtal_bus::lease::{ClosedPort, PortLease};
use oqtal_bus::time::{Span, Time};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Signal, pidfd_send_signal};

use crate::link::VehicleLink;
use crate::note::Note;

/// Time after which a port that the tenant is writing to is looked at again.
const RETRY: Span = Span::from_millis(1);
/// Time for which a set-point that must replace flight commands waits for a tenant that is writing. A frame takes microseconds.
const LONGEST_FRAME: Span = Span::from_millis(5);

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
    is_killed: bool,
    /// Whether the tenant has left: the port is not offered again.
    pub has_left: bool,
}

impl PortTenant {
    /// The tenant with this lease and this handle of its process.
    pub fn new(lease: PortLease, process: OwnedFd) -> Self {
        let (is_awaited, is_killed, has_left) = (false, false, false);
        Self { lease, process, is_awaited, urgent_since: None, is_killed, has_left }
    }

    /// Closes the port to the tenant; `None` while the bridge has to wait for it. If it `is_urgent`, a tenant that hangs in a frame is
    /// killed, so that it does not write the frame later.
    pub fn close(
        &mut self,
        now: Time,
        is_urgent: bool,
        note: &mut dyn FnMut(Note),
    ) -> Option<ClosedPort> {
        let closed = self.lease.close().or_else(|| self.has_ended().then(|| self.lease.seize()));
        self.is_awaited = closed.is_none();
        if closed.is_some() || !is_urgent {
            self.urgent_since = None;
            return closed;
        }
        let since = *self.urgent_since.get_or_insert(now);
        if now.since(since) >= LONGEST_FRAME && !self.is_killed {
            // It fails only if the process has ended.
            let _ = pidfd_send_signal(&self.process, Signal::KILL);
            self.is_killed = true;
            note(Note::TenantKilled);
        }
        None
    }

    /// Instant of the next turn, of which the bridge would make one for `event`.
    pub fn next_turn(&self, now: Time, event: Time) -> Time {
        if self.is_awaited { event.max(now + RETRY) } else { event }
    }

    /// Whether no thread of the process is left.
    fn has_ended(&self) -> bool {
        let mut handle = [PollFd::new(&self.process, PollFlags::IN)];
        poll(&mut handle, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })) == Ok(1)
    }
}
