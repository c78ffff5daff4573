//! Tests of the flight recorder with synthetic samples.

use oqtal_bus::code::{HandoverCause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::message::{ExternalV1, Header, HealthV1, Stamps};
use oqtal_bus::origin::Origin;
use oqtal_bus::text::LongText;
use oqtal_config::Setting;
use oqtal_control::trajectory::Phase;

use super::*;
use crate::compare::Comparison;
use crate::latency::ANSWER;
use crate::summary::Summary;
use crate::{report, table};

/// Passes a tick to `recorder`, and the truth of its instant: a level vehicle at this height \[m, world z\].
fn fly(recorder: &mut Recorder, telemetry: &TelemetryV1, height_m: f64) {
    let time = telemetry.time;
    let reception = Reception { received_at: time, ..Reception::default() };
    recorder.sample(&reception, Sample::Telemetry(telemetry));
    let (position, attitude) = ([0.0, 0.0, height_m], [0.0, 0.0, 0.0, 1.0]);
    let truth = TruthV1 { time, position, attitude, ..TruthV1::default() };
    recorder.sample(&reception, Sample::Truth(&truth));
}

/// The flight of a daemon that reports `states`, one tick of 20 ms each, with truth in the first `true_ticks` of them.
fn recorded(states: &[SafetyState], true_ticks: usize) -> Recorder {
    let mut recorder = Recorder::new(&Config::default());
    for (k, state) in states.iter().enumerate() {
        let time = Time::VIRTUAL_START + Span::from_millis(20).scaled(k as f64);
        let is_stopped = *state == SafetyState::Stop;
        let mode = if is_stopped { Mode::Disarmed } else { Mode::Flying };
        let (mode, state) = (mode.code(), state.code());
        let position = [0.0, 0.0, 1.0];
        let telemetry = TelemetryV1 { time, mode, state, position, ..TelemetryV1::default() };
        if k < true_ticks {
            fly(&mut recorder, &telemetry, position[2]);
        } else {
            let reception = Reception { received_at: time, ..Reception::default() };
            recorder.sample(&reception, Sample::Telemetry(&telemetry));
        }
    }
    recorder
}

#[test]
fn a_flight_is_named_by_the_trajectory_at_the_take_off_and_the_laws_that_were_scored() {
    let mut recorder = Recorder::new(&Config::default());
    let at = |millis| Time::VIRTUAL_START + Span::from_millis(millis);
    let mut set = |received_at, number, text: &str| {
        let (command, text) =
            (OperatorCommand::Set.code(), LongText::of_lines(text.lines()).unwrap());
        let event = EventV1 { number, command, text, time: received_at, ..EventV1::default() };
        recorder.sample(&Reception { received_at, ..Reception::default() }, Sample::Event(&event));
        let mode = if number == 1 { Mode::Disarmed } else { Mode::Flying }.code();
        let scored = u8::from(number > 2);
        let tick = TelemetryV1 { time: received_at, mode, scored, ..TelemetryV1::default() };
        fly(&mut recorder, &tick, 0.0);
    };
    set(at(0), 1, "control.controller=geometric\ntrajectory.kind=circle");
    set(at(500), 2, "position.tilt-limit-deg=12");
    set(at(1000), 3, "control.controller=pid");
    set(at(1500), 4, "position.tilt-limit-deg=13");
    set(at(2000), 5, "control.controller=oqtal-dt");
    let flight = recorder.finish(Outcome::Landed, 1.0);
    let summary = Summary::of(&flight);
    assert_eq!((&*summary.controller, &*summary.trajectory), ("pid then oqtal-dt", "circle"));
    assert_eq!(summary.settings.config_hash, format!("{:016x}", flight.config_at_arming().hash()));
    assert_ne!(summary.settings.config_hash, format!("{:016x}", Config::default().hash()));
    let changed = "control.controller=geometric, trajectory.kind=circle";
    assert!(summary.settings.changed().unwrap().starts_with(changed), "{summary:?}");
    let page = report::html(&flight, &summary);
    assert!(page.contains(changed) && page.contains("controller = &quot;geometric&quot;"));
    let closing = table::closing(&summary).replace("\n   ", "");
    assert!(closing.contains(&format!("settings changed before the take-off: {changed}")));
}

#[test]
fn a_change_is_told_unless_it_is_refused_and_a_landing_after_it_was_requested() {
    let mut recorder = Recorder::new(&Config::default());
    let (planned_landing_s, mode) = (f64::INFINITY, Mode::Flying.code());
    for tick in 0..4 {
        let time = Time::VIRTUAL_START + Span::from_millis(500 * tick);
        let phase = if tick < 3 { Phase::Trajectory } else { Phase::Landing } as u8;
        let telemetry =
            TelemetryV1 { time, mode, phase, planned_landing_s, ..TelemetryV1::default() };
        fly(&mut recorder, &telemetry, if tick == 0 { 0.5 } else { 1.0 });
        let reception = Reception { received_at: time, ..Reception::default() };
        let text =
            LongText::new(&format!("control.controller=geometric\nposition.tilt-limit-deg={tick}"));
        let command = OperatorCommand::Set.code();
        let event = EventV1 { number: tick.unsigned_abs(), command, text, ..EventV1::default() };
        recorder.sample(&reception, Sample::Event(&event));
        if tick != 1 {
            let answer = Answer::Refused.code();
            recorder.sample(&reception, Sample::Event(&EventV1 { answer, ..event }));
        }
    }
    // Another daemon counts its requests from the beginning.
    let mut other = Reception::default();
    other.header.source = 7;
    let answer = Answer::Refused.code();
    recorder.sample(&other, Sample::Event(&EventV1 { number: 1, answer, ..EventV1::default() }));
    let flight = recorder.finish(Outcome::Landed, 1.0);
    let summary = Summary::of(&flight);
    assert_eq!(summary.shortfall.as_deref(), Some("landed, as requested 1.50 s after arming"));
    assert_eq!((summary.changes.len(), summary.changes[0].time_s), (1, 0.5));
    let told =
        "requests in flight: 1, the last at 0.5 s: operator: set control.controller=geometric";
    let closing = table::closing(&summary);
    assert!(closing.replace("\n   ", "").contains(told), "{closing}");
    assert!(closing.lines().all(|line| line.chars().count() <= 80), "{closing}");
    assert!(report::html(&flight, &summary).contains(told));
    let comparison = Comparison::new(vec![("a".to_owned(), flight)]).to_html();
    assert!(comparison.contains("operator: set control.controller=geometric"));
}

#[test]
fn a_course_of_an_earlier_flight_is_not_one_of_this_flight_and_settings_stay() {
    use OperatorCommand::{Goto, Hover, Set, Trajectory};
    let mut recorder = Recorder::new(&Config::default());
    let reception = Reception::default();
    let mut number = 0;
    let mut change = |recorder: &mut Recorder, command: OperatorCommand| {
        number += 1;
        let event = EventV1 { number, command: command.code(), ..EventV1::default() };
        recorder.sample(&reception, Sample::Event(&event));
    };
    for command in [Goto, Set, Trajectory, Hover] {
        change(&mut recorder, command);
    }
    for mode in [Mode::Disarmed, Mode::Flying, Mode::Flying] {
        let telemetry = TelemetryV1 { mode: mode.code(), ..TelemetryV1::default() };
        recorder.sample(&reception, Sample::Telemetry(&telemetry));
    }
    change(&mut recorder, Goto);
    let flight = recorder.finish(Outcome::Landed, 1.0);
    let commands: Vec<_> = flight.changes.iter().map(|(_, change)| change.command).collect();
    assert_eq!(commands, [Set, Goto].map(OperatorCommand::code));
}

#[test]
fn a_daemon_that_ends_in_flight_while_others_publish_has_crashed_the_vehicle() {
    let outcome = |later_ms| {
        let mut recorder = recorded(&[SafetyState::Nominal; 50], 50);
        let last = recorder.latest().unwrap().telemetry.time;
        let received_at = last + Span::from_millis(later_ms);
        let reception = Reception { received_at, ..Reception::default() };
        recorder.sample(&reception, Sample::Pose(&PoseV1::default()));
        let flight = recorder.finish(Outcome::Unfinished, 1.0);
        (flight.outcome, flight.crash.map(|(_, crash)| crash))
    };
    assert_eq!(outcome(900), (Outcome::Unfinished, None));
    assert_eq!(outcome(1100), (Outcome::Crashed, Some(Crash::DaemonDied)));
}

#[test]
fn another_configuration_is_that_of_a_daemon_that_flew() {
    let flown = |others: &[u32]| {
        let mut recorder = Recorder::new(&Config::default());
        for (process, mode) in [(1, Mode::Flying), (2, Mode::Disarmed)] {
            let source = Origin::new(0, process).bits();
            let header = Header { source, ..Header::default() };
            let reception = Reception { header, ..Reception::default() };
            let tick = TelemetryV1 { mode: mode.code(), ..TelemetryV1::default() };
            recorder.sample(&reception, Sample::Telemetry(&tick));
            let own = u64::from(others.contains(&process));
            let config_hash = Config::default().hash() + own;
            let health = HealthV1 { config_hash, ..HealthV1::default() };
            recorder.sample(&reception, Sample::Health(Role::Daemon, &health));
        }
        recorder.finish(Outcome::Crashed, 1.0).has_other_config
    };
    assert_eq!([flown(&[]), flown(&[2]), flown(&[1])], [false, false, true]);
}

#[test]
fn changes_of_a_completed_flight_stay_when_the_daemon_restarts() {
    use OperatorCommand::{Goto, Set, Trajectory};
    let mut recorder = Recorder::new(&Config::default());
    let mut second = 0;
    let mut tick = |recorder: &mut Recorder, mode: Mode, (source, command)| {
        second += 1;
        let time = Time::VIRTUAL_START + Span::from_millis(1000 * second);
        let mut reception = Reception { received_at: time, ..Reception::default() };
        reception.header.source = source;
        let telemetry = TelemetryV1 { time, mode: mode.code(), ..TelemetryV1::default() };
        recorder.sample(&reception, Sample::Telemetry(&telemetry));
        let (attitude, number) = ([0.0, 0.0, 0.0, 1.0], second.unsigned_abs());
        recorder
            .sample(&reception, Sample::Truth(&TruthV1 { time, attitude, ..TruthV1::default() }));
        let change =
            |it: OperatorCommand| EventV1 { number, command: it.code(), ..EventV1::default() };
        let event: Option<EventV1> = Option::<OperatorCommand>::map(command, change);
        event.iter().for_each(|event| recorder.sample(&reception, Sample::Event(event)));
    };
    let (old, new) = (1, 2);
    tick(&mut recorder, Mode::Flying, (old, Some(Set)));
    tick(&mut recorder, Mode::Flying, (old, Some(Goto)));
    tick(&mut recorder, Mode::Landing, (old, None));
    tick(&mut recorder, Mode::Disarmed, (old, Some(Trajectory)));
    tick(&mut recorder, Mode::Disarmed, (new, None));
    tick(&mut recorder, Mode::Flying, (new, None));
    let flight = recorder.finish(Outcome::Landed, 1.0);
    let commands: Vec<_> = flight.changes.iter().map(|(_, change)| change.command).collect();
    assert_eq!(commands, [Set, Goto].map(OperatorCommand::code));
}

/// Counts of a flight of three ticks with a tick before and one after it. The samples come tick by tick, or, as in lockstep, all ticks
/// before the other messages.
fn timed(comes_by_topic: bool) -> Flight {
    let mut recorder = Recorder::new(&Config::default());
    let modes = [Mode::Disarmed, Mode::Flying, Mode::Flying, Mode::Landing, Mode::Disarmed];
    let at = |tick: i64| Time::VIRTUAL_START + Span::from_millis(20 * tick);
    let tick = |recorder: &mut Recorder, tick: i64, mode: Mode| {
        // Every tick is late by its number, so that the distribution names the ticks it contains.
        let (time, wakeup_lateness_ns) = (at(tick), 1000 * tick);
        let telemetry =
            TelemetryV1 { time, mode: mode.code(), wakeup_lateness_ns, ..TelemetryV1::default() };
        recorder.sample(&Reception::default(), Sample::Telemetry(&telemetry));
    };
    let others = |recorder: &mut Recorder, tick: i64| {
        let (time, mut reception) = (at(tick), Reception::default());
        let answer = ExternalV1 { asked_at: time, answered_at: time, ..Default::default() };
        recorder.sample(&reception, Sample::External(&answer));
        reception.header.stamps = Stamps {
            captured_at: time,
            pose_published_at: time,
            woken_at: time,
            computed_at: time,
            command_published_at: time,
            received_at: time,
            applied_at: time,
            ..Stamps::default()
        };
        let vehicle = VehicleV1 { lost: tick.unsigned_abs(), ..VehicleV1::default() };
        recorder.sample(&reception, Sample::Vehicle(&vehicle));
    };
    for (number, mode) in (1..).zip(modes) {
        tick(&mut recorder, number, mode);
        if !comes_by_topic {
            others(&mut recorder, number);
        }
    }
    (1..=5).filter(|_| comes_by_topic).for_each(|number| others(&mut recorder, number));
    recorder.finish(Outcome::Landed, 1.0)
}

#[test]
fn timing_and_hops_count_from_arming_to_disarming() {
    for flight in [false, true].map(timed) {
        let lateness = flight.wakeup_lateness.summary();
        assert_eq!((lateness.count, lateness.min_ns / 1000, lateness.max_ns / 1000), (3, 2, 4));
        assert_eq!(flight.period_jitter.count(), 2, "the two periods between three ticks");
        let hops: Vec<_> = flight.hops.iter().map(|(name, hop)| (name, hop.count())).collect();
        assert!(hops.iter().all(|(_, count)| *count == 3), "{hops:?}");
        assert!(hops.iter().any(|(name, _)| *name == ANSWER), "{hops:?}");
        assert_eq!(flight.applied.len(), 5, "every applied command is recorded");
        assert_eq!(flight.commands_lost, 3);
    }
}

#[test]
fn answers_that_are_not_in_time_are_counted_and_have_no_time() {
    let settings = [Setting::flag("test", "control.controller", "external")];
    let mut recorder = Recorder::new(&Config::from_settings(&settings).unwrap());
    let telemetry = TelemetryV1 { mode: Mode::Flying.code(), ..TelemetryV1::default() };
    recorder.sample(&Reception::default(), Sample::Telemetry(&telemetry));
    let asked_at = Time::VIRTUAL_START;
    let answered_at = asked_at + Span::from_millis(3);
    let good = ExternalV1 { sequence: 1, question: 1, asked_at, answered_at, ..Default::default() };
    let none = ExternalV1 { sequence: 0, question: 2, answered_at: Time::UNSET, ..good };
    // The answer to the second question, received with the third.
    let late = ExternalV1 { sequence: 2, question: 3, answered_at: asked_at, ..good };
    // Received just after the deadline of its own question.
    let verdict = HandoverCause::Missing.code();
    let just_late = ExternalV1 { sequence: 4, question: 4, verdict, ..good };
    let verdict = HandoverCause::Absent.code();
    let absent = ExternalV1 { question: 5, verdict, ..none };
    // Received after the tick that ended the flight.
    let time = asked_at + Span::from_millis(20);
    let disarmed = TelemetryV1 { time, ..TelemetryV1::default() };
    recorder.sample(&Reception::default(), Sample::Telemetry(&disarmed));
    for answer in [good, none, late, just_late, absent] {
        recorder.sample(&Reception::default(), Sample::External(&answer));
    }
    let flight = recorder.finish(Outcome::Landed, 1.0);
    let summary = Summary::of(&flight);
    let hop = summary.hops[ANSWER];
    assert_eq!((hop.count, hop.min_ns), (1, 3_000_000));
    let told = "4 of 5 questions had no answer in time, 1 because no law was connected";
    assert!(table::closing(&summary).contains(&format!("\nanswers: {told}")));
    assert!(report::html(&flight, &summary).contains(told));
}

#[test]
fn a_stop_that_is_in_force_when_a_recording_begins_is_of_an_earlier_flight() {
    let (stopped, flown) = ([SafetyState::Stop; 50], [SafetyState::Nominal; 50]);
    let later = [&stopped[..], &flown].concat();
    assert_eq!(recorded(&later, 100).outcome(), None);
    let ended = [&later[..], &stopped].concat();
    assert_eq!(recorded(&ended, 150).outcome(), Some(Outcome::Stopped));
    let twice = recorded(&[&ended[..], &ended].concat(), 300).finish(Outcome::Timeout, 1.0);
    let Summary { shortfall, duration_s, .. } = Summary::of(&twice);
    assert!((duration_s - 1.96).abs() < 1e-9, "{duration_s}");
    assert!(shortfall.as_ref().is_some_and(|it| it.starts_with("2 flights")), "{shortfall:?}");
    let called_off = [&flown[..1], &stopped].concat();
    assert_eq!(recorded(&called_off, 51).outcome(), Some(Outcome::Stopped));
}

#[test]
fn a_stop_before_the_take_off_is_not_the_end_of_the_flight() {
    let mut recorder = Recorder::new(&Config::default());
    let (waits, flies) =
        ((Mode::Disarmed, SafetyState::Nominal), (Mode::Flying, SafetyState::Nominal));
    let ticks = [waits, (Mode::Disarmed, SafetyState::Stop), flies, flies, flies, flies];
    let mut time = Time::VIRTUAL_START;
    for (mode, state) in ticks {
        time = time + Span::from_millis(600);
        let (mode, state) = (mode.code(), state.code());
        let telemetry = TelemetryV1 { time, mode, state, ..TelemetryV1::default() };
        recorder.sample(&Reception::default(), Sample::Telemetry(&telemetry));
    }
    assert_eq!(recorder.finish(Outcome::Unfinished, 1.0).outcome, Outcome::Unfinished);
}

#[test]
fn a_flight_whose_truth_ends_ends_as_the_daemon_reports() {
    let flown = [SafetyState::Nominal; 50];
    let ended = [SafetyState::Coast; 25];
    let stopped = [SafetyState::Stop; 50];
    let states = [&flown[..], &ended, &stopped].concat();
    assert_eq!(recorded(&states, 50).outcome(), Some(Outcome::Stopped));
    assert_eq!(recorded(&states[..75], 50).outcome(), None, "the daemon has not stopped yet");
    let flight = recorded(&states, 50).finish(Outcome::Timeout, 1.0);
    let coasted = flight.samples.iter().any(|sample| sample.telemetry.state == 2);
    assert!(coasted, "the states after the end of the truth are recorded");
}

#[test]
fn an_observation_is_neither_a_crash_nor_a_flight_whatever_the_vehicle_does() {
    let setting = Setting::parse("test", "safety.observe-only=true").unwrap();
    let config = Config::parse("test", "", &[setting]).unwrap();
    let mut recorder = Recorder::new(&config);
    for k in 0..150 {
        let time = Time::VIRTUAL_START + Span::from_millis(20).scaled(f64::from(k));
        let mut reception = Reception { received_at: time, ..Reception::default() };
        // Another daemon continues the observation.
        reception.header.source = u64::from(k > 100);
        let (mode, phase) = (Mode::Observing.code(), Phase::Trajectory as u8);
        let telemetry = TelemetryV1 { time, mode, phase, ..TelemetryV1::default() };
        recorder.sample(&reception, Sample::Telemetry(&telemetry));
        // The vehicle falls, and lies upside down on the floor.
        let (velocity, attitude) =
            ([0.0, 0.0, if k < 50 { -5.0 } else { 0.0 }], [1.0, 0.0, 0.0, 0.0]);
        let truth = TruthV1 { time, velocity, attitude, ..TruthV1::default() };
        recorder.sample(&reception, Sample::Truth(&truth));
        let vehicle = VehicleV1::default();
        reception.header.stamps.applied_at = time;
        recorder.sample(&reception, Sample::Vehicle(&vehicle));
    }
    assert_eq!(recorder.outcome(), None);
    let flight = recorder.finish(Outcome::Observed, 1.0);
    let summary = Summary::of(&flight);
    assert_eq!(
        (summary.shortfall.as_deref(), summary.outcome.to_string()),
        (None, "observed".to_owned())
    );
    assert!(summary.hops.values().all(|hop| hop.count == 0), "commands that were not sent");
    let (page, closing) = (report::html(&flight, &summary), table::closing(&summary));
    assert!(page.contains("Command (computed, not sent)") && !page.contains("Attitude sent"));
    assert!(page.contains("observation") && closing.contains("s observed"), "{closing}");
}

#[test]
fn a_single_scored_tick_has_no_figures() {
    let figures = |scored: [u8; 3]| {
        let mut recorder = Recorder::new(&Config::default());
        for (tick, scored) in (1..).zip(scored) {
            let time = Time::VIRTUAL_START + Span::from_millis(20).scaled(tick as f64);
            let mode = Mode::Flying.code();
            let telemetry = TelemetryV1 { time, tick, mode, scored, ..TelemetryV1::default() };
            fly(&mut recorder, &telemetry, 0.0);
        }
        Summary::of(&recorder.finish(Outcome::Landed, 1.0)).position_error_m
    };
    assert!(figures([0, 1, 0]).is_none() && figures([0, 1, 1]).is_some());
}
