//! The columns of `telemetry.csv`: name, unit, instant, meaning, value.

use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::message::TelemetryV1;
use oqtal_bus::time::{Span, Time};
use oqtal_control::trajectory::Phase;

use super::column::{CellValues, ColumnGroup, Instant, Row};
use crate::flight::AppliedCommand;
use crate::latency::{hops, sensor_to_actuator};

const UNKNOWN: [f64; 6] = [f64::NAN; 6];

fn fill<const N: usize>(values: [f64; N]) -> [f64; 6] {
    let mut cells = UNKNOWN;
    cells[..N].copy_from_slice(&values);
    cells
}

fn instant(row: &Row<'_>, at: Time) -> f64 {
    if at.is_set() { at.since(row.origin).seconds() } else { f64::NAN }
}

fn truth<const N: usize>(
    row: &Row<'_>,
    value: fn(&oqtal_bus::message::TruthV1) -> [f64; N],
) -> [f64; 6] {
    row.sample.truth.as_ref().map_or(UNKNOWN, |truth| fill(value(truth)))
}

fn micros(span: Span) -> f64 {
    span.nanos() as f64 * 1e-3
}

/// Hops of a command \[us\], their sum last.
fn hops_us(command: &AppliedCommand) -> Option<[f64; 6]> {
    let mut cells = UNKNOWN;
    let spans = hops(&command.stamps)?;
    cells.iter_mut().zip(spans).for_each(|(cell, span)| *cell = micros(span));
    cells[5] = micros(sensor_to_actuator(&command.stamps, command.onward));
    Some(cells)
}

const fn numbers(
    names: &'static [&'static str],
    (unit, instant): (&'static str, Instant),
    about: &'static str,
    cells: fn(&Row<'_>) -> [f64; 6],
) -> ColumnGroup {
    ColumnGroup { names, unit, instant, about, cells: CellValues::Numbers(cells) }
}

const fn word(
    names: &'static [&'static str],
    about: &'static str,
    cell: fn(&Row<'_>) -> Option<String>,
) -> ColumnGroup {
    let (unit, instant) = ("word", Instant::Tick);
    ColumnGroup { names, unit, instant, about, cells: CellValues::Word(cell) }
}

fn telemetry<'a>(row: &Row<'a>) -> &'a TelemetryV1 {
    &row.sample.telemetry
}

use Instant::{Capture, Command, Tick};

/// Every column, in order.
pub(super) const COLUMNS: [ColumnGroup; 42] = [
    numbers(&["t_s"], ("s", Tick), "time of the tick since the first armed one", |r| {
        fill([instant(r, telemetry(r).time)])
    }),
    word(&["mode"], "activity of the daemon", |r| {
        Mode::from_code(telemetry(r).mode).map(|mode| mode.to_string())
    }),
    word(&["state"], "safety state of the daemon", |r| {
        SafetyState::from_code(telemetry(r).state).map(|state| state.to_string())
    }),
    word(&["cause"], "cause of that state", |r| {
        Cause::from_code(telemetry(r).cause).map(|cause| cause.to_string())
    }),
    word(&["phase"], "phase of the flight", |r| {
        Phase::from_number(telemetry(r).phase).map(|phase| phase.to_string())
    }),
    numbers(&["pose_captured_s", "pose_published_s"], ("s", Capture), CAPTURE, |r| {
        let TelemetryV1 { pose_captured_at, pose_published_at, .. } = telemetry(r);
        fill([instant(r, *pose_captured_at), instant(r, *pose_published_at)])
    }),
    numbers(&["tick"], ("-", Tick), "number of the tick, from 1", |r| {
        fill([telemetry(r).tick as f64])
    }),
    numbers(&["mission_s", "planned_landing_s"], ("s", Tick), MISSION, |r| {
        fill([telemetry(r).mission_s, telemetry(r).planned_landing_s])
    }),
    numbers(&["scored", "fresh", "saturated"], ("0 or 1", Tick), FLAGS, |r| {
        let TelemetryV1 { scored, fresh, saturated, .. } = telemetry(r);
        fill([*scored, *fresh, *saturated].map(f64::from))
    }),
    numbers(&["est_x_m", "est_y_m", "est_z_m"], ("m, world", Capture), ESTIMATE, |r| {
        fill(telemetry(r).position)
    }),
    numbers(&["est_vx_m_s", "est_vy_m_s", "est_vz_m_s"], ("m/s, world", Capture), ESTIMATE, |r| {
        fill(telemetry(r).velocity)
    }),
    numbers(&["est_qx", "est_qy", "est_qz", "est_qw"], (QUATERNION, Capture), ESTIMATE, |r| {
        fill(telemetry(r).attitude)
    }),
    numbers(
        &["est_rate_x_rad_s", "est_rate_y_rad_s", "est_rate_z_rad_s"],
        ("rad/s, body", Capture),
        ESTIMATE,
        |r| fill(telemetry(r).rate),
    ),
    numbers(&["true_x_m", "true_y_m", "true_z_m"], ("m, world", Tick), TRUTH, |r| {
        truth(r, |truth| truth.position)
    }),
    numbers(&["true_vx_m_s", "true_vy_m_s", "true_vz_m_s"], ("m/s, world", Tick), TRUTH, |r| {
        truth(r, |truth| truth.velocity)
    }),
    numbers(&["true_qx", "true_qy", "true_qz", "true_qw"], (QUATERNION, Tick), TRUTH, |r| {
        truth(r, |truth| truth.attitude)
    }),
    numbers(
        &["true_rate_x_rad_s", "true_rate_y_rad_s", "true_rate_z_rad_s"],
        ("rad/s, body", Tick),
        TRUTH,
        |r| truth(r, |truth| truth.rate),
    ),
    numbers(&["ref_x_m", "ref_y_m", "ref_z_m"], ("m, world", Tick), "reference position", |r| {
        fill(telemetry(r).reference_position)
    }),
    numbers(
        &["ref_vx_m_s", "ref_vy_m_s", "ref_vz_m_s"],
        ("m/s, world", Tick),
        "velocity of the reference; empty when not flying, as is the next",
        |r| fill(telemetry(r).reference_velocity),
    ),
    numbers(&["ref_yaw_rad"], ("rad, world", Tick), "yaw of the reference", |r| {
        fill([telemetry(r).reference_yaw])
    }),
    numbers(
        &["cmd_vx_m_s", "cmd_vy_m_s", "cmd_vz_m_s"],
        ("m/s, world", Tick),
        "velocity commanded by the position loops; empty when not flying, as is the next",
        |r| fill(telemetry(r).velocity_command),
    ),
    numbers(
        &["cmd_qx", "cmd_qy", "cmd_qz", "cmd_qw"],
        (QUATERNION, Tick),
        "commanded attitude, the law's reference",
        |r| fill(telemetry(r).attitude_command),
    ),
    numbers(
        &["stick_roll", "stick_pitch", "stick_yaw"],
        ("-1 to 1, body", Tick),
        "sticks sent to a vehicle that is commanded by body rates; 0 to others",
        |r| fill(telemetry(r).sticks),
    ),
    numbers(
        &["torque_x_nm", "torque_y_nm", "torque_z_nm"],
        ("N m, body", Tick),
        "torque sent to a vehicle that is commanded by torque; 0 to others",
        |r| fill(telemetry(r).torque),
    ),
    numbers(
        &["sent_qx", "sent_qy", "sent_qz", "sent_qw"],
        (QUATERNION, Tick),
        "attitude sent; zeros if motors are off",
        |r| fill(telemetry(r).attitude_sent),
    ),
    numbers(&["thrust"], ("0 to 1", Tick), "collective thrust sent, fraction of maximum", |r| {
        fill([telemetry(r).thrust])
    }),
    numbers(&["pose_age_ms"], ("ms", Tick), "age of the newest accepted pose", |r| {
        fill([telemetry(r).pose_age_s * 1e3])
    }),
    numbers(
        &["wakeup_lateness_us"],
        ("us", Tick),
        "delay of the wake-up after the pose's arrival, or after the deadline; 0 in virtual time",
        |r| fill([telemetry(r).wakeup_lateness_ns as f64 * 1e-3]),
    ),
    numbers(
        &["riccati_solves", "riccati_failures", "deadline_misses"],
        ("-", Tick),
        "counts since the start of the daemon, as are the next",
        |r| {
            let TelemetryV1 { riccati_solves, riccati_failures, deadline_misses, .. } =
                telemetry(r);
            fill([*riccati_solves, *riccati_failures, *deadline_misses].map(|count| count as f64))
        },
    ),
    numbers(
        &["poses_lost", "poses_superseded", "poses_refused"],
        ("-", Tick),
        "camera frames without a pose; poses overtaken by a newer one; poses that the guard refused",
        |r| {
            let TelemetryV1 { poses_lost, poses_superseded, poses_refused, .. } = telemetry(r);
            fill([*poses_lost, *poses_superseded, *poses_refused].map(|count| count as f64))
        },
    ),
    numbers(
        &["command_sequence"],
        ("-", Tick),
        "sequence of the command published in the tick",
        |r| fill([telemetry(r).command_sequence as f64]),
    ),
    numbers(&["pose_x_m", "pose_y_m", "pose_z_m"], ("m, world", Capture), POSE, |r| {
        fill(telemetry(r).pose_position)
    }),
    numbers(&["pose_qx", "pose_qy", "pose_qz", "pose_qw"], (QUATERNION, Capture), POSE, |r| {
        fill(telemetry(r).pose_attitude)
    }),
    numbers(
        &["pose_sequence", "pose_residual_mm"],
        ("-; mm", Capture),
        "number of the camera frame; distance of the markers from the fitted body, empty if unknown",
        |r| fill([telemetry(r).pose_sequence as f64, telemetry(r).pose_residual_m * 1e3]),
    ),
    FILTER,
    FILTER_MOTION,
    FILTER_RATE,
    INNOVATION,
    NIS,
    ADAPTED,
    HOPS_US,
    BATTERY,
];

const CAPTURE: &str = "capture and publication of the newest accepted pose, on the axis of `t_s`; empty before the first";
const MISSION: &str =
    "time since the flight began, and at which its landing is planned; empty before";
const FLAGS: &str = "1 if the tick belongs to the scored window; used a new pose; hit the limit of the attitude command";
const ESTIMATE: &str = "the estimate by which the vehicle is guarded";
const TRUTH: &str = "the simulator's state; empty for a real vehicle and in a replay";
const POSE: &str = "the pose as measured; empty before the first";
const QUATERNION: &str = "body to world, scalar last";

const FILTER: ColumnGroup = numbers(
    &["filter_x_m", "filter_y_m", "filter_z_m", "filter_vx_m_s", "filter_vy_m_s", "filter_vz_m_s"],
    ("m and m/s, world", Capture),
    "position and velocity by the filter of the law's own control stack; empty if it has none, as are the next",
    |r| {
        let TelemetryV1 { filter_position: [x, y, z], filter_velocity: [u, v, w], .. } =
            *telemetry(r);
        [x, y, z, u, v, w]
    },
);

const FILTER_MOTION: ColumnGroup = numbers(
    &["filter_qx", "filter_qy", "filter_qz", "filter_qw"],
    (QUATERNION, Capture),
    "attitude by that filter",
    |r| fill(telemetry(r).filter_attitude),
);

const FILTER_RATE: ColumnGroup = numbers(
    &["filter_rate_x_rad_s", "filter_rate_y_rad_s", "filter_rate_z_rad_s"],
    ("rad/s, body", Capture),
    "body rate by that filter",
    |r| fill(telemetry(r).filter_rate),
);

const NIS: ColumnGroup = numbers(
    &["nis_position", "nis_attitude"],
    ("-", Capture),
    "squared innovations over their expected variances, mean of the axes: 1 for a filter that knows its noise",
    |r| fill(telemetry(r).nis),
);

const ADAPTED: ColumnGroup = numbers(
    &[
        "adapted_rate_gain",
        "adapted_rate_lag_ms",
        "adapted_delay_ms",
        "adapted_thrust_gain",
        "adapted_fell_back",
    ],
    ("-; ms; ms; -; 0 or 1", Tick),
    "the model that is flown: rate over the commanded one, its lag, its delay that no report shows, thrust over the configured one; 1 while the configured model predicts better and is flown; empty without adaptation",
    |r| {
        let t = telemetry(r);
        let fell_back = if t.adapted_rate_gain.is_nan() { f64::NAN } else { t.fell_back.into() };
        let (lag_ms, delay_ms) = (t.adapted_rate_lag_s * 1e3, t.adapted_delay_s * 1e3);
        fill([t.adapted_rate_gain, lag_ms, delay_ms, t.adapted_thrust_gain, fell_back])
    },
);

const INNOVATION: ColumnGroup = numbers(
    &[
        "innovation_x_m",
        "innovation_y_m",
        "innovation_z_m",
        "innovation_roll_rad",
        "innovation_pitch_rad",
        "innovation_yaw_rad",
    ],
    ("m, world; rad, body", Capture),
    "measured minus expected position; rotation from the expected to the measured attitude",
    |r| {
        let TelemetryV1 { innovation_position: [x, y, z], innovation_attitude: [u, v, w], .. } =
            *telemetry(r);
        [x, y, z, u, v, w]
    },
);

const HOPS_US: ColumnGroup = numbers(
    &[
        "capture_to_publish_us",
        "publish_to_daemon_us",
        "compute_us",
        "command_to_vehicle_us",
        "vehicle_to_applied_us",
        "sensor_to_actuator_us",
    ],
    ("us", Command),
    "hops of the command of this tick and their sum, which contains the times on a wire and in the air; empty if it never reached the vehicle",
    |r| r.applied.and_then(hops_us).unwrap_or(UNKNOWN),
);

const BATTERY: ColumnGroup = numbers(
    &["battery_v"],
    ("V", Command),
    "battery voltage when the vehicle applied the command; empty if unknown",
    |r| fill([r.applied.map_or(f64::NAN, |command| command.battery_v)]),
);
