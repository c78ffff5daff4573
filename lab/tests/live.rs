//! Flights that are changed in flight: points, trajectories, settings and laws by request, and references of a planner.

mod attitude;
mod fallback;
mod planners;
mod requests;
mod room;

use std::path::Path;

use crate::config;
use nalgebra::Vector3;
use oqtal_bus::code::{Answer, Cause, OperatorCommand, ReferenceKind};
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1, ReferenceV1, TelemetryV1};
use oqtal_bus::text::LongText;
use oqtal_bus::time::Span;
use oqtal_config::Config;
use oqtal_control::trajectory::Reference;
use oqtal_daemon::LawPort;
use oqtal_lab::mission::Mission;
use oqtal_lab::replay::{RecordedWaypoints, replay};
use oqtal_lab::simulation::online::OnlineFlight;
use oqtal_observe::flight::Outcome;
use oqtal_observe::provenance::Provenance;
use oqtal_observe::recording::{InputHistory, McapRecorder, RecordingFile, RecordingPlan, play};

/// The mission of a hover for `duration_s` \[s\], with `more` settings.
fn hover(duration_s: f64, more: &[&str]) -> Mission {
    let duration = format!("trajectory.duration-s={duration_s}");
    let own = ["trajectory.kind=hover", &duration, "clock.kind=in-process"];
    Mission::new(config(&[more, &own].concat())).unwrap()
}

/// Recorder of a flight of `mission` into the file `path`.
pub fn recorder(mission: &Mission, path: &Path) -> McapRecorder {
    let provenance = Provenance { version: "test", revision: "test" };
    let plan = RecordingPlan {
        path: path.to_owned(),
        config: &mission.config,
        provenance,
        rotates: false,
        complain: |text| panic!("{text}"),
    };
    McapRecorder::create(&plan).unwrap()
}

fn request(text: &str) -> ControlRequestV1 {
    let text = LongText::of_lines(text.split(' ')).unwrap();
    ControlRequestV1 { text, ..ControlRequestV1::of(OperatorCommand::Set) }
}

fn goto(point: [f64; 3]) -> ControlRequestV1 {
    ControlRequestV1 { point, ..ControlRequestV1::of(OperatorCommand::Goto) }
}

fn is_done(response: &ControlResponseV1) -> bool {
    response.answer == Answer::Done.code()
}

fn last<'a>(flight: &'a OnlineFlight<'_>) -> &'a TelemetryV1 {
    &flight.samples().last().unwrap().telemetry
}

fn fly_for(flight: &mut OnlineFlight<'_>, seconds: f64) {
    let until = flight.now() + Span::from_seconds(seconds);
    while flight.now() < until && flight.advance().unwrap() {}
}

/// Greatest change of the reference's position between two ticks, over their distance in time \[m/s\].
fn fastest_reference(flight: &OnlineFlight<'_>) -> f64 {
    let samples = flight.samples();
    let flown = |tick: &TelemetryV1| tick.mission_s.is_finite() && tick.reference_yaw.is_finite();
    let pairs = samples.windows(2).map(|pair| (&pair[0].telemetry, &pair[1].telemetry));
    let speed = |(a, b): (&TelemetryV1, &TelemetryV1)| {
        let way = |axis: usize| (b.reference_position[axis] - a.reference_position[axis]).powi(2);
        (0..3).map(way).sum::<f64>().sqrt() / b.time.since(a.time).seconds()
    };
    pairs.filter(|(a, b)| flown(a) && flown(b)).map(speed).fold(0.0, f64::max)
}

#[test]
fn points_trajectories_and_a_stop_follow_one_another_smoothly_in_one_flight() {
    let mission = hover(60.0, &[]);
    let mut flight = OnlineFlight::begin(&mission).unwrap();
    fly_for(&mut flight, 1.5);
    let refused = flight.change(OperatorCommand::Goto, &goto([1.0, 0.0, 1.0])).unwrap().unwrap();
    assert_eq!(refused.cause, Cause::TakeOff.code(), "during the take-off");
    fly_for(&mut flight, 6.0);
    flight.end_after(Span::from_millis(90_000));
    let outside = flight.change(OperatorCommand::Goto, &goto([1e3, 0.0, 1.0])).unwrap();
    assert_eq!(outside.unwrap_err().cause, Cause::Fence);
    assert!(is_done(
        &flight.change(OperatorCommand::Goto, &goto([1.0, 0.5, 1.3])).unwrap().unwrap()
    ));
    fly_for(&mut flight, 1.2);
    // Back before the point is reached.
    assert!(is_done(
        &flight.change(OperatorCommand::Goto, &goto([0.0, 0.0, 1.0])).unwrap().unwrap()
    ));
    fly_for(&mut flight, 8.0);
    assert_eq!(last(&flight).reference_position.map(|x| (x * 1e6).round() / 1e6), [0.0, 0.0, 1.0]);
    let circle = flight.change(OperatorCommand::Trajectory, &request("circle")).unwrap().unwrap();
    assert!(is_done(&circle));
    fly_for(&mut flight, 10.0);
    let hover = ControlRequestV1::of(OperatorCommand::Hover);
    assert!(is_done(&flight.change(OperatorCommand::Hover, &hover).unwrap().unwrap()));
    fly_for(&mut flight, 5.0);
    assert!(last(&flight).reference_velocity.iter().all(|v| v.abs() < 1e-9));
    let fastest = fastest_reference(&flight);
    assert!(fastest < 0.8, "{fastest} m/s");
    assert!(flight.request(OperatorCommand::Land).unwrap());
    let refused = flight.change(OperatorCommand::Goto, &goto([1.0, 0.0, 1.0])).unwrap().unwrap();
    assert_eq!(refused.cause, Cause::WrongMode.code(), "during a landing");
    let flown = flight.finish().unwrap();
    assert_eq!(flown.outcome, Outcome::Landed);
}

/// A descending vehicle that is sent far away, and points near the floor.
#[test]
fn no_request_leads_to_the_floor() {
    let mission = hover(60.0, &["control.controller=oqtal-dt"]);
    let mut flight = OnlineFlight::begin(&mission).unwrap();
    fly_for(&mut flight, 8.0);
    let ask = |flight: &mut OnlineFlight<'_>, point| {
        flight.change(OperatorCommand::Goto, &goto(point)).unwrap().unwrap()
    };
    assert!(is_done(&ask(&mut flight, [0.0, 0.0, 0.3])));
    fly_for(&mut flight, 1.9);
    assert!(last(&flight).reference_velocity[2] < -0.3, "descends");
    assert!(is_done(&ask(&mut flight, [1.9, 1.4, 1.9])));
    fly_for(&mut flight, 8.0);
    for low in [0.0, 0.09, -0.4] {
        let refused = ask(&mut flight, [1.9, 1.4, low]);
        assert_eq!(refused.cause, Cause::NearFloor.code(), "{low}");
    }
    assert!(is_done(&ask(&mut flight, [1.9, 1.4, 0.15])));
    fly_for(&mut flight, 8.0);
    let flown = flight.samples().iter().skip_while(|sample| sample.telemetry.position[2] < 0.9);
    let lowest = flown.map(|sample| sample.telemetry.position[2]).fold(f64::INFINITY, f64::min);
    assert!(lowest > 0.1, "{lowest}");
    assert!(flight.request(OperatorCommand::Land).unwrap());
    assert_eq!(flight.finish().unwrap().outcome, Outcome::Landed);
}

/// The recorded points fly, whatever becomes of the file.
#[test]
fn waypoints_flown_by_request_are_those_of_the_start_and_replay_bit_for_bit() {
    let directory = tempfile::tempdir().unwrap();
    let points = directory.path().join("points.csv");
    let text = "t,x,y,z\n0,0,0,1\n4,0.5,0,1\n8,0,0,1\n";
    std::fs::write(&points, text).unwrap();
    let file = format!("trajectory.waypoints-file={:?}", points.display().to_string());
    let mission = hover(60.0, &[&file]);
    let path = directory.path().join("flight.mcap");
    let recorder = recorder(&mission, &path);
    let mut flight =
        OnlineFlight::begin_with(&mission, Some(recorder), LawPort::default()).unwrap();
    fly_for(&mut flight, 7.0);
    std::fs::remove_file(&points).unwrap();
    let fly = ControlRequestV1::of(OperatorCommand::Trajectory);
    let fly = ControlRequestV1 { text: LongText::new("waypoints"), ..fly };
    assert!(is_done(&flight.change(OperatorCommand::Trajectory, &fly).unwrap().unwrap()));
    fly_for(&mut flight, 4.0);
    assert!(last(&flight).position[0] > 0.3, "{:?}", last(&flight).position);
    let law = request("control.controller=geometric");
    assert!(is_done(&flight.change(OperatorCommand::Set, &law).unwrap().unwrap()));
    fly_for(&mut flight, 2.0);
    assert!(flight.request(OperatorCommand::Land).unwrap());
    flight.end_after(Span::from_millis(20_000));
    assert_eq!(flight.finish().unwrap().outcome, Outcome::Landed);
    assert_replays(&mission, &path, 4);
}

/// Asserts that the recording at `path` replays bit for bit, with this number of requests.
fn assert_replays(mission: &Mission, path: &Path, requests: u64) {
    let (file, mut histories) = (RecordingFile::read(path).unwrap(), InputHistory::default());
    play(&file, &mut histories).unwrap();
    let waypoints = RecordedWaypoints::of(&file).unwrap();
    let result = replay(&mission.config, &waypoints, &histories.finish()[0]).unwrap();
    assert!(result.is_identical() && result.requests == requests, "{}", result.requests);
}

/// Between these requests, neither the flight nor its replay depends on the file.
#[test]
fn a_waypoint_file_is_read_whenever_it_is_named_in_flight_and_replays_bit_for_bit() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("flight.mcap");
    let mission = hover(60.0, &[]);
    let mut flight =
        OnlineFlight::begin_with(&mission, Some(recorder(&mission, &path)), LawPort::default())
            .unwrap();
    fly_for(&mut flight, 7.0);
    let file = |number: u32| directory.path().join(format!("{number}.csv"));
    let name = |number| request(&format!("trajectory.waypoints-file={}", file(number).display()));
    let missing = flight.change(OperatorCommand::Set, &name(0)).unwrap().unwrap_err();
    assert!(missing.reason.contains("0.csv"), "{}", missing.reason);
    let ask = |flight: &mut OnlineFlight<'_>, command, request: &ControlRequestV1| {
        assert!(is_done(&flight.change(command, request).unwrap().unwrap()), "{command}");
        fly_for(flight, 1.0);
    };
    let fly = ControlRequestV1::of(OperatorCommand::Trajectory);
    let fly = ControlRequestV1 { text: LongText::new("waypoints"), ..fly };
    // The last one is named again, with other points.
    for (number, x) in [(1, 0.5), (2, -0.5), (2, 0.5)] {
        std::fs::write(file(number), format!("t,x,y,z\n0,0,0,1\n4,{x},0,1\n8,0,0,1\n")).unwrap();
        ask(&mut flight, OperatorCommand::Set, &name(number));
        std::fs::remove_file(file(number)).unwrap();
        ask(&mut flight, OperatorCommand::Set, &request("trajectory.kind=waypoints"));
        ask(&mut flight, OperatorCommand::Set, &request("control.controller=geometric"));
        ask(&mut flight, OperatorCommand::Trajectory, &fly);
        ask(&mut flight, OperatorCommand::Undo, &ControlRequestV1::of(OperatorCommand::Undo));
        fly_for(&mut flight, 2.0);
        let flown_m = last(&flight).position[0] / x;
        assert!(flown_m > 0.4, "{number}: {flown_m}");
        fly_for(&mut flight, 5.0);
        let hover = request("trajectory.kind=hover");
        ask(&mut flight, OperatorCommand::Set, &hover);
    }
    ask(&mut flight, OperatorCommand::Undo, &ControlRequestV1::of(OperatorCommand::Undo));
    assert!(flight.request(OperatorCommand::Land).unwrap());
    flight.end_after(Span::from_millis(20_000));
    assert_eq!(flight.finish().unwrap().outcome, Outcome::Landed);
    assert_replays(&mission, &path, 21);
}

/// A planner's reference of the shipped circle from the hover point, at `t_s` \[s\] after its start.
fn circle(t_s: f64, config: &Config, anchor: [f64; 3]) -> Reference {
    let mut options = config.trajectory.clone();
    options.kind = oqtal_control::trajectory::TrajectoryKind::Circle;
    let trajectory = options.trajectory(None).unwrap();
    let (reference, start) = (trajectory.sample(t_s), trajectory.sample(0.0));
    let position = reference.position - start.position + Vector3::from(anchor);
    Reference { position, ..reference }
}

/// Publishes the references of a circle each `period` for 26 s, from the present reference on.
fn stream_circle(flight: &mut OnlineFlight<'_>, config: &Config, period: Span) {
    let began = flight.now();
    let anchor = last(flight).reference_position;
    while flight.now().since(began).seconds() < 26.0 {
        let now = flight.now();
        let t_s = now.since(began).seconds();
        let Reference { position, velocity, acceleration, jerk, .. } = circle(t_s, config, anchor);
        flight
            .publish(ReferenceV1 {
                time: now,
                valid_until: now + period.scaled(2.0),
                kind: ReferenceKind::Position.code(),
                position: position.into(),
                velocity: velocity.into(),
                acceleration: acceleration.into(),
                jerk: jerk.into(),
                ..ReferenceV1::default()
            })
            .unwrap();
        assert!(flight.advance().unwrap());
    }
}

/// Root of the mean square distance of the vehicle from the reference, over the samples from `from` on \[m\].
fn error_m(flight: &OnlineFlight<'_>, from: usize) -> f64 {
    let samples = &flight.samples()[from..];
    let sum: f64 = samples.iter().map(|sample| sample.position_error().norm_squared()).sum();
    (sum / samples.len() as f64).sqrt()
}

#[test]
fn f35_a_planner_flies_the_circle_as_well_as_the_daemon_and_its_end_holds_and_lands() {
    for law in ["oqtal", "oqtal-dt"] {
        planner_flies_the_circle(law);
    }
}

/// Derivatives that do not belong to the positions, at the limits.
#[test]
fn f35_wrong_derivatives_of_a_planner_do_not_cost_the_vehicle() {
    let forces = [[5.9, 0.0], [0.0, 5.9], [1.9, 0.0], [0.0, 0.9]];
    for (law, wrong) in ["oqtal-dt", "mpc"].into_iter().flat_map(|law| forces.map(|it| (law, it))) {
        let mission = hover(20.0, &[&format!("control.controller={law}")]);
        let mut flight = OnlineFlight::begin(&mission).unwrap();
        fly_for(&mut flight, 6.0);
        let period = Span::from_millis(20);
        flight.pause_every(period);
        let (began, position) = (flight.now(), last(&flight).reference_position);
        while flight.now().since(began).seconds() < 5.0 {
            let now = flight.now();
            let message = ReferenceV1 {
                time: now,
                valid_until: now + period.scaled(2.0),
                kind: ReferenceKind::Position.code(),
                position,
                acceleration: [wrong[0], 0.0, 0.0],
                jerk: [10.0 * wrong[1], 0.0, 0.0],
                ..ReferenceV1::default()
            };
            flight.publish(message).unwrap();
            assert!(flight.advance().unwrap());
        }
        let offsets = flight.samples().iter().map(|sample| sample.position_error().norm());
        let furthest_m = offsets.fold(0.0, f64::max);
        assert!(furthest_m < 0.5, "{law}, {wrong:?}: {furthest_m} m");
        assert_eq!(flight.finish().unwrap().outcome, Outcome::Landed, "{law}, {wrong:?}");
    }
}

fn planner_flies_the_circle(law: &str) {
    let law_setting = format!("control.controller={law}");
    let mission = hover(120.0, &["reference.land-after-ms=2000", &law_setting]);
    let mut flight = OnlineFlight::begin(&mission).unwrap();
    fly_for(&mut flight, 8.0);
    let builtin_from = flight.samples().len();
    assert!(is_done(
        &flight.change(OperatorCommand::Trajectory, &request("circle")).unwrap().unwrap()
    ));
    fly_for(&mut flight, 26.0);
    let builtin = error_m(&flight, builtin_from);
    fly_for(&mut flight, 4.0);
    for rate_hz in [60.0, 240.0, 10.0] {
        let period = Span::from_seconds(1.0 / rate_hz);
        flight.pause_every(period);
        // The next pause is still one of the period before.
        assert!(flight.advance().unwrap());
        let from = flight.samples().len();
        stream_circle(&mut flight, &mission.config, period);
        let streamed = error_m(&flight, from);
        println!("{law}, {rate_hz} Hz: {:.2} mm, built in {:.2} mm", 1e3 * streamed, 1e3 * builtin);
        assert!(
            streamed < 1.1 * builtin,
            "{law}, {rate_hz} Hz: {streamed} m, built in {builtin} m"
        );
        assert_eq!(last(&flight).cause, Cause::None.code(), "{rate_hz} Hz");
        // The planner is gone: hold, then a new planner, at last a landing.
        let ended = flight.now();
        flight.pause_every(Span::from_millis(250));
        fly_for(&mut flight, 1.0);
        let held = flight.samples().iter().map(|sample| &sample.telemetry);
        let mut held = held.filter(|tick| tick.cause == Cause::ReferencesEnded.code());
        let first = held.find(|tick| tick.time > ended).unwrap().time;
        assert!(first.since(ended) <= period.scaled(2.0) + Span::from_millis(34), "{rate_hz} Hz");
    }
    let flown = flight.finish().unwrap();
    assert_eq!(flown.outcome, Outcome::Landed);
}
