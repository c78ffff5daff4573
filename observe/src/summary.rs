//! The figures of a flight: `summary.json`.

use std::collections::BTreeMap;

use crate::attitude_steps::attitude_steps;
use crate::latency::{Distribution, DistributionSummary};
use nalgebra::Vector3;
use oqtal_bus::message::{FNV_OFFSET, TelemetryV1, fnv1a};
use oqtal_config::{ClockKind, Config, Interface};
use oqtal_control::metrics::Statistics;
use serde::Serialize;

use crate::command_path::CommandPath;
use crate::corners::CornerFigures;
use crate::event::ChangeInFlight;
use crate::fault::{AppliedDisturbance, InjectedFault};
use crate::flight::{AnswerCounts, COUNTED_AFTER, Flight, FlightSample, Outcome};
use crate::handovers::HandoverFigures;
use crate::hold::FenceHold;
use crate::kernel::ProcessUsage;
use crate::provenance::Provenance;
use crate::settling::StepSettling;
use crate::wire::WireFigures;

/// Maximum number of safety states listed by name \[-\].
const MOST_STATES: usize = 7;

/// Statistics of an error, in the unit of the summary's field: \[m\], \[m/s\] or \[deg\].
#[derive(Clone, Debug, Serialize)]
pub struct ErrorFigures {
    /// Mean magnitude \[unit of the field\].
    pub mean: f64,
    /// Root mean square of the magnitude \[unit of the field\].
    pub rms: f64,
    /// Maximum magnitude \[unit of the field\].
    pub max: f64,
    /// Root mean square by axis \[unit of the field\]: x, y, z of the world, or roll, pitch, yaw of the body.
    pub rms_by_axis: [f64; 3],
}

/// The vehicle that flew.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlownVehicle {
    /// In the form of `--vehicle`; `none` if nothing was flown.
    vehicle: String,
    /// Whether a simulated vehicle has other values than its preset.
    vehicle_changed: bool,
}

/// Number of lost or repeated messages by topic.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TopicCounts {
    /// Poses \[-\]; lost ones from gaps in frame numbers, or, in a recording, from gaps in time.
    pub pose: u64,
    /// Commands \[-\]; lost ones from gaps in their sequence.
    pub command: u64,
}

/// Figures of a flight. Errors are computed over the scored window and are `None` if it is empty.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Summary {
    pub controller: String,
    pub trajectory: String,
    #[serde(flatten)]
    pub vehicle: FlownVehicle,
    pub clock: String,
    pub seed: u64,
    pub ticks: usize,
    pub duration_s: f64,
    pub scored_s: f64,
    #[serde(flatten)]
    pub hold: FenceHold,
    pub outcome: Outcome,
    /// Reason why the flight did not end as planned; `None` if it did.
    pub shortfall: Option<String>,
    pub error_source: &'static str,
    pub position_error_m: Option<ErrorFigures>,
    pub velocity_error_m_s: Option<ErrorFigures>,
    pub attitude_error_deg: Option<ErrorFigures>,
    /// Figures at the corners; `None` for a path without corners.
    pub corners: Option<CornerFigures>,
    /// Settling after the steps of an `attitude-doublet`; `None` for another trajectory.
    pub attitude_steps: Option<StepSettling>,
    /// Integral of the norm of sticks \[s\] or torque \[N m s\] over the scored window, Table II.
    pub effort: Option<f64>,
    pub riccati_solves: u64,
    /// Flight time over wall time \[-\].
    pub speed_factor: f64,
    pub deadline_misses: u64,
    pub lost: TopicCounts,
    pub repeated: TopicCounts,
    /// Poses superseded by a newer one before the daemon read them \[-\]: bursts, or a late daemon.
    pub poses_superseded: u64,
    /// Poses refused by the guard \[-\].
    pub poses_refused: u64,
    pub hops: BTreeMap<&'static str, DistributionSummary>,
    /// Figures of the wire to the vehicle; `None` without a wire.
    pub wire: Option<WireFigures>,
    /// Wake-up lateness of the daemon; `None` in virtual time, where it has no meaning.
    pub wakeup_lateness: Option<DistributionSummary>,
    /// Deviation of the time between two ticks from the loop period; `None` in virtual time, where it has no meaning.
    pub period_jitter: Option<DistributionSummary>,
    /// Resource use of the daemon; `None` if it was not a separate process.
    pub daemon: Option<ProcessUsage>,
    /// Questions to an external law; `None` for another law.
    pub answers: Option<AnswerCounts>,
    /// Hand-overs to the fallback law; `None` for a law without one.
    pub handovers: Option<HandoverFigures>,
    /// Safety states passed through, in order.
    pub state_sequence: Vec<String>,
    /// Injected faults, in order of their beginnings.
    pub faults: Vec<InjectedFault>,
    /// Disturbances, in order of their beginnings.
    pub disturbances: Vec<AppliedDisturbance>,
    #[serde(flatten)]
    pub settings: FlownSettings,
    /// Operators' requests that changed the flight or its settings, in order.
    pub changes: Vec<ChangeInFlight>,
    pub trajectory_hash: Option<String>,
}

/// Settings at the take-off.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlownSettings {
    /// Settings that operators changed before it, each `KEY=VALUE`.
    pub changed_settings: Vec<String>,
    /// Hash of the configuration.
    pub config_hash: String,
}

impl FlownSettings {
    fn of(flight: &Flight, config: &Config) -> Self {
        let config_hash = format!("{:016x}", config.hash());
        Self { changed_settings: flight.changed_settings(), config_hash }
    }

    /// The settings that operators changed, as text; `None` without any.
    pub fn changed(&self) -> Option<String> {
        (!self.changed_settings.is_empty()).then(|| self.changed_settings.join(", "))
    }
}

impl FlownVehicle {
    fn of(flight: &Flight) -> Self {
        let (preset, plant) = (&flight.config.vehicle.preset, &flight.config.plant);
        let vehicle = match (&flight.command_path, plant.interface) {
            (CommandPath::Bus, _) if flight.is_replay() || flight.is_observation() => "none".into(),
            (CommandPath::Bus, Interface::Torque) => format!("sim:{preset}"),
            (CommandPath::Bus, Interface::Rate | Interface::Attitude) => {
                format!("sim:{preset},fidelity={}", name_of(&plant.fidelity))
            }
            (path, _) => path.to_string(),
        };
        let is_simulated = vehicle.starts_with("sim:");
        Self { vehicle, vehicle_changed: is_simulated && !flight.config.has_vehicle_of_preset() }
    }
}

impl std::fmt::Display for FlownVehicle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.vehicle)?;
        f.write_str(if self.vehicle_changed { " with changed values" } else { "" })
    }
}

impl TopicCounts {
    fn new(pose: u64, command: u64) -> Self {
        Self { pose, command }
    }
}

impl Summary {
    /// The figures of `flight`.
    pub fn of(flight: &Flight) -> Self {
        Self::with(flight, &flight.config_at_arming())
    }

    /// The figures of `flight` under the configuration of its take-off.
    fn with(flight: &Flight, config: &Config) -> Self {
        Self {
            controller: flight.laws(),
            trajectory: name_of(&config.trajectory.kind),
            vehicle: FlownVehicle::of(flight),
            clock: name_of(&config.clock.kind),
            seed: config.clock.seed,
            ticks: flight.armed().count(),
            duration_s: duration_s(flight),
            scored_s: flight.scored_s(),
            hold: FenceHold::of(flight),
            outcome: flight.outcome,
            shortfall: flight.shortfall(),
            error_source: error_source(flight),
            position_error_m: scored_figures(flight, FlightSample::position_error),
            velocity_error_m_s: scored_figures(flight, FlightSample::velocity_error),
            attitude_error_deg: scored_figures(flight, attitude_error_deg),
            corners: CornerFigures::of(flight),
            attitude_steps: attitude_steps(flight),
            effort: effort(flight),
            riccati_solves: riccati_solves(flight),
            speed_factor: flight.speed_factor,
            deadline_misses: count(flight, |tick| tick.deadline_misses),
            lost: TopicCounts::new(count(flight, |tick| tick.poses_lost), flight.commands_lost),
            repeated: TopicCounts::new(flight.poses_repeated(), flight.commands_repeated()),
            poses_superseded: count(flight, |tick| tick.poses_superseded),
            poses_refused: count(flight, |tick| tick.poses_refused),
            hops: flight.hops.iter().map(|(name, hop)| (name, hop.summary())).collect(),
            wire: flight.wire.figures(flight.command_path.is_line()),
            wakeup_lateness: in_real_time(config, &flight.wakeup_lateness),
            period_jitter: in_real_time(config, &flight.period_jitter),
            daemon: flight.daemon.clone(),
            answers: config.control.is_external().then_some(flight.answers),
            handovers: HandoverFigures::of(flight),
            state_sequence: flight.state_sequence(),
            faults: InjectedFault::all(flight),
            disturbances: AppliedDisturbance::all(flight),
            settings: FlownSettings::of(flight, config),
            changes: ChangeInFlight::all(flight),
            trajectory_hash: trajectory_hash(flight),
        }
    }

    /// The holds by the fence, as text; `None` without any.
    pub fn held(&self) -> Option<String> {
        self.hold.text(self.scored_s > 0.0)
    }

    /// Notes on the figures.
    pub fn notes(&self) -> impl Iterator<Item = &'static str> {
        let of_fallback = self.handovers.as_ref().and_then(HandoverFigures::note);
        of_fallback.into_iter().chain(self.note_on_errors())
    }

    /// Note on the errors of velocity and attitude of an external law; `None` for other laws.
    fn note_on_errors(&self) -> Option<&'static str> {
        let is_external = self.position_error_m.is_some() && self.controller.contains("external");
        is_external.then_some(
            "velocity and attitude errors of an external law are relative to the commands of its fallback law",
        )
    }

    /// Number of requests, with the last one; `None` without a request.
    pub fn requests(&self) -> Option<String> {
        let (last, count) = (self.changes.last()?, self.changes.len());
        let when = if self.outcome.is_of_flight() { "in flight" } else { "while observing" };
        Some(format!("requests {when}: {count}, the last at {last}"))
    }

    /// Safety states passed through, as text; only the first few if there are many.
    pub fn states(&self) -> String {
        let states = &self.state_sequence;
        let shown = states[..states.len().min(MOST_STATES)].join(" → ");
        if states.len() > MOST_STATES {
            format!("{shown} … ({} changes)", states.len() - 1)
        } else {
            shown
        }
    }

    /// The summary as one JSON document, with the version and revision of the program.
    pub fn to_json(&self, provenance: Provenance) -> String {
        /// Summary and build.
        #[derive(Serialize)]
        struct Document<'a> {
            #[serde(flatten)]
            summary: &'a Summary,
            version: &'static str,
            revision: &'static str,
        }
        let Provenance { version, revision } = provenance;
        serde_json::to_string_pretty(&Document { summary: self, version, revision })
            .expect("a summary is plain JSON")
    }
}

/// The figures of `spans`; `None` in virtual time, where they have no meaning.
fn in_real_time(config: &Config, spans: &Distribution) -> Option<DistributionSummary> {
    (config.clock.kind == ClockKind::Real).then(|| spans.summary())
}

/// Source of the vehicle's motion from which errors are computed.
fn error_source(flight: &Flight) -> &'static str {
    if flight.has_truth() { "truth" } else { "pose" }
}

/// Configuration name of an enumeration's value.
pub fn name_of(value: &impl Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => name,
        other => format!("{other:?}"),
    }
}

/// Sum of the increases of a counter of the daemon over the flights, and shortly after each; over all ticks if none is armed \[-\].
fn count(flight: &Flight, counter: impl Fn(&TelemetryV1) -> u64) -> u64 {
    let samples = &flight.samples;
    let increase = |ticks: &[FlightSample]| {
        let [first, .., last] = ticks else { return 0 };
        counter(&last.telemetry).saturating_sub(counter(&first.telemetry))
    };
    let is_armed = |index: usize| samples.get(index).is_some_and(FlightSample::is_armed);
    let ends = (0..samples.len()).filter(|last| is_armed(*last) && !is_armed(last + 1));
    let mut after = ends.map(|last| {
        let until = samples[last].telemetry.time + COUNTED_AFTER;
        let is_after = |tick: &&FlightSample| !tick.is_armed() && tick.telemetry.time <= until;
        let count = samples[last + 1..].iter().take_while(is_after).count();
        // The tick that ends a flight may be late: it counts what the daemon missed before.
        increase(&samples[last..(last + 1 + count.max(1)).min(samples.len())])
    });
    match after.next() {
        None => increase(samples),
        Some(first) => flight.flights().map(increase).chain(after).fold(first, u64::saturating_add),
    }
}

/// Number of Riccati equations solved in the flights, or in all ticks if none is armed; a first one before the take-off counts, and
/// another daemon counts from zero \[-\].
fn riccati_solves(flight: &Flight) -> u64 {
    let has_flown = flight.armed().next().is_some();
    let pairs = flight.samples.windows(2).filter(|pair| !has_flown || pair[1].is_armed());
    let counts = pairs.map(|pair| [0, 1].map(|index: usize| pair[index].telemetry.riccati_solves));
    let add = |sum, [before, now]: [u64; 2]| sum + now.checked_sub(before).unwrap_or(now);
    counts.fold(0, |sum, pair| add(sum, pair).max(pair[1].min(1)))
}

/// Time from the first to the last armed tick of each flight, together \[s\].
fn duration_s(flight: &Flight) -> f64 {
    let seconds = |ticks: &[FlightSample]| {
        let [first, .., last] = ticks else { return 0.0 };
        last.telemetry.time.since(first.telemetry.time).seconds()
    };
    // The sum of nothing would be -0.
    flight.flights().map(seconds).fold(0.0, |a, b| a + b)
}

/// Figures of an error over the scored window; `None` if it is empty.
fn scored_figures(
    flight: &Flight,
    error: fn(&FlightSample) -> Vector3<f64>,
) -> Option<ErrorFigures> {
    let mut magnitude = Statistics::default();
    let mut squares = Vector3::zeros();
    for error in flight.scored().map(error) {
        magnitude.add(error.norm());
        squares += error.component_mul(&error);
    }
    (magnitude.count() > 0).then(|| ErrorFigures {
        mean: magnitude.mean(),
        rms: magnitude.rms(),
        max: magnitude.max(),
        rms_by_axis: squares.map(|sum| (sum / magnitude.count() as f64).sqrt()).into(),
    })
}

/// Rotation from the commanded to the true attitude \[deg, commanded body axes\].
fn attitude_error_deg(sample: &FlightSample) -> Vector3<f64> {
    sample.attitude_error().map(f64::to_degrees)
}

/// Effort of Table II: the integral of the norm of the input; `None` for a vehicle whose input is an attitude.
fn effort(flight: &Flight) -> Option<f64> {
    if flight.config.vehicle.interface.holds_attitude() {
        return None;
    }
    let norm = |sample: &FlightSample| {
        Vector3::from(sample.telemetry.sticks).norm()
            + Vector3::from(sample.telemetry.torque).norm()
    };
    flight.scored().next().map(|_| flight.integral(FlightSample::is_scored, norm))
}

/// FNV-1a over the bits of (t, p, v, q, omega) of the truth at every tick from arming to disarming; t is the mission time.
fn trajectory_hash(flight: &Flight) -> Option<String> {
    flight.armed().next()?;
    let mut hash = FNV_OFFSET;
    for sample in flight.armed() {
        let truth = sample.truth?;
        let numbers = [sample.telemetry.mission_s]
            .into_iter()
            .chain(truth.position)
            .chain(truth.velocity)
            .chain(truth.attitude)
            .chain(truth.rate);
        for number in numbers {
            hash = fnv1a(hash, &number.to_bits().to_le_bytes());
        }
    }
    Some(format!("{hash:016x}"))
}

#[cfg(test)]
mod tests;
