//! Position, velocity, attitude and command over time.

use maud::{Markup, html};
use oqtal_bus::message::TelemetryV1;
use oqtal_config::Interface;
use oqtal_control::quaternion::Attitude;

use crate::flight::FlightSample;

use super::timeline::Timeline;
use super::timeline::over_time;
use crate::page::section;
use crate::plot::palette::Ink;

/// The axes of the world.
const WORLD: [&str; 3] = ["x", "y", "z"];
/// The 3-2-1 Euler angles.
const ANGLES: [&str; 3] = ["Roll", "Pitch", "Yaw"];
/// Colours of the components of a vector.
const COMPONENTS: [Ink; 3] = [Ink::Actual, Ink::Second, Ink::Third];

/// `value` while armed, else NaN: with the motors off, command and error are undefined.
fn in_flight(sample: &FlightSample, value: f64) -> f64 {
    if sample.is_armed() { value } else { f64::NAN }
}

/// `value` while the vehicle's motion is known, else NaN: without poses the estimate stays where it was.
fn located(sample: &FlightSample, value: f64) -> f64 {
    if sample.is_located() { value } else { f64::NAN }
}

/// Position by axis with its reference, and the magnitude of the error.
pub fn position(timeline: &Timeline<'_>) -> Markup {
    let axis = |i: usize| {
        let traces = vec![
            timeline.trace("reference", Ink::Reference, |s| {
                in_flight(s, s.telemetry.reference_position[i])
            }),
            timeline.trace(timeline.actual(), Ink::Actual, |s| located(s, s.position()[i])),
        ];
        over_time(timeline, &format!("Position {} [m]", WORLD[i]), traces)
    };
    let error = |s: &FlightSample| located(s, in_flight(s, s.position_error().norm()));
    let error = timeline.trace("error", Ink::Bad, error);
    section(
        "Position",
        html! {
            @for i in 0..3 { (axis(i)) }
            (over_time(timeline, "Position error, magnitude [m]", vec![error]))
        },
    )
}

/// Attitude by angle with its command, and the angle of the error.
pub fn attitude(timeline: &Timeline<'_>) -> Markup {
    let angle = |i: usize| {
        let commanded = |s: &FlightSample| in_flight(s, euler_angles(&s.attitude_command())[i]);
        let traces = vec![
            timeline.angle("commanded", Ink::Reference, commanded),
            timeline.angle(timeline.actual(), Ink::Actual, |s| {
                located(s, euler_angles(&s.attitude())[i])
            }),
        ];
        over_time(timeline, &format!("{} [deg]", ANGLES[i]), traces)
    };
    let degrees =
        |s: &FlightSample| located(s, in_flight(s, s.attitude_error().norm().to_degrees()));
    let error = timeline.trace("error", Ink::Bad, degrees);
    section(
        "Attitude",
        html! {
            @for i in 0..3 { (angle(i)) }
            (over_time(timeline, "Attitude error, angle [deg]", vec![error]))
        },
    )
}

/// Velocity by axis with its command, and the magnitude of the error.
pub fn velocity(timeline: &Timeline<'_>) -> Markup {
    let axis = |i: usize| {
        let traces = vec![
            timeline.trace("commanded", Ink::Reference, |s| {
                in_flight(s, s.telemetry.velocity_command[i])
            }),
            timeline.trace(timeline.actual(), Ink::Actual, |s| located(s, s.velocity()[i])),
        ];
        over_time(timeline, &format!("Velocity {} [m/s]", WORLD[i]), traces)
    };
    let error = |s: &FlightSample| located(s, in_flight(s, s.velocity_error().norm()));
    let error = timeline.trace("error", Ink::Bad, error);
    section(
        "Velocity",
        html! {
            @for i in 0..3 { (axis(i)) }
            (over_time(timeline, "Velocity error, magnitude [m/s]", vec![error]))
        },
    )
}

/// Command, body rate and battery voltage.
pub fn command(timeline: &Timeline<'_>) -> Markup {
    let thrust = timeline.trace("thrust", Ink::Actual, |s| s.telemetry.thrust);
    let title =
        if timeline.flight.is_observation() { "Command (computed, not sent)" } else { "Command" };
    section(
        title,
        html! {
            (rotation_command(timeline))
            (over_time(timeline, "Collective thrust [fraction of maximum]", vec![thrust]))
            // Two plots or none, since the grid has two columns.
            @if let Some(voltage) = timeline.battery() {
                (body_rate(timeline))
                (over_time(timeline, "Battery voltage [V]", vec![voltage]))
            }
        },
    )
}

/// Terms of the law's rotation command.
pub fn terms(timeline: &Timeline<'_>) -> Markup {
    let unit = match timeline.flight.config.vehicle.interface {
        Interface::Rate | Interface::Attitude => "-1..1",
        Interface::Torque => "N m, body",
    };
    let term = |name: &str, of: fn(&TelemetryV1) -> [f64; 3]| {
        let title = format!("{name} [{unit}]");
        by_component(timeline, &title, ["roll", "pitch", "yaw"], |s| of(&s.telemetry))
    };
    section(
        "Terms of the law",
        html! {
            (term("Feedback", |t| t.proportional_term))
            (term("Integral action", |t| t.integral_term))
            (term("Feed-forward", |t| t.feed_forward_term))
            (term("Compensation of the estimated disturbance", |t| t.disturbance_term))
        },
    )
}

/// Sticks, torque or attitude, depending on the command interface.
fn rotation_command(timeline: &Timeline<'_>) -> Markup {
    let (title, vector): (_, fn(&FlightSample) -> [f64; 3]) =
        match timeline.flight.config.vehicle.interface {
            Interface::Rate => ("Sticks [-1..1]", |s| s.telemetry.sticks),
            Interface::Torque => ("Torque [N m, body]", |s| s.telemetry.torque),
            Interface::Attitude => ("Attitude [deg]", |s| {
                let attitude = Attitude::from_xyzw(s.telemetry.attitude_sent);
                attitude.map_or([f64::NAN; 3], |q| euler_angles(&q).map(f64::to_degrees))
            }),
        };
    by_component(timeline, title, ["roll", "pitch", "yaw"], vector)
}

/// Estimated motion and pose age.
pub fn estimate(timeline: &Timeline<'_>) -> Markup {
    let angle = |i: usize| {
        let angle = timeline.angle("estimate", Ink::Actual, |s| euler_angles(&s.attitude())[i]);
        over_time(timeline, &format!("{} [deg]", ANGLES[i]), vec![angle])
    };
    let age = timeline.trace("age", Ink::Bad, |s| s.telemetry.pose_age_s * 1e3);
    section(
        "Estimated motion",
        html! {
            (by_component(timeline, "Velocity [m/s]", WORLD, |s| s.telemetry.velocity))
            (body_rate(timeline))
            @for i in 0..3 { (angle(i)) }
            (over_time(timeline, "Age of the newest pose at each tick [ms]", vec![age]))
        },
    )
}

fn body_rate(timeline: &Timeline<'_>) -> Markup {
    let rate = |s: &FlightSample| s.telemetry.rate.map(f64::to_degrees);
    by_component(timeline, "Estimated body rate [deg/s, body]", WORLD, rate)
}

fn by_component(
    timeline: &Timeline<'_>,
    title: &str,
    names: [&'static str; 3],
    vector: impl Fn(&FlightSample) -> [f64; 3],
) -> Markup {
    let traces = (0..3)
        .map(|i| timeline.trace(names[i], COMPONENTS[i], |sample| vector(sample)[i]))
        .collect();
    over_time(timeline, title, traces)
}

/// Roll, pitch and yaw, 3-2-1 \[rad\].
fn euler_angles(attitude: &Attitude) -> [f64; 3] {
    attitude.unit_quaternion().euler_angles().into()
}
