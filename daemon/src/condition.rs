//! The condition of the loop that the background thread logs and reports.

use oqtal_bus::code::{Cause, HandoverCause, Mode, SafetyState};
use oqtal_bus::message::TelemetryV1;

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
}

impl Condition {
    /// The condition in a tick's `telemetry`, with the state of the automatic flight at start-up and the source of the references.
    pub fn of(telemetry: &TelemetryV1, first_flight: FirstFlight, followed: Followed) -> Self {
        let TelemetryV1 { mode, state, cause, obstacles, command_sequence, .. } = *telemetry;
        let handover_cause = telemetry.handover_cause;
        Self {
            mode,
            state,
            cause,
            obstacles,
            command_sequence,
            unlogged: 0,
            first_flight,
            handover_cause,
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
            (flight, c.first_flight, c.handover_cause)
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

    /// Text, state and cause; `None` for codes that this version does not know.
    pub(crate) fn text(&self) -> Option<(String, SafetyState, Cause)> {
        let mode = Mode::from_code(self.mode)?;
        let (state, cause) = (SafetyState::from_code(self.state)?, Cause::from_code(self.cause)?);
        let text = match cause {
            Cause::None => format!("{mode}, {state}"),
            Cause::Fallback => {
                format!("{mode}, {state}: {cause}, {}", self.handover_reason())
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
