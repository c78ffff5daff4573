//! Pictures of instances in terminals of several sizes, with and without colour.

use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::message::{Header, HealthV1, Stamps, TelemetryV1, VehicleV1};
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, POSE, Role, Sample};
use oqtal_observe::sink::{Reception, Sink};

use crate::draw::draw;
use crate::look::ScreenLook;
use crate::model::{MonitorModel, ShownAnswer};
use crate::picture::Picture;

const PLAIN: ScreenLook = ScreenLook { has_colour: false, has_blocks: false };
const COLOURED: ScreenLook = ScreenLook { has_colour: true, has_blocks: true };

fn at(millis: i64) -> Time {
    Time::VIRTUAL_START + Span::from_millis(millis)
}

fn reception(received_at: Time, stamps: Stamps) -> Reception {
    let header = Header { source: 4711, stamps, ..Header::default() };
    Reception { header, received_at }
}

/// A tick in flight, 0.5 m off the reference.
fn flying(now: Time) -> TelemetryV1 {
    TelemetryV1 {
        time: now,
        mission_s: 12.3,
        position: [0.5, 0.0, 1.0],
        reference_position: [0.0, 0.0, 1.0],
        thrust: 0.45,
        pose_age_s: 0.0152,
        adapted_rate_gain: [0.93, 0.91, 0.92],
        adapted_rate_lag_s: 0.0614,
        adapted_delay_s: 0.0071,
        adapted_thrust_gain: 1.04,
        adapted_thrust_lag_s: 0.052,
        mode: Mode::Flying.code(),
        fresh: 1,
        ..TelemetryV1::default()
    }
}

fn vehicle() -> VehicleV1 {
    VehicleV1 {
        battery_v: 11.43,
        link_quality: 0.98,
        armed: 1,
        link: 1,
        simulated: 1,
        ..VehicleV1::default()
    }
}

/// Stamps of a command that took effect 18 ms after its pose was captured.
fn stamps(now: Time) -> Stamps {
    let captured_at = now - Span::from_millis(18);
    Stamps {
        captured_at,
        pose_published_at: captured_at + Span::from_millis(15),
        woken_at: captured_at + Span::from_millis(16),
        computed_at: captured_at + Span::from_millis(16),
        command_published_at: captured_at + Span::from_millis(17),
        received_at: now,
        applied_at: now,
        ..Stamps::default()
    }
}

fn receive_health(model: &mut MonitorModel, role: Role, now: Time) {
    let health = HealthV1 { time: now, config_hash: 7, ..HealthV1::default() };
    model.sample(&reception(now, Stamps::default()), Sample::Health(role, &health));
}

/// A model after three seconds of flight.
fn in_flight() -> MonitorModel {
    let mut model = MonitorModel::new("lab", at(0));
    for tick in 0..180 {
        let now = at(tick * 1000 / 60);
        model.advance(now);
        for role in [Role::Daemon, Role::Plant, Role::Mocap] {
            receive_health(&mut model, role, now);
        }
        model.sample(&reception(now, Stamps::default()), Sample::Telemetry(&flying(now)));
        model.sample(&reception(now, stamps(now)), Sample::Vehicle(&vehicle()));
    }
    model
}

fn text(picture: &Picture) -> String {
    let row = |cells: &[crate::picture::Cell]| {
        cells.iter().map(|(character, _)| character).collect::<String>().trim_end().to_owned()
    };
    picture.rows().map(|cells| row(cells) + "\n").collect()
}

fn seen(model: &MonitorModel, size: (u16, u16)) -> String {
    text(&draw(model, PLAIN, size))
}

#[test]
fn a_flight_is_seen_whole_in_80_by_24() {
    let seen = seen(&in_flight(), (80, 24));
    for expected in [
        "oqtal monitor: lab",
        "state     Nominal",
        "problems  none",
        "mode      flying, mission 12.3 s",
        "simulated, answers, motors running, battery 11.4 V, link quality 98 %",
        "age 15.2 ms; lost 0, refused 0",
        "0.50 0.00 1.00 m; estimate 0.500 m from reference, max 0.500 m",
        "model     rate x 0.93, 0.91, lag 61 ms, hidden 7 ms; thrust x 1.04, lag 52 ms",
        "observed: 180 ticks, deadlines missed 0",
        "plant-sim 4711, mocap-emu 4711, daemon 4711",
        "distance [m]",
        "0.500 /0.500",
        "45.0 /100.0",
        "18.0 /18.0",
        "sensor_to_actuator    18.0",
        "vehicle_to_applied",
        "flying, Nominal",
        "q quits",
    ] {
        assert!(seen.contains(expected), "`{expected}` is missing in\n{seen}");
    }
    assert!(seen.is_ascii() && !seen.contains("not shown"), "{seen}");
    // Error and latency fill both rows of their charts; thrust, at half its range, fills one.
    assert_eq!(seen.matches("######").count(), 5, "six steps in each chart\n{seen}");
}

#[test]
fn an_instance_whose_daemon_ended_before_the_observation_has_a_problem() {
    let mut model = MonitorModel::new("lab", at(0));
    for millis in (0..=2000).step_by(500) {
        model.advance(at(millis));
        for role in [Role::Plant, Role::Mocap] {
            receive_health(&mut model, role, at(millis));
        }
    }
    let seen = seen(&model, (80, 24));
    for expected in ["state     no daemon: not started, or ended", "problems  no daemon"] {
        assert!(seen.contains(expected), "`{expected}` is missing in\n{seen}");
    }
}

#[test]
fn every_size_is_drawn_with_a_note_of_omitted_parts() {
    let model = in_flight();
    for (width, height) in (0..100).step_by(3).flat_map(|w| (0..32).map(move |h| (w, h))) {
        let seen = seen(&model, (width, height));
        if width >= 20 && height >= 4 {
            assert!(seen.contains("Nominal"), "{width} x {height}:\n{seen}");
        }
    }
    let small = seen(&model, (60, 14));
    assert!(small.contains("not shown: charts, hops (needs 80 x 24)"), "{small}");
    assert!(small.contains("flying, Nominal"), "the events are left out\n{small}");
    let tiny = seen(&model, (24, 4));
    assert!(tiny.contains("state     Nominal") && tiny.contains("q quits, S stops"), "{tiny}");
}

#[test]
fn states_are_words_and_without_colour_no_cell_has_one() {
    let mut model = in_flight();
    let now = model.instance.now + Span::from_millis(10);
    model.advance(now);
    let lost = TelemetryV1 {
        state: SafetyState::Coast.code(),
        cause: Cause::NoPose.code(),
        fresh: 0,
        ..flying(now)
    };
    model.sample(&reception(now, Stamps::default()), Sample::Telemetry(&lost));
    let seen = seen(&model, (80, 24));
    assert!(seen.contains("state     Coast: no pose"), "{seen}");
    assert!(seen.contains("3.0 flying, Coast: no pose"), "the event is missing\n{seen}");
    let has_colour = |look: ScreenLook| {
        let picture = draw(&model, look, (80, 24));
        let mut weights = picture.rows().flatten().map(|(_, weight)| look.sequence(*weight));
        weights.any(|sequence| sequence.contains(";3") || sequence.contains(";4"))
    };
    assert!(has_colour(COLOURED) && !has_colour(PLAIN));
}

#[test]
fn obstacles_to_a_take_off_are_shown() {
    let mut model = in_flight();
    let obstacles = ArmingObstacles::default().with(ArmingObstacle::Tilted, true).bits();
    let (mode, mission_s) = (Mode::Disarmed.code(), f64::NAN);
    let tick = TelemetryV1 { obstacles, mode, mission_s, ..flying(model.instance.now) };
    model.sample(&reception(model.instance.now, Stamps::default()), Sample::Telemetry(&tick));
    let seen = seen(&model, (80, 24));
    assert!(seen.contains("disarmed; no take-off: the vehicle is tilted"), "{seen}");
    assert!(seen.contains("no reference"), "{seen}");
}

#[test]
fn long_reasons_are_shown_whole() {
    let mut model = in_flight();
    let all = ArmingObstacle::all();
    let obstacles = all.fold(ArmingObstacles::default(), |all, it| all.with(it, true));
    let (mode, mission_s) = (Mode::Disarmed.code(), f64::NAN);
    let bits = obstacles.bits();
    let tick = TelemetryV1 { obstacles: bits, mode, mission_s, ..flying(model.instance.now) };
    model.sample(&reception(model.instance.now, Stamps::default()), Sample::Telemetry(&tick));
    let answer = format!("refused, {}", ArmingObstacle::Tilted).repeat(3);
    model.answer = Some(ShownAnswer::at(model.instance.now, "arm", &answer));
    let seen = seen(&model, (80, 60));
    let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    for reason in [answer, format!("no take-off: {obstacles}")] {
        assert!(words(&seen).contains(&words(&reason)), "{reason}\n{seen}");
    }
}

#[test]
fn cameras_that_do_not_answer_the_receiver_are_a_problem() {
    let mut model = in_flight();
    let (time, cause) = (model.instance.now, Cause::NoPose.code());
    let health = HealthV1 { time, cause, config_hash: 7, ..HealthV1::default() };
    model.sample(&reception(time, Stamps::default()), Sample::Health(Role::Receiver, &health));
    assert!(seen(&model, (80, 24)).contains("problems  cameras silent"));
}

#[test]
fn an_instance_that_ends_is_told_and_one_that_comes_back_is_shown_again() {
    let mut model = in_flight();
    let gone = model.instance.now + Span::from_millis(2000);
    model.advance(gone);
    let picture = seen(&model, (80, 24));
    for expected in [
        "no process runs, last tick 2 s ago: waiting for the instance",
        "daemon SILENT",
        "the instance has ended",
        "plant-sim silent, mocap-emu silent, daemon silent",
    ] {
        assert!(picture.contains(expected), "`{expected}` is missing in\n{picture}");
    }
    let back = gone + Span::from_millis(5000);
    model.advance(back);
    receive_health(&mut model, Role::Daemon, back);
    let other =
        Reception { header: Header { source: 4712, ..Header::default() }, received_at: back };
    model.sample(&other, Sample::Telemetry(&flying(back)));
    let picture = seen(&model, (100, 30));
    assert!(picture.contains("state     Nominal") && picture.contains("1 ticks"), "{picture}");
    assert!(picture.contains("daemon came, pid 4711"), "{picture}");
}

#[test]
fn an_answer_is_shown_until_another_flight_or_daemon() {
    for (source, mode) in [(4711, Mode::Flying), (4712, Mode::Disarmed)] {
        let mut model = in_flight();
        let mut tick = |seconds: i64, source, mode: Mode| {
            let now = at(3000 + 1000 * seconds);
            model.advance(now);
            if seconds == 1 {
                model.answer = Some(ShownAnswer::at(now, "land", "landing where it is"));
            }
            let reception =
                Reception { header: Header { source, ..Header::default() }, received_at: now };
            let tick = TelemetryV1 { mode: mode.code(), ..flying(now) };
            model.sample(&reception, Sample::Telemetry(&tick));
            seen(&model, (80, 24)).contains("UTC: landing where it is")
        };
        assert!(tick(1, 4711, Mode::Landing) && tick(9, 4711, Mode::Disarmed));
        assert!(!tick(10, source, mode), "{mode}");
    }
    let mut model = in_flight();
    let mut is_shown_at = |seconds: i64, mode: Mode| {
        let tick = TelemetryV1 { mode: mode.code(), ..flying(at(3000 + 1000 * seconds)) };
        model.sample(&Reception::default(), Sample::Telemetry(&tick));
        if seconds == 1 {
            model.show_answer(tick.time, "arm", "armed");
        }
        seen(&model, (80, 24)).contains("UTC: armed")
    };
    assert!(is_shown_at(1, Mode::Disarmed) && is_shown_at(9, Mode::Flying));
    assert!(is_shown_at(10, Mode::Disarmed) && !is_shown_at(11, Mode::Flying));
    // Received after the first tick of the flight.
    assert!(is_shown_at(1, Mode::Flying) && is_shown_at(2, Mode::Disarmed));
    assert!(!is_shown_at(3, Mode::Flying));
    let mut model = in_flight();
    model.keyboard.take(b":go", at(0));
    assert!(seen(&model, (80, 24)).contains("lab (Ctrl-S stops): go_"));
}

#[test]
fn an_observer_that_was_too_slow_reports_the_loss() {
    let mut model = in_flight();
    model.lost(ObservedTopic::Telemetry, POSE.quality.buffer as u64);
    let seen = seen(&model, (80, 24));
    assert!(seen.contains("1024 samples not observed"), "{seen}");
    model.instance.restart_figures();
    assert!(model.instance.figures.counters().unobserved == 0 && model.instance.max_error_m == 0.0);
}
