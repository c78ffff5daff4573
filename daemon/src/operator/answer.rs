//! Answers to operators' requests, and the events that record them.

use oqtal_bus::code::{Answer, Cause, SafetyState};
use oqtal_bus::message::{ControlRequestV1, ControlResponseV1, EventV1, UNCHANGED};
use oqtal_bus::obstacle::ArmingObstacles;
use oqtal_bus::text::LongText;
use oqtal_bus::time::Time;

use crate::refusal::Refusal;

/// Text of the answer to `request`, which changes no present value; `repeated` are the settings that it sets again.
pub(super) fn unchanged_text(request: &ControlRequestV1, repeated: &LongText) -> LongText {
    let title = match (repeated.is_empty(), request.text.is_empty()) {
        (false, _) => UNCHANGED,
        (true, true) => "no setting differs",
        (true, false) => "no setting in the file differs; the others keep their values",
    };
    let lines = std::iter::once(title).chain(repeated.as_str().lines());
    LongText::of_lines(lines).unwrap_or_else(|| LongText::new(title))
}

/// Publishes an event, with this `number`, for a request that was executed or refused.
pub(super) fn publish_answered(
    request: &ControlRequestV1,
    number: u64,
    response: &ControlResponseV1,
    publish: &mut dyn FnMut(EventV1),
) {
    let event = EventV1 { number, ..event(request, Answer::Accepted) };
    publish(match response.answer == Answer::Refused.code() {
        true => refused_event(event, response),
        false => EventV1 { text: response.text, ..event },
    });
}

/// `response` to a change, with its warnings, which are logged.
pub(super) fn with_warnings(response: ControlResponseV1, warnings: &[String]) -> ControlResponseV1 {
    if response.answer == Answer::Refused.code() || warnings.is_empty() {
        return response;
    }
    warnings.iter().for_each(|told| tracing::warn!("{told}"));
    let told = warnings.iter().map(|told| format!("warning: {told}"));
    let lines = response.text.as_str().lines().map(str::to_owned).chain(told);
    ControlResponseV1 { text: first_lines(&lines.collect::<Vec<_>>()), ..response }
}

/// As many of `lines` as an answer can have.
pub(super) fn first_lines(lines: &[String]) -> LongText {
    LongText::of_first_lines(&lines.iter().map(String::as_str).collect::<Vec<_>>())
}

/// The event of `request`, with this answer.
pub(super) fn event(request: &ControlRequestV1, answer: Answer) -> EventV1 {
    let ControlRequestV1 { command, process, user, program, point, yaw, text, .. } = *request;
    let (now, made_at, answer) = (Time::now(), request.asked_at, answer.code());
    let time = if made_at.is_set() { made_at.min(now) } else { now };
    let base = EventV1 { time, command, answer, process, user, program, ..EventV1::default() };
    EventV1 { point, yaw, text, ..base }
}

/// `event`, refused with `response`.
pub(super) fn refused_event(event: EventV1, response: &ControlResponseV1) -> EventV1 {
    let ControlResponseV1 { cause, text, obstacles, .. } = *response;
    let reason = match text.is_empty() && cause == Cause::NotReady.code() {
        true => LongText::new(&ArmingObstacles::from_bits(obstacles).to_string()),
        false => text,
    };
    EventV1 { answer: Answer::Refused.code(), cause, reason, ..event }
}

/// The refusal `refusal`, with mode and state as in `present`.
pub(super) fn with_reason(refusal: &Refusal, present: ControlResponseV1) -> ControlResponseV1 {
    let text = LongText::new(&refusal.reason);
    ControlResponseV1 { text, ..refused(refusal.cause, present) }
}

/// The refusal for the reason `cause`, with mode and state as in `present`.
pub(super) fn refused(cause: Cause, present: ControlResponseV1) -> ControlResponseV1 {
    ControlResponseV1 { answer: Answer::Refused.code(), cause: cause.code(), ..present }
}

/// `response`, with the place that a trajectory `needs` if the fence refuses it there.
pub(super) fn with_place(
    response: ControlResponseV1,
    needs: impl FnOnce() -> Option<String>,
) -> ControlResponseV1 {
    let is_held = response.state == SafetyState::Hold.code();
    let is_refused = response.cause == Cause::Fence.code() && !is_held;
    match is_refused.then(needs).flatten() {
        Some(place) => ControlResponseV1 { text: LongText::new(&place), ..response },
        None => response,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trajectory_that_the_fence_refuses_is_answered_with_the_place_that_it_needs() {
        let told = |cause: Cause, state: SafetyState| {
            let (cause, state) = (cause.code(), state.code());
            let refusal = refused(Cause::None, ControlResponseV1::default());
            let response = ControlResponseV1 { cause, state, ..refusal };
            with_place(response, || Some("it fits there".to_owned())).text
        };
        assert_eq!(told(Cause::Fence, SafetyState::Nominal).as_str(), "it fits there");
        assert!(told(Cause::Fence, SafetyState::Hold).is_empty(), "the fence holds the vehicle");
        assert!(told(Cause::NearFloor, SafetyState::Nominal).is_empty());
    }
}
