//! Settings in flight under a fallback: it flies with the gains of the daemon's start.

use oqtal_bus::code::{HandoverCause, OperatorCommand};
use oqtal_bus::message::{ExternalV1, StateV1, TelemetryV1};
use oqtal_bus::time::Span;
use oqtal_daemon::{ExternalLaw, LawPort, LiveSettings, without_answer};
use oqtal_lab::simulation::online::OnlineFlight;
use oqtal_observe::flight::Outcome;
use oqtal_observe::summary::Summary;

use super::{fly_for, goto, hover, is_done, last, request};
use crate::external::pd::PositionPd;

/// Settings of the law and of the loops around it; the fallback is the same law.
#[test]
fn f70_a_setting_that_fails_is_not_one_of_the_fallback() {
    for (law, set) in [
        ("lqr", "control.lqr.integral-weight=1e300"),
        ("lqr", "control.lqr.attitude-weight=1e-9 control.lqr.integral-weight=0.0"),
        ("lqr", "control.predictive.command-bandwidth-rad-s=0.1"),
        ("geometric", "control.geometric.attitude-gain=1e-6"),
        ("oqtal-dt", "control.predictive.command-bandwidth-rad-s=0.1"),
    ] {
        let own = ["controller", "fallback"].map(|key| format!("control.{key}={law}"));
        let more =
            [own[0].as_str(), &own[1], "control.stack=predictive", "plant.force-n=[0.2,0,0]"];
        let mission = hover(6.0, &more);
        let mut flight = OnlineFlight::begin(&mission).unwrap();
        fly_for(&mut flight, 7.0);
        let fly = request("circle");
        flight.change(OperatorCommand::Trajectory, &fly).unwrap().unwrap();
        fly_for(&mut flight, 2.0);
        assert!(is_done(&flight.change(OperatorCommand::Set, &request(set)).unwrap().unwrap()));
        fly_for(&mut flight, 20.0);
        assert!(flight.request(OperatorCommand::Land).is_ok(), "{law}, {set}");
        flight.end_after(Span::from_millis(20_000));
        let flown = flight.finish().unwrap();
        let handovers = flown.samples.iter().map(|sample| sample.telemetry.handovers).max();
        assert_eq!(flown.outcome, Outcome::Landed, "{law}, {set}, hand-overs {handovers:?}");
    }
}

/// A law that is connected for the first and for the last of these ranges of questions.
struct Returning(u64, u64);

impl ExternalLaw for Returning {
    fn reset(&mut self) {}

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        let Self(until, from) = *self;
        Some(match state.sequence {
            sequence if sequence == until => without_answer(HandoverCause::Ended),
            sequence if sequence > until && sequence < from => {
                without_answer(HandoverCause::Absent)
            }
            _ => PositionPd::default().command(state),
        })
    }
}

#[test]
fn f70_a_law_that_is_gone_cannot_be_given_control_and_neither_can_the_next_one_by_that_request() {
    let mission = hover(20.0, &["control.controller=external", "external.return-answers=0"]);
    let law = LawPort::of(Returning(480, 720));
    let mut flight = OnlineFlight::begin_with(&mission, None, law).unwrap();
    let state = |flight: &OnlineFlight| {
        let tick = last(flight);
        (tick.fallback, HandoverCause::from_code(tick.handover_cause).unwrap())
    };
    fly_for(&mut flight, 7.5);
    assert_eq!(state(&flight), (0, HandoverCause::None));
    fly_for(&mut flight, 2.0);
    assert_eq!(state(&flight), (1, HandoverCause::Absent));
    assert!(!flight.request(OperatorCommand::Resume).unwrap(), "no law is connected");
    fly_for(&mut flight, 4.0);
    assert_eq!(state(&flight), (1, HandoverCause::Ended), "the next law waits for a request");
    assert!(flight.request(OperatorCommand::Resume).unwrap());
    fly_for(&mut flight, 1.0);
    assert_eq!(state(&flight).0, 0, "it flies");
    assert!(flight.request(OperatorCommand::Land).unwrap());
    let flown = flight.finish().unwrap();
    let samples = flown.samples.iter().map(|sample| sample.telemetry);
    let by_fallback = samples.filter(|it| it.phase == 3 && it.mode == 2 && it.fallback == 1);
    let (by_fallback, summary) = (by_fallback.count(), Summary::of(&flown));
    assert_eq!(summary.handovers.unwrap().fallback_ticks, by_fallback);
    assert_eq!(summary.answers.unwrap().unconnected, 240);
}

#[test]
fn f70_a_law_that_first_connects_in_flight_returns_like_one_that_failed() {
    for (answers, is_by_request) in [(60, false), (0, true)] {
        let returns = format!("external.return-answers={answers}");
        let mission = hover(20.0, &["control.controller=external", &returns]);
        let law = LawPort::of(Returning(0, 600));
        let mut flight = OnlineFlight::begin_with(&mission, None, law).unwrap();
        let is_absent = |it: &TelemetryV1| it.handover_cause == HandoverCause::Absent.code();
        fly_for(&mut flight, 15.0);
        let ticks: Vec<_> = flight.samples().iter().map(|sample| sample.telemetry).collect();
        let connected = ticks.iter().rposition(|it| is_absent(it) && it.fallback == 1).unwrap();
        let waited = ticks[connected..].iter().skip(1).take_while(|it| it.fallback == 1).count();
        let now = last(&flight);
        assert_eq!((now.fallback == 1, now.handovers), (is_by_request, 0));
        if is_by_request {
            assert!(waited > 120 && now.handover_cause == HandoverCause::None.code(), "{waited}");
            assert!(flight.request(OperatorCommand::Resume).unwrap());
            fly_for(&mut flight, 1.0);
            assert_eq!(last(&flight).fallback, 0, "it flies");
        } else {
            assert_eq!(waited, 59, "the law flies with the 60th good command");
        }
    }
}

/// The fallback of an external law is the control stack.
#[test]
fn f70_gains_that_are_set_do_not_change_the_fallback_of_an_external_law() {
    let mission = hover(8.0, &["control.controller=external", "plant.force-n=[0.2,0,0]"]);
    let gain = request("control.geometric.attitude-gain=30");
    let flown = |sets: bool| {
        let law = LawPort::of(Returning(0, u64::MAX));
        let mut flight = OnlineFlight::begin_with(&mission, None, law).unwrap();
        fly_for(&mut flight, 7.0);
        if sets {
            assert!(is_done(&flight.change(OperatorCommand::Set, &gain).unwrap().unwrap()));
        }
        fly_for(&mut flight, 4.0);
        flight.samples().iter().map(|sample| sample.telemetry.sticks).collect::<Vec<_>>()
    };
    assert_eq!(flown(false), flown(true));
    let settings = LiveSettings::new(&mission.config, &[]);
    let prepared = settings.prepare(OperatorCommand::Set, &gain).unwrap();
    let notes = settings.new_warnings(&prepared)();
    assert!(notes.iter().any(|note| note.contains("keeps the gains")), "{notes:?}");
}

#[test]
fn f70_a_point_at_which_the_envelope_leaves_the_law_no_room_is_answered_with_a_warning() {
    let mission = hover(8.0, &["control.controller=external"]);
    let settings = LiveSettings::new(&mission.config, &[]);
    for (height_m, notes) in [(0.2, 1), (0.5, 0)] {
        let point = goto([0.0, 0.0, height_m]);
        let prepared = settings.prepare(OperatorCommand::Goto, &point).unwrap();
        assert_eq!(settings.new_warnings(&prepared)().len(), notes, "{height_m} m");
    }
}
