//! The figures of a flight: `summary.json`.

use std::collections::BTreeMap;

use crate::latency::DistributionSummary;
use nalgebra::Vector3;
use oqtal_bus::code::SafetyState;
use oqtal_bus::message::{FNV_OFFSET, fnv1a};
use oqtal_config::{Fidelity, VehicleKind};
use oqtal_control::metrics::Statistics;
use serde::Serialize;

use crate::command_path::CommandPath;
use crate::flight::{Flight, FlightSample, Outcome};
use crate::kernel::ProcessUsage;
use crate::wire::WireFigures;

/// Safety states that are listed by name at most.
const MOST_STATES: usize = 7;

/// Mean, root mean square and greatest value of an error's magnitude, and the root mean square by axis.
#[derive(Clone, Debug, Serialize)]
pub struct ErrorFigures {
    /// Mean magnitude.
    pub mean: f64,
    /// Root mean square of the magnitude.
    pub rms: f64,
    /// Greatest magnitude.
    pub max: f64,
    /// Root mean square by axis: x, y, z of the world, or roll, pitch, yaw of the body.
    pub rms_by_axis: [f64; 3],
}

/// Messages by topic that were missed, or came more than once.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TopicCounts {
    /// Poses, by the gaps in their frame numbers; in a recording by the gaps in time.
    pub pose: u64,
    /// Commands, by the gaps in their sequence.
    pub command: u64,
}

/// What happened in a flight, in figures. Errors are over the scored window; `None` where there is nothing to judge.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct Summary {
    pub controller: String,
    pub trajectory: String,
    pub vehicle: String,
    pub clock: String,
    pub seed: u64,
    pub ticks: usize,
    pub duration_s: f64,
    pub scored_s: f64,
    pub outcome: Outcome,
    pub error_source: &'static str,
    pub position_error_m: Option<ErrorFigures>,
    pub velocity_error_m_s: Option<ErrorFigures>,
    pub attitude_error_deg: Option<ErrorFigures>,
    /// Integral of the norm of sticks \[s\] or torque \[N m s\] over the scored window, Table II.
    pub effort: Option<f64>,
    pub riccati_solves: u64,
    pub speed_factor: f64,
    pub deadline_misses: u64,
    pub lost: TopicCounts,
    pub repeated: TopicCounts,
    /// Poses that a newer one overtook before the daemon looked: bursts, or a daemon that was late.
    pub poses_superseded: u64,
    pub hops: BTreeMap<&'static str, DistributionSummary>,
    /// The wire to the vehicle; `None` without one.
    pub wire: Option<WireFigures>,
    pub wakeup_lateness: DistributionSummary,
    /// How far the time between two turns of the loop was from a period.
    pub period_jitter: DistributionSummary,
    /// The daemon as the kernel sees it; `None` if it was no process of its own.
    pub daemon: Option<ProcessUsage>,
    /// The safety states passed through, in order.
    pub state_sequence: Vec<String>,
    pub config_hash: String,
    pub trajectory_hash: Option<String>,
}

impl Summary {
    /// The figures of `flight`.
    #[must_use]
    pub fn of(flight: &Flight) -> Self {
        let config = &flight.config;
        let last = flight.samples.last().map(|sample| sample.telemetry).unwrap_or_default();
        let (ticks, duration_s) = extent(flight.armed());
        let (_, scored_s) = extent(flight.scored());
        let figures =
            |error: fn(&FlightSample) -> Vector3<f64>| error_figures(flight.scored().map(error));
        let has_truth = flight.samples.iter().any(|sample| sample.truth.is_some());
        Self {
            controller: name_of(&config.control.controller),
            trajectory: name_of(&config.trajectory.kind),
            vehicle: match &flight.command_path {
                CommandPath::Bus => vehicle_name(config.vehicle.kind, config.vehicle.fidelity),
                way => way.to_string(),
            },
            clock: name_of(&config.clock.kind),
            seed: config.clock.seed,
            ticks,
            duration_s,
            scored_s,
            outcome: flight.outcome,
            error_source: if has_truth { "truth" } else { "pose" },
            position_error_m: figures(FlightSample::position_error),
            velocity_error_m_s: figures(FlightSample::velocity_error),
            attitude_error_deg: figures(|sample| sample.attitude_error().map(f64::to_degrees)),
            effort: effort(flight),
            riccati_solves: last.riccati_solves,
            speed_factor: flight.speed_factor,
            deadline_misses: last.deadline_misses,
            lost: TopicCounts { pose: last.poses_lost, command: flight.commands_lost },
            repeated: TopicCounts {
                pose: flight.poses_repeated,
                command: flight.commands_repeated,
            },
            poses_superseded: last.poses_superseded,
            hops: flight.hops.iter().map(|(name, hop)| (name, hop.summary())).collect(),
            wire: flight.wire.figures(),
            wakeup_lateness: flight.wakeup_lateness.summary(),
            period_jitter: flight.period_jitter.summary(),
            daemon: flight.daemon.clone(),
            state_sequence: state_sequence(flight),
            config_hash: format!("{:016x}", config.hash()),
            trajectory_hash: trajectory_hash(flight),
        }
    }

    /// The safety states passed through, as text; the first few if there are many.
    #[must_use]
    pub fn states(&self) -> String {
        let states = &self.state_sequence;
        let shown = states[..states.len().min(MOST_STATES)].join(" → ");
        if states.len() > MOST_STATES {
            format!("{shown} … ({} changes)", states.len() - 1)
        } else {
            shown
        }
    }

    /// As one JSON document.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a summary holds only what JSON can say")
    }
}

/// How a value of the configuration is written.
/// The name that serde gives to a plain enumeration's value.
#[must_use]
pub fn name_of(value: &impl Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => name,
        other => format!("{other:?}"),
    }
}

fn vehicle_name(kind: VehicleKind, fidelity: Fidelity) -> String {
    match kind {
        VehicleKind::Spacecraft => "sim:spacecraft".to_owned(),
        VehicleKind::Hummingbird => format!("sim:hummingbird,fidelity={}", name_of(&fidelity)),
    }
}

/// How many samples there are, and the time from the first to the last \[s\].
fn extent<'a>(mut samples: impl Iterator<Item = &'a FlightSample>) -> (usize, f64) {
    let Some(first) = samples.next() else { return (0, 0.0) };
    let (count, last) = samples.fold((1, first), |(count, _), sample| (count + 1, sample));
    (count, last.telemetry.time.since(first.telemetry.time).seconds())
}

fn error_figures(errors: impl Iterator<Item = Vector3<f64>>) -> Option<ErrorFigures> {
    let mut magnitude = Statistics::default();
    let mut squares = Vector3::zeros();
    for error in errors {
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

/// Table II: the integral of the norm of the input.
fn effort(flight: &Flight) -> Option<f64> {
    let period_s = 1.0 / flight.config.control.rate_hz;
    let norms = flight.scored().map(|sample| {
        Vector3::from(sample.telemetry.sticks).norm()
            + Vector3::from(sample.telemetry.torque).norm()
    });
    let mut any = false;
    let sum: f64 = norms.inspect(|_| any = true).sum();
    any.then_some(sum * period_s)
}

fn state_sequence(flight: &Flight) -> Vec<String> {
    let mut states: Vec<u8> = flight.samples.iter().map(|sample| sample.telemetry.state).collect();
    states.dedup();
    let name = |code: &u8| SafetyState::from_code(*code).map(|state| state.to_string());
    states.iter().filter_map(name).collect()
}

/// FNV-1a over the bits of (t, p, v, q, omega) of the truth at every tick from arming to disarming; t is mission time.
fn trajectory_hash(flight: &Flight) -> Option<String> {
    let mut hash = FNV_OFFSET;
    let mut any = false;
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
        any = true;
    }
    any.then(|| format!("{hash:016x}"))
}
