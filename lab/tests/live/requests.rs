//! Random requests in one flight, and changes of the law one after another.

use std::path::Path;

use oqtal_bus::code::{Mode, OperatorCommand};
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::time::Span;
use oqtal_config::Config;
use oqtal_daemon::{LawPort, SlewLimits};
use oqtal_lab::replay::{RecordedWaypoints, replay};
use oqtal_lab::simulation::online::OnlineFlight;
use oqtal_observe::flight::Outcome;
use oqtal_observe::recording::{InputHistory, RecordingFile, play};

use super::{error_m, fly_for, goto, hover, is_done, last, recorder, request};
use crate::Draw;

/// A request, and the text that its refusal must contain; an empty one for a valid request.
type Drawn = (OperatorCommand, ControlRequestV1, &'static str);

/// A random request.
fn draw(draw: &mut Draw, directory: &Path) -> Drawn {
    let is_valid = draw.next() < 0.5;
    match (draw.next() * 4.0) as u32 {
        0 => draw_settings(draw, is_valid),
        1 => draw_law(draw, is_valid),
        2 => draw_file(draw, is_valid, directory),
        _ => draw_goto(draw, is_valid),
    }
}

fn draw_settings(draw: &mut Draw, is_valid: bool) -> Drawn {
    if is_valid {
        // A setting equal to the present one would not reach the loop.
        let share = draw.next();
        let text = match (draw.next() * 5.0) as u32 {
            0 => format!("position.horizontal-position.kp={}", 1.2 + 0.2 * share),
            1 => format!(
                "position.vertical-velocity.kp={} position.vertical-velocity.ki=1.1",
                3.2 + 0.2 * share
            ),
            2 => format!("control.oqtal.integral-weight={}", 0.01 + 0.02 * share),
            3 => format!("control.lqr.integral-weight={}", 0.01 + 0.02 * share),
            _ => format!("trajectory.circle.radius-m={}", 0.4 + 0.2 * share),
        };
        return (OperatorCommand::Set, request(&text), "");
    }
    let (text, key) = [
        ("position.horizontal-position.kp=-1", "position.horizontal-position.kp"),
        ("position.tilt-limit-deg=1e9", "position.tilt-limit-deg"),
        ("position.horizontal-position.kp=1 vehicle.mass-kg=0.7", "vehicle.mass-kg"),
        ("control.nothing=1", "control.nothing"),
        ("control.rate-hz=120", "control.rate-hz"),
        ("control.oqtal.integral-weight=nan control.oqtal.integral-weight=0.02", "control.oqtal"),
    ][(draw.next() * 6.0) as usize];
    (OperatorCommand::Set, request(text), key)
}

fn draw_law(draw: &mut Draw, is_valid: bool) -> Drawn {
    if !is_valid {
        return (OperatorCommand::Set, request("control.controller=best"), "control.controller");
    }
    let law = draw.one(&["pid", "lqr", "oqtal", "geometric", "oqtal-dt"]);
    (OperatorCommand::Set, request(&format!("control.controller={law}")), "")
}

fn draw_file(draw: &mut Draw, is_valid: bool, directory: &Path) -> Drawn {
    let (name, text, key) = if is_valid {
        // The file of another instance is as good.
        let tilt = 14.0 + draw.next();
        let text = format!("[instance]\nname = \"other\"\n[position]\ntilt-limit-deg = {tilt}\n");
        ("good.toml", text, "")
    } else {
        ("bad.toml", "[fence]\nx-m = [-9.5, 9.5]\n".to_owned(), "fence.x-m")
    };
    let path = directory.join(name);
    std::fs::write(&path, text).unwrap();
    (OperatorCommand::Reload, request(path.to_str().unwrap()), key)
}

fn draw_goto(draw: &mut Draw, is_valid: bool) -> Drawn {
    let [x, y, z] = [draw.next(), draw.next(), 0.8 + 0.4 * draw.next()];
    let (point, key) =
        if is_valid { ([x - 0.5, y - 0.5, z], "") } else { ([x + 50.0, f64::NAN, z], "fence.x-m") };
    (OperatorCommand::Goto, goto(point), key)
}

/// Sends `count` random requests, of which the valid ones alone may be done; returns how many were refused.
fn send_at_random(flight: &mut OnlineFlight<'_>, count: usize, directory: &Path) -> usize {
    let mut random = Draw(7);
    let mut refused = 0;
    for number in 0..count {
        let (command, request, key) = draw(&mut random, directory);
        let answer = flight.change(command, &request).unwrap();
        // The loop may refuse a goto whose way leaves the fence, and nothing else.
        let is_right = match &answer {
            Ok(response) => key.is_empty() && is_done(response),
            Err(refusal) => {
                refused += 1;
                !key.is_empty() && refusal.reason.contains(key)
            }
        };
        assert!(is_right, "{number}: {command} {:?} {answer:?}", request.text);
        assert!(flight.advance().unwrap(), "{number}: the flight ended");
    }
    refused
}

/// Asserts that commands are within their range, and that the thrust follows its slew limit.
fn assert_commands(flight: &OnlineFlight<'_>, config: &Config) {
    let slew = SlewLimits::of(config).thrust_n_per_s / config.vehicle.max_thrust_n;
    let samples: Vec<_> = flight.samples().iter().map(|sample| sample.telemetry).collect();
    for pair in samples.windows(2).filter(|pair| pair[0].mode == Mode::Flying.code()) {
        let [before, now] = [&pair[0], &pair[1]];
        assert!(now.sticks.iter().all(|stick| stick.abs() <= 1.0));
        assert!((0.0..=1.0).contains(&now.thrust));
        // One step of the hand-over, and the change that the laws make by themselves in a flight without requests.
        let thrust = (now.thrust - before.thrust).abs();
        assert!(thrust <= slew * now.time.since(before.time).seconds() + 0.1, "{thrust}");
    }
}

#[test]
fn a_thousand_random_requests_leave_the_command_in_range_and_replay_bit_for_bit() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("flight.mcap");
    let mission = hover(100.0, &[]);
    let config = &mission.config;
    let recorder = recorder(&mission, &path);
    let mut flight =
        OnlineFlight::begin_with(&mission, Some(recorder), LawPort::default()).unwrap();
    fly_for(&mut flight, 7.0);
    flight.pause_every(Span::from_millis(50));
    let refused = send_at_random(&mut flight, 1000, directory.path());
    assert!((300..700).contains(&refused), "{refused}");
    assert_eq!(last(&flight).mode, Mode::Flying.code());
    assert_commands(&flight, config);
    assert!(flight.request(OperatorCommand::Land).unwrap());
    flight.end_after(Span::from_millis(20_000));
    assert_eq!(flight.finish().unwrap().outcome, Outcome::Landed);
    let mut histories = InputHistory::default();
    play(&RecordingFile::read(&path).unwrap(), &mut histories).unwrap();
    let histories = histories.finish();
    let result = replay(config, &RecordedWaypoints::default(), &histories[0]).unwrap();
    assert!(
        result.ticks.len() > 3000 && result.requests > 400,
        "{} {}",
        result.ticks.len(),
        result.requests
    );
    assert!(result.is_identical());
}

/// The filters of predictive laws settle after the change; without a limit their commands jump by up to the whole range.
#[test]
fn after_a_change_of_the_law_no_command_changes_faster_than_the_hand_over_allows() {
    let laws = ["oqtal", "oqtal-dt", "pid", "mpc", "geometric", "oqtal-dt", "indi", "mpc", "px4"];
    let mission = hover(120.0, &["control.controller=lqr"]);
    let slew = SlewLimits::of(&mission.config).rotation_per_s;
    let mut flight = OnlineFlight::begin(&mission).unwrap();
    fly_for(&mut flight, 8.0);
    let from = flight.samples().len();
    for law in laws.iter().cycle().take(60) {
        let before = flight.samples().len() - 1;
        let change = request(&format!("control.controller={law}"));
        assert!(is_done(&flight.change(OperatorCommand::Set, &change).unwrap().unwrap()));
        fly_for(&mut flight, 0.5);
        let ticks: Vec<_> = flight.samples()[before..].iter().map(|s| s.telemetry).collect();
        // The hand-over lasts a quarter of a second.
        for pair in ticks.windows(2).take(14) {
            let most = slew * pair[1].time.since(pair[0].time).seconds() + 1e-6;
            let change = |axis: usize| (pair[1].sticks[axis] - pair[0].sticks[axis]).abs();
            assert!((0..3).all(|axis| change(axis) <= most), "{law}: {pair:?}");
            // The whole range of the thrust is half that of a stick.
            assert!((pair[1].thrust - pair[0].thrust).abs() <= 0.5 * most, "{law}: {pair:?}");
        }
    }
    assert!(error_m(&flight, from) < 0.05, "{}", error_m(&flight, from));
    assert!(flight.request(OperatorCommand::Land).unwrap());
    assert_eq!(flight.finish().unwrap().outcome, Outcome::Landed);
}

/// Adapted gains \[-\] and lag \[s\] of the last tick.
fn adapted(flight: &OnlineFlight<'_>) -> [f64; 4] {
    let tick = last(flight);
    let [roll, pitch, _] = tick.adapted_rate_gain;
    [roll, pitch, tick.adapted_rate_lag_s, tick.adapted_thrust_gain]
}

/// A vehicle that no fixed model flies well.
const UNTOLD: [&str; 3] =
    ["plant.rate-authority-rad-s=[2.6,2.6,2.0]", "plant.rate-lag-ms=90", "plant.mass-kg=0.6"];

#[test]
fn a_gain_set_in_flight_keeps_the_adapted_model() {
    let mission = hover(20.0, &[&["control.controller=oqtal-dt"][..], &UNTOLD].concat());
    let mut flight = OnlineFlight::begin(&mission).unwrap();
    fly_for(&mut flight, 9.0);
    flight.pause_every(Span::from_millis(20));
    for set in [
        "control.predictive.position-gain-per-s=1.4",
        "control.predictive.filter.attitude-noise-deg=0.3",
        "position.tilt-limit-deg=16",
    ] {
        let before = adapted(&flight);
        assert!(before[2] > 0.06 && before[3] < 0.9, "{before:?} is adapted");
        flight.change(OperatorCommand::Set, &request(set)).unwrap().unwrap();
        fly_for(&mut flight, 0.1);
        let after = adapted(&flight);
        for (before, after) in before.into_iter().zip(after) {
            assert!((after / before - 1.0).abs() < 0.05, "{set}: {before} to {after}");
        }
    }
    assert_eq!(flight.finish().unwrap().outcome, Outcome::Landed);
}

#[test]
fn a_law_that_predicts_adapts_its_model_although_it_began_in_flight() {
    let mission = hover(30.0, &[&["control.controller=geometric"][..], &UNTOLD].concat());
    let mut flight = OnlineFlight::begin(&mission).unwrap();
    fly_for(&mut flight, 6.0);
    flight.change(OperatorCommand::Set, &request("control.controller=oqtal-dt")).unwrap().unwrap();
    fly_for(&mut flight, 12.0);
    let [.., lag_s, thrust] = adapted(&flight);
    assert!(lag_s > 0.06 && thrust < 0.9, "{lag_s} s, {thrust}");
    assert_eq!(flight.finish().unwrap().outcome, Outcome::Landed);
}
