//! Events of a flight as text, for recordings, the terminal, the browser page and the report.

use std::fmt;

use oqtal_bus::code::{
    Answer, Cause, HandoverCause, InputKind, Mode, OperatorCommand, SafetyState,
};
use oqtal_bus::message::{EventV1, InputV1, TelemetryV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use serde::Serialize;

use crate::flight::{Flight, FlightSample};

/// Maximum time between a request and its reception by an observer in real time.
const RECEIVED_WITHIN: Span = Span::from_millis(2000);
/// Maximum delay between the end of a flight and the recording of the request that ended it.
const RECORDED_WITHIN: Span = Span::from_millis(100);

/// Mode, safety state and cause of the daemon in a tick, and whether it uses the configured model instead of the adapted one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DaemonCondition {
    mode: u8,
    state: u8,
    cause: u8,
    fell_back: u8,
}

impl DaemonCondition {
    /// The condition in a tick.
    pub fn of(telemetry: &TelemetryV1) -> Self {
        let TelemetryV1 { mode, state, cause, fell_back, .. } = *telemetry;
        Self { mode, state, cause, fell_back }
    }

    /// The safety state; `None` for an unknown code.
    pub fn state(self) -> Option<SafetyState> {
        SafetyState::from_code(self.state)
    }

    /// The mode as text.
    pub fn mode_text(self) -> String {
        word(Mode::from_code(self.mode))
    }

    /// State and cause as text.
    pub fn state_text(self) -> String {
        let state = word(self.state());
        match Cause::from_code(self.cause) {
            Some(Cause::None) => state,
            cause => format!("{state}: {}", word(cause)),
        }
    }

    /// Whether the configured model is used because the adapted one predicts worse.
    pub fn fell_back(self) -> bool {
        self.fell_back != 0
    }

    /// Name of the model in use.
    pub fn model_text(self) -> &'static str {
        match self.fell_back() {
            false => "adapted model",
            true => "configured model, since the adapted one predicts worse",
        }
    }
}

impl fmt::Display for DaemonCondition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}", self.mode_text(), self.state_text())?;
        if self.fell_back() {
            write!(f, "; {}", self.model_text())?;
        }
        Ok(())
    }
}

/// Request during a flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChangeInFlight {
    /// Instant, from arming \[s\].
    pub time_s: f64,
    /// The request and its author.
    pub text: String,
    /// Whether it changed the course.
    #[serde(skip)]
    pub changes_course: bool,
    /// Whether no request changed the course of at least one of the flights.
    #[serde(skip)]
    pub leaves_a_flight: bool,
}

impl fmt::Display for ChangeInFlight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} s: {}", self.time_s, self.text)
    }
}

impl ChangeInFlight {
    /// The changes between the take-off of `flight` and its end, in order.
    pub fn all(flight: &Flight) -> Vec<Self> {
        let origin = flight.origin();
        let extents: Vec<[Time; 2]> = flight.flights().map(recorded_span).collect();
        let begins = |event: &EventV1| {
            OperatorCommand::from_code(event.command).is_some_and(OperatorCommand::begins_flight)
        };
        let is_in_flight = |(at, event): &&(Time, EventV1)| {
            extents.iter().any(|[begin, end]| at > begin && at <= end)
                && !begins(event)
                && !is_list(event)
        };
        let leaves_a_flight = leaves_a_flight(flight);
        let all = flight.changes.iter().filter(is_in_flight).map(|(at, event)| Self {
            time_s: at.since(origin).seconds(),
            text: of_operator(event),
            changes_course: changes_course(event),
            leaves_a_flight,
        });
        all.collect()
    }
}

/// Whether an event repeats the settings that were changed earlier, for a recording that begins later: a title and a list.
fn is_list(event: &EventV1) -> bool {
    event.command == OperatorCommand::Set.code()
        && !event.text.as_str().lines().next().unwrap_or_default().contains('=')
}

/// Whether no request changed the course of at least one of the flights.
fn leaves_a_flight(flight: &Flight) -> bool {
    flight.flights().map(recorded_span).any(|[begin, end]| {
        let during = flight.changes.iter().filter(|(at, _)| *at > begin && *at <= end);
        !during.into_iter().any(|(_, event)| changes_course(event))
    })
}

/// First and last instant at which a request counts as made in this flight; the request that ends it is recorded after the last tick.
fn recorded_span(ticks: &[FlightSample]) -> [Time; 2] {
    let [first, last] = [&ticks[0], &ticks[ticks.len() - 1]].map(|tick| tick.telemetry.time);
    [first, last + RECORDED_WITHIN]
}

/// Whether the request changes the course of the current flight only, and no settings.
pub(crate) fn changes_course(event: &EventV1) -> bool {
    use OperatorCommand::{Goto, Hover, Trajectory};
    matches!(OperatorCommand::from_code(event.command), Some(Goto | Hover | Trajectory))
}

/// Whether the request changes settings, or reports that such a request was refused.
pub(crate) fn changes_settings(event: &EventV1) -> bool {
    use OperatorCommand::{Reload, Set, Undo};
    matches!(OperatorCommand::from_code(event.command), Some(Set | Undo | Reload))
}

/// Keys of the settings that the request changes.
pub(crate) fn changed_keys(event: &EventV1) -> impl Iterator<Item = &str> {
    let lines = event.text.as_str().lines();
    lines.filter_map(|line| match line.split_once('=') {
        Some((key, _)) => Some(key),
        None => line.strip_suffix(" unset"),
    })
}

/// Instant at which a request received at `received_at` was made; `None` in virtual time, whose instants are not those of the machine's
/// clock.
pub fn made_at(received_at: Time, event: &EventV1) -> Option<Time> {
    let passed = received_at.since(event.time);
    let is_recent = event.time.is_set() && (Span::ZERO..=RECEIVED_WITHIN).contains(&passed);
    is_recent.then_some(event.time)
}

/// Text of a request that changes a flight or its settings, with its author and, if it was refused, the reason.
pub fn of_operator(event: &EventV1) -> String {
    let EventV1 { text, point: [x, y, z], yaw, .. } = event;
    let command = OperatorCommand::from_code(event.command);
    let what = match command {
        Some(OperatorCommand::Goto) if yaw.is_nan() => format!("{x:.2} {y:.2} {z:.2}"),
        Some(OperatorCommand::Goto) => {
            format!("{x:.2} {y:.2} {z:.2} {:.0}°", yaw.to_degrees())
        }
        _ => text.as_str().replace('\n', " "),
    };
    let said = format!("operator: {} {what}", word(command)).trim_end().to_owned();
    let said = format!("{said} ({})", event.author());
    event.refusal().map_or_else(|| said.clone(), |refusal| format!("{said}: {refusal}"))
}

fn word(code: Option<impl ToString>) -> String {
    code.map_or_else(|| "?".to_owned(), |code| code.to_string())
}

/// Events between two ticks: changes of state, cause or model, losses, refusals and missed deadlines.
pub fn changes(before: &TelemetryV1, now: &TelemetryV1) -> Vec<String> {
    let counted = [
        ("poses lost", before.poses_lost, now.poses_lost),
        ("poses refused", before.poses_refused, now.poses_refused),
        ("deadlines missed", before.deadline_misses, now.deadline_misses),
    ];
    let state = (before.state, before.cause) != (now.state, now.cause);
    // On the floor the adapted model is reset; this is not an event.
    let model = before.fell_back != now.fell_back && now.mode == Mode::Flying.code();
    let condition = DaemonCondition::of(now);
    let states = state.then(|| condition.state_text());
    let law = law_change(before, now);
    let models = model.then(|| condition.model_text().to_owned());
    let more = counted.into_iter().filter(|(_, before, now)| now > before);
    let counts = more.map(|(name, before, now)| format!("{name}: {}", now - before));
    states.into_iter().chain(law).chain(models).chain(counts).collect()
}

/// A change between a law and its fallback as text; `None` without one, and before the law first flies.
fn law_change(before: &TelemetryV1, now: &TelemetryV1) -> Option<String> {
    let cause = word(HandoverCause::from_code(now.handover_cause));
    if now.handovers > before.handovers {
        Some(format!("fallback law: {cause}"))
    } else {
        let returns = now.handovers > 0 && now.fallback < before.fallback;
        returns.then(|| "the law flies again".to_owned())
    }
}

/// Events at the beginning and, if it is finite, at the end of the period of `what`: time after arming \[s\] and text.
pub fn of_period(
    what: &str,
    (from_s, until_s): (f64, f64),
) -> impl Iterator<Item = (f64, String)> + use<> {
    let begins = (from_s, format!("{what} begins"));
    let ends = until_s.is_finite().then(|| (until_s, format!("{what} ends")));
    std::iter::once(begins).chain(ends)
}

/// Beginnings and ends of the faults and disturbances of `config`: time after arming \[s\], `fault` or `disturbance`, and text.
pub fn of_faults(config: &Config) -> impl Iterator<Item = (f64, &'static str, String)> {
    let faults = config.fault.inject.iter();
    let faults = faults.map(|it| ("fault", it.to_string(), (it.at_s, it.end_s())));
    let loads = config.plant.disturb.iter();
    let loads = loads.map(|it| ("disturbance", it.to_string(), (it.at_s, it.end_s())));
    faults.chain(loads).flat_map(|(source, name, period)| {
        of_period(&name, period).map(move |(at_s, text)| (at_s, source, text))
    })
}

/// Event of an input of the daemon as text; `None` for an ordinary turn and for a request of the status.
pub fn of_input(input: &InputV1) -> Option<String> {
    match InputKind::from_code(input.kind)? {
        InputKind::Start => Some("daemon started".to_owned()),
        InputKind::Turn => {
            (input.stop == 1).then(|| format!("operator: {}", OperatorCommand::Stop))
        }
        InputKind::FilesLost => Some(Cause::FilesLost.to_string()),
        // The message on topic `event` says more.
        InputKind::Request if input.event != 0 => None,
        InputKind::Request => {
            let command = OperatorCommand::from_code(input.request)?;
            let answer = Answer::from_code(input.answer)?;
            let cause = Cause::from_code(input.cause).filter(|_| answer == Answer::Refused);
            let because = cause.map_or_else(String::new, |cause| format!(": {cause}"));
            (command != OperatorCommand::Status)
                .then(|| format!("operator: {command}, {answer}{because}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_and_stops_are_events_and_ordinary_turns_are_not() {
        let request = |command: OperatorCommand, answer: Answer| InputV1 {
            kind: InputKind::Request.code(),
            request: command.code(),
            answer: answer.code(),
            cause: Cause::WrongMode.code(),
            ..InputV1::default()
        };
        let said = |input: InputV1| of_input(&input);
        assert_eq!(
            said(request(OperatorCommand::Disarm, Answer::Refused)).unwrap(),
            "operator: disarm, refused: not possible in this mode"
        );
        assert_eq!(
            said(request(OperatorCommand::Land, Answer::Done)).unwrap(),
            "operator: land, done"
        );
        assert_eq!(said(request(OperatorCommand::Status, Answer::Done)), None);
        let turn = InputV1 { kind: InputKind::Turn.code(), ..InputV1::default() };
        assert_eq!(said(turn), None);
        assert_eq!(said(InputV1 { stop: 1, ..turn }).unwrap(), "operator: stop");
    }

    #[test]
    fn a_condition_names_its_cause_if_there_is_one() {
        let tick = TelemetryV1 {
            mode: Mode::Flying.code(),
            state: SafetyState::Coast.code(),
            cause: Cause::NoPose.code(),
            ..TelemetryV1::default()
        };
        assert_eq!(DaemonCondition::of(&tick).to_string(), "flying, Coast: no pose");
        let nominal = TelemetryV1 { state: 0, cause: 0, ..tick };
        assert_eq!(DaemonCondition::of(&nominal).to_string(), "flying, Nominal");
        assert_eq!(DaemonCondition::of(&TelemetryV1 { state: 99, ..nominal }).state_text(), "?");
    }

    #[test]
    fn a_model_that_predicts_worse_is_an_event_and_so_is_its_return() {
        let adapted = TelemetryV1 { mode: Mode::Flying.code(), ..TelemetryV1::default() };
        let landed = TelemetryV1::default();
        let fallen = TelemetryV1 { fell_back: 1, ..adapted };
        let said = "configured model, since the adapted one predicts worse";
        assert_eq!(changes(&adapted, &fallen), [said]);
        assert_eq!(changes(&fallen, &adapted), ["adapted model"]);
        assert!(changes(&fallen, &landed).is_empty());
        assert_eq!(DaemonCondition::of(&fallen).to_string(), format!("flying, Nominal; {said}"));
    }
}
