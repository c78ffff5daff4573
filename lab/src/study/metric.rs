//! Metrics of flights on the testbed: the metrics of Table V, and metrics that a smoother command cannot improve.

use nalgebra::Vector3;
use oqtal_bus::message::Stamps;
use oqtal_bus::time::Span;
use oqtal_config::Interface;
use oqtal_control::metrics::Statistics;
use oqtal_control::quaternion::Attitude;

use oqtal_observe::attitude_steps::{attitude_steps, prescribed};
use oqtal_observe::corners::CornerFigures;
use oqtal_observe::flight::{Flight, FlightSample};

/// Metric by which laws are compared.
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// Name in JSON.
    pub key: &'static str,
    /// Heading of its column.
    pub title: &'static str,
    /// Weight in the objective of tuning \[-\].
    pub weight: f64,
    /// Figure of the shipped `oqtal` with the shipped vehicle \[unit of the title\].
    pub shipped: f64,
}

/// Number of metrics.
pub const METRICS: usize = 9;

/// Metrics, in the order of [`Figures`]. In tuning, hover has double weight: it is the only position metric that depends neither
/// on limits nor on a command filtered by the law itself, while there are two such metrics of a prescribed attitude.
pub const METRIC: [Metric; METRICS] = [
    metric("position_error_m", "mean position [m]", [1.0, 0.271]),
    metric("velocity_error_m_s", "mean velocity [m/s]", [1.0, 0.0994]),
    metric("attitude_error_deg", "mean attitude [°]", [1.0, 1.30]),
    metric("settle_s", "settled to 5 cm [s]", [1.0, 2.05]),
    metric("overshoot_mm", "overshoot [mm]", [0.2, 7.12]),
    metric("hover_rms_mm", "hover RMS [mm]", [2.0, 9.98]),
    metric("jitter_rad_s", "jitter [rad/s]", [0.1, 0.129]),
    metric("chirp4_rms_deg", "chirp 4° RMS [°]", [1.0, 4.01]),
    metric("doublet_settle_s", "doublet settled [s]", [1.0, 0.421]),
];

/// Index of the position error in [`Figures`].
pub const POSITION: usize = 0;
/// Index of the velocity error.
pub const VELOCITY: usize = 1;
/// Index of the attitude error.
pub const ATTITUDE: usize = 2;
/// Index of the settling time at a corner.
pub const SETTLE: usize = 3;
/// Index of the overshoot at a corner.
pub const OVERSHOOT: usize = 4;
/// Index of the hover error.
pub const HOVER: usize = 5;
/// Index of the command jitter in hover.
pub const JITTER: usize = 6;
/// Index of the error in a chirp.
pub const CHIRP: usize = 7;
/// Index of the settling time after an attitude step.
pub const DOUBLET: usize = 8;

const fn metric(key: &'static str, title: &'static str, [weight, shipped]: [f64; 2]) -> Metric {
    Metric { key, title, weight, shipped }
}

/// Metrics of one run; infinite for a flight that did not land as planned, and for a settling time that was not reached; NaN
/// without a meaning for the flight.
pub type Figures = [f64; METRICS];

/// Value of `statistic`; NaN for a flight of which nothing is scored.
fn of_scored(statistics: &Statistics, statistic: fn(&Statistics) -> f64) -> f64 {
    if statistics.count() > 0 { statistic(statistics) } else { f64::NAN }
}

/// Mean position, velocity and attitude error of a flight along a path, and settling time and overshoot at its corners: NaN for a
/// path without corners, an infinite settling time if a corner did not settle before the next.
///
/// Velocity and attitude errors are relative to the newest set-point of the law. `oqtal-dt` computes set-points for the instant
/// at which its command takes effect, and telemetry shows each of them at that instant.
pub fn of_path(flight: &Flight) -> [f64; 5] {
    let corners = CornerFigures::of(flight);
    let [settle_s, overshoot_m] =
        corners.map_or([f64::NAN; 2], |corners| [corners.settling.of_all_s(), corners.overshoot_m]);
    let mut position = Statistics::default();
    flight.scored().for_each(|sample| position.add(sample.position_error().norm()));
    let (mut velocity, mut attitude) = (Statistics::default(), Statistics::default());
    let ahead = look_ahead(flight);
    for (index, sample) in flight.samples.iter().enumerate() {
        if sample.is_scored() {
            let (set_velocity, set_attitude) = newest_set_point(&flight.samples[index..], ahead);
            velocity.add((sample.velocity() - set_velocity).norm());
            attitude.add(set_attitude.angle_to(&sample.attitude()).to_degrees());
        }
    }
    let [position, velocity, attitude] =
        [position, velocity, attitude].map(|errors| of_scored(&errors, Statistics::mean));
    [position, velocity, attitude, settle_s, 1e3 * overshoot_m]
}

/// Time from the computation of a set-point to the instant for which it is valid: the mean delay of commands with prediction,
/// zero without.
fn look_ahead(flight: &Flight) -> Span {
    if !flight.config.control.is_predictive() || flight.applied.is_empty() {
        return Span::ZERO;
    }
    let mut delay = Statistics::default();
    for Stamps { applied_at, command_published_at, .. } in flight.applied.iter().map(|a| a.stamps) {
        delay.add(applied_at.since(command_published_at).seconds());
    }
    Span::from_seconds(delay.mean())
}

/// Velocity \[m/s, world\] and attitude computed at the first of `samples` for the instant `ahead` of it.
fn newest_set_point(samples: &[FlightSample], ahead: Span) -> (Vector3<f64>, Attitude) {
    let velocity = |sample: &FlightSample| Vector3::from(sample.telemetry.velocity_command);
    let at = samples[0].telemetry.time + ahead;
    let later = samples.iter().position(|sample| sample.telemetry.time >= at);
    let later = later.unwrap_or(samples.len() - 1);
    let [a, b] = [&samples[later.saturating_sub(1)], &samples[later]];
    let between = b.telemetry.time.since(a.telemetry.time).seconds();
    let share = match between > 0.0 {
        true => (at.since(a.telemetry.time).seconds() / between).clamp(0.0, 1.0),
        false => 1.0,
    };
    let (from, to) = (a.attitude_command(), b.attitude_command());
    let attitude = from.turned_by(from.rotation_to(&to) * share);
    (velocity(a).lerp(&velocity(b), share), attitude)
}

/// RMS of the position error \[mm\], and of the change of the commanded rate per tick \[rad/s\], in a hover; the latter is NaN for a
/// vehicle that is not commanded by rates.
pub fn of_hover(flight: &Flight) -> [f64; 2] {
    let authority = Vector3::from(flight.config.vehicle.rate_authority_rad_s);
    let (mut error, mut jitter) = (Statistics::default(), Statistics::default());
    let mut last = None;
    for sample in flight.scored() {
        error.add(1e3 * sample.position_error().norm());
        let sticks = Vector3::from(sample.telemetry.sticks).component_mul(&authority);
        if let Some(last) = last.replace(sticks) {
            jitter.add((sticks - last).norm());
        }
    }
    let is_by_rates = flight.config.vehicle.interface == Interface::Rate;
    let jitter_rad_s = if is_by_rates { of_scored(&jitter, Statistics::rms) } else { f64::NAN };
    [of_scored(&error, Statistics::rms), jitter_rad_s]
}

/// Error of the true attitude relative to the prescribed one: RMS \[deg\] and mean settling time after a step \[s\], infinite if
/// one did not settle before the next; then the same mean with the time until the next step for one that did not settle \[s\].
/// The times are NaN for a trajectory other than `attitude-doublet`.
pub fn of_attitude(flight: &Flight) -> [f64; 3] {
    let mut rms = Statistics::default();
    prescribed(flight).iter().for_each(|at| rms.add(at.error_deg));
    let [settle_s, least_s] = attitude_steps(flight)
        .map_or([f64::NAN; 2], |steps| [steps.of_all_s(), steps.least_settle_s]);
    [of_scored(&rms, Statistics::rms), settle_s, least_s]
}
