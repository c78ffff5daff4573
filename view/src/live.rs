//! Updates for the pages of a running instance: rows, events, and periodically the status of its processes.

use oqtal_bus::obstacle::ArmingObstacles;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Sample};
use oqtal_config::Config;
use oqtal_observe::instance::InstanceModel;
use oqtal_observe::sink::{Reception, Sink, Tee};
use oqtal_observe::status::{ProcessHealth, VehicleStatus};
use serde::Serialize;

use crate::collect::{Collected, Collector};

/// Maximum number of rows of a kind in one update \[-\]; in virtual time thousands may have arrived since the last one.
const MOST_ROWS: usize = 240;
/// Time between two updates of the status.
const STATUS_PERIOD: Span = Span::from_millis(250);

/// Number of nanoseconds in a millisecond, the unit of the pages' times.
pub const NANOS_PER_MS: u64 = 1_000_000;
/// Age of a message above which it does not describe the present state.
const SILENT: Span = Span::from_millis(1000);

/// Collects the updates for the pages of a running instance.
#[derive(Debug)]
pub struct LiveView {
    collector: Collector,
    /// Model of the instance.
    pub instance: InstanceModel,
    last_status: Time,
}

/// Status of the processes of an instance.
#[derive(Clone, Debug, Serialize)]
pub struct LiveStatus {
    processes: Vec<ProcessHealth>,
    vehicle: Option<VehicleStatus>,
    /// Whether all processes run with one configuration; `None` if none was observed.
    config_agrees: Option<bool>,
    /// Conditions that prevent a flight; none from a daemon without ticks.
    obstacles: Vec<String>,
    /// Time since the newest tick was received \[s\]; `None` before the first.
    silence_s: Option<f64>,
    /// Time since the newest vehicle message was received \[s\]; `None` before the first.
    vehicle_silence_s: Option<f64>,
    /// Law and trajectory that fly, as reported by the daemon; `None` before its first report.
    flown: Option<String>,
}

/// Update for a page, as one line.
#[derive(Serialize)]
struct Line<'a> {
    /// Instant at which it was made, by the clock of this machine \[ms\].
    at_ms: u64,
    #[serde(flatten)]
    collected: &'a Collected,
    #[serde(skip_serializing_if = "Option::is_none")]
    status: Option<&'a LiveStatus>,
}

/// An update made at `at` as a line of JSON.
pub fn line(at: Time, collected: &Collected, status: Option<&LiveStatus>) -> String {
    let line = Line { at_ms: at.nanos() / NANOS_PER_MS, collected, status };
    let text = serde_json::to_string(&line).expect("rows, events and status are plain JSON");
    text + "\n"
}

impl LiveView {
    /// Topics shown on a page.
    pub fn topics() -> Vec<ObservedTopic> {
        let others = [ObservedTopic::Truth, ObservedTopic::Input, ObservedTopic::Event];
        InstanceModel::status_topics().into_iter().chain(others).collect()
    }

    /// View of an instance that runs with `config`; health messages older than `timeout` are ignored.
    pub fn new(config: &Config, timeout: Span) -> Self {
        Self {
            collector: Collector::new(config),
            instance: InstanceModel::new(Time::UNSET, timeout),
            last_status: Time::UNSET,
        }
    }

    /// Rows and events since the last call, and the status if it is due.
    pub fn take(&mut self, now: Time) -> (Collected, Option<LiveStatus>) {
        let mut collected = self.collector.take();
        thin(&mut collected.ticks);
        thin(&mut collected.vehicles);
        if now.since(self.last_status) < STATUS_PERIOD {
            return (collected, None);
        }
        self.last_status = now;
        (collected, Some(self.status_at(now)))
    }

    fn status_at(&self, now: Time) -> LiveStatus {
        let status = self.instance.status(now);
        let config_agrees = status.config_agrees();
        let InstanceModel { tick, vehicle, .. } = &self.instance;
        let age = |received_at| now.since(received_at);
        let present = tick.filter(|tick| age(tick.received_at) <= SILENT);
        let obstacles = ArmingObstacles::from_bits(present.map_or(0, |tick| tick.body.obstacles));
        LiveStatus {
            config_agrees,
            processes: status.processes,
            vehicle: status
                .vehicle
                .filter(|_| vehicle.is_some_and(|it| age(it.received_at) <= SILENT)),
            obstacles: obstacles.iter().map(|obstacle| obstacle.to_string()).collect(),
            flown: self.instance.law_and_trajectory.clone(),
            silence_s: tick.map(|tick| age(tick.received_at).seconds()),
            vehicle_silence_s: vehicle.map(|vehicle| age(vehicle.received_at).seconds()),
        }
    }
}

/// Keeps at most `MOST_ROWS` rows, evenly spread, including the last.
fn thin<T: Copy>(rows: &mut Vec<T>) {
    let stride = rows.len().div_ceil(MOST_ROWS);
    if stride > 1 {
        *rows = rows.iter().rev().step_by(stride).rev().copied().collect();
    }
}

impl Sink for LiveView {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        Tee(&mut self.collector, &mut self.instance).sample(reception, sample);
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        Tee(&mut self.collector, &mut self.instance).lost(topic, count);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::message::{TelemetryV1, VehicleV1};

    #[test]
    fn an_update_is_one_line_of_json_and_the_status_comes_when_it_is_due() {
        let mut view = LiveView::new(&Config::default(), Span::from_millis(1500));
        let now = Time::VIRTUAL_START;
        let tick = TelemetryV1 { time: now, obstacles: 1 << 5, ..TelemetryV1::default() };
        let reception = Reception { received_at: now, ..Reception::default() };
        view.sample(&reception, Sample::Telemetry(&tick));
        let (collected, status) = view.take(now);
        let text = line(now, &collected, status.as_ref());
        assert_eq!(text.matches('\n').count(), 1);
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(json["ticks"].as_array().unwrap().len(), 1);
        assert_eq!(json["at_ms"], 1000);
        assert_eq!(json["ticks"][0][11], serde_json::Value::Null, "no error on the ground");
        assert!(json["status"]["obstacles"][0].is_string(), "{json}");
        assert!(view.take(now + Span::from_millis(100)).1.is_none());
        assert!(view.take(now + Span::from_millis(300)).1.is_some());
    }

    #[test]
    fn the_state_of_a_silent_daemon_or_vehicle_is_not_the_present_one() {
        let mut view = LiveView::new(&Config::default(), Span::from_millis(1500));
        let now = Time::VIRTUAL_START;
        let tick = TelemetryV1 { time: now, obstacles: 1 << 5, ..TelemetryV1::default() };
        let reception = Reception { received_at: now, ..Reception::default() };
        view.sample(&reception, Sample::Telemetry(&tick));
        view.sample(&reception, Sample::Vehicle(&VehicleV1::default()));
        let fresh = view.take(now).1.unwrap();
        assert!(!fresh.obstacles.is_empty() && fresh.vehicle.is_some());
        let stale = view.take(now + Span::from_millis(2000)).1.unwrap();
        assert!(stale.obstacles.is_empty() && stale.vehicle.is_none());
        assert_eq!((stale.silence_s, stale.vehicle_silence_s), (Some(2.0), Some(2.0)));
    }

    #[test]
    fn an_update_is_bounded_and_ends_with_the_newest_row() {
        let mut rows: Vec<usize> = (0..10_001).collect();
        thin(&mut rows);
        assert!(rows.len() <= MOST_ROWS && rows.last() == Some(&10_000));
        assert!(rows.is_sorted());
    }
}
