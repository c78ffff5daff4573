//! Telemetry before there is anything to tell.

use oqtal_bus::message::TelemetryV1;

/// Telemetry before the first pose.
pub(super) fn without_pose() -> TelemetryV1 {
    let unknown = [f64::NAN; 3];
    TelemetryV1 {
        mission_s: f64::NAN,
        planned_landing_s: f64::NAN,
        reference_velocity: unknown,
        reference_yaw: f64::NAN,
        pose_age_s: f64::NAN,
        pose_position: unknown,
        pose_attitude: [f64::NAN; 4],
        pose_residual_m: f64::NAN,
        filter_position: unknown,
        filter_velocity: unknown,
        filter_attitude: [f64::NAN; 4],
        filter_rate: unknown,
        innovation_position: unknown,
        innovation_attitude: unknown,
        nis: [f64::NAN; 2],
        adapted_rate_gain: f64::NAN,
        adapted_rate_lag_s: f64::NAN,
        adapted_delay_s: f64::NAN,
        adapted_thrust_gain: f64::NAN,
        ..TelemetryV1::default()
    }
}
