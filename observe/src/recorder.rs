//! The flight recorder: a sink that joins every tick of the daemon with the truth, and returns the recorded [`Flight`].

use std::collections::{BTreeSet, HashMap};

use oqtal_bus::code::Answer;
use oqtal_bus::message::{EventV1, PoseV1, TelemetryV1, TruthV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Role, Sample};
use oqtal_config::Config;

use crate::command_path::CommandPath;
use crate::crash::Crash;
use crate::event::{changes_course, made_at};
use crate::flight::{AppliedCommand, Flight, FlightSample, Outcome, PoseArrival};
use crate::flight_end::FlightEnd;
use crate::latency::OnwardTime;
use crate::nearest::NearestJoin;
use crate::sink::{Reception, Sink};
use crate::wire::WireRecord;

/// Time for which ticks wait for truth: without a first sample, a real vehicle is observed by real cameras; without a further one, its
/// source has ended, and the flight ends as the daemon reports.
const TRUTH_TIMEOUT: Span = Span::from_millis(1000);
/// Time without a tick in flight, while others publish, after which the daemon has ended.
const DAEMON_TIMEOUT: Span = Span::from_millis(1000);

/// Recorder of one flight.
#[derive(Debug)]
pub struct Recorder {
    /// The flight so far, with a provisional outcome.
    flight: Flight,
    end: FlightEnd,
    /// Process id of the daemon; `None` before its first tick.
    daemon_pid: Option<u32>,
    /// Source of the daemon's messages; `None` before its first tick.
    daemon_source: Option<u64>,
    /// Number of samples lost before the recorder received them, by topic.
    lost: Vec<(ObservedTopic, u64)>,
    /// Instant of the newest tick if the vehicle was armed in it.
    armed_at: Option<Time>,
    /// Instant of the tick that began the present or the last flight.
    armed_since: Time,
    /// Instant of the tick that ended the last flight.
    disarmed_at: Time,
    /// Instant of the newest message of cameras, vehicle or simulator.
    newest_at: Time,
    /// Commands lost according to the vehicle's last message \[-\].
    vehicle_lost: Option<u64>,
    join: NearestJoin<TelemetryV1, TruthV1>,
    /// Source of the newest truth; `None` before the first.
    truth_source: Option<u64>,
    config_hash: u64,
    /// Daemons whose configuration differs from the recorded one; and, in `flew`, daemons that flew.
    other_configs: BTreeSet<u32>,
    flew: BTreeSet<u32>,
    /// Instant of each request, by daemon and number.
    requests: HashMap<(u64, u64), Time>,
}

impl Recorder {
    /// Topics required for the evaluation of a flight.
    pub const TOPICS: [ObservedTopic; 6] = [
        ObservedTopic::Telemetry,
        ObservedTopic::Truth,
        ObservedTopic::Pose,
        ObservedTopic::Vehicle,
        ObservedTopic::External,
        ObservedTopic::Event,
    ];

    /// A recorder for a flight under `config`.
    pub fn new(config: &Config) -> Self {
        Self {
            flight: Flight::new(config),
            end: FlightEnd::default(),
            daemon_pid: None,
            daemon_source: None,
            lost: Vec::new(),
            armed_at: None,
            armed_since: Time::UNSET,
            disarmed_at: Time::UNSET,
            newest_at: Time::UNSET,
            vehicle_lost: None,
            join: NearestJoin::default(),
            truth_source: None,
            config_hash: config.hash(),
            other_configs: BTreeSet::new(),
            flew: BTreeSet::new(),
            requests: HashMap::new(),
        }
    }

    /// The newest vehicle message and the figures of the wire.
    pub fn wire(&self) -> &WireRecord {
        &self.flight.wire
    }

    /// Whether topic `truth` does not describe the vehicle: in a replay, and if the simulator is the shadow of another vehicle.
    fn has_no_truth(&self) -> bool {
        self.flight.is_replay() || self.flight.config.plant.shadow
    }

    /// Whether a pose was received.
    pub fn has_poses(&self) -> bool {
        !self.flight.arrivals.is_empty()
    }

    /// Process id of the daemon; `None` before its first tick was received.
    pub fn daemon_pid(&self) -> Option<u32> {
        self.daemon_pid
    }

    /// Number of samples lost before the recorder received them, by topic; empty if none were lost.
    pub fn lost(&self) -> &[(ObservedTopic, u64)] {
        &self.lost
    }

    /// Outcome of the flight; `None` while it lasts.
    pub fn outcome(&self) -> Option<Outcome> {
        self.end.outcome
    }

    /// Whether the vehicle was armed in a tick.
    pub fn was_armed(&self) -> bool {
        self.end.flown
    }

    /// Ticks so far, in order of time.
    pub fn samples(&self) -> &[FlightSample] {
        &self.flight.samples
    }

    /// The newest tick.
    pub fn latest(&self) -> Option<&FlightSample> {
        self.flight.samples.last()
    }

    /// Closes the record. The outcome is `otherwise` if the flight has not ended.
    pub fn finish(mut self, otherwise: Outcome, speed_factor: f64) -> Flight {
        let silent = self.armed_at.map(|armed_at| self.newest_at.since(armed_at));
        let has_died = silent.is_some_and(|silent| silent > DAEMON_TIMEOUT);
        if has_died && self.end.outcome.is_none() && !self.flight.is_observation() {
            self.daemon_died();
        }
        // A daemon that came later does not count, unless none flew.
        let mut others = self.other_configs.iter();
        let has_other_config = others.any(|it| self.flew.is_empty() || self.flew.contains(it));
        let (outcome, crash) = (self.end.at_end().unwrap_or(otherwise), self.end.crash);
        // Errors have one source: what has no truth in a flight with truth is not scored.
        if self.flight.has_truth() {
            let without = self.flight.samples.iter_mut().filter(|sample| sample.truth.is_none());
            without.for_each(|sample| sample.telemetry.scored = 0);
        }
        // A single tick has no duration.
        if self.flight.scored().take(2).count() == 1 {
            self.flight.samples.iter_mut().for_each(|sample| sample.telemetry.scored = 0);
        }
        let lost = self.lost.iter().find(|(topic, _)| *topic == ObservedTopic::Event);
        let lost_requests = lost.map_or(0, |(_, count)| *count);
        Flight { outcome, crash, speed_factor, has_other_config, lost_requests, ..self.flight }
    }

    /// Joins every waiting tick up to the newest truth sample with its nearest sample; in virtual time both have the same
    /// instant.
    fn join(&mut self) {
        while let Some((telemetry, truth)) = self.join.next_pair() {
            let truth = Some(*truth);
            self.push(FlightSample { telemetry, truth });
        }
    }

    /// Records the waiting ticks without truth if none has been published for too long.
    fn give_up_truth(&mut self) {
        let Some((first, last)) = self.join.waiting() else { return };
        let is_known_absent = self.join.newest().is_none() && !self.flight.samples.is_empty();
        if last.since(first) < TRUTH_TIMEOUT && !is_known_absent {
            return;
        }
        while let Some(telemetry) = self.join.next_tick() {
            self.push(FlightSample { telemetry, truth: None });
        }
    }

    fn push(&mut self, sample: FlightSample) {
        self.flight.samples.push(sample);
        if !self.flight.is_observation() {
            self.end.tick(&sample, &self.flight.config.fence);
        }
    }

    /// Records that the daemon ended in flight, after its last armed tick. On the floor, where nothing falls, the flight is unfinished.
    fn daemon_died(&mut self) {
        let Some(last) = self.flight.armed().last() else { return };
        match self.end.has_risen(last) {
            true => self.end.crashed(last.telemetry.time, Crash::DaemonDied),
            false => self.end.outcome = Some(Outcome::Unfinished),
        }
    }

    /// Ends a flight whose daemon died: the next daemon starts disarmed, and the vehicle has fallen.
    fn daemon_replaced(&mut self) {
        let in_flight =
            !self.flight.is_observation() && self.latest().is_some_and(FlightSample::is_armed);
        if in_flight && self.end.outcome.is_none() {
            self.daemon_died();
        } else if !in_flight {
            // The next daemon has the settings of its start.
            self.flight.discard_changes(|_| true);
        }
    }

    fn telemetry(&mut self, reception: &Reception, telemetry: &TelemetryV1) {
        let source = reception.header.source;
        if self.daemon_source.replace(source).is_some_and(|last| last != source) {
            self.daemon_replaced();
        }
        let process = reception.header.origin().process();
        self.daemon_pid = Some(process);
        if telemetry.is_armed() {
            self.flew.insert(process);
        }
        self.add_timing(telemetry);
        if self.has_no_truth() {
            self.push(FlightSample { telemetry: *telemetry, truth: None });
            return;
        }
        self.join.add_tick(telemetry.time, *telemetry);
        self.join();
        self.give_up_truth();
    }

    /// Adds the timing of a tick in which the vehicle is armed.
    fn add_timing(&mut self, telemetry: &TelemetryV1) {
        let armed_at = telemetry.is_armed().then_some(telemetry.time);
        let last = std::mem::replace(&mut self.armed_at, armed_at);
        if last.is_none() && armed_at.is_some() {
            self.end.is_replaced = false;
            self.armed_since = telemetry.time;
            // Settings stay as they are; the course begins again.
            self.flight.discard_changes(changes_course);
        }
        if last.is_some() && armed_at.is_none() {
            self.disarmed_at = telemetry.time;
        }
        let Some(now) = self.armed_at else { return };
        self.flight.wakeup_lateness.add(Span::from_nanos(telemetry.wakeup_lateness_ns));
        if let Some(last) = last {
            let deviation = now.since(last) - Span::period_of(self.flight.config.loop_rate_hz());
            self.flight.period_jitter.add(Span::from_nanos(deviation.nanos().abs()));
        }
    }

    /// Whether the vehicle was armed at the instant `at` of the present or the last flight. Topics are received one after the other, so
    /// that the newest tick may be much newer than the other messages.
    fn was_armed_at(&self, at: Time) -> bool {
        at >= self.armed_since && (self.armed_at.is_some() || at < self.disarmed_at)
    }

    fn pose(&mut self, reception: &Reception, pose: &PoseV1) {
        let header = &reception.header;
        self.flight.arrivals.push(PoseArrival {
            captured_at: header.stamps.captured_at,
            at: header.stamps.pose_published_at,
            frame: header.pose_sequence,
            position: pose.position,
            attitude: pose.attitude,
            is_tracked: pose.tracked != 0,
        });
    }

    fn vehicle(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        let header = &reception.header;
        // A bridge publishes in every period, also without a command.
        let woken_at = Some(header.stamps.woken_at).filter(|at| at.is_set());
        let is_armed = woken_at.map_or(self.armed_at.is_some(), |at| self.was_armed_at(at));
        let flight = &mut self.flight;
        let lost = vehicle
            .lost
            .saturating_sub(self.vehicle_lost.replace(vehicle.lost).unwrap_or(vehicle.lost));
        if is_armed {
            flight.commands_lost += lost;
        }
        if vehicle.simulated == 0 && flight.command_path == CommandPath::Bus {
            flight.command_path = CommandPath::of_bridge(&flight.config);
        }
        flight.wire.vehicle(header, vehicle, is_armed);
        if !header.stamps.applied_at.is_set() {
            return;
        }
        let (stamps, onward) = (header.stamps, OnwardTime::of(vehicle));
        if is_armed && !flight.is_observation() {
            flight.hops.add(&stamps, onward);
        }
        let (sequence, battery_v) = (vehicle.command_sequence, vehicle.battery_v);
        flight.applied.push(AppliedCommand { sequence, stamps, onward, battery_v });
    }

    /// Takes a request that changes the flight. One that the loop refuses has a second event, with the same number; each daemon counts
    /// its own requests.
    fn change(&mut self, reception: &Reception, event: &EventV1) {
        let changes = &mut self.flight.changes;
        let request = (reception.header.source, event.number);
        if event.answer == Answer::Refused.code() {
            if let Some(made_at) = self.requests.remove(&request) {
                changes.retain(|(at, change)| (*at, change.number) != (made_at, event.number));
            }
        } else {
            let received_at = reception.received_at;
            // A later file begins with the changes made before it; they precede all of its ticks.
            let is_before_all = self.daemon_source.is_none();
            let unknown = if is_before_all { Time::UNSET } else { received_at };
            let made_at = made_at(received_at, event).unwrap_or(unknown);
            self.requests.insert(request, made_at);
            changes.push((made_at, *event));
        }
    }
}

impl Sink for Recorder {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        if matches!(sample, Sample::Truth(_) | Sample::Pose(_) | Sample::Vehicle(_)) {
            self.newest_at = reception.received_at;
        }
        match sample {
            Sample::Truth(truth) => {
                let source = Some(reception.header.source);
                let last = std::mem::replace(&mut self.truth_source, source);
                // The last ticks of the flight wait for truth.
                let is_flown =
                    self.armed_at.is_some() || truth.time.since(self.disarmed_at) < TRUTH_TIMEOUT;
                self.end.is_replaced |= is_flown && last.is_some() && last != source;
                self.join.add_sample(truth.time, *truth);
                self.join();
            }
            Sample::Telemetry(telemetry) => self.telemetry(reception, telemetry),
            Sample::Pose(pose) => self.pose(reception, pose),
            Sample::Vehicle(vehicle) => self.vehicle(reception, vehicle),
            Sample::External(it) if self.was_armed_at(it.asked_at) => self.flight.add_answer(it),
            Sample::Event(event) => self.change(reception, event),
            Sample::Health(Role::Daemon, health) if health.config_hash != self.config_hash => {
                self.other_configs.insert(reception.header.origin().process());
            }
            _ => {}
        }
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        match self.lost.iter_mut().find(|(other, _)| *other == topic) {
            Some((_, total)) => *total += count,
            None => self.lost.push((topic, count)),
        }
    }
}

#[cfg(test)]
mod tests;
