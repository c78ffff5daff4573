//! Metrics of flights with known errors: flown flights in which the truth was replaced.

use nalgebra::Vector3;
use oqtal_bus::time::Span;
use oqtal_control::quaternion::Attitude;
use oqtal_control::trajectory::FlightPlan;
use oqtal_lab::mission::Mission;
use oqtal_lab::simulation;
use oqtal_lab::study::metric::{of_attitude, of_hover, of_path};
use oqtal_observe::corners::CornerFigures;
use oqtal_observe::flight::{Flight, FlightSample, Outcome};
use oqtal_observe::settling::StepSettling;
use oqtal_observe::summary::Summary;
use oqtal_observe::table::closing;

use crate::config;

/// Heading of the vehicle at the start \[rad\].
const HEADING: f64 = 0.3;

fn flown(controller: &str, trajectory: &str) -> (Flight, Mission) {
    let settings = [
        format!("control.controller={controller}"),
        format!("trajectory.kind={trajectory}"),
        "trajectory.hover.duration-s=14".to_owned(),
    ];
    let mission = Mission::new(config(&settings)).unwrap();
    let flight = simulation::fly(&mission).unwrap();
    assert!(flight.scored().count() > 100, "{:?}", flight.shortfall());
    (flight, mission)
}

/// Flight of a prescribed attitude by a vehicle turned from it by `off` \[rad, body\], which may depend on the time since the
/// last step \[s\].
fn turned(trajectory: &str, off: impl Fn(f64) -> Vector3<f64>) -> Flight {
    let (mut flight, mission) = flown("pid", trajectory);
    let options = &flight.config.trajectory;
    let start_s = options.take_off_s + options.settle_s;
    let heading = Attitude::from_rotation_vector(Vector3::z() * HEADING);
    let mut last: Option<(Attitude, f64)> = None;
    for sample in flight.samples.iter_mut().filter(|sample| sample.is_scored()) {
        let t_s = sample.telemetry.mission_s - start_s;
        let Some(prescribed) = mission.trajectory.sample(t_s).attitude else { continue };
        let wanted = heading.unit_quaternion() * prescribed.attitude.unit_quaternion();
        let wanted = Attitude::from_unit_quaternion(wanted);
        let steps = last.is_none_or(|(last, _)| last.angle_to(&wanted).to_degrees() > 5.0);
        let since_s = last.filter(|_| !steps).map_or(t_s, |(_, since_s)| since_s);
        last = Some((wanted, since_s));
        sample.telemetry.attitude_command = wanted.xyzw();
        let truth = sample.truth.as_mut().unwrap();
        truth.attitude = wanted.turned_by(off(t_s - since_s)).xyzw();
    }
    flight
}

/// The result is the same about every axis; the initial heading is taken into account.
#[test]
fn the_chirp_is_scored_by_the_angle_about_every_axis() {
    for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
        let flight = turned("attitude-chirp", |_| axis * 1_f64.to_radians());
        let [rms_deg, ..] = of_attitude(&flight);
        assert_eq!(Summary::of(&flight).attitude_steps, None);
        assert!((rms_deg - 1.0).abs() < 1e-3, "{axis}: {rms_deg} deg");
    }
}

#[test]
fn a_doublet_is_settled_after_the_last_pose_that_is_off() {
    let three_deg = Vector3::y() * 3_f64.to_radians();
    let flight = turned("attitude-doublet", |since_s| match since_s < 0.5 {
        true => three_deg,
        false => Vector3::zeros(),
    });
    let [_, settle_s, least_s] = of_attitude(&flight);
    let summary = Summary::of(&flight);
    let StepSettling { count, settled, settle_s: told_s, .. } = summary.attitude_steps.unwrap();
    assert!(count > 1 && (settled, told_s) == (count, settle_s), "{settled} of {count}");
    let line = format!("steps of the attitude: {count}, within 1.5 deg after {settle_s:.2} s");
    assert!(closing(&summary).contains(&line), "{line} in\n{}", closing(&summary));
    assert!((settle_s - 0.5).abs() <= 1.0 / 60.0 && least_s == settle_s, "{settle_s} s");
    let mut flight = turned("attitude-doublet", |_| three_deg);
    let [_, settle_s, least_s] = of_attitude(&flight);
    let told = closing(&Summary::of(&flight));
    // The flight continues after the last step, which is not cut off.
    let none = format!("steps of the attitude: {count}, none within 1.5 deg before the next\n");
    assert!(told.contains(&none), "{told}");
    assert!(settle_s == f64::INFINITY && least_s > 0.5, "never settled: {settle_s}, {least_s} s");
    let last = flight.samples.iter().rposition(FlightSample::is_scored).unwrap();
    flight.samples.truncate(last - 20);
    let told = closing(&Summary::of(&flight));
    assert!(told.contains("1 cut off by the end of the flight"), "{told}");
}

#[test]
fn a_corner_that_does_not_settle_has_no_settling_time() {
    let (mut flight, _) = flown("pid", "square");
    let all = CornerFigures::of(&flight).unwrap().settling;
    assert!(all.settled == all.count && of_path(&flight)[3] == all.settle_s, "{all:?}");
    // Away from the reference in the scored ticks from the second corner on.
    let references: Vec<_> = flight.scored().map(|s| s.telemetry.reference_position).collect();
    let first = references[0];
    for sample in flight.samples.iter_mut().filter(|sample| sample.is_scored()) {
        let reference = sample.telemetry.reference_position;
        if let Some(truth) = sample.truth.as_mut().filter(|_| reference != first) {
            truth.position = (Vector3::from(reference) + Vector3::z() * 0.2).into();
        }
    }
    let some = CornerFigures::of(&flight).unwrap().settling;
    assert_eq!((some.count, some.settled), (all.count, 1), "{some:?}");
    assert!(some.settle_s.is_finite() && some.least_settle_s > some.settle_s, "{some:?}");
    assert_eq!(of_path(&flight)[3], f64::INFINITY);
}

/// A gust pushes a hovering vehicle beyond the soft border of the fence; the safety holds it there for a time.
#[test]
fn a_flight_that_the_fence_held_is_not_as_planned_and_its_held_ticks_are_not_scored() {
    let settings = [
        "trajectory.kind=hover",
        "fence.x-m=[-2.0,0.8]",
        "fence.soft-margin-m=0.6",
        "plant.disturb=[\"gust@16+2=6,0,0m/s\"]",
    ];
    let mission = Mission::new(config(&settings)).unwrap();
    let flight = simulation::fly(&mission).unwrap();
    assert_eq!(flight.outcome, Outcome::Landed, "{:?}", flight.shortfall());
    assert_eq!(flight.cause().as_deref(), Some("held by the fence"));
    assert!(flight.held_s() > 0.5, "{} s", flight.held_s());
    assert!(flight.scored().all(|sample| !sample.is_held()));
    let summary = Summary::of(&flight);
    // The trajectory waits meanwhile, and is flown to its end.
    let kept = FlightPlan::from_origin(&flight.config.trajectory, &mission.trajectory);
    let ticks = (0..6000).filter(|k| kept.scored(f64::from(*k) / 100.0)).count();
    let scored_s = ticks as f64 / 100.0;
    assert!((summary.scored_s - scored_s).abs() < 0.1, "{} of {scored_s} s", summary.scored_s);
}

#[test]
fn effort_is_integrated_over_the_time_that_each_command_is_held() {
    let (mut flight, _) = flown("pid", "circle");
    let whole = Summary::of(&flight).effort.unwrap();
    // Ticks that were lost.
    let mut tick = 0..;
    flight.samples.retain(|_| tick.next().is_none_or(|k| k % 3 != 0));
    let thinned = Summary::of(&flight).effort.unwrap();
    assert!((thinned / whole - 1.0).abs() < 0.05, "{thinned} and {whole}");
    flight.samples.iter_mut().for_each(|sample| sample.telemetry.sticks = [0.0, 3.0, 4.0]);
    let summary = Summary::of(&flight);
    assert!((summary.effort.unwrap() - 5.0 * summary.scored_s).abs() < 1e-9);
}

#[test]
fn a_hover_is_scored_by_the_distance_in_millimetres() {
    let (mut flight, _) = flown("pid", "hover");
    for FlightSample { telemetry, truth } in &mut flight.samples {
        let wanted = Vector3::from(telemetry.reference_position);
        let Some(truth) = truth else { continue };
        truth.position = (wanted + Vector3::new(3e-3, 0.0, -4e-3)).into();
    }
    let [rms_mm, _] = of_hover(&flight);
    assert!((rms_mm - 5.0).abs() < 1e-6, "{rms_mm} mm");
}

/// The set-points move, and the vehicle follows the newest one: for `oqtal-dt` it is valid at the instant at which its command
/// takes effect, for other laws at present.
#[test]
fn the_errors_of_every_law_are_against_the_newest_set_point() {
    let (ahead_s, speed, turn) = (35e-3, 0.3, 0.2);
    for (controller, look_ahead_s) in [("oqtal-dt", ahead_s), ("pid", 0.0)] {
        let (mut flight, _) = flown(controller, "hover");
        flight.applied.truncate(1);
        let stamps = &mut flight.applied[0].stamps;
        stamps.applied_at = stamps.command_published_at + Span::from_seconds(ahead_s);
        let start = flight.samples[0].telemetry.time;
        let velocity = |t_s: f64| [speed * t_s, 0.0, 0.0];
        let attitude =
            |t_s: f64| Attitude::from_rotation_vector(Vector3::x() * (turn * t_s)).xyzw();
        for FlightSample { telemetry, truth } in &mut flight.samples {
            let t_s = telemetry.time.since(start).seconds();
            let Some(truth) = truth else { continue };
            telemetry.velocity_command = velocity(t_s);
            telemetry.attitude_command = attitude(t_s);
            truth.velocity = velocity(t_s + ahead_s);
            truth.attitude = attitude(t_s + ahead_s);
        }
        let [_, velocity_m_s, attitude_deg, ..] = of_path(&flight);
        let behind_s = ahead_s - look_ahead_s;
        let expected = [speed * behind_s, (turn * behind_s).to_degrees()];
        assert!((velocity_m_s - expected[0]).abs() < 1e-6, "{controller}: {velocity_m_s} m/s");
        assert!((attitude_deg - expected[1]).abs() < 1e-4, "{controller}: {attitude_deg} deg");
    }
}
