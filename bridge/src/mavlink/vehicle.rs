//! State of the autopilot to which the bridge is connected: address, firmware, mode, motors, estimate.

use oqtal_bus::code::{ControlHolder, EstimatorState, VehicleRefusal};
use oqtal_bus::text::ShortText;
use oqtal_bus::time::{Span, Time};
use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::{
    AutopilotFirmware, MavlinkAddress, MavlinkContent, MavlinkHeartbeat, MavlinkPacket,
    MavlinkText, TextSeverity,
};

use crate::protocol::{ReportedMotors, VehicleEstimate, VehicleReply, VehicleText};

/// Time without an estimator's flags after which the estimator is unknown.
const FLAGS_AGE: Span = Span::from_millis(3000);
/// Heartbeat time-out of the selected autopilot; after it, another one can be selected. An autopilot that sent a single heartbeat thus does
/// not lock the vehicle out.
const ABSENT: Span = Span::from_millis(3000);
/// Backward step of the vehicle's clock that counts as a restart \[ms\].
const RESTART_MS: u32 = 2000;

/// Autopilot that was selected by its heartbeat.
#[derive(Clone, Copy, Debug)]
struct SelectedAutopilot {
    address: MavlinkAddress,
    kind: AutopilotKind,
    custom_mode: u32,
    is_armed: bool,
    /// Instant of arming, if it was observed.
    armed_at: Option<Time>,
    heartbeat_at: Time,
}

impl SelectedAutopilot {
    /// Autopilot before its heartbeat is read.
    fn new(address: MavlinkAddress, kind: AutopilotKind) -> Self {
        Self {
            address,
            kind,
            custom_mode: 0,
            is_armed: false,
            armed_at: None,
            heartbeat_at: Time::UNSET,
        }
    }
}

/// State of the autopilot.
#[derive(Clone, Debug)]
pub(super) struct AutopilotState {
    required_kind: Option<AutopilotKind>,
    required_system: Option<u8>,
    selected: Option<SelectedAutopilot>,
    estimate: VehicleEstimate,
    flags_at: Time,
    /// The vehicle's clock in its last message \[ms\].
    time_ms: u32,
    is_restarted: bool,
}

impl AutopilotState {
    /// State before the first heartbeat of an autopilot of this kind and system; `None` stands for any.
    pub(super) fn new(required_kind: Option<AutopilotKind>, required_system: Option<u8>) -> Self {
        Self {
            required_kind,
            required_system,
            selected: None,
            estimate: VehicleEstimate::UNKNOWN,
            flags_at: Time::UNSET,
            time_ms: 0,
            is_restarted: false,
        }
    }

    /// Discards the selected autopilot and its state.
    pub(super) fn reset(&mut self) {
        *self = Self::new(self.required_kind, self.required_system);
    }

    /// Address and kind of the autopilot; `None` before its first heartbeat.
    pub(super) fn known(&self) -> Option<(MavlinkAddress, AutopilotKind)> {
        self.selected.map(|selected| (selected.address, selected.kind))
    }

    /// Whether the autopilot is in the mode in which it follows set-points.
    pub(super) fn follows_setpoints(&self) -> bool {
        self.selected.is_some_and(|selected| selected.kind.follows_setpoints(selected.custom_mode))
    }

    /// Instant of the last heartbeat.
    pub(super) fn heartbeat_at(&self) -> Option<Time> {
        self.selected.map(|selected| selected.heartbeat_at)
    }

    /// Whether the estimator has a position.
    pub(super) fn has_position(&self) -> bool {
        self.estimate.state == EstimatorState::Ready
    }

    /// Whether the vehicle was restarted since the last call.
    pub(super) fn was_restarted(&mut self) -> bool {
        std::mem::take(&mut self.is_restarted)
    }

    /// Whether `packet`, which arrived at `now`, is of the autopilot. Selects the autopilot by its first heartbeat; reports one of another
    /// kind or system.
    pub(super) fn takes(
        &mut self,
        now: Time,
        packet: &MavlinkPacket,
        reply: &mut dyn FnMut(VehicleReply),
    ) -> bool {
        if self.selected.is_some_and(|selected| selected.address == packet.from) {
            return true;
        }
        let MavlinkContent::Heartbeat(heartbeat) = packet.content else { return false };
        if heartbeat.autopilot == AutopilotFirmware::None || !self.is_vacant(now, &heartbeat) {
            return false;
        }
        let refusal = match heartbeat.autopilot {
            _ if self.required_system.is_some_and(|wanted| wanted != packet.from.system) => {
                VehicleRefusal::OtherSystem
            }
            AutopilotFirmware::Known(kind)
                if self.required_kind.is_none_or(|wanted| wanted == kind) =>
            {
                if self.selected.is_some() {
                    self.reset();
                    self.is_restarted = true;
                    reply(VehicleReply::Replaced);
                }
                self.selected = Some(SelectedAutopilot::new(packet.from, kind));
                return true;
            }
            _ => VehicleRefusal::OtherAutopilot,
        };
        reply(VehicleReply::Refused(refusal));
        false
    }

    /// Takes a packet without a valid signature: reports the heartbeat of an autopilot while none is selected.
    pub(super) fn receive_unsigned(
        &self,
        packet: &MavlinkPacket,
        reply: &mut dyn FnMut(VehicleReply),
    ) {
        let MavlinkContent::Heartbeat(heartbeat) = packet.content else { return };
        if self.selected.is_none() && heartbeat.autopilot != AutopilotFirmware::None {
            reply(VehicleReply::Refused(VehicleRefusal::Unsigned));
        }
    }

    /// Whether the sender of `heartbeat` may be selected: none is selected yet, or it is [`ABSENT`] and the sender's motors are off.
    fn is_vacant(&self, now: Time, heartbeat: &MavlinkHeartbeat) -> bool {
        let is_absent = |selected: SelectedAutopilot| now.since(selected.heartbeat_at) > ABSENT;
        self.selected.is_none_or(|selected| is_absent(selected) && !heartbeat.is_armed)
    }

    /// Takes a message of the autopilot.
    pub(super) fn receive(
        &mut self,
        now: Time,
        content: &MavlinkContent,
        reply: &mut dyn FnMut(VehicleReply),
    ) {
        match content {
            MavlinkContent::Heartbeat(heartbeat) => self.heartbeat(now, heartbeat, reply),
            MavlinkContent::Battery(volts) if volts.is_finite() => {
                reply(VehicleReply::Battery(*volts));
            }
            MavlinkContent::Position(position) => {
                self.note_time(position.time_ms);
                self.estimate.position = position.position;
            }
            MavlinkContent::Attitude(attitude) => {
                self.note_time(attitude.time_ms);
                self.estimate.attitude = attitude.attitude;
                reply(VehicleReply::Estimate(self.estimate));
                reply(VehicleReply::BodyRate(attitude.rate));
            }
            MavlinkContent::Estimator(flags) => {
                let wanted = MavlinkContent::ESTIMATOR_READY;
                let is_ready = flags & wanted == wanted;
                self.flags_at = now;
                self.estimate.state =
                    if is_ready { EstimatorState::Ready } else { EstimatorState::NotReady };
                reply(VehicleReply::Estimate(self.estimate));
            }
            MavlinkContent::Text(text) => reply(VehicleReply::Text(text_of(text))),
            _ => {}
        }
        reply(VehicleReply::Other);
    }

    fn heartbeat(
        &mut self,
        now: Time,
        heartbeat: &MavlinkHeartbeat,
        reply: &mut dyn FnMut(VehicleReply),
    ) {
        let Some(selected) = &mut self.selected else { return };
        selected.custom_mode = heartbeat.custom_mode;
        if heartbeat.is_armed && !selected.is_armed {
            // Armed in the first heartbeat: the instant of arming is unknown and earlier.
            selected.armed_at = selected.heartbeat_at.is_set().then_some(now);
        }
        selected.is_armed = heartbeat.is_armed;
        selected.heartbeat_at = now;
        let turns = selected.armed_at.is_none_or(|at| now.since(at) >= spool_up(selected.kind));
        let follows = selected.kind.follows_setpoints(heartbeat.custom_mode);
        reply(VehicleReply::Motors(match (heartbeat.is_armed, turns) {
            (false, _) => ReportedMotors::Off,
            (true, false) => ReportedMotors::SpoolingUp,
            (true, true) => ReportedMotors::Running,
        }));
        reply(VehicleReply::Control(match (heartbeat.is_armed, follows) {
            (false, _) => ControlHolder::Nobody,
            (true, true) => ControlHolder::Bridge,
            (true, false) => ControlHolder::Another,
        }));
        if self.flags_at.is_set() && now.since(self.flags_at) > FLAGS_AGE {
            self.estimate.state = EstimatorState::Unknown;
        }
        reply(VehicleReply::Estimate(self.estimate));
    }

    fn note_time(&mut self, time_ms: u32) {
        self.is_restarted |= time_ms.saturating_add(RESTART_MS) < self.time_ms;
        self.time_ms = time_ms;
    }
}

/// Time from arming to the first thrust that is applied: ArduCopter waits for two seconds, PX4 for `COM_SPOOLUP_TIME`, one.
fn spool_up(kind: AutopilotKind) -> Span {
    match kind {
        AutopilotKind::ArduPilot => Span::from_millis(2100),
        AutopilotKind::Px4 => Span::from_millis(1100),
    }
}

fn text_of(text: &MavlinkText) -> VehicleText {
    let is_trouble = text.severity == TextSeverity::Trouble;
    VehicleText { is_trouble, text: ShortText::from_ascii(&text.text) }
}
