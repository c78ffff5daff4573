//! One turn of the bridge: what is due, what it says, what it means that it was handed over. Pure: bytes and time are
//! arguments.
//!
//! A frame that a port takes only in part is finished before another begins. One that stands for longer than a period is
//! abandoned together with what the port still holds: else an old command could go out when the other end lets go. The vehicle
//! then sees a frame cut short, whose checksum fails, and finds the next one by its head; it may take that one for the missing
//! rest and lose it too. So the next one is neutral.
//!
//! A port may also take frame after frame and pass on none, while its far end asks for a pause. Then nothing is handed over behind
//! what it holds, and what it holds for a period too long is dropped: commands cannot pile up and go out late.

use oqtal_bus::message::{CommandV1, Header, Stamps, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;

use crate::background::Note;
use crate::line::LineOccupancy;
use crate::motors::MotorChange;
use crate::protocol::{FrameSizes, VehicleFrame, VehicleProtocol, VehicleReply};
use crate::safety::{CommandGate, ForwardedCommand, MotorStatus, SafetyLimits, VehicleSetpoint};
use crate::schedule::{Schedule, spacing};
use crate::vehicle::VehicleMonitor;

/// A status counts for a motor sequence for so many periods of asking.
const STATUS_PERIODS: f64 = 3.0;
/// A port that took nothing, or a part of a frame, is looked at again so soon.
const RETRY: Span = Span::from_millis(1);
/// A port may be so much of an setpoint behind the reckoning before nothing more is handed to it.
const LAG_FRAMES: f64 = 0.5;

/// Refused commands that are further apart are two matters.
const REFUSALS_APART: Span = Span::from_millis(1000);

/// What is told to the daemon and to observers: the pose's sequence, the stations passed, the vehicle.
pub type VehicleReport = (u64, Stamps, VehicleV1);

/// What a frame is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum FrameKind {
    VehicleSetpoint(Option<ForwardedCommand>),
    Poll,
    EmergencyStop,
}

/// A frame on its way out.
#[derive(Clone, Copy, Debug)]
struct Outgoing {
    kind: FrameKind,
    frame: VehicleFrame,
    handed_over: usize,
    begun: Time,
}

/// The bridge, from command to bytes and from bytes to what is known of the vehicle.
#[derive(Debug)]
pub struct Bridge {
    protocol: Box<dyn VehicleProtocol>,
    sizes: FrameSizes,
    period: Span,
    air: Span,
    emergency_stop: bool,
    safety: CommandGate,
    schedule: Schedule,
    line: LineOccupancy,
    vehicle: VehicleMonitor,
    outgoing: Option<Outgoing>,
    is_open: bool,
    /// Since when the port holds back what should have gone out.
    held_since: Option<Time>,
    /// Something was dropped, and no frame has gone since.
    neutral_first: bool,
    /// A command came that no frame has gone for.
    command_waits: bool,
    emergency_waits: bool,
    last_command: u64,
    commands_lost: u64,
    answers: bool,
    refused: u64,
    /// When a command was last found refused.
    refused_at: Time,
}

/// How far apart polls must be on `line`; `None` if there is no room for any.
pub(crate) fn poll_spacing(line: &LineOccupancy, period: Span, sizes: FrameSizes) -> Option<Span> {
    let FrameSizes { setpoint, acknowledgement, poll, status } = sizes;
    spacing(period, line.time_for(setpoint + acknowledgement), line.time_for(poll + status))
}

impl Bridge {
    /// A bridge of `config` at `baud` that has no port yet.
    #[must_use]
    pub fn new(config: &Config, protocol: Box<dyn VehicleProtocol>, baud: u32, now: Time) -> Self {
        let options = &config.bridge;
        let millis = |millis: f64| Span::from_seconds(millis * 1e-3);
        let period = Span::period_of(config.control.rate_hz);
        let (line, sizes) = (LineOccupancy::new(baud), protocol.sizes());
        // Without any room the configuration was refused.
        let spacing = poll_spacing(&line, period, sizes).unwrap_or(period);
        let status_period = Span::period_of(options.status_rate_hz).max(spacing);
        let limits = SafetyLimits {
            command_age: period.scaled(options.command_timeout_periods),
            status_age: status_period.scaled(STATUS_PERIODS),
            sequence: millis(options.motor_sequence_ms),
            rest: millis(options.rest_ms),
        };
        Self {
            sizes,
            protocol,
            period,
            air: millis(options.air_latency_ms),
            emergency_stop: options.emergency_stop,
            safety: CommandGate::new(now, limits),
            schedule: Schedule::new(period, status_period, spacing),
            line,
            vehicle: VehicleMonitor::new(millis(options.silence_ms)),
            outgoing: None,
            is_open: false,
            held_since: None,
            neutral_first: false,
            command_waits: false,
            emergency_waits: false,
            last_command: 0,
            commands_lost: 0,
            answers: false,
            refused: 0,
            refused_at: Time::UNSET,
        }
    }

    /// The port is open: frames go from now on, neutral first.
    pub fn open(&mut self, now: Time) {
        self.is_open = true;
        self.safety.forget(now);
        self.vehicle.forget();
        self.protocol.forget();
        self.line.clear();
        self.schedule.restart();
        (self.outgoing, self.emergency_waits) = (None, false);
        (self.held_since, self.neutral_first) = (None, false);
    }

    /// The port is lost.
    pub fn close(&mut self, now: Time) {
        self.open(now);
        self.is_open = false;
    }

    /// When there is something to do of its own accord.
    #[must_use]
    pub fn next_event(&self, now: Time) -> Time {
        match self.outgoing {
            Some(_) => now + RETRY,
            None if self.held_since.is_some() => now + RETRY,
            None if self.command_waits => self.clear_at(now),
            None => self.schedule.next_frame().max(self.clear_at(now)),
        }
    }

    /// Takes a command off the bus at `now`; `lost` never arrived, in total.
    pub fn receive(&mut self, now: Time, header: &Header, command: CommandV1, lost: u64) {
        self.commands_lost = lost;
        self.command_waits |= self.safety.receive(now, header, command);
    }

    /// Takes bytes from the port.
    pub fn hear(&mut self, now: Time, bytes: &[u8]) {
        let (vehicle, safety) = (&mut self.vehicle, &mut self.safety);
        self.protocol.hear(bytes, &mut |reply| {
            vehicle.hear(now, reply);
            if let VehicleReply::Status { motors_run, .. } = reply {
                safety.hear(MotorStatus { heard_at: now, run: motors_run });
            }
        });
    }

    /// Begins the frame that is due, if one is and the line is clear. Without a port the report alone is due.
    pub fn turn(&mut self, now: Time, note: &mut dyn FnMut(Note)) -> Option<VehicleReport> {
        self.watch(now, note);
        let due = self.command_waits || now >= self.schedule.next_frame();
        let blocked = self.outgoing.is_some() || self.held_since.is_some();
        if blocked || !due || now < self.clear_at(now) {
            return None;
        }
        if std::mem::take(&mut self.neutral_first) {
            // The command that waits goes right behind it.
            self.schedule.frame(now, false);
            self.say_neutral(now);
            return None;
        }
        let (setpoint, about, change) = self.safety.decide(now);
        if let Some(change) = change {
            note(Note::Motors(change));
            self.emergency_waits |= change == MotorChange::StopFailed && self.emergency_stop;
        }
        let with_command = std::mem::take(&mut self.command_waits);
        self.schedule.frame(now, with_command);
        if self.is_open {
            let frame = self.protocol.setpoint(&setpoint);
            self.begin(now, FrameKind::VehicleSetpoint(about), frame);
            None
        } else {
            Some(self.report(now, None, Span::ZERO))
        }
    }

    /// Begins what goes right behind an setpoint: the emergency stop, or a poll if there is room for it.
    pub fn follow_up(&mut self, now: Time) {
        if !self.is_open || self.outgoing.is_some() {
            return;
        }
        if std::mem::take(&mut self.emergency_waits) {
            let frame = self.protocol.emergency_stop();
            self.begin(now, FrameKind::EmergencyStop, frame);
            return;
        }
        let asking = self.line.time_for(self.sizes.poll);
        let urgent = self.safety.is_in_sequence();
        if self.schedule.poll(now, self.line.ahead(now), asking, urgent) {
            let frame = self.protocol.poll();
            self.begin(now, FrameKind::Poll, frame);
        }
    }

    /// Bytes to hand to the port.
    #[must_use]
    pub fn outbox(&self) -> &[u8] {
        self.outgoing
            .as_ref()
            .map_or(&[], |outgoing| &outgoing.frame.bytes()[outgoing.handed_over..])
    }

    /// So many of them were taken at `now`. With the last byte of an setpoint there is something to report.
    pub fn handed_over(&mut self, now: Time, bytes: usize) -> Option<VehicleReport> {
        let outgoing = self.outgoing.as_mut()?;
        outgoing.handed_over += bytes;
        if outgoing.handed_over < outgoing.frame.bytes().len() {
            return None;
        }
        let Outgoing { kind, frame, .. } = *outgoing;
        self.outgoing = None;
        let on_wire = self.line.take(now, frame.bytes().len());
        match kind {
            FrameKind::VehicleSetpoint(about) => {
                self.vehicle.asked(now);
                Some(self.report(now, about, on_wire))
            }
            FrameKind::Poll => {
                self.vehicle.asked(now);
                None
            }
            FrameKind::EmergencyStop => None,
        }
    }

    /// Looks at the port, which has `queued` bytes yet to send: nothing is handed over behind more than the line should have
    /// ahead. Whether what was handed over is to be dropped: a frame stands, or the port holds back, for longer than a period.
    #[must_use]
    pub fn is_stuck(&mut self, now: Time, queued: usize) -> bool {
        let lag = self.line.time_for(self.sizes.setpoint).scaled(LAG_FRAMES);
        let holds_back = self.line.time_for(queued) > self.line.ahead(now) + lag;
        let free_at = self.line.free_at();
        // Frames stop going at once, so this is about the last of them.
        let since = if free_at.is_set() { free_at.min(now) } else { now };
        self.held_since = holds_back.then(|| self.held_since.unwrap_or(since));
        let outlasts = |since: Time| now.since(since) > self.period;
        self.held_since.is_some_and(outlasts)
            || self.outgoing.is_some_and(|out| outlasts(out.begun))
    }

    /// What was handed over is dropped: neutral comes next.
    pub fn drop_outgoing(&mut self) {
        (self.outgoing, self.held_since, self.neutral_first) = (None, None, true);
        self.line.clear();
    }

    /// The last words: neutral. To be called as often as it is to be said.
    pub fn say_neutral(&mut self, now: Time) {
        let frame = self.protocol.setpoint(&VehicleSetpoint::Zero);
        self.begin(now, FrameKind::VehicleSetpoint(None), frame);
    }

    /// The very last: the emergency stop, if the motors run because of this bridge. Nobody will be left to stop them.
    pub fn say_emergency_stop(&mut self, now: Time) -> bool {
        let needed = self.is_open && self.emergency_stop && self.safety.may_run();
        if needed {
            let frame = self.protocol.emergency_stop();
            self.begin(now, FrameKind::EmergencyStop, frame);
        }
        needed
    }

    /// The time until all that was handed over is out.
    #[must_use]
    pub fn ahead(&self, now: Time) -> Span {
        self.line.ahead(now)
    }

    /// How the vehicle is, as told without a frame.
    pub fn report(
        &mut self,
        now: Time,
        about: Option<ForwardedCommand>,
        on_wire: Span,
    ) -> VehicleReport {
        if let Some(about) = &about {
            self.last_command = about.command;
        }
        let vehicle = VehicleV1 {
            command_sequence: self.last_command,
            lost: self.commands_lost,
            battery_v: self.vehicle.battery_v(),
            link_quality: self.vehicle.quality(now),
            wire_ns: on_wire.nanos(),
            air_ns: self.air.nanos(),
            armed: u8::from(self.answers(now) && self.safety.ran_last()),
            starting: u8::from(self.safety.is_starting()),
            link: u8::from(self.answers(now)),
            simulated: 0,
        };
        let stamps =
            about.map_or_else(Stamps::default, |about| Stamps { applied_at: now, ..about.stamps });
        (about.map_or(0, |about| about.pose), stamps, vehicle)
    }

    /// Whether there is a port, and the vehicle was reply lately.
    #[must_use]
    pub fn answers(&self, now: Time) -> bool {
        self.is_open && self.vehicle.answers(now)
    }

    /// Notes what changed by itself: silence, refused commands.
    fn watch(&mut self, now: Time, note: &mut dyn FnMut(Note)) {
        let answers = self.answers(now);
        if std::mem::replace(&mut self.answers, answers) != answers && self.is_open {
            note(if answers {
                Note::Answers
            } else {
                Note::Silent { damaged: self.protocol.damaged() }
            });
        }
        let refused = self.safety.refused();
        if refused > self.refused {
            // The first of a run says enough.
            if !self.refused_at.is_set() || now.since(self.refused_at) > REFUSALS_APART {
                note(Note::RefusedOld);
            }
            (self.refused, self.refused_at) = (refused, now);
        }
    }

    /// When the line has no more ahead than a frame: a command that comes later overtakes one that waits here, but none on the
    /// line.
    fn clear_at(&self, now: Time) -> Time {
        now + (self.line.ahead(now) - self.line.time_for(self.sizes.setpoint)).max(Span::ZERO)
    }

    fn begin(&mut self, now: Time, kind: FrameKind, frame: VehicleFrame) {
        self.outgoing = Some(Outgoing { kind, frame, handed_over: 0, begun: now });
    }
}
