//! Keeps the loop warm. Sixty times a second is seldom: between two turns the processor's caches fill with other work, and a
//! turn that takes half a microsecond warm takes ten cold. Shortly before the next pose is expected the loop therefore runs a
//! turn on a copy of itself and throws the result away.

use std::hint::black_box;

use oqtal_bus::message::{Header, PoseV1, Stamps};
use oqtal_bus::time::{Span, Time};

use crate::cycle::Cycle;

/// When to rehearse, and with which pose. Off without a lead.
#[derive(Clone, Debug)]
pub struct Rehearsal {
    lead: Option<Span>,
    period: Span,
    last: Option<(Header, PoseV1)>,
    due: Option<Time>,
}

impl Rehearsal {
    /// `lead` before a pose is expected, a `period` after the last; `None` for never.
    #[must_use]
    pub fn new(lead: Option<Span>, period: Span) -> Self {
        Self { lead, period, last: None, due: None }
    }

    /// Expects the pose after `arrival`, which came at `now`.
    pub fn expect(&mut self, now: Time, arrival: &(Header, PoseV1)) {
        if let Some(lead) = self.lead {
            self.last = Some(*arrival);
            self.due = Some(now + self.period - lead);
        }
    }

    /// The instant to wake at, if it is before `next`.
    #[must_use]
    pub fn or(&self, next: Time) -> Time {
        self.due.map_or(next, |due| due.min(next))
    }

    /// Rehearses on a copy of `cycle` if it is time to; says whether it did.
    pub fn perform(&mut self, now: Time, cycle: &Cycle) -> bool {
        let (Some(lead), Some(due), Some((header, pose))) = (self.lead, self.due, self.last) else {
            return false;
        };
        if now < due {
            return false;
        }
        self.due = None;
        let later = |instant: Time| instant + self.period;
        let stamps = Stamps {
            captured_at: later(header.stamps.captured_at),
            pose_published_at: later(header.stamps.pose_published_at),
            ..Stamps::default()
        };
        let header = Header {
            sequence: header.sequence + 1,
            pose_sequence: header.pose_sequence + 1,
            stamps,
            ..header
        };
        let mut copy = cycle.clone();
        let tick = copy.step(due + lead, Some(&(header, pose)));
        black_box(tick.map(|tick| copy.report(&tick.stamps, 0)));
        true
    }
}
