//! The condition of the loop that the background thread logs and reports.

use oqtal_bus::code::{Cause, HandoverCause, Mode, SafetyState};
use oqtal_bus::message::TelemetryV1;
use oqtal_config::{ClockKind, Config};

use crate::cycle::FirstFlight;
use crate::setpoint::SetpointRefusal;

/// The condition of the loop that operators see.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Condition {
    pub(crate) mode: u8,
    pub(crate) state: u8,
    pub(crate) cause: u8,
    /// Reasons against a flight.
    pub(crate) obstacles: u32,
    /// Sequence of the command at which it changed.
    pub(crate) command_sequence: u64,
    /// Changes before it that found the queue full.
    pub(crate) unlogged: u64,
    pub(crate) first_flight: FirstFlight,
    /// Why the fallback law flies.
    pub(crate) handover_cause: u8,
    /// Whether the fallback law computed the last command, also in take-off and landing.
    pub(crate) is_fallback: bool,
    pub(crate) followed: Followed,
    /// Why a reference was refused; `None` in the next tick. The same reason again, with another value, does not count as a change: a planner
    /// may send sixty invalid references a second.
    pub(crate) refusal: Option<SetpointRefusal>,
}

/// Source of the references of a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Followed {
    /// The course: the trajectory, or a change of it.
    #[default]
    Course,
    /// The end of the course, at which the vehicle stays.
    End,
    /// References of a planner.
    Planner,
    /// The stop after a planner's references.
    Ended,
    /// The course, while references of a planner arrive that are ignored until they pause.
    Ignored,
}

impl Condition {
    /// The condition in a tick's `telemetry`, with the state of the automatic flight at start-up and the source of the references.
    pub fn of(telemetry: &TelemetryV1, first_flight: FirstFlight, followed: Followed) -> Self {
        let TelemetryV1 { mode, state, cause, obstacles, command_sequence, .. } = *telemetry;
        let (handover_cause, is_fallback) = (telemetry.handover_cause, telemetry.fallback == 1);
        Self {
            mode,
            state,
            cause,
            obstacles,
            command_sequence,
            unlogged: 0,
            first_flight,
            handover_cause,
            is_fallback,
            followed,
            refusal: None,
        }
    }

    /// Whether a flight is under way, or is planned at the start of the daemon.
    pub(crate) fn has_flight(&self) -> bool {
        self.mode != Mode::Disarmed.code()
            || matches!(self.first_flight, FirstFlight::Expected | FirstFlight::Pending)
    }

    pub(crate) fn differs_from(&self, other: &Self) -> bool {
        let changing = |c: &Self| {
            let flight = (c.mode, c.state, c.cause, c.obstacles, c.followed);
            (flight, c.first_flight, c.handover_cause, c.is_fallback)
        };
        let is_other_refusal = self
            .refusal
            .is_some_and(|refusal| other.refusal.is_some_and(|last| last.kind() != refusal.kind()));
        changing(self) != changing(other) || is_other_refusal
    }

    /// Whether the log has a line for this condition after `last`: obstacles to a take-off, and the value of a refused reference, change
    /// without one.
    pub(crate) fn is_logged_after(&self, last: &Self) -> bool {
        let line = |c: &Self| {
            let reason = c.refusal().map(|refusal| refusal.kind());
            (Self { refusal: None, ..*c }.text(), reason)
        };
        line(self) != line(last)
    }

    /// Why a reference was refused, while that is the cause of the state.
    pub(crate) fn refusal(&self) -> Option<SetpointRefusal> {
        self.refusal.filter(|_| self.cause == Cause::Setpoint.code())
    }

    /// Why the fallback law flies.
    pub(crate) fn handover_reason(&self) -> HandoverCause {
        HandoverCause::from_code(self.handover_cause).unwrap_or_default()
    }

    /// The law of a daemon of `config` in the mode `mode`, as text: in flight the one that flies, with the reason if it is the fallback.
    /// `lacks_law`: the law is external, and none is connected.
    pub(crate) fn law(&self, config: &Config, mode: u8, lacks_law: bool) -> String {
        let control = &config.control;
        let configured = control.controller.name();
        let fallback = control.of_fallback().unwrap_or(*control).built_in().name();
        let is_in_flight = Mode::from_code(mode).is_some_and(Mode::commands_motors);
        if self.cause == Cause::Fallback.code() || self.is_fallback && is_in_flight {
            let reason = self.fallback_reason(mode, lacks_law);
            return format!("law {fallback} in place of {configured} ({reason})");
        }
        let absent = HandoverCause::Absent;
        match (lacks_law, config.clock.kind) {
            (false, _) => format!("law {configured}"),
            (true, ClockKind::Real) => {
                format!("law {configured} ({absent}; {fallback} flies until one is)")
            }
            // A flight in virtual time waits for the first law.
            (true, _) => format!("law {configured} ({absent})"),
        }
    }

    /// Why the fallback law flies, also where the configured law is not meant to fly.
    fn fallback_reason(&self, mode: u8, lacks_law: bool) -> String {
        let state = SafetyState::from_code(self.state);
        let reaction = state.filter(|state| *state > SafetyState::Degraded);
        let was_absent = self.handover_reason() == HandoverCause::Absent;
        if was_absent && !lacks_law && reaction.is_none() && mode == Mode::Flying.code() {
            return failure(HandoverCause::None);
        }
        match (self.handover_reason(), reaction) {
            (reason, _) if self.cause == Cause::Fallback.code() => failure(reason),
            _ if lacks_law => HandoverCause::Absent.to_string(),
            _ if mode == Mode::Landing.code() => "landing".to_owned(),
            (_, Some(state)) => state.to_string(),
            (HandoverCause::None, None) => "take-off".to_owned(),
            (reason, None) => reason.to_string(),
        }
    }

    /// Text, state and cause; `None` for codes that this version does not know.
    pub(crate) fn text(&self) -> Option<(String, SafetyState, Cause)> {
        let mode = Mode::from_code(self.mode)?;
        let (state, cause) = (SafetyState::from_code(self.state)?, Cause::from_code(self.cause)?);
        let text = match cause {
            Cause::None => format!("{mode}, {state}"),
            Cause::Fallback => {
                format!("{mode}, {state}: {cause}, {}", failure(self.handover_reason()))
            }
            Cause::Setpoint => match self.refusal() {
                Some(refusal) => format!("{mode}, {state}: {cause}, {refusal}"),
                None => format!("{mode}, {state}: {cause}"),
            },
            cause => format!("{mode}, {state}: {cause}"),
        };
        Some((text, state, cause))
    }

    /// Writes the condition to the log, with the severity that page and terminal show: an error if the state ends a flight.
    pub(crate) fn log(&self) {
        let Some((text, state, cause)) = self.text() else { return };
        let (state_name, cause_name) = (state.to_string(), cause.to_string());
        let sequence = self.command_sequence;
        if state == SafetyState::Nominal {
            tracing::info!(state = state_name, sequence, "{text}");
        } else if state.ends_flight() {
            tracing::error!(state = state_name, cause = cause_name, sequence, "{text}");
        } else {
            tracing::warn!(state = state_name, cause = cause_name, sequence, "{text}");
        }
    }
}

/// Why the fallback law flies in place of one that failed, as text; a law that connected in flight has no reason of its own.
fn failure(reason: HandoverCause) -> String {
    match reason {
        HandoverCause::None => "the law waits for its return".to_owned(),
        reason => reason.to_string(),
    }
}
