//! Sink that converts the messages of an instance to rows and events.

use std::collections::VecDeque;

use oqtal_bus::code::{InputKind, SafetyState};
use oqtal_bus::message::{TelemetryV1, TruthV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Sample};
use oqtal_config::{Config, Interface};
use oqtal_observe::event::{self, DaemonCondition};
use oqtal_observe::flight::FlightSample;
use oqtal_observe::nearest::nearest;
use oqtal_observe::sink::{Reception, Sink};
use serde::Serialize;

use crate::row::{self, TickRow, VehicleRow};

/// Maximum number of stored truth samples: more than arrive between two polls.
const TRUTHS_KEPT: usize = 2048;
/// Greatest time between a tick and the truth sample used for its errors: more than half the period of a source at 200 Hz; of a
/// slower one, some ticks have no errors.
const TRUTH_DISTANCE: Span = Span::from_millis(3);
/// Time for which ticks wait for a truth sample that is not older.
const TRUTH_TIMEOUT: Span = Span::from_millis(100);
/// Maximum number of events between two calls of [`Collector::take`]; further events are counted.
const MOST_EVENTS: usize = 4096;

/// Severity of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EventMood {
    /// Expected.
    Neutral,
    /// Recovered.
    Good,
    /// Degraded; the flight continues.
    Warning,
    /// The flight ends.
    Bad,
}

/// An event.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewedEvent {
    /// Time since the origin \[s\].
    #[serde(rename = "t")]
    pub t_s: f64,
    /// Severity.
    pub mood: EventMood,
    /// Text.
    pub text: String,
}

/// Rows and events in the order of time.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Collected {
    /// Ticks.
    pub ticks: Vec<TickRow>,
    /// Vehicle messages.
    pub vehicles: Vec<VehicleRow>,
    /// Events.
    pub events: Vec<ViewedEvent>,
}

impl Collected {
    /// Whether there are neither rows nor events.
    pub fn is_empty(&self) -> bool {
        self.ticks.is_empty() && self.vehicles.is_empty() && self.events.is_empty()
    }
}

/// Collector of the rows and events of one instance for its pages.
#[derive(Debug)]
pub struct Collector {
    interface: Interface,
    has_truth: bool,
    faults: Vec<(f64, String)>,
    /// Zero of the time axis: the first tick.
    origin: Option<Time>,
    /// First tick that armed, from which the times of faults count; `None` also if arming was before the first tick.
    armed_at: Option<Time>,
    /// Whether the first tick is in flight.
    begins_in_flight: bool,
    /// Maximum number of events between two calls of [`Collector::take`].
    most_events: usize,
    /// Number of further events \[-\].
    omitted: usize,
    truths: VecDeque<TruthV1>,
    waiting: Vec<TelemetryV1>,
    last: Option<TelemetryV1>,
    collected: Collected,
}

impl Collector {
    /// Collector for an instance that runs with `config`.
    pub fn new(config: &Config) -> Self {
        let faults = event::of_faults(config);
        let faults = faults.map(|(at_s, source, text)| (at_s, format!("{source} {text}")));
        Self {
            interface: config.vehicle.interface,
            has_truth: !config.is_replay() && !config.plant.shadow,
            faults: faults.collect(),
            origin: None,
            armed_at: None,
            begins_in_flight: false,
            most_events: MOST_EVENTS,
            omitted: 0,
            truths: VecDeque::new(),
            waiting: Vec::new(),
            last: None,
            collected: Collected::default(),
        }
    }

    /// Collector for a recording made with `config`, without a limit of the number of events.
    pub fn of_recording(config: &Config) -> Self {
        Self { most_events: usize::MAX, ..Self::new(config) }
    }

    /// Rows and events since the last call; the newest ticks may wait for their truth.
    pub fn take(&mut self) -> Collected {
        self.join();
        if let Some(last) = self.collected.events.last().filter(|_| self.omitted > 0) {
            let text = omitted(std::mem::take(&mut self.omitted));
            let further = ViewedEvent { t_s: last.t_s, mood: EventMood::Warning, text };
            self.collected.events.push(further);
        }
        std::mem::take(&mut self.collected)
    }

    /// Rows and events since the last call, with all ticks.
    pub fn finish(&mut self) -> Collected {
        self.join();
        self.join_first(self.waiting.len());
        std::mem::take(&mut self.collected)
    }

    /// Time from the first tick to the first that armed \[s\]; `None` if no tick armed, or arming was before the first tick.
    pub fn armed_at_s(&self) -> Option<f64> {
        Some(self.seconds(self.armed_at?))
    }

    /// The newest tick.
    pub fn latest(&self) -> Option<&TelemetryV1> {
        self.waiting.last().or(self.last.as_ref())
    }

    /// Discards the ticks of a daemon in virtual time once its successor has begun, since rows are in the order of time.
    fn begin_again(&mut self) {
        self.waiting.clear();
        self.collected = Collected::default();
        (self.origin, self.armed_at, self.last) = (None, None, None);
    }

    fn seconds(&self, at: Time) -> f64 {
        self.origin.map_or(0.0, |origin| at.since(origin).seconds())
    }

    /// Converts the waiting ticks to rows, except those later than the newest truth sample, until there is none for too long.
    fn join(&mut self) {
        let Some(last) = self.waiting.last() else { return };
        let newest = self.truths.back().map(|truth| truth.time);
        let until = newest.filter(|newest| last.time.since(*newest) < TRUTH_TIMEOUT);
        let until = until.unwrap_or(last.time);
        self.join_first(self.waiting.partition_point(|tick| tick.time <= until));
    }

    /// Converts the first `count` waiting ticks to rows, each with the nearest truth sample. A tick without a sample nearby has no
    /// errors: those against the estimate are not comparable with the others.
    fn join_first(&mut self, count: usize) {
        for telemetry in self.waiting.drain(..count).collect::<Vec<_>>() {
            let sample = FlightSample { telemetry, truth: self.truth_at(telemetry.time) };
            self.note_changes(&sample);
            let mut row = row::tick(self.seconds(telemetry.time), &sample, self.interface);
            if sample.truth.is_none() && !self.truths.is_empty() {
                row[row::ERRORS].fill(f64::NAN);
            }
            self.collected.ticks.push(row);
            self.last = Some(telemetry);
        }
    }

    fn truth_at(&self, at: Time) -> Option<TruthV1> {
        let truth = self.truths[nearest(&self.truths, at, |truth| truth.time)?];
        (truth.time.since(at).nanos().abs() <= TRUTH_DISTANCE.nanos()).then_some(truth)
    }

    fn note_changes(&mut self, sample: &FlightSample) {
        let now = sample.telemetry;
        match self.last {
            None => self.begins_in_flight = now.is_armed(),
            // The first arming is zero, not that of a flight after the one in which a file begins.
            Some(last) if now.is_armed() && !last.is_armed() && !self.begins_in_flight => {
                self.armed_at.get_or_insert(now.time);
            }
            Some(_) => {}
        }
        self.note_faults(now.time);
        let Some(last) = self.last else {
            return self.note(now.time, (mood(now.state), DaemonCondition::of(&now).state_text()));
        };
        let moods = if last.state == now.state { EventMood::Warning } else { mood(now.state) };
        for text in event::changes(&last, &now) {
            self.note(now.time, (moods, text));
        }
    }

    /// Adds events for faults that began or ended since the previous tick.
    fn note_faults(&mut self, now: Time) {
        let (Some(armed_at), Some(last)) = (self.armed_at, self.last) else { return };
        let from_s = last.time.since(armed_at).seconds();
        let to_s = now.since(armed_at).seconds();
        let due = self.faults.iter().filter(|(at_s, _)| *at_s > from_s && *at_s <= to_s);
        for (at_s, text) in due.cloned().collect::<Vec<_>>() {
            self.note(armed_at + Span::from_seconds(at_s), (EventMood::Warning, text));
        }
    }

    fn note(&mut self, at: Time, (mood, text): (EventMood, String)) {
        if self.collected.events.len() == self.most_events {
            self.omitted += 1;
        } else {
            let t_s = (self.seconds(at) * 1e3).round() * 1e-3;
            self.collected.events.push(ViewedEvent { t_s, mood, text });
        }
    }
}

/// Text of the line that replaces this many events.
pub(crate) fn omitted(events: usize) -> String {
    format!("… and {events} more events, which are not shown")
}

/// Severity of a safety state.
fn mood(state: u8) -> EventMood {
    match SafetyState::from_code(state) {
        Some(SafetyState::Nominal) => EventMood::Good,
        Some(state) if state.ends_flight() => EventMood::Bad,
        _ => EventMood::Warning,
    }
}

impl Collector {
    fn truth(&mut self, truth: &TruthV1) {
        if !self.has_truth {
            return;
        }
        // The time of a restarted simulator may start again.
        if self.truths.back().is_some_and(|last| last.time > truth.time) {
            self.join();
            self.truths.clear();
        }
        // A recording is read in one go: its ticks must not wait until their truth is gone.
        if self.truths.len() == TRUTHS_KEPT {
            self.join();
            self.truths.drain(..TRUTHS_KEPT / 2);
        }
        self.truths.push_back(*truth);
    }

    fn vehicle(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        let Some(origin) = self.origin else { return };
        let since = |at: Time| at.since(origin).seconds();
        let row = row::vehicle(reception.received_at, (&reception.header, vehicle), since);
        self.collected.vehicles.push(row);
    }
}

impl Sink for Collector {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        match sample {
            Sample::Truth(truth) => self.truth(truth),
            Sample::Telemetry(telemetry) => {
                if self.latest().is_some_and(|latest| latest.time > telemetry.time) {
                    self.begin_again();
                }
                self.origin.get_or_insert(telemetry.time);
                self.waiting.push(*telemetry);
            }
            Sample::Vehicle(vehicle) => self.vehicle(reception, vehicle),
            Sample::Input(input) => {
                if let Some(text) = event::of_input(input) {
                    let is_loss = input.kind == InputKind::FilesLost.code();
                    let mood = if is_loss { EventMood::Bad } else { EventMood::Neutral };
                    self.note(input.time, (mood, text));
                }
            }
            Sample::Event(request) => {
                let latest = self.latest().map_or(Time::UNSET, |tick| tick.time);
                let at = event::made_at(reception.received_at, request).unwrap_or(latest);
                self.note(at, (EventMood::Neutral, event::of_operator(request)));
            }
            _ => {}
        }
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        let at = self.latest().map_or(Time::UNSET, |tick| tick.time);
        let text = format!("{count} samples of `{topic}` were lost before they were shown");
        self.note(at, (EventMood::Warning, text));
    }
}

#[cfg(test)]
mod tests;
