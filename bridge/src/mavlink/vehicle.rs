//! The autopilot at the other end: who it is, in which mode, and what it says of itself.

use oqtal_bus::code::{ControlHolder, EstimatorState, VehicleRefusal};
use oqtal_bus::text::ShortText;
use oqtal_bus::time::{Span, Time};
use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::{
    AutopilotFirmware, MavlinkAddress, MavlinkContent, MavlinkHeartbeat, MavlinkPacket,
    MavlinkText, TextSeverity,
};

use crate::protocol::{VehicleEstimate, VehicleReply, VehicleText};

/// Time without an estimator's flags after which the estimator is unknown.
const FLAGS_AGE: Span = Span::from_millis(3000);
/// Time without a heartbeat after which another autopilot may take the vehicle's place: a stranger that was heard once does not keep
/// the vehicle out.
const ABSENT: Span = Span::from_millis(3000);
/// Step back of the vehicle's clock by which a restart is noticed \[ms\].
const RESTART_MS: u32 = 2000;

/// AutopilotFirmware that was chosen from those that are heard.
#[derive(Clone, Copy, Debug)]
struct Chosen {
    address: MavlinkAddress,
    kind: AutopilotKind,
    custom_mode: u32,
    is_armed: bool,
    /// When it armed, if that was seen.
    armed_at: Option<Time>,
    heard_at: Time,
}

impl Chosen {
    /// Autopilot of which no heartbeat was read.
    fn new(address: MavlinkAddress, kind: AutopilotKind) -> Self {
        Self {
            address,
            kind,
            custom_mode: 0,
            is_armed: false,
            armed_at: None,
            heard_at: Time::UNSET,
        }
    }
}

/// State of the autopilot.
#[derive(Clone, Debug)]
pub(super) struct AutopilotState {
    wanted_kind: Option<AutopilotKind>,
    wanted_system: Option<u8>,
    chosen: Option<Chosen>,
    estimate: VehicleEstimate,
    flags_at: Time,
    /// The vehicle's clock as last heard \[ms\].
    time_ms: u32,
    is_restarted: bool,
}

impl AutopilotState {
    /// An autopilot of this kind and system that has not been heard; any, where they are `None`.
    pub(super) fn new(wanted_kind: Option<AutopilotKind>, wanted_system: Option<u8>) -> Self {
        Self {
            wanted_kind,
            wanted_system,
            chosen: None,
            estimate: VehicleEstimate::UNKNOWN,
            flags_at: Time::UNSET,
            time_ms: 0,
            is_restarted: false,
        }
    }

    /// Forgets the autopilot.
    pub(super) fn reset(&mut self) {
        *self = Self::new(self.wanted_kind, self.wanted_system);
    }

    /// Address and kind of the autopilot; `None` before it is heard.
    pub(super) fn known(&self) -> Option<(MavlinkAddress, AutopilotKind)> {
        self.chosen.map(|chosen| (chosen.address, chosen.kind))
    }

    /// Whether the autopilot is in the mode in which it follows set-points.
    pub(super) fn follows_setpoints(&self) -> bool {
        self.chosen.is_some_and(|chosen| chosen.kind.follows_setpoints(chosen.custom_mode))
    }

    /// Instant of the last heartbeat.
    pub(super) fn heard_at(&self) -> Option<Time> {
        self.chosen.map(|chosen| chosen.heard_at)
    }

    /// Whether the estimator has a position, or is not known.
    pub(super) fn has_position(&self) -> bool {
        self.estimate.state == EstimatorState::Ready
    }

    /// Whether the vehicle was restarted since this was asked last.
    pub(super) fn was_restarted(&mut self) -> bool {
        std::mem::take(&mut self.is_restarted)
    }

    /// Whether `packet`, which arrived at `now`, is of the autopilot. Chooses it by its first heartbeat; tells of one that is of another
    /// kind or system.
    pub(super) fn takes(
        &mut self,
        now: Time,
        packet: &MavlinkPacket,
        reply: &mut dyn FnMut(VehicleReply),
    ) -> bool {
        if self.chosen.is_some_and(|chosen| chosen.address == packet.from) {
            return true;
        }
        let MavlinkContent::Heartbeat(heartbeat) = packet.content else { return false };
        if heartbeat.autopilot == AutopilotFirmware::None || !self.is_vacant(now, &heartbeat) {
            return false;
        }
        let refusal = match heartbeat.autopilot {
            _ if self.wanted_system.is_some_and(|wanted| wanted != packet.from.system) => {
                VehicleRefusal::OtherSystem
            }
            AutopilotFirmware::Known(kind)
                if self.wanted_kind.is_none_or(|wanted| wanted == kind) =>
            {
                if self.chosen.is_some() {
                    self.reset();
                    self.is_restarted = true;
                    reply(VehicleReply::Replaced);
                }
                self.chosen = Some(Chosen::new(packet.from, kind));
                return true;
            }
            _ => VehicleRefusal::OtherAutopilot,
        };
        reply(VehicleReply::Refused(refusal));
        false
    }

    /// Takes a packet that is not believed: tells of it if it is the heartbeat of an autopilot, and none is known.
    pub(super) fn hear_unsigned(
        &self,
        packet: &MavlinkPacket,
        reply: &mut dyn FnMut(VehicleReply),
    ) {
        let MavlinkContent::Heartbeat(heartbeat) = packet.content else { return };
        if self.chosen.is_none() && heartbeat.autopilot != AutopilotFirmware::None {
            reply(VehicleReply::Refused(VehicleRefusal::Unsigned));
        }
    }

    /// Whether the sender of `heartbeat` may be chosen: there is no autopilot yet, or it is [`ABSENT`] and the motors of this one stand.
    fn is_vacant(&self, now: Time, heartbeat: &MavlinkHeartbeat) -> bool {
        let is_absent = |chosen: Chosen| now.since(chosen.heard_at) > ABSENT;
        self.chosen.is_none_or(|chosen| is_absent(chosen) && !heartbeat.is_armed)
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
        let Some(chosen) = &mut self.chosen else { return };
        chosen.custom_mode = heartbeat.custom_mode;
        if heartbeat.is_armed && !chosen.is_armed {
            // Armed when first heard, it has been for longer.
            chosen.armed_at = chosen.heard_at.is_set().then_some(now);
        }
        chosen.is_armed = heartbeat.is_armed;
        chosen.heard_at = now;
        let turns = chosen.armed_at.is_none_or(|at| now.since(at) >= spool_up(chosen.kind));
        let follows = chosen.kind.follows_setpoints(heartbeat.custom_mode);
        reply(VehicleReply::Motors(heartbeat.is_armed && turns));
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

/// Time from arming to the first thrust that is obeyed: ArduCopter waits for two seconds, PX4 for `COM_SPOOLUP_TIME`, one.
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
