//! Keeps the loop warm. Sixty times a second is seldom: between two turns the processor's caches fill with other work, and a
//! turn that takes half a microsecond warm takes ten cold. Shortly before the next pose is expected the loop therefore runs a
//! turn on a copy of itself and throws the result away.

use std::hint::black_box;

use oqtal_bus::message::{Header, PoseV1, Stamps};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;

use crate::cycle::Cycle;

/// When to warm_up, and with which pose. Off without a lead.
#[derive(Clone, Debug)]
pub struct CacheWarmup {
    lead: Option<Span>,
    period: Span,
    last: Option<(Header, PoseV1)>,
    due: Option<Time>,
}

impl CacheWarmup {
    /// None at all: in virtual time nothing is gained by it.
    #[must_use]
    pub fn never() -> Self {
        Self { lead: None, period: Span::ZERO, last: None, due: None }
    }

    /// As a configuration asks for.
    #[must_use]
    pub fn of(config: &Config) -> Self {
        let lead = Span::from_seconds(config.realtime.warmup_us * 1e-6);
        let period = Span::period_of(config.safety.pose_rate_hz);
        Self { lead: (lead > Span::ZERO).then_some(lead), period, ..Self::never() }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn arrival(now: Time) -> (Header, PoseV1) {
        let stamps = Stamps { captured_at: now, pose_published_at: now, ..Stamps::default() };
        let pose = PoseV1 { attitude: [0.0, 0.0, 0.0, 1.0], tracked: 1, ..PoseV1::default() };
        (Header { pose_sequence: 1, stamps, ..Header::default() }, pose)
    }

    fn cycle(now: Time) -> Cycle {
        let config = Config::default();
        Cycle::new(&config, crate::waypoint_file::trajectory(&config).unwrap(), now).unwrap()
    }

    #[test]
    fn a_rehearsal_comes_once_before_each_pose_and_leaves_no_trace() {
        let start = Time::VIRTUAL_START;
        let cycle = cycle(start);
        let before = format!("{cycle:?}");
        let mut warmup = CacheWarmup::of(&Config::default());
        let far = start + Span::from_millis(1000);
        assert_eq!(warmup.or(far), far, "no pose is expected yet");
        for k in 0..3 {
            let now = start + Span::from_millis(17).scaled(f64::from(k));
            warmup.expect(now, &arrival(now));
            let due = warmup.or(far);
            assert!(due > now && due < now + Span::from_millis(17));
            assert!(!warmup.perform(now, &cycle), "too early");
            assert!(warmup.perform(due, &cycle));
            assert!(!warmup.perform(due, &cycle), "once is enough");
        }
        assert_eq!(format!("{cycle:?}"), before);
    }

    #[test]
    fn without_a_lead_nothing_is_rehearsed() {
        let now = Time::VIRTUAL_START;
        let mut warmup = CacheWarmup::never();
        warmup.expect(now, &arrival(now));
        assert!(!warmup.perform(now + Span::from_millis(1000), &cycle(now)));
    }
}
