//! Tests of the hand-off of requests.

use super::*;
use oqtal_bus::code::{HandoverCause, SafetyState};
use oqtal_bus::obstacle::{ArmingObstacle, ArmingObstacles};
use oqtal_config::{Config, Setting};

use crate::setpoint::SetpointRefusal;

fn asks(command: OperatorCommand) -> ControlRequestV1 {
    ControlRequestV1::of(command)
}

fn answers(answer: Answer) -> ControlResponseV1 {
    ControlResponseV1 { answer: answer.code(), ..ControlResponseV1::default() }
}

#[test]
fn no_operator_gets_the_reply_to_the_request_of_another() {
    let (mut handle, mut requests) = loop_handoff();
    requests.last.mode = Mode::Flying.code();
    // The loop stands still: the first operator gets no reply from it.
    let first = requests.ask(asks(OperatorCommand::Status), &mut |_| {});
    assert_eq!(first.answer, Answer::Accepted.code());
    let second = std::thread::spawn(move || requests.ask(asks(OperatorCommand::Land), &mut |_| {}));
    assert!(handle.poll_request(|_| answers(Answer::Refused)).is_some());
    // The loop runs again once the second request is there, too.
    let land = |request: &mut LoopRequest| {
        assert_eq!(request.name().0, OperatorCommand::Land);
        answers(Answer::Done)
    };
    while handle.poll_request(land).is_none() {
        std::thread::yield_now();
    }
    let second = second.join().unwrap().answer;
    // Accepted: this machine took longer for the above than an operator waits.
    assert!([Answer::Done, Answer::Accepted].map(Answer::code).contains(&second));
}

#[test]
fn a_request_to_fly_expires_and_a_stop_does_not() {
    let (mut handle, requests) = loop_handoff();
    let long_ago = Time::now();
    for (command, is_executed) in [
        (OperatorCommand::Arm, false),
        (OperatorCommand::Fly, false),
        (OperatorCommand::Land, true),
        (OperatorCommand::Stop, true),
    ] {
        let validity = Validity { asked_at: Time::UNSET, until: long_ago, is_repeated: false };
        requests.queues.send((0, LoopRequest::Operator { command, event: 0 }, validity)).unwrap();
        let mut executed = false;
        while Time::now() == long_ago {}
        let asked = handle.poll_request(|asked| {
            executed |= asked.name().0 == command;
            answers(Answer::Done)
        });
        assert_eq!(asked.map(|(command, ..)| command), Some(command));
        let (_, response, _) = requests.queues.replies().recv().unwrap();
        assert_eq!(executed, is_executed, "{command}");
        let is_refused = response.cause == Cause::Expired.code();
        assert_eq!(is_refused, !is_executed, "{command}");
    }
}

#[test]
fn the_event_of_a_refusal_names_the_obstacles() {
    let obstacles = ArmingObstacles::from_bits(u32::MAX);
    let reply = ControlResponseV1 { obstacles: u32::MAX, ..answers(Answer::Refused) };
    let refusal = |cause| refused_event(EventV1::default(), &refused(cause, reply)).reason;
    assert!(obstacles.to_string().starts_with(refusal(Cause::NotReady).as_str()));
    assert!(!refusal(Cause::NotReady).is_empty());
    assert!(refusal(Cause::OtherConfig).is_empty());
}

#[test]
fn a_request_to_fly_with_another_configuration_is_refused() {
    let (_handle, requests) = loop_handoff();
    let mut requests = OperatorRequests { config_hash: 7, ..requests };
    let request = ControlRequestV1 { config_hash: 8, ..asks(OperatorCommand::Arm) };
    let mut events = Vec::new();
    let response = requests.ask(request, &mut |event| events.push((event.answer, event.cause)));
    assert_eq!((response.answer, response.config_hash), (Answer::Refused.code(), 7));
    assert_eq!(response.cause, Cause::OtherConfig.code());
    assert_eq!(events, [(Answer::Refused.code(), Cause::OtherConfig.code())], "recorded");
    for config_hash in [0, 7] {
        let response = requests.ask(ControlRequestV1 { config_hash, ..request }, &mut |_| {});
        assert_eq!(response.answer, Answer::Accepted.code());
    }
    let stop = requests
        .ask(ControlRequestV1 { config_hash: 8, ..asks(OperatorCommand::Stop) }, &mut |_| {});
    assert_eq!(stop.answer, Answer::Accepted.code());
}

#[test]
fn changes_that_found_the_queue_full_are_counted_in_the_next_one() {
    let (mut handle, mut requests) = loop_handoff();
    let condition = |mode| Condition { mode, ..Condition::default() };
    let mut mode = 0;
    let mut publish = |handle: &mut LoopHandle| {
        mode = 1 - mode;
        handle.publish_status(condition(mode));
    };
    while handle.queues.dropped_notes() < 3 {
        publish(&mut handle);
    }
    requests.take_changes();
    assert_eq!(requests.last.unlogged, 0);
    publish(&mut handle);
    requests.take_changes();
    assert_eq!(requests.last.unlogged, 3);
}

#[test]
fn those_who_come_later_are_told_what_flies_and_what_was_changed() {
    let (mut handle, requests) = loop_handoff();
    let settings = LiveSettings::new(&Config::default(), &[]);
    let mut requests = requests.with_settings(7, settings);
    requests.last.mode = Mode::Flying.code();
    let mut events = Vec::new();
    let mut ask = |command: OperatorCommand, text: &str| {
        let request = ControlRequestV1 { text: LongText::new(text), ..asks(command) };
        let response = requests.ask(request, &mut |event| events.push(event));
        handle.poll_request(|_| answers(Answer::Done));
        response.text.as_str().to_owned()
    };
    assert_eq!(ask(OperatorCommand::Get, ""), "law oqtal, trajectory square");
    ask(OperatorCommand::Set, "trajectory.kind=hover");
    assert!(ask(OperatorCommand::Status, "").ends_with(", trajectory square"));
    ask(OperatorCommand::Undo, "");
    ask(OperatorCommand::Set, "control.controller=geometric");
    ask(OperatorCommand::Trajectory, "circle");
    let told = ask(OperatorCommand::Get, "");
    assert!(told.starts_with("law geometric, trajectory circle\n"), "{told}");
    assert!(told.ends_with("\ncontrol.controller=\"geometric\""), "{told}");
    ask(OperatorCommand::Arm, "");
    assert!(ask(OperatorCommand::Status, "").starts_with("law geometric, trajectory square"));
    ask(OperatorCommand::Undo, "");
    let told = |event: &EventV1| (event.command, event.text.as_str().to_owned());
    let [.., armed, undone] = &events[..] else { panic!("{events:?}") };
    assert_eq!(armed.command, OperatorCommand::Arm.code());
    assert!(armed.text.as_str().ends_with("\ncontrol.controller=\"geometric\""), "{armed:?}");
    let undo = (OperatorCommand::Undo.code(), "control.controller=\"oqtal\"".to_owned());
    assert_eq!(told(undone), undo);
}

#[test]
fn a_setting_that_has_its_value_already_is_not_a_change() {
    let (mut handle, requests) = loop_handoff();
    let mut requests = requests.with_settings(7, LiveSettings::new(&Config::default(), &[]));
    let mut events = Vec::new();
    let text = LongText::new("control.controller=oqtal");
    let request = ControlRequestV1 { text, ..asks(OperatorCommand::Set) };
    let response = requests.ask(request, &mut |event| events.push(event));
    assert_eq!(response.answer, Answer::Done.code());
    assert!(response.text.as_str().starts_with("nothing changes"), "{response:?}");
    assert!(events.is_empty() && handle.poll_request(|_| answers(Answer::Done)).is_none());
}

#[test]
fn changed_settings_that_do_not_fit_into_an_answer_are_counted() {
    let (_, requests) = loop_handoff();
    let mut settings = LiveSettings::new(&Config::default(), &[]);
    let is_changed = |key: &str| {
        ["position.", "reference.", "control.indi.", "control.lqr."]
            .iter()
            .any(|it| key.starts_with(it))
    };
    let numbers = Config::default().comparable_values().into_iter().filter_map(|(key, value)| {
        let number = value.parse::<f64>().ok().filter(|_| is_changed(&key))?;
        Some(format!("{key}={}", 0.987_654_321 * number))
    });
    let changes: Vec<_> = numbers.collect();
    for change in &changes {
        let request =
            ControlRequestV1 { text: LongText::new(change), ..asks(OperatorCommand::Set) };
        if let Ok(mut prepared) = settings.prepare(OperatorCommand::Set, &request) {
            settings.commit(&mut prepared);
        }
    }
    let mut requests = requests.with_settings(7, settings);
    let response = requests.ask(asks(OperatorCommand::Get), &mut |_| {});
    let lines: Vec<_> = response.text.as_str().lines().collect();
    assert!(lines.len() > 10 && lines.last().unwrap().ends_with(" more"), "{lines:?}");
}

#[test]
fn on_the_ground_the_next_flight_is_reported_and_not_the_course_of_the_last() {
    let (_, requests) = loop_handoff();
    let mut requests = requests.with_settings(7, LiveSettings::new(&Config::default(), &[]));
    requests.course = Some("trajectory circle".to_owned());
    for (mode, course) in [
        (Mode::Flying, "trajectory circle"),
        (Mode::Landing, "landing"),
        (Mode::Disarmed, "trajectory square"),
    ] {
        requests.last.mode = mode.code();
        let response = requests.ask(asks(OperatorCommand::Get), &mut |_| {});
        assert_eq!(response.text.as_str(), format!("law oqtal, {course}"));
    }
    requests.warning = Some("poses arrive at 100 Hz".to_owned());
    let response = requests.ask(asks(OperatorCommand::Get), &mut |_| {});
    assert!(response.text.as_str().ends_with("square; poses arrive at 100 Hz"), "{response:?}");
    let settings = Setting::parse("test", "control.fallback=geometric").unwrap();
    let config = Config::from_settings(&[settings]).unwrap();
    let mut requests = requests.with_settings(7, LiveSettings::new(&config, &[]));
    (requests.last.mode, requests.last.cause) = (Mode::Flying.code(), Cause::Fallback.code());
    requests.last.handover_cause = HandoverCause::Tilt.code();
    let response = requests.ask(asks(OperatorCommand::Get), &mut |_| {});
    let law = "law geometric in place of oqtal (leads to too much tilt), ";
    assert!(response.text.as_str().starts_with(law), "{response:?}");
}

#[test]
fn f70_that_no_external_law_is_connected_is_told_before_the_flight_and_what_flies_during_it() {
    let (mut handle, requests) = loop_handoff();
    let settings = Setting::parse("test", "control.controller=external").unwrap();
    let config = Config::from_settings(&[settings]).unwrap();
    let mut requests = requests.with_settings(7, LiveSettings::new(&config, &[]));
    let told = |requests: &mut OperatorRequests| {
        let text = requests.ask(asks(OperatorCommand::Get), &mut |_| {}).text;
        text.as_str().split(", ").next().unwrap().to_owned()
    };
    (requests.lacks_law, requests.last.is_fallback) = (true, true);
    let awaited = "law external (no law is connected; geometric flies until one is)";
    assert_eq!(told(&mut requests), awaited);
    let mut events = Vec::new();
    let armed = requests.ask(asks(OperatorCommand::Arm), &mut |event| events.push(event));
    handle.poll_request(|_| answers(Answer::Done));
    assert_eq!(armed.text.as_str(), awaited);
    assert!(events[0].text.is_empty(), "only settings are recorded");
    requests.last.mode = Mode::Flying.code();
    assert_eq!(told(&mut requests), "law geometric in place of external (no law is connected)");
    requests.lacks_law = false;
    assert_eq!(told(&mut requests), "law geometric in place of external (take-off)");
    requests.last.handover_cause = HandoverCause::Absent.code();
    let waits = "law geometric in place of external (the law waits for its return)";
    assert_eq!(told(&mut requests), waits);
    requests.last.handover_cause = HandoverCause::None.code();
    requests.last.cause = Cause::Fallback.code();
    assert_eq!(told(&mut requests), waits);
    requests.last.cause = Cause::None.code();
    requests.last.state = SafetyState::Hold.code();
    assert_eq!(told(&mut requests), "law geometric in place of external (Hold)");
    (requests.last.is_fallback, requests.last.state) = (false, SafetyState::Nominal.code());
    assert_eq!(told(&mut requests), "law external");
    (requests.last.is_fallback, requests.last.mode) = (true, Mode::Landing.code());
    assert_eq!(told(&mut requests), "law geometric in place of external (landing)");
}

#[test]
fn a_request_that_ends_flights_calls_off_those_requested_before_it() {
    for ending in [OperatorCommand::Stop, OperatorCommand::Land, OperatorCommand::Disarm] {
        let (mut handle, requests) = loop_handoff();
        let before = Time::now();
        let mut asked = |command: OperatorCommand, asked_at: Time| {
            let validity = Validity { asked_at, until: Time::UNSET, is_repeated: false };
            let request = LoopRequest::Operator { command, event: 0 };
            requests.queues.send((0, request, validity)).unwrap();
            let (_, _, response) = handle.poll_request(|_| answers(Answer::Done)).unwrap();
            requests.queues.replies().recv().unwrap();
            response.cause
        };
        while Time::now() == before {}
        asked(ending, Time::now());
        assert_eq!(asked(OperatorCommand::Arm, before), Cause::CalledOff.code(), "{ending}");
        assert_eq!(asked(OperatorCommand::Arm, Time::now()), Cause::None.code(), "{ending}");
    }
}

#[test]
fn a_landing_succeeds_if_it_calls_off_a_flight_that_waits_for_the_vehicle_to_be_at_rest() {
    let (mut handle, requests) = loop_handoff();
    let obstacles = ArmingObstacles::default().with(ArmingObstacle::Moving, true).bits();
    let stopped = SafetyState::Stop.code();
    let mut asked = |command: OperatorCommand, is_repeated, millis| {
        let asked_at = Time::VIRTUAL_START + oqtal_bus::time::Span::from_millis(millis);
        let validity = Validity { asked_at, until: Time::UNSET, is_repeated };
        requests.queues.send((0, LoopRequest::Operator { command, event: 0 }, validity)).unwrap();
        let (_, _, response) = handle
            .poll_request(|request| match request.name().0 {
                OperatorCommand::Status => answers(Answer::Done),
                _ => ControlResponseV1 { obstacles, state: stopped, ..answers(Answer::Refused) },
            })
            .unwrap();
        requests.queues.replies().recv().unwrap();
        response.answer
    };
    use OperatorCommand::{Arm, Land};
    assert_eq!(asked(Land, false, 0), Answer::Refused.code());
    assert_eq!(asked(Arm, true, 1), Answer::Refused.code());
    assert_eq!(asked(Land, false, 2), Answer::Done.code());
    assert_eq!(asked(Land, false, 2), Answer::Done.code(), "repeated: the first reply was lost");
    assert_eq!(asked(Land, false, 3), Answer::Refused.code());
    // There is nothing to call off once nobody repeats the request.
    for is_repeated in [true, false] {
        assert_eq!(asked(Arm, is_repeated, 4), Answer::Refused.code());
    }
    assert_eq!(asked(Land, false, 5), Answer::Refused.code());
}

#[test]
fn the_newest_reason_of_a_refused_reference_is_reported() {
    let (mut handle, mut requests) = loop_handoff();
    let (cause, mode) = (Cause::Setpoint.code(), Mode::Flying.code());
    let condition = Condition { cause, mode, ..Condition::default() };
    let [fast, unknown] = ["too fast", "of an unknown kind"].map(SetpointRefusal::Invalid);
    let mut publish = |refusal: Option<SetpointRefusal>, followed| {
        handle.publish_status(Condition { refusal, followed, ..condition });
        requests.take_changes();
        requests.last.refusal().map(|refusal| refusal.to_string())
    };
    assert_eq!(publish(Some(fast), Followed::Planner).as_deref(), Some("too fast"));
    // The stream ends in a tick without a refusal.
    assert_eq!(publish(None, Followed::Ended).as_deref(), Some("too fast"));
    assert_eq!(publish(Some(unknown), Followed::Ended).as_deref(), Some("of an unknown kind"));
}

#[test]
fn a_status_names_the_newest_value_beyond_a_limit_and_the_log_its_first() {
    let (mut handle, mut requests) = loop_handoff();
    let (cause, mode) = (Cause::Setpoint.code(), Mode::Flying.code());
    let mut tick = |value: Option<f64>, is_asked: bool| {
        let limit = ("reference.speed-limit-m-s", 2.5);
        let quantity = ["speed", "m/s"];
        let refusal = value.map(|value| SetpointRefusal::Beyond { quantity, value, limit });
        handle.publish_status(Condition { cause, mode, refusal, ..Condition::default() });
        if is_asked {
            let request = asks(OperatorCommand::Status);
            let name = LoopRequest::Operator { command: OperatorCommand::Status, event: 0 };
            requests.queues.send((0, name, Validity::of(&request))).unwrap();
            handle.poll_request(|_| answers(Answer::Done)).unwrap();
            requests.queues.replies().recv().unwrap();
        }
        let before = requests.last;
        requests.take_changes();
        let told = requests.last.refusal().map(|refusal| refusal.to_string());
        (told.unwrap_or_default(), requests.last.is_logged_after(&before))
    };
    let text = |value| format!("speed {value} m/s exceeds reference.speed-limit-m-s = 2.5");
    assert_eq!(tick(Some(9.0), false), (text("9.00"), true));
    assert_eq!(tick(Some(8.0), false), (text("9.00"), false), "no flood of the queue");
    assert_eq!(tick(Some(3.0), true), (text("3.00"), false));
    assert_eq!(tick(Some(4.0), false), (text("3.00"), false));
    assert_eq!(tick(None, true), (text("4.00"), false), "it stays while its warning does");
}

#[test]
fn a_change_of_gains_that_do_not_fly_is_answered_with_a_warning() {
    let (_handle, requests) = loop_handoff();
    let settings = [Setting::parse("test", "control.controller=oqtal-dt").unwrap()];
    let config = Config::from_settings(&settings).unwrap();
    let mut requests = requests.with_settings(7, LiveSettings::new(&config, &[]));
    let mut set = |text: &str| {
        let request = ControlRequestV1 { text: LongText::new(text), ..asks(OperatorCommand::Set) };
        requests.ask(request, &mut |_| {}).text.as_str().to_owned()
    };
    let told = set("position.horizontal-position.kp=2.4");
    assert!(told.contains("\nwarning: position.horizontal-position: these loops"), "{told}");
    let told = set("position.tilt-limit-deg=20");
    assert!(!told.contains("warning"), "{told}");
}

#[test]
fn a_request_that_needs_a_flight_is_refused_without_one_also_while_the_loop_stands_still() {
    use OperatorCommand::{Goto, Hover, Land, Resume, Set, Stop, Trajectory};
    let (_handle, requests) = loop_handoff();
    let mut requests = requests.with_settings(7, LiveSettings::new(&Config::default(), &[]));
    let answer = |requests: &mut OperatorRequests, command| {
        let text = match command {
            Trajectory => "circle",
            Set => "position.tilt-limit-deg=20",
            _ => "",
        };
        let request =
            ControlRequestV1 { point: [0.0, 0.0, 1.0], text: LongText::new(text), ..asks(command) };
        requests.ask(request, &mut |_| {}).answer
    };
    let [accepted, refused] = [Answer::Accepted, Answer::Refused].map(Answer::code);
    for command in [Goto, Trajectory, Hover, Resume, Land] {
        assert_eq!(answer(&mut requests, command), refused, "{command}");
    }
    for command in [Set, Stop] {
        assert_eq!(answer(&mut requests, command), accepted, "{command}");
    }
    requests.last.first_flight = FirstFlight::Expected;
    assert_eq!(answer(&mut requests, Land), accepted, "calls off the expected flight");
    requests.last.first_flight = FirstFlight::Pending;
    let status = requests.ask(asks(OperatorCommand::Status), &mut |_| {}).text;
    assert!(status.as_str().contains("\nan automatic flight begins"), "{status:?}");
}
