//! A tick of the daemon and a vehicle message as compact rows of numbers for JSON. Non-finite numbers become `null`.

use oqtal_bus::message::{Header, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Interface;
use oqtal_control::quaternion::Attitude;
use oqtal_observe::flight::FlightSample;
use oqtal_observe::latency::{AIR, HOPS, OnwardTime, WIRE, hops, sensor_to_actuator};

/// Names of the columns of a [`TickRow`]: time since the origin \[s\]; position \[m, world\] and attitude, scalar last, both
/// non-finite before the first pose unless the truth is known; reference position \[m, world\]; magnitudes of the errors
/// \[m, m/s, deg\]; command by axis and collective thrust; age of the pose \[ms\]; codes of mode, state, cause and phase; counters;
/// whether position and errors are of the truth, not of the estimate.
pub const TICK_COLUMNS: [&str; 27] = [
    "t", "x", "y", "z", "qx", "qy", "qz", "qw", "rx", "ry", "rz", "position", "velocity",
    "attitude", "roll", "pitch", "yaw", "thrust", "age", "mode", "state", "cause", "phase",
    "missed", "lost", "refused", "truth",
];

/// Indices of the errors in a [`TickRow`].
pub const ERRORS: std::ops::Range<usize> = 11..14;

/// Indices of the values in a [`TickRow`] that are drawn over time.
pub const TICK_CURVES: std::ops::Range<usize> = 11..18;

/// Names of the columns of a [`VehicleRow`]: time since the origin \[s\]; the hops, with wire and air, and their sum \[ms\]; battery \[V\]; link
/// quality \[0..1\]; flags; commands lost.
pub const VEHICLE_COLUMNS: [&str; HOPS.len() + 10] = [
    "t", HOPS[0], HOPS[1], HOPS[2], HOPS[3], HOPS[4], WIRE, AIR, "whole", "battery", "quality",
    "armed", "link", "stopped", "lost",
];

/// Indices of the values in a [`VehicleRow`] that are drawn over time.
pub const VEHICLE_CURVES: std::ops::Range<usize> = 1..HOPS.len() + 5;

/// A tick.
pub type TickRow = [f64; TICK_COLUMNS.len()];
/// A vehicle message.
pub type VehicleRow = [f64; VEHICLE_COLUMNS.len()];

/// The row of a tick; `t_s` is its time since the origin.
pub fn tick(t_s: f64, sample: &FlightSample, interface: Interface) -> TickRow {
    let telemetry = &sample.telemetry;
    // Before the first pose the estimate is its initial value, not a motion of the vehicle.
    let is_known = sample.truth.is_some() || telemetry.pose_age_s.is_finite();
    let known = |value: f64| if is_known { rounded(value, 4) } else { f64::NAN };
    let [x, y, z] = sample.position().map(known).into();
    let [qx, qy, qz, qw] = sample.attitude().xyzw().map(known);
    let [rx, ry, rz] = telemetry.reference_position.map(|value| rounded(value, 4));
    let [roll, pitch, yaw] = command(sample, interface).map(|value| rounded(value, 4));
    // Without poses the estimate stays where it was.
    let is_scored = sample.is_armed() && sample.is_located() && telemetry.pose_age_s.is_finite();
    let scored = |value: f64, digits| if is_scored { rounded(value, digits) } else { f64::NAN };
    [
        rounded(t_s, 4),
        x,
        y,
        z,
        qx,
        qy,
        qz,
        qw,
        rx,
        ry,
        rz,
        scored(sample.position_error().norm(), 5),
        scored(sample.velocity_error().norm(), 4),
        scored(sample.attitude_error().norm().to_degrees(), 3),
        roll,
        pitch,
        yaw,
        rounded(telemetry.thrust, 4),
        rounded(telemetry.pose_age_s * 1e3, 2),
        f64::from(telemetry.mode),
        f64::from(telemetry.state),
        f64::from(telemetry.cause),
        f64::from(telemetry.phase),
        telemetry.deadline_misses as f64,
        telemetry.poses_lost as f64,
        telemetry.poses_refused as f64,
        f64::from(u8::from(sample.truth.is_some())),
    ]
}

/// Command by axis: sticks \[-1..1\], torque \[N m\], or roll, pitch and yaw \[deg\], depending on the interface.
fn command(sample: &FlightSample, interface: Interface) -> [f64; 3] {
    let telemetry = &sample.telemetry;
    match interface {
        Interface::Rate => telemetry.sticks,
        Interface::Torque => telemetry.torque,
        Interface::Attitude => {
            let attitude = Attitude::from_xyzw(telemetry.attitude_sent);
            attitude.map_or([f64::NAN; 3], |attitude| {
                let (roll, pitch, yaw) = attitude.unit_quaternion().euler_angles();
                [roll, pitch, yaw].map(f64::to_degrees)
            })
        }
    }
}

/// The row of a vehicle message; `since_origin_s` converts an instant to the axis of time \[s\].
pub fn vehicle(
    received_at: Time,
    message: (&Header, &VehicleV1),
    since_origin_s: impl Fn(Time) -> f64,
) -> VehicleRow {
    let (Header { stamps, .. }, vehicle) = message;
    let at = if stamps.applied_at.is_set() { stamps.applied_at } else { received_at };
    let milliseconds = |span: Span| rounded(span.seconds() * 1e3, 4);
    let passed = |span| if span > Span::ZERO { milliseconds(span) } else { f64::NAN };
    let onward = OnwardTime::of(vehicle);
    let spans = hops(stamps).map(|spans| spans.map(milliseconds));
    let [a, b, c, d, e] = spans.unwrap_or([f64::NAN; HOPS.len()]);
    let whole = spans.map_or(f64::NAN, |_| milliseconds(sensor_to_actuator(stamps, onward)));
    [
        rounded(since_origin_s(at), 4),
        a,
        b,
        c,
        d,
        e,
        passed(onward.wire),
        passed(onward.air),
        whole,
        rounded(vehicle.battery_v, 2),
        rounded(vehicle.link_quality, 2),
        f64::from(vehicle.armed),
        f64::from(vehicle.link),
        f64::from(vehicle.stopped),
        vehicle.lost as f64,
    ]
}

/// `value` rounded to this number of decimals, for a short decimal text.
fn rounded(value: f64, decimals: i32) -> f64 {
    let unit = 10_f64.powi(decimals);
    (value * unit).round() / unit
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::message::{Stamps, TelemetryV1, TruthV1};

    #[test]
    fn before_the_first_pose_there_is_a_position_only_of_the_truth() {
        let telemetry = TelemetryV1 { pose_age_s: f64::NAN, ..TelemetryV1::default() };
        let motion = |truth| {
            let sample = FlightSample { telemetry, truth };
            tick(0.0, &sample, Interface::Rate)[1..8].to_vec()
        };
        assert!(motion(None).iter().all(|value| value.is_nan()));
        assert!(motion(Some(TruthV1::default()))[..3].iter().all(|value| *value == 0.0));
    }

    #[test]
    fn the_hops_of_a_row_add_up_to_the_whole() {
        let at = |millis| Time::VIRTUAL_START + Span::from_millis(millis);
        let stamps = Stamps {
            captured_at: at(1),
            pose_published_at: at(2),
            woken_at: at(4),
            command_published_at: at(7),
            received_at: at(8),
            applied_at: at(9),
            ..Stamps::default()
        };
        let header = Header { stamps, ..Header::default() };
        let message = VehicleV1 { wire_ns: 1_000_000, air_ns: 17_000_000, ..VehicleV1::default() };
        let row = vehicle(at(9), (&header, &message), |_| 0.0);
        let whole = VEHICLE_COLUMNS.iter().position(|name| *name == "whole").unwrap();
        assert_eq!((row[1..whole].iter().sum::<f64>(), row[whole]), (26.0, 26.0));
    }
}
