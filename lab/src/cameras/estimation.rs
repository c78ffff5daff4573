//! Estimation errors with the poses of the emulated cameras: one flight, whose poses are processed again with each kind of stamp.

use nalgebra::Vector3;
use oqtal_bus::time::Time;
use oqtal_config::{Config, Interface};
use oqtal_control::controller::ControllerName;
use oqtal_control::estimator::{Estimate, Estimator};
use oqtal_control::predictive::{
    AdaptationOptions, FilterInnovation, MeasuredPose, ModelInput, MotionTracker,
    PredictiveOptions, Rotation, VehicleModel,
};
use oqtal_control::quaternion::Attitude;
use oqtal_control::statistics::mean;
use oqtal_daemon::CommandModel;
use oqtal_mocap_emu::capture::Captures;
use oqtal_mocap_emu::recording::{RecordedPose, Recording};
use oqtal_observe::flight::{Flight, FlightSample};
use oqtal_runtime::process::{Exit, Failure};
use serde::Serialize;

use crate::mission::Mission;
use crate::simulation;
use crate::text_table::markdown;

/// Number of poses at the beginning of a flight during which the filters settle.
const SETTLING: usize = 120;

/// Figures for one kind of stamp.
#[derive(Clone, Debug, Serialize)]
pub struct StampFigures {
    /// Name of the kind.
    #[serde(rename = "stamps")]
    pub stamp: &'static str,
    /// Root mean square error of the estimator's velocity, against the truth at the stamp \[m/s\].
    pub velocity_m_s: f64,
    /// Root mean square error of the estimator's body rate \[rad/s\].
    pub rate_rad_s: f64,
    /// Root mean square error of the velocity of `oqtal-dt`'s filter \[m/s\].
    pub filter_velocity_m_s: f64,
    /// Root mean square error of the body rate of that filter \[rad/s\].
    pub filter_rate_rad_s: f64,
    /// Mean normalised innovation squared, position and attitude \[-\]: 1 for a filter with a correct noise model.
    #[serde(rename = "nis")]
    pub nis_ratio: [f64; 2],
    /// Correlation of successive innovations, position and attitude \[-\]: 0 for white innovations.
    #[serde(rename = "next")]
    pub next_ratio: [f64; 2],
}

/// A pose with its stamp, and the tick at which the daemon received it.
struct StampedPose {
    stamp_s: f64,
    sample: FlightSample,
}

/// Flies the trajectory of `config` with `oqtal-dt`, and estimates from its poses with exact, arrival and estimated stamps.
///
/// # Errors
/// The vehicle is not commanded by rates (exit code 78), or the flight cannot be flown, or ends before the filters have settled.
pub fn study(config: Config) -> Result<Vec<StampFigures>, Failure> {
    if config.vehicle.interface != Interface::Rate {
        let reason =
            "this study needs a vehicle commanded by body rates; set vehicle.interface = \"rate\"";
        return Err(Failure::new(Exit::Config, reason));
    }
    let mut config = config;
    config.control.controller = ControllerName::OqtalDt;
    let flight = simulation::fly(&Mission::new(config)?)?;
    let poses = poses(&flight);
    if poses.len() < 2 * SETTLING {
        let reason = format!(
            "the flight {} after {} poses: too few; try another --seed, or --set mocap.room.stalls-per-1000-s=0",
            flight.outcome,
            poses.len()
        );
        return Err(Failure::new(Exit::Flight, reason));
    }
    let stamps = |of: fn(&FlightSample) -> Time| poses.iter().map(|s| of(s).seconds()).collect();
    let exact: Vec<f64> = stamps(|sample| sample.telemetry.pose_captured_at);
    let arrival: Vec<f64> = stamps(|sample| sample.telemetry.pose_published_at);
    let kinds = [("exact", exact), ("arrival", arrival), ("estimated", estimated(&poses))];
    let figures = |(name, stamps): (&'static str, Vec<f64>)| {
        let pairs = stamps.into_iter().zip(&poses);
        let stamped: Vec<StampedPose> =
            pairs.map(|(stamp_s, sample)| StampedPose { stamp_s, sample: *sample }).collect();
        estimate(&flight, name, &stamped)
    };
    Ok(kinds.into_iter().map(figures).collect())
}

/// The ticks in the air with a new pose.
fn poses(flight: &Flight) -> Vec<FlightSample> {
    let mut last = 0;
    let is_new = |sample: &&FlightSample| {
        let is_new = sample.telemetry.pose_sequence != last && sample.telemetry.fresh == 1;
        last = sample.telemetry.pose_sequence;
        is_new && sample.is_armed() && sample.truth.is_some()
    };
    flight.samples.iter().filter(is_new).copied().collect()
}

/// Captures estimated from arrivals and motion only \[s\].
fn estimated(poses: &[FlightSample]) -> Vec<f64> {
    let recorded = poses.iter().map(|sample| RecordedPose {
        time_ns: sample.telemetry.pose_published_at.nanos(),
        position: sample.telemetry.pose_position.into(),
        attitude: Attitude::from_xyzw(sample.telemetry.pose_attitude).unwrap_or_default(),
    });
    let first_s = poses.first().map_or(0.0, |s| s.telemetry.pose_published_at.seconds());
    Recording::from_poses(recorded.collect()).map_or_else(Vec::new, |recording| {
        Captures::of(&recording).captured_s.iter().map(|captured_s| captured_s + first_s).collect()
    })
}

/// Runs both estimators over `poses`, in the order of the flight's ticks.
fn estimate(flight: &Flight, stamp: &'static str, poses: &[StampedPose]) -> StampFigures {
    let config = &flight.config;
    let mut estimator = Estimator::new(config.control.estimator);
    let mut tracker = tracker(config);
    let mut errors: [Vec<Vector3<f64>>; 4] = Default::default();
    let mut innovations: Vec<FilterInnovation> = Vec::new();
    let mut next = poses.iter().enumerate().peekable();
    for sample in &flight.samples {
        let is_taken =
            |(_, pose): &(usize, &StampedPose)| pose.sample.telemetry.tick == sample.telemetry.tick;
        if let Some((k, pose)) = next.next_if(is_taken) {
            let measured = update(&mut estimator, pose);
            let taken = MeasuredPose { position: measured.position, attitude: measured.attitude };
            match tracker.track() {
                Some(_) => tracker.take(pose.stamp_s, &taken),
                None => tracker.begin(pose.stamp_s, &taken, f64::NEG_INFINITY),
            }
            let truth = truth_at(&flight.samples, pose.stamp_s);
            if let (Some((motion, innovation)), Some((velocity, rate))) =
                (tracker.filtered(), truth)
                && k >= SETTLING
            {
                let by = [measured.velocity - velocity, measured.rate.0 - rate];
                let of_filter = [motion.velocity - velocity, motion.rate - rate];
                for (errors, error) in errors.iter_mut().zip(by.into_iter().chain(of_filter)) {
                    errors.push(error);
                }
                innovations.extend(innovation);
            }
        }
        tracker.sent(
            sample.telemetry.command_sequence,
            sample.telemetry.time.seconds(),
            input(config, sample),
        );
    }
    figures(stamp, &errors, &innovations)
}

fn figures(
    stamp: &'static str,
    errors: &[Vec<Vector3<f64>>; 4],
    innovations: &[FilterInnovation],
) -> StampFigures {
    let rms = |values: &[Vector3<f64>]| {
        let squares = values.iter().map(Vector3::norm_squared).sum::<f64>();
        (squares / values.len().max(1) as f64).sqrt()
    };
    let average =
        |of: fn(&FilterInnovation) -> f64| mean(&innovations.iter().map(of).collect::<Vec<_>>());
    let next = |of: &dyn Fn(&FilterInnovation) -> Vector3<f64>| {
        let products = innovations.windows(2).map(|pair| of(&pair[0]).dot(&of(&pair[1])));
        let squares = innovations.iter().map(|innovation| of(innovation).norm_squared());
        products.sum::<f64>() / squares.sum::<f64>().max(f64::MIN_POSITIVE)
    };
    StampFigures {
        stamp,
        velocity_m_s: rms(&errors[0]),
        rate_rad_s: rms(&errors[1]),
        filter_velocity_m_s: rms(&errors[2]),
        filter_rate_rad_s: rms(&errors[3]),
        nis_ratio: [average(|i| i.position_nis), average(|i| i.attitude_nis)],
        next_ratio: [next(&|i| i.position), next(&|i| i.attitude)],
    }
}

fn update(estimator: &mut Estimator, pose: &StampedPose) -> Estimate {
    let telemetry = &pose.sample.telemetry;
    let attitude = Attitude::from_xyzw(telemetry.pose_attitude).unwrap_or_default();
    estimator.update(pose.stamp_s, telemetry.pose_position.into(), attitude)
}

/// Tracker that always uses the configured model.
fn tracker(config: &Config) -> MotionTracker {
    let adaptation = AdaptationOptions { adapt: false, ..AdaptationOptions::default() };
    let options = PredictiveOptions { adaptation, ..config.control.predictive };
    let delay_s = config.vehicle.command_delay_ms * 1e-3;
    MotionTracker::new(model(config), config.safety.filter, delay_s).predictive(&options)
}

/// Model of `[vehicle]`, commanded by rates.
fn model(config: &Config) -> VehicleModel {
    let rotation = Rotation::RateLoop { lag_s: config.vehicle.rate_lag_ms * 1e-3 };
    let CommandModel { model, .. } =
        CommandModel::new(config).expect("the flight was flown with it");
    VehicleModel { rotation, ..model }
}

fn input(config: &Config, sample: &FlightSample) -> ModelInput {
    let authority = Vector3::from(config.vehicle.rate_authority_rad_s);
    ModelInput {
        demand: Vector3::from(sample.telemetry.sticks).component_mul(&authority),
        thrust_n: sample.telemetry.thrust * config.vehicle.max_thrust_n,
        ..ModelInput::default()
    }
}

/// True velocity \[m/s, world\] and rate \[rad/s, body\] at `t_s`, interpolated between two ticks.
fn truth_at(samples: &[FlightSample], t_s: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let after = samples.partition_point(|sample| sample.telemetry.time.seconds() < t_s);
    let (from, to) = (samples.get(after.checked_sub(1)?)?, samples.get(after)?);
    let (a, b) = (from.truth?, to.truth?);
    let step_s = to.telemetry.time.since(from.telemetry.time).seconds();
    let share = (t_s - from.telemetry.time.seconds()) / step_s;
    let between = |a: [f64; 3], b: [f64; 3]| Vector3::from(a).lerp(&Vector3::from(b), share);
    Some((between(a.velocity, b.velocity), between(a.rate, b.rate)))
}

/// The figures as a table in Markdown.
pub fn to_text(rows: &[StampFigures]) -> String {
    let headings = [
        "stamps",
        "velocity, rms error [m/s]",
        "rate, rms error [rad/s]",
        "filter: velocity [m/s]",
        "filter: rate [rad/s]",
        "NIS position, attitude",
        "next innovation: position, attitude",
    ];
    let row = |row: &StampFigures| {
        let errors =
            [row.velocity_m_s, row.rate_rad_s, row.filter_velocity_m_s, row.filter_rate_rad_s];
        let pairs = [row.nis_ratio, row.next_ratio].map(|[a, b]| format!("{a:.2}, {b:.2}"));
        let errors = errors.map(|error| format!("{error:.3}"));
        [row.stamp.to_owned()].into_iter().chain(errors).chain(pairs).collect()
    };
    markdown(&headings, rows.iter().map(row))
}
