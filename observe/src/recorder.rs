//! The flight recorder: a sink that joins every tick of the daemon with the truth, detects the end of the flight, and makes a
//! [`Flight`] of it.

use std::collections::VecDeque;

use crate::latency::{Distribution, HopDistributions, OnwardTime};
use oqtal_bus::code::{Mode, SafetyState};
use oqtal_bus::message::{PoseV1, TelemetryV1, TruthV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;

use crate::command_path::CommandPath;
use crate::crash::Crash;
use crate::flight::{AppliedCommand, Flight, FlightSample, Outcome, PoseArrival};
use crate::nearest::nearest;
use crate::sink::{ObservedTopic, Reception, Sink};
use crate::wire::WireRecord;

/// Height below which a vehicle at rest has landed \[m\].
const ON_FLOOR_M: f64 = 0.05;
/// Speed below which a vehicle is at rest \[m/s\].
const AT_REST_M_S: f64 = 0.1;
/// Time at rest after which the flight is over.
const REST: Span = Span::from_millis(500);
/// Ticks that wait so long for the first sample of the truth have none: a real vehicle, seen by real cameras.
const TRUTH_TIMEOUT: Span = Span::from_millis(1000);
/// Number of truth samples kept, among which a late tick finds the nearest.
const TRUTHS_KEPT: usize = 64;

/// Records one flight.
#[derive(Debug)]
pub struct Recorder {
    config: Config,
    /// Process id of the daemon; `None` before its first tick.
    daemon_pid: Option<u64>,
    /// Source of the daemon's messages; `None` before its first tick.
    daemon_source: Option<u64>,
    /// Samples that were lost before the recorder received them, by topic.
    lost: Vec<(ObservedTopic, u64)>,
    samples: Vec<FlightSample>,
    arrivals: Vec<PoseArrival>,
    hops: HopDistributions,
    wire: WireRecord,
    wakeup_lateness: Distribution,
    period_jitter: Distribution,
    commands_lost: u64,
    poses_repeated: u64,
    commands_repeated: u64,
    last_tick: Option<Time>,
    last_command: u64,
    applied: Vec<AppliedCommand>,
    waiting: VecDeque<TelemetryV1>,
    /// The newest samples of the truth, oldest first.
    truths: VecDeque<TruthV1>,
    flown: bool,
    resting_since: Option<Time>,
    outcome: Option<Outcome>,
    crash: Option<Crash>,
}

impl Recorder {
    /// The topics that a flight is judged by.
    pub const TOPICS: [ObservedTopic; 4] = [
        ObservedTopic::Telemetry,
        ObservedTopic::Truth,
        ObservedTopic::Pose,
        ObservedTopic::Vehicle,
    ];

    /// A recorder for a flight under `config`.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        Self {
            config: config.clone(),
            daemon_pid: None,
            daemon_source: None,
            lost: Vec::new(),
            samples: Vec::with_capacity(4096),
            arrivals: Vec::with_capacity(4096),
            hops: HopDistributions::default(),
            wire: WireRecord::default(),
            wakeup_lateness: Distribution::default(),
            period_jitter: Distribution::default(),
            commands_lost: 0,
            poses_repeated: 0,
            commands_repeated: 0,
            last_tick: None,
            last_command: 0,
            applied: Vec::with_capacity(4096),
            waiting: VecDeque::new(),
            truths: VecDeque::with_capacity(TRUTHS_KEPT),
            flown: false,
            resting_since: None,
            outcome: None,
            crash: None,
        }
    }

    /// The newest vehicle message and the figures of the wire.
    #[must_use]
    pub fn wire(&self) -> &WireRecord {
        &self.wire
    }

    /// Whether topic `truth` does not describe the vehicle: in a replay, and when the simulator is the shadow of another vehicle.
    fn has_no_truth(&self) -> bool {
        self.config.is_replay() || self.config.plant.shadow
    }

    /// Whether a pose was received.
    #[must_use]
    pub fn has_poses(&self) -> bool {
        !self.arrivals.is_empty()
    }

    /// Process id of the daemon; `None` before its first tick was received.
    #[must_use]
    pub fn daemon_pid(&self) -> Option<u64> {
        self.daemon_pid
    }

    /// Samples that were lost before the recorder received them, by topic; empty if there were none.
    #[must_use]
    pub fn lost(&self) -> &[(ObservedTopic, u64)] {
        &self.lost
    }

    /// How the flight ended; `None` while it lasts.
    #[must_use]
    pub fn outcome(&self) -> Option<Outcome> {
        self.outcome
    }

    /// The ticks so far, in the order of time.
    #[must_use]
    pub fn samples(&self) -> &[FlightSample] {
        &self.samples
    }

    /// The newest tick.
    #[must_use]
    pub fn latest(&self) -> Option<&FlightSample> {
        self.samples.last()
    }

    /// Closes the record. The outcome is `otherwise` if the flight has not ended by itself.
    #[must_use]
    pub fn finish(self, otherwise: Outcome, speed_factor: f64) -> Flight {
        Flight {
            outcome: self.outcome.unwrap_or(otherwise),
            crash: self.crash,
            config: self.config,
            command_path: CommandPath::Bus,
            samples: self.samples,
            arrivals: self.arrivals,
            hops: self.hops,
            wire: self.wire,
            wakeup_lateness: self.wakeup_lateness,
            period_jitter: self.period_jitter,
            commands_lost: self.commands_lost,
            poses_repeated: self.poses_repeated,
            commands_repeated: self.commands_repeated,
            applied: self.applied,
            speed_factor,
            daemon: None,
        }
    }

    /// Joins every waiting tick up to the newest truth sample with the sample nearest in time; in virtual time both have the
    /// same instant.
    fn join(&mut self) {
        let Some(newest) = self.truths.back().map(|truth| truth.time) else { return };
        while self.waiting.front().is_some_and(|first| first.time <= newest) {
            let Some(telemetry) = self.waiting.pop_front() else { return };
            let index = nearest(&self.truths, telemetry.time, |truth| truth.time);
            let truth = index.map(|index| self.truths[index]);
            self.push(FlightSample { telemetry, truth });
        }
    }

    /// Goes on without the truth where none comes.
    fn give_up_truth(&mut self) {
        let Some((first, last)) = self.waiting.front().zip(self.waiting.back()) else { return };
        let may_come = self.samples.is_empty() && last.time.since(first.time) < TRUTH_TIMEOUT;
        if !self.truths.is_empty() || may_come {
            return;
        }
        while let Some(telemetry) = self.waiting.pop_front() {
            self.push(FlightSample { telemetry, truth: None });
        }
    }

    fn push(&mut self, sample: FlightSample) {
        let before = self.samples.last().copied();
        self.samples.push(sample);
        if self.outcome.is_some() || self.config.is_replay() {
            return;
        }
        self.judge(&sample);
        let touchdown = before.filter(|_| self.outcome.is_none() && self.flown);
        if let Some(crash) = touchdown.and_then(|before| Crash::at_touchdown(&before, &sample)) {
            (self.outcome, self.crash) = (Some(Outcome::Crashed), Some(crash));
        }
    }

    /// The daemon that flew has died: another one starts disarmed, and the vehicle has fallen.
    fn daemon_replaced(&mut self) {
        let in_flight = self.samples.last().is_some_and(FlightSample::is_armed);
        if in_flight && self.outcome.is_none() {
            (self.outcome, self.crash) = (Some(Outcome::Crashed), Some(Crash::DaemonDied));
        }
    }

    fn judge(&mut self, sample: &FlightSample) {
        if sample.is_armed() {
            self.flown = true;
            self.crash = Crash::of(sample, &self.config.fence);
            self.outcome = self.crash.map(|_| Outcome::Crashed);
            return;
        }
        if sample.telemetry.state == SafetyState::Stop.code() {
            self.outcome = Some(Outcome::Stopped);
            return;
        }
        let landed = self.flown
            && sample.telemetry.mode == Mode::Disarmed.code()
            && sample.position().z < ON_FLOOR_M
            && sample.velocity().norm() < AT_REST_M_S;
        let now = sample.telemetry.time;
        self.resting_since = landed.then(|| self.resting_since.unwrap_or(now));
        if self.resting_since.is_some_and(|since| now.since(since) >= REST) {
            self.outcome = Some(Outcome::Landed);
        }
    }
}

impl Sink for Recorder {
    /// Joins the waiting ticks up to this sample with the truth.
    fn truth(&mut self, _: &Reception, truth: &TruthV1) {
        if self.truths.len() == TRUTHS_KEPT {
            self.truths.pop_front();
        }
        self.truths.push_back(*truth);
        self.join();
    }

    fn telemetry(&mut self, reception: &Reception, telemetry: &TelemetryV1) {
        let source = reception.header.source;
        if self.daemon_source.replace(source).is_some_and(|last| last != source) {
            self.daemon_replaced();
        }
        self.daemon_pid = Some(u64::from(reception.header.origin().process()));
        self.wakeup_lateness.add(Span::from_nanos(telemetry.wakeup_lateness_ns));
        if let Some(last) = self.last_tick.replace(telemetry.time) {
            let period = Span::period_of(self.config.control.rate_hz);
            let deviation = telemetry.time.since(last) - period;
            self.period_jitter.add(Span::from_nanos(deviation.nanos().abs()));
        }
        if self.has_no_truth() {
            self.push(FlightSample { telemetry: *telemetry, truth: None });
            return;
        }
        self.waiting.push_back(*telemetry);
        self.join();
        self.give_up_truth();
    }

    fn pose(&mut self, reception: &Reception, pose: &PoseV1) {
        let header = &reception.header;
        let last = self.arrivals.last().map_or(0, |arrival| arrival.frame);
        self.poses_repeated += u64::from(header.pose_sequence == last);
        self.arrivals.push(PoseArrival {
            at: header.stamps.pose_published_at,
            frame: header.pose_sequence,
            position: pose.position,
        });
    }

    fn vehicle(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        let header = &reception.header;
        self.commands_lost = vehicle.lost;
        self.wire.vehicle(header, vehicle);
        if !header.stamps.applied_at.is_set() {
            // A bridge publishes in every period; in this one it had no new command.
            return;
        }
        let (stamps, onward) = (header.stamps, OnwardTime::of(vehicle));
        self.hops.add(&stamps, onward);
        self.commands_repeated += u64::from(vehicle.command_sequence == self.last_command);
        self.last_command = vehicle.command_sequence;
        let (sequence, battery_v) = (vehicle.command_sequence, vehicle.battery_v);
        self.applied.push(AppliedCommand { sequence, stamps, onward, battery_v });
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        match self.lost.iter_mut().find(|(other, _)| *other == topic) {
            Some((_, total)) => *total += count,
            None => self.lost.push((topic, count)),
        }
    }
}
