//! The loop monitor: a sink that collects the latencies and counters of a running instance.

use oqtal_bus::message::{TelemetryV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Sample};
use serde::Serialize;

use crate::latency::{Distribution, HopDistributions, OnwardTime};
use crate::sink::{Reception, Sink};

/// Counters of the control loop over the observation time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LoopCounters {
    /// Ticks of the loop.
    pub ticks: u64,
    /// Ticks that used a new pose; the others acted on their deadline.
    pub fresh_ticks: u64,
    /// Commands published later than one period after their pose.
    pub deadline_misses: u64,
    /// Poses lost, from gaps in their frame numbers.
    pub poses_lost: u64,
    /// Poses refused by the guard.
    pub poses_refused: u64,
    /// Commands published.
    pub commands: u64,
    /// Commands lost on the way to the vehicle, from gaps in their sequence.
    pub commands_lost: u64,
    /// Samples lost by the observer; they are not included in the figures.
    #[serde(rename = "unheard")]
    pub unobserved: u64,
}

/// Collects latencies and counters of one instance.
#[derive(Debug, Default)]
pub struct LoopMonitor {
    from: Time,
    first: Option<TelemetryV1>,
    last: TelemetryV1,
    commands_lost_before: Option<u64>,
    counters: LoopCounters,
    armed: bool,
    daemon_pid: Option<u32>,
    hops: HopDistributions,
    wakeup_lateness: Distribution,
}

impl LoopMonitor {
    /// Topics with latencies and counters.
    pub const TOPICS: [ObservedTopic; 3] =
        [ObservedTopic::Telemetry, ObservedTopic::Vehicle, ObservedTopic::Command];

    /// Monitor that ignores samples from before `from`.
    pub fn new(from: Time) -> Self {
        Self { from, ..Self::default() }
    }

    /// Discards all figures and ignores samples from before `from`; the state of daemon and motors is kept.
    pub fn restart(&mut self, from: Time) {
        *self = Self { armed: self.armed, daemon_pid: self.daemon_pid, ..Self::new(from) };
    }

    /// The newest tick of the loop; `None` if there was none.
    pub fn latest(&self) -> Option<&TelemetryV1> {
        self.first.map(|_| &self.last)
    }

    /// Process id of the daemon; `None` before its first tick was received.
    pub fn daemon_pid(&self) -> Option<u32> {
        self.daemon_pid
    }

    /// Whether the motors of the vehicle run.
    pub fn is_armed(&self) -> bool {
        self.armed
    }

    /// The counters.
    pub fn counters(&self) -> LoopCounters {
        self.counters
    }

    /// Hops of every applied command.
    pub fn hops(&self) -> &HopDistributions {
        &self.hops
    }

    /// Wake-up lateness of the daemon.
    pub fn wakeup_lateness(&self) -> &Distribution {
        &self.wakeup_lateness
    }

    fn telemetry(&mut self, reception: &Reception, telemetry: &TelemetryV1) {
        // A late joiner receives the last sample of the topic, which may be old.
        if telemetry.time < self.from {
            return;
        }
        self.daemon_pid = Some(reception.header.origin().process());
        let first = *self.first.get_or_insert(*telemetry);
        self.last = *telemetry;
        self.wakeup_lateness.add(Span::from_nanos(telemetry.wakeup_lateness_ns));
        let counters = &mut self.counters;
        counters.ticks += 1;
        counters.fresh_ticks += u64::from(telemetry.fresh);
        // A restarted daemon counts from zero.
        counters.deadline_misses = telemetry.deadline_misses.saturating_sub(first.deadline_misses);
        counters.poses_lost = telemetry.poses_lost.saturating_sub(first.poses_lost);
        counters.poses_refused = telemetry.poses_refused.saturating_sub(first.poses_refused);
    }

    fn vehicle(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        let stamps = &reception.header.stamps;
        if stamps.woken_at < self.from {
            return;
        }
        self.armed = vehicle.armed == 1;
        self.hops.add(stamps, OnwardTime::of(vehicle));
        let before = *self.commands_lost_before.get_or_insert(vehicle.lost);
        self.counters.commands_lost = vehicle.lost.saturating_sub(before);
    }
}

impl Sink for LoopMonitor {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        match sample {
            Sample::Telemetry(telemetry) => self.telemetry(reception, telemetry),
            Sample::Vehicle(vehicle) => self.vehicle(reception, vehicle),
            Sample::Command(_) => {
                let is_counted = reception.header.stamps.woken_at >= self.from;
                self.counters.commands += u64::from(is_counted);
            }
            _ => {}
        }
    }

    fn lost(&mut self, _: ObservedTopic, count: u64) {
        self.counters.unobserved += count;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_start_with_the_first_tick_observed() {
        let mut monitor = LoopMonitor::new(Time::from_nanos(10));
        let reception = Reception::default();
        for (nanos, deadline_misses) in [(9, 3), (10, 4), (20, 6)] {
            let time = Time::from_nanos(nanos);
            let tick = TelemetryV1 { time, deadline_misses, fresh: 1, ..TelemetryV1::default() };
            monitor.sample(&reception, Sample::Telemetry(&tick));
        }
        monitor.lost(ObservedTopic::Telemetry, 5);
        let counted = monitor.counters();
        assert_eq!((counted.ticks, counted.fresh_ticks, counted.deadline_misses), (2, 2, 2));
        assert_eq!(counted.unobserved, 5);
        monitor.restart(Time::from_nanos(30));
        assert_eq!((monitor.counters(), monitor.latest()), (LoopCounters::default(), None));
        assert!(monitor.daemon_pid().is_some());
    }
}
