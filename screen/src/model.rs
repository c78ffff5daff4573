//! What is known of an instance: a sink that keeps what the picture shows.

use oqtal_bus::message::{Header, Stamps, TelemetryV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Sample};
use oqtal_observe::event::{self, DaemonCondition};
use oqtal_observe::latency::{OnwardTime, hops, sensor_to_actuator};
use oqtal_observe::loop_monitor::LoopMonitor;
use oqtal_observe::sink::{Reception, Sink};

use crate::journal::Journal;
use crate::processes::{OBSERVED, ProcessChange, ProcessTable};
use crate::trend::Trend;

/// The quantities that are shown over time.
#[derive(Debug, Default)]
pub struct Trends {
    /// Distance of the estimated position from the reference, in flight \[m\].
    pub error: Trend,
    /// Collective thrust sent \[percent of the vehicle's greatest\].
    pub thrust: Trend,
    /// Time from the capture of a pose to its effect on the vehicle \[ms\].
    pub latency: Trend,
}

/// The newest sample of a topic.
#[derive(Clone, Copy, Debug)]
pub struct Newest<M> {
    /// When it was received.
    pub received_at: Time,
    /// The sample.
    pub body: M,
}

/// What is known of the observed instance.
#[derive(Debug)]
pub struct MonitorModel {
    /// Name of the instance.
    pub instance: String,
    /// The latest instant of the observation.
    pub now: Time,
    /// The newest tick of the daemon.
    pub tick: Option<Newest<TelemetryV1>>,
    /// The newest message of the vehicle.
    pub vehicle: Option<Newest<VehicleV1>>,
    /// The processes.
    pub processes: ProcessTable,
    /// Latencies and counters since the observation began, the daemon was replaced, or an operator asked for new ones.
    pub figures: LoopMonitor,
    /// Quantities over time.
    pub trends: Trends,
    /// Events.
    pub journal: Journal,
    /// Greatest tracking error of the figures \[m\].
    pub greatest_error_m: f64,
    /// Writer of the newest tick.
    daemon: Option<u64>,
    condition: Option<DaemonCondition>,
}

impl MonitorModel {
    /// The model of an instance of which nothing is known at `now`.
    #[must_use]
    pub fn new(instance: &str, now: Time) -> Self {
        Self {
            instance: instance.to_owned(),
            now,
            tick: None,
            vehicle: None,
            processes: ProcessTable::default(),
            figures: LoopMonitor::new(Time::UNSET),
            trends: Trends::default(),
            journal: Journal::new(now),
            greatest_error_m: 0.0,
            daemon: None,
            condition: None,
        }
    }

    /// The topics that are observed.
    #[must_use]
    pub fn topics() -> Vec<ObservedTopic> {
        let health = OBSERVED.into_iter().map(ObservedTopic::Health);
        LoopMonitor::TOPICS.into_iter().chain([ObservedTopic::Input]).chain(health).collect()
    }

    /// Begins an instant; to be called before the samples received at it.
    pub fn advance(&mut self, now: Time) {
        self.now = now;
        let Trends { error, thrust, latency } = &mut self.trends;
        for trend in [error, thrust, latency] {
            trend.advance(now);
        }
        let was_alive = self.processes.is_alive();
        for change in self.processes.advance(now) {
            self.note(change);
        }
        if was_alive && !self.processes.is_alive() {
            self.journal.add(now, "the instance has ended");
        }
    }

    /// Discards latencies and counters, and begins new ones.
    pub fn restart_figures(&mut self) {
        self.figures.restart(Time::UNSET);
        self.greatest_error_m = 0.0;
    }

    /// Time since the newest tick was received; `None` before the first.
    #[must_use]
    pub fn tick_age(&self) -> Option<Span> {
        self.tick.map(|tick| self.now.since(tick.received_at))
    }

    fn note(&mut self, change: ProcessChange) {
        let text = match change {
            ProcessChange::Came(role, pid) => format!("{} came, pid {pid}", role.name()),
            ProcessChange::Silent(role) => format!("{} is silent", role.name()),
        };
        self.journal.add(self.now, text);
    }

    /// Takes note of a daemon in place of the one before.
    fn notice_daemon(&mut self, header: &Header) {
        let source = header.source;
        if self.daemon.replace(source).is_some_and(|before| before != source) {
            self.restart_figures();
            self.condition = None;
        }
    }

    /// Adds the latency of a command that was applied.
    fn add_latency(&mut self, stamps: &Stamps, vehicle: &VehicleV1) {
        if hops(stamps).is_some() {
            let whole = sensor_to_actuator(stamps, OnwardTime::of(vehicle));
            self.trends.latency.add(whole.seconds() * 1e3);
        }
    }

    fn note_vehicle(&mut self, before: &VehicleV1, now: &VehicleV1) {
        let changes = [
            (before.armed != now.armed, if now.armed == 1 { "motors run" } else { "motors off" }),
            (
                before.link != now.link,
                if now.link == 1 { "vehicle answers" } else { "vehicle silent" },
            ),
            (
                before.stopped != now.stopped,
                if now.stopped == 1 { "vehicle stopped by an operator" } else { "stop lifted" },
            ),
        ];
        for (_, text) in changes.into_iter().filter(|(is_change, _)| *is_change) {
            self.journal.add(self.now, text);
        }
    }
}

/// Distance of the estimated position from the reference \[m\]; `None` when not flying.
#[must_use]
pub fn tracking_error_m(tick: &TelemetryV1) -> Option<f64> {
    let pairs = tick.position.iter().zip(tick.reference_position);
    let distance = pairs.map(|(is, wanted)| (is - wanted).powi(2)).sum::<f64>().sqrt();
    (distance.is_finite() && tick.mission_s.is_finite()).then_some(distance)
}

impl MonitorModel {
    fn telemetry(&mut self, reception: &Reception, telemetry: &TelemetryV1) {
        self.notice_daemon(&reception.header);
        self.figures.sample(reception, Sample::Telemetry(telemetry));
        self.tick = Some(Newest { received_at: reception.received_at, body: *telemetry });
        self.trends.thrust.add(telemetry.thrust * 100.0);
        if let Some(error) = tracking_error_m(telemetry) {
            self.trends.error.add(error);
            self.greatest_error_m = self.greatest_error_m.max(error);
        }
        let condition = DaemonCondition::of(telemetry);
        if self.condition.replace(condition) != Some(condition) {
            self.journal.add(self.now, condition.to_string());
        }
    }

    fn vehicle(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        self.figures.sample(reception, Sample::Vehicle(vehicle));
        self.add_latency(&reception.header.stamps, vehicle);
        let newest = Newest { received_at: reception.received_at, body: *vehicle };
        if let Some(before) = self.vehicle.replace(newest) {
            self.note_vehicle(&before.body, vehicle);
        }
    }
}

impl Sink for MonitorModel {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        match sample {
            Sample::Telemetry(telemetry) => self.telemetry(reception, telemetry),
            Sample::Vehicle(vehicle) => self.vehicle(reception, vehicle),
            Sample::Command(_) => self.figures.sample(reception, sample),
            Sample::Input(input) => {
                if let Some(text) = event::of_input(input) {
                    self.journal.add(self.now, text);
                }
            }
            Sample::Health(role, health) => {
                let change = self.processes.hear(self.now, role, (&reception.header, health));
                change.into_iter().for_each(|change| self.note(change));
            }
            _ => {}
        }
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        self.figures.lost(topic, count);
        self.journal.add(self.now, format!("{count} samples of `{topic}` were not observed"));
    }
}
