//! Cache warm-up. At 60 Hz the processor's caches go cold between ticks, and a cold tick takes many times as long as a warm one.
//! This module executes a tick on a copy of the control cycle shortly before each expected pose and discards its result.

use std::hint::black_box;

use oqtal_bus::message::{ExternalV1, Header, PoseV1, Stamps, StateV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;

use crate::cycle::Cycle;
use crate::external::ExternalLaw;

/// Schedule of the warm-up, and the messages that it uses. Without a lead there is no warm-up.
#[derive(Clone, Debug)]
pub struct CacheWarmup {
    lead: Option<Span>,
    period: Span,
    last: Option<(Header, PoseV1)>,
    vehicle: Option<(Header, VehicleV1)>,
    due: Option<Time>,
}

impl CacheWarmup {
    /// No warm-up, as in virtual time, in which computation takes no time.
    pub fn never() -> Self {
        Self { lead: None, period: Span::ZERO, last: None, vehicle: None, due: None }
    }

    /// The warm-up that `config` sets by `realtime.warmup-us`.
    pub fn of(config: &Config) -> Self {
        let lead = Span::from_seconds(config.realtime.warmup_us * 1e-6);
        let period = Span::period_of(config.safety.pose_rate_hz);
        Self { lead: (lead > Span::ZERO).then_some(lead), period, ..Self::never() }
    }

    /// Schedules the warm-up for the pose that follows `arrival`, which was received at `now`.
    pub fn expect(&mut self, now: Time, arrival: &(Header, PoseV1)) {
        if let Some(lead) = self.lead {
            self.last = Some(*arrival);
            self.due = Some(now + self.period - lead);
        }
    }

    /// Takes the state of the vehicle, which usually arrives before a tick.
    pub fn receive_vehicle(&mut self, vehicle: &(Header, VehicleV1)) {
        if self.lead.is_some() {
            self.vehicle = Some(*vehicle);
        }
    }

    /// The earlier of `next` and the instant of the warm-up.
    pub fn or(&self, next: Time) -> Time {
        self.due.map_or(next, |due| due.min(next))
    }

    /// Executes the warm-up on a copy of `cycle` if it is due. Returns whether it was.
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
        if let Some((header, vehicle)) = &self.vehicle {
            copy.receive_vehicle(due + lead, header, vehicle);
        }
        let mut law = Repeated(cycle.exchange().map(|(_, answer)| *answer));
        let tick = copy.step_with(due + lead, Some(&(header, pose)), &mut law);
        black_box(tick.map(|tick| *copy.report(&tick.stamps, 0)));
        true
    }
}

/// An external law that repeats its last answer.
struct Repeated(Option<ExternalV1>);

impl ExternalLaw for Repeated {
    fn reset(&mut self) {}

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        self.0.map(|answer| ExternalV1 { sequence: state.sequence, ..answer })
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
    fn a_warm_up_comes_once_before_each_pose_and_changes_nothing() {
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
    fn without_a_lead_there_is_no_warm_up() {
        let now = Time::VIRTUAL_START;
        let mut warmup = CacheWarmup::never();
        warmup.expect(now, &arrival(now));
        assert!(!warmup.perform(now + Span::from_millis(1000), &cycle(now)));
    }
}
