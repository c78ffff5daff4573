//! Commands that start and stop the motors: mode, then arming; disarming, by force if the vehicle refuses.

use oqtal_bus::code::VehicleRefusal;
use oqtal_bus::time::{Span, Time};
use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::{AckResult, CommandKind, MavlinkAddress, VehicleCommandLong};

use super::vehicle::AutopilotState;
use crate::protocol::VehicleReply;

/// Time for which set-points must have been sent before Offboard is requested from PX4, which refuses it otherwise.
const STREAM_FIRST: Span = Span::from_millis(1500);
/// Pause between set-points that ends a stream of them.
const STREAM_GAP: Span = Span::from_millis(300);
/// Time-out of an answer.
const ANSWER_WITHIN: Span = Span::from_millis(250);
/// Pause after a refusal.
const AFTER_REFUSAL: Span = Span::from_millis(600);
/// Commands without an answer after which the vehicle does not answer \[-\].
const UNANSWERED: u8 = 4;
/// Sequence of commands.
#[derive(Clone, Debug, Default)]
pub(super) struct StartSequence {
    /// Instant before which no command is sent.
    not_before: Option<Time>,
    /// Commands sent since the last answer \[-\].
    unanswered: u8,
    is_stopping: bool,
    /// Instant at which a stop was refused.
    refused_at: Option<Time>,
    stream_since: Option<Time>,
    last_setpoint: Option<Time>,
}

impl StartSequence {
    /// Resets the sequence after a port was opened, another has taken control, or the vehicle was restarted.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }

    /// Interrupts a sequence; set-points continue. A refused stop is forced later.
    pub(super) fn rest(&mut self) {
        (self.not_before, self.unanswered) = (None, 0);
    }

    /// Ends a sequence: the vehicle flies.
    pub(super) fn fly(&mut self) {
        self.rest();
        (self.is_stopping, self.refused_at) = (false, None);
    }

    /// Records a set-point that is sent at `now`.
    pub(super) fn note_setpoint(&mut self, now: Time) {
        let continues = self.last_setpoint.is_some_and(|last| now.since(last) <= STREAM_GAP);
        if !continues {
            self.stream_since = Some(now);
        }
        self.last_setpoint = Some(now);
    }

    /// The command that starting the motors of `vehicle` needs at `now`; `None` for a zero set-point.
    pub(super) fn start(
        &mut self,
        now: Time,
        (target, kind): (MavlinkAddress, AutopilotKind),
        vehicle: &AutopilotState,
    ) -> Option<VehicleCommandLong> {
        (self.is_stopping, self.refused_at) = (false, None);
        let streams = self.stream_since.is_some_and(|since| now.since(since) >= STREAM_FIRST);
        let needs_stream = kind == AutopilotKind::Px4 && !streams;
        if needs_stream || !self.is_due(now) {
            return None;
        }
        let command = if vehicle.follows_setpoints() {
            CommandKind::Arm { run: true, is_forced: false }
        } else {
            CommandKind::SetMode { mode: kind.setpoint_mode_command(), sub_mode: 0 }
        };
        Some(self.send(now, target, command))
    }

    /// The command that stopping the motors needs at `now`; `None` for a zero set-point. `heartbeat_at`: instant of the last heartbeat.
    pub(super) fn stop(
        &mut self,
        now: Time,
        target: MavlinkAddress,
        heartbeat_at: Option<Time>,
    ) -> Option<VehicleCommandLong> {
        if !std::mem::replace(&mut self.is_stopping, true) {
            self.rest();
        }
        // After a refusal a heartbeat is awaited: a pilot may have taken control, which it reports.
        let is_seen = |at: Time| heartbeat_at.is_some_and(|heartbeat_at| heartbeat_at > at);
        if !self.is_due(now) || !self.refused_at.is_none_or(is_seen) {
            return None;
        }
        // The daemon requires motors off: a vehicle that reports flight is disarmed by force.
        let is_forced = self.refused_at.is_some() || self.unanswered > 0;
        Some(self.send(now, target, CommandKind::Arm { run: false, is_forced }))
    }

    /// Takes the result of a command.
    pub(super) fn acknowledged(
        &mut self,
        now: Time,
        command: u16,
        result: AckResult,
        reply: &mut dyn FnMut(VehicleReply),
    ) {
        let refusal = match command {
            CommandKind::SET_MODE => VehicleRefusal::Mode,
            CommandKind::ARM if self.is_stopping => VehicleRefusal::Disarming,
            CommandKind::ARM => VehicleRefusal::Arming,
            _ => return,
        };
        if self.not_before.is_none() {
            // Requested by another ground station.
            return;
        }
        self.unanswered = 0;
        match result {
            AckResult::Accepted => self.not_before = Some(now + ANSWER_WITHIN),
            AckResult::InProgress => {}
            _ if self.is_stopping => {
                // Without delay: the daemon requires motors off.
                (self.refused_at, self.not_before) = (Some(now), Some(now));
                reply(VehicleReply::Refused(refusal));
            }
            _ => {
                self.not_before = Some(now + AFTER_REFUSAL);
                reply(VehicleReply::Refused(refusal));
            }
        }
    }

    /// Whether commands are not answered.
    pub(super) fn is_unanswered(&self) -> bool {
        self.unanswered >= UNANSWERED
    }

    fn is_due(&self, now: Time) -> bool {
        self.not_before.is_none_or(|at| now >= at)
    }

    fn send(&mut self, now: Time, target: MavlinkAddress, kind: CommandKind) -> VehicleCommandLong {
        let confirmation = self.unanswered;
        self.unanswered = self.unanswered.saturating_add(1);
        self.not_before = Some(now + ANSWER_WITHIN);
        VehicleCommandLong { target, kind, confirmation }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VEHICLE: MavlinkAddress =
        MavlinkAddress { system: 1, component: MavlinkAddress::AUTOPILOT };

    #[test]
    fn a_stop_is_forced_once_a_heartbeat_after_its_refusal_shows_no_pilot() {
        let at = |millis| Time::VIRTUAL_START + Span::from_millis(millis);
        let mut sequence = StartSequence::default();
        let forced = |sent: Option<VehicleCommandLong>| {
            sent.map(|it| matches!(it.kind, CommandKind::Arm { is_forced: true, .. }))
        };
        assert_eq!(forced(sequence.stop(at(0), VEHICLE, None)), Some(false));
        sequence.acknowledged(at(10), CommandKind::ARM, AckResult::Denied, &mut |_| {});
        assert_eq!(forced(sequence.stop(at(20), VEHICLE, Some(at(5)))), None);
        sequence.rest();
        assert_eq!(forced(sequence.stop(at(1010), VEHICLE, Some(at(1000)))), Some(true));
        sequence.fly();
        assert_eq!(forced(sequence.stop(at(2000), VEHICLE, Some(at(2000)))), Some(false));
    }

    #[test]
    fn the_refusal_of_a_mode_that_another_requested_is_not_the_bridge_s() {
        let now = Time::VIRTUAL_START;
        let refusals = |sequence: &mut StartSequence| {
            let mut refusals = 0;
            sequence.acknowledged(now, CommandKind::SET_MODE, AckResult::Denied, &mut |_| {
                refusals += 1
            });
            refusals
        };
        let mut sequence = StartSequence::default();
        assert_eq!(refusals(&mut sequence), 0);
        let mode = AutopilotKind::ArduPilot.setpoint_mode_command();
        sequence.send(now, VEHICLE, CommandKind::SetMode { mode, sub_mode: 0 });
        assert_eq!(refusals(&mut sequence), 1);
    }
}
