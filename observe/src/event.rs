//! Events in words: what changed between two ticks of the daemon, and what operators asked for.

use oqtal_bus::code::{Answer, Cause, InputKind, OperatorCommand, SafetyState};
use oqtal_bus::message::{InputV1, TelemetryV1};

/// Changes of state and cause, losses, refusals and missed deadlines between two ticks.
#[must_use]
pub fn changes(before: &TelemetryV1, now: &TelemetryV1) -> Vec<String> {
    let counted = [
        ("poses lost", before.poses_lost, now.poses_lost),
        ("poses refused", before.poses_refused, now.poses_refused),
        ("deadlines missed", before.deadline_misses, now.deadline_misses),
    ];
    let state = (before.state, before.cause) != (now.state, now.cause);
    let more = counted.into_iter().filter(|(_, before, now)| now > before);
    let counts = more.map(|(name, before, now)| format!("{name}: {}", now - before));
    state.then(|| condition(now)).into_iter().chain(counts).collect()
}

/// Safety state and cause of a tick.
#[must_use]
pub fn condition(telemetry: &TelemetryV1) -> String {
    let state = SafetyState::from_code(telemetry.state);
    let state = state.map_or_else(|| "unknown state".to_owned(), |state| state.to_string());
    match Cause::from_code(telemetry.cause) {
        None => format!("{state}: unknown cause"),
        Some(Cause::None) => state,
        Some(cause) => format!("{state}: {cause}"),
    }
}

/// What an input says; `None` for an ordinary turn, and for a request of the state, which is no event.
#[must_use]
pub fn input(input: &InputV1) -> Option<String> {
    match InputKind::from_code(input.kind)? {
        InputKind::Start => Some("daemon started".to_owned()),
        InputKind::Turn => None,
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
