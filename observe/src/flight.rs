//! A recorded flight: the messages of all processes, joined by time. Source of summary, tables and report.

use std::fmt;

use crate::latency::{Distribution, HopDistributions};
use oqtal_bus::code::{Cause, HandoverCause, SafetyState};
use oqtal_bus::message::{EventV1, ExternalV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use serde::{Deserialize, Serialize};

pub use crate::applied_command::AppliedCommand;
use crate::command_path::CommandPath;
use crate::crash::Crash;
pub use crate::flight_sample::FlightSample;
use crate::kernel::ProcessUsage;
use crate::wire::WireRecord;

/// Time after the last armed tick in which losses are still counted: a loss that ends a flight is detected slightly later.
pub(crate) const COUNTED_AFTER: Span = Span::from_millis(1000);

/// Cause of a flight that the fence held for a time but that landed by itself.
pub const HELD: &str = "held by the fence";

/// Time since the beginning of a flight above which a record that begins then has missed the arming \[s\].
pub(crate) const MISSED_ARMING_S: f64 = 0.1;

/// Height above the vehicle's place at arming below which it has not taken off \[m\].
const TAKEN_OFF_M: f64 = 0.05;

/// Whether `cause`, of [`Flight::cause`], is a hold by the fence, with or without a landing by the daemon, or a stop at it.
pub fn is_of_fence(cause: &str) -> bool {
    let ends_with = |known: Cause| cause.ends_with(&known.to_string());
    cause == HELD || ends_with(Cause::HeldTooLong) || ends_with(Cause::Fence)
}

/// Outcome of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// On the floor, at rest, disarmed.
    Landed,
    /// The daemon stopped the motors, by its own decision or on an operator's request.
    Stopped,
    /// The vehicle crashed, see [`Crash`].
    Crashed,
    /// The flight did not end within the time planned for it.
    Timeout,
    /// A recording was played to its end.
    Replayed,
    /// The daemon only observed: it sent no commands.
    Observed,
    /// The recording ends before the flight.
    Unfinished,
}

impl Outcome {
    /// Whether a vehicle was to fly: neither a replay nor an observation.
    pub fn is_of_flight(self) -> bool {
        !matches!(self, Self::Replayed | Self::Observed)
    }

    /// Outcome with this name.
    pub fn parse(name: &str) -> Option<Self> {
        serde_json::from_value(name.into()).ok()
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Landed => "landed",
            Self::Stopped => "stopped",
            Self::Crashed => "crashed",
            Self::Timeout => "timeout",
            Self::Replayed => "replayed",
            Self::Observed => "observed",
            Self::Unfinished => "unfinished",
        })
    }
}

/// Received pose.
#[derive(Clone, Copy, Debug)]
pub struct PoseArrival {
    /// Instant of capture.
    pub captured_at: Time,
    /// Instant of publication.
    pub at: Time,
    /// Number of its camera frame \[-\]; a gap is a lost frame.
    pub frame: u64,
    /// Measured position \[m, world\].
    pub position: [f64; 3],
    /// Measured attitude, scalar last \[-\]; body to world.
    pub attitude: [f64; 4],
    /// Whether the cameras saw the body.
    pub is_tracked: bool,
}

/// Questions to an external law from arming to disarming.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct AnswerCounts {
    /// Number of questions \[-\].
    pub questions: u64,
    /// Number of questions that were answered late or not at all \[-\].
    pub unanswered: u64,
    /// Number of these for which no law was connected, or the law ended \[-\].
    pub unconnected: u64,
}

impl AnswerCounts {
    /// Share of the questions without an answer in time, as text.
    pub(crate) fn share(&self) -> String {
        format!("{} of {} questions", self.unanswered, self.questions)
    }

    /// Counts a question with its answer; returns whether the answer came in time: a late one is received with a later question, or not
    /// at all.
    pub(crate) fn add(&mut self, answer: &ExternalV1) -> bool {
        use HandoverCause::{Absent, Ended, Malformed, Missing};
        let verdict = HandoverCause::from_code(answer.verdict).unwrap_or_default();
        // A malformed answer has no number.
        let is_of_question = answer.sequence == answer.question || verdict == Malformed;
        let is_in_time = answer.answered_at.is_set() && is_of_question && verdict != Missing;
        self.questions += 1;
        self.unanswered += u64::from(!is_in_time);
        self.unconnected += u64::from(matches!(verdict, Absent | Ended));
        is_in_time
    }
}

impl fmt::Display for AnswerCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} had no answer in time", self.share())?;
        match self.unconnected {
            0 => Ok(()),
            count => write!(f, ", {count} because no law was connected"),
        }
    }
}

/// The record of a flight.
#[derive(Clone, Debug)]
pub struct Flight {
    /// Effective configuration.
    pub config: Config,
    /// Path of the commands to the vehicle.
    pub command_path: CommandPath,
    /// Outcome of the flight.
    pub outcome: Outcome,
    /// Instant and cause of a crash; `None` unless the vehicle crashed.
    pub crash: Option<(Time, Crash)>,
    /// Every tick, from the first to the last.
    pub samples: Vec<FlightSample>,
    /// Every pose received.
    pub arrivals: Vec<PoseArrival>,
    /// Latencies of the commands that were applied while the vehicle was armed.
    pub hops: HopDistributions,
    /// Figures of the wire to the vehicle; empty without a wire.
    pub wire: WireRecord,
    /// Wake-up lateness of the daemon in the ticks from arming to disarming.
    pub wakeup_lateness: Distribution,
    /// Deviation of the time between two ticks from the loop period, from arming to disarming.
    pub period_jitter: Distribution,
    /// Number of commands that never reached the vehicle.
    pub commands_lost: u64,
    /// Every command that reached the vehicle.
    pub applied: Vec<AppliedCommand>,
    /// Questions to an external law; none without one.
    pub answers: AnswerCounts,
    /// Operators' requests that changed the flight or its settings, with their instants; without those that were refused.
    pub changes: Vec<(Time, EventV1)>,
    /// Flight time over wall time, from the first to the last tick \[-\].
    pub speed_factor: f64,
    /// Resource use of the daemon; `None` if it was not a separate process.
    pub daemon: Option<ProcessUsage>,
    /// Whether the daemon ran with another configuration than the flight has.
    pub has_other_config: bool,
    /// Number of requests that were overwritten before they were recorded \[-\].
    pub lost_requests: u64,
}

impl Flight {
    /// Record of a flight under `config` that has not begun.
    pub fn new(config: &Config) -> Self {
        Self {
            config: config.clone(),
            command_path: CommandPath::Bus,
            outcome: Outcome::Unfinished,
            crash: None,
            samples: Vec::with_capacity(4096),
            arrivals: Vec::with_capacity(4096),
            hops: HopDistributions::default(),
            wire: WireRecord::default(),
            wakeup_lateness: Distribution::default(),
            period_jitter: Distribution::default(),
            commands_lost: 0,
            applied: Vec::with_capacity(4096),
            answers: AnswerCounts::default(),
            changes: Vec::new(),
            speed_factor: 0.0,
            daemon: None,
            has_other_config: false,
            lost_requests: 0,
        }
    }

    /// Adds a question to an external law, with the time of an answer that came in time.
    pub(crate) fn add_answer(&mut self, answer: &ExternalV1) {
        if self.answers.add(answer) {
            self.hops.add_answer(answer.answered_at.since(answer.asked_at));
        }
    }

    /// The configuration with the settings that operators changed before the take-off.
    pub fn config_at_arming(&self) -> Config {
        self.config_after(self.changes_until(self.origin()))
    }

    /// Safety states of the flights, and shortly after each; all of them if the vehicle was never armed. On the ground the daemon waits for
    /// poses in a state that is not part of a flight, and another daemon may follow.
    pub(crate) fn state_sequence(&self) -> Vec<String> {
        let is_flown = self.armed().next().is_some();
        let (mut was_armed, mut until) = (false, Time::UNSET);
        let mut is_counted = |sample: &&FlightSample| {
            let (time, is_armed) = (sample.telemetry.time, sample.is_armed());
            until = if is_armed { time + COUNTED_AFTER } else { until };
            // The tick that stopped the motors may come late.
            let stops =
                std::mem::replace(&mut was_armed, is_armed) && self.outcome == Outcome::Stopped;
            !is_flown || stops || time <= until
        };
        let counted = self.samples.iter().filter(|sample| is_counted(sample));
        let mut states: Vec<u8> = counted.map(|sample| sample.telemetry.state).collect();
        states.dedup();
        let name = |code: &u8| SafetyState::from_code(*code).map(|state| state.to_string());
        states.iter().filter_map(name).collect()
    }

    /// Discards the changes for which `is_void` holds, except those of a completed flight.
    pub(crate) fn discard_changes(&mut self, is_void: fn(&EventV1) -> bool) {
        let flown = self.samples.iter().rev().find(|sample| sample.is_armed());
        let ended_at = flown.map(|sample| sample.telemetry.time);
        let is_flown = |at: Time| ended_at.is_some_and(|ended_at| at <= ended_at);
        self.changes.retain(|(at, change)| is_flown(*at) || !is_void(change));
    }

    /// Settings that operators changed before the take-off and did not change back, each `KEY=VALUE`, by their last change.
    pub fn changed_settings(&self) -> Vec<String> {
        let mut changed: Vec<&str> = Vec::new();
        let key = |line: &str| line.split(['=', ' ']).next().unwrap_or_default().to_owned();
        for line in self.settings_of(self.changes_until(self.origin())) {
            changed.retain(|other| key(other) != key(line));
            changed.push(line);
        }
        let differences = self.config.described_differences(&self.config_at_arming());
        let differs = |line: &&str| differences.iter().any(|other| key(other) == key(line));
        changed.into_iter().filter(differs).map(str::to_owned).collect()
    }

    /// Names of the laws that flew the scored window, in order; of all armed ticks if nothing is scored.
    pub fn laws(&self) -> String {
        let until = |sample: &FlightSample| self.changes_until(sample.telemetry.time);
        let mut changes: Vec<usize> = self.scored().map(until).collect();
        if changes.is_empty() {
            changes.extend(self.armed().map(until));
        }
        changes.dedup();
        if changes.is_empty() {
            changes.push(self.changes_until(self.origin()));
        }
        let law = |count| self.config_after(count).control.controller.name();
        let mut laws: Vec<&str> = changes.into_iter().map(law).collect();
        laws.dedup();
        laws.join(" then ")
    }

    /// Number of changes up to the instant `at`.
    fn changes_until(&self, at: Time) -> usize {
        self.changes.partition_point(|(changed_at, _)| *changed_at <= at)
    }

    /// The configuration with the settings of the first `count` changes.
    fn config_after(&self, count: usize) -> Config {
        let mut settings: Vec<Setting> = Vec::new();
        for line in self.settings_of(count) {
            match line.strip_suffix(" unset") {
                Some(key) => settings.retain(|setting| setting.key != key),
                None => settings.extend(Setting::parse("set", line).ok()),
            }
        }
        self.config.with_live(&settings).unwrap_or_else(|_| self.config.clone())
    }

    /// The settings of the first `count` changes, `KEY=VALUE` or `KEY unset`.
    fn settings_of(&self, count: usize) -> impl Iterator<Item = &str> {
        let before = self.changes[..count].iter().filter(|(_, event)| event.refusal().is_none());
        let lines = before.flat_map(|(_, event)| event.text.as_str().lines());
        // Requests of the course, like a title, are not settings.
        lines.filter(|line| line.contains('=') || line.ends_with(" unset"))
    }

    /// The ticks from arming to disarming.
    pub fn armed(&self) -> impl Iterator<Item = &FlightSample> {
        self.samples.iter().filter(|sample| sample.is_armed())
    }

    /// Whether the vehicle did not rise in the first flight, for example because the flight was ended while the motors were being started.
    pub(crate) fn lacks_take_off(&self) -> bool {
        let Some(first) = self.flights().next() else { return false };
        let is_risen =
            |sample: &FlightSample| sample.position().z > first[0].position().z + TAKEN_OFF_M;
        !self.begins_in_flight() && !first.iter().any(is_risen)
    }

    /// The ticks of each flight, from arming to disarming: several in the recording of a session.
    pub fn flights(&self) -> impl Iterator<Item = &[FlightSample]> {
        let alike = |a: &FlightSample, b: &FlightSample| a.is_armed() == b.is_armed();
        self.samples.chunk_by(alike).filter(|ticks| ticks[0].is_armed())
    }

    /// The configuration at the start of the longest flight, with the settings that operators had changed by then.
    pub fn config_of_longest_flight(&self) -> Config {
        let longest = self.flights().max_by_key(|ticks| ticks.len());
        let start = longest.map_or(self.origin(), |ticks| ticks[0].telemetry.time);
        self.config_after(self.changes_until(start))
    }

    /// Whether the true motion of the vehicle is known, at least in some ticks.
    pub(crate) fn has_truth(&self) -> bool {
        self.samples.iter().any(|sample| sample.truth.is_some())
    }

    /// The ticks of the scored window, over which errors are computed.
    pub fn scored(&self) -> impl Iterator<Item = &FlightSample> {
        self.samples.iter().filter(|sample| sample.is_scored())
    }

    /// Integral of `value`, held from tick to tick, over the pairs of successive ticks of which both have a property \[s times its unit\].
    pub(crate) fn integral(
        &self,
        has: impl Fn(&FlightSample) -> bool,
        value: impl Fn(&FlightSample) -> f64,
    ) -> f64 {
        let both = self.samples.windows(2).filter(|pair| pair.iter().all(&has));
        let time_s =
            |pair: &[FlightSample]| pair[1].telemetry.time.since(pair[0].telemetry.time).seconds();
        // An empty sum of floating-point numbers would be -0.
        both.fold(0.0, |sum, pair| sum + value(&pair[0]) * time_s(pair))
    }

    /// Time that is scored, without that for which the fence held the vehicle \[s\].
    pub fn scored_s(&self) -> f64 {
        self.integral(FlightSample::is_scored, |_| 1.0)
    }

    /// Time for which the fence held the vehicle \[s\].
    pub fn held_s(&self) -> f64 {
        self.integral(FlightSample::is_held, |_| 1.0)
    }

    /// Whether a recording was played.
    pub fn is_replay(&self) -> bool {
        self.config.is_replay()
    }

    /// Whether the record begins in flight, some time after arming: the instant of arming is unknown.
    pub fn begins_in_flight(&self) -> bool {
        let began = self.samples.first();
        began.is_some_and(|tick| tick.is_armed() && tick.telemetry.mission_s > MISSED_ARMING_S)
    }

    /// Whether the daemon only observed the poses of cameras or of a recording: no flight took place, and no commands were sent.
    pub fn is_observation(&self) -> bool {
        self.config.safety.observe_only
    }

    /// Instant of the first armed tick, or of the first tick if none is armed: zero of the time axis.
    pub fn origin(&self) -> Time {
        let first = self.armed().next().or(self.samples.first());
        first.map_or(Time::UNSET, |sample| sample.telemetry.time)
    }
}
