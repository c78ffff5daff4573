//! The bridge between commands on the bus and bytes on a port: selects the frame that is due, encodes it, and evaluates the
//! replies. Pure: bytes and time are arguments.

mod due;
mod ending;
mod lent;
mod report;

use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps, VehicleV1};
use oqtal_bus::stop::StoppedMotors;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;

use crate::line::LineOccupancy;
use crate::monitor::VehicleMonitor;
use crate::motors::MotorEvent;
use crate::note::Note;
use crate::outbox::{FrameKind, Outbox};
use crate::poses::PoseRelay;
use crate::protocol::{
    FrameSizes, PeriodicFrame, ReportedMotors, VehicleFrame, VehicleProtocol, VehicleReply,
};
use crate::safety::{CommandGate, MotorStatus};
use crate::schedule::Schedule;
use crate::setpoint::VehicleSetpoint;
use crate::timing::{limits, millis, periodic_spacing};
use crate::transport::VehicleTransport;

/// Time between rejected commands above which they are logged separately.
const REJECTION_PAUSE: Span = Span::from_millis(1000);
/// Time after the opening of the port within which a vehicle that is there answers.
const LONGEST_START: Span = Span::from_millis(3000);

/// Report to the daemon and to observers: sequence of the pose, stamps, state of the vehicle.
pub type VehicleReport = (u64, Stamps, VehicleV1);

/// The bridge from commands to bytes, and from bytes to the state of the vehicle.
#[derive(Debug)]
pub struct Bridge {
    protocol: Box<dyn VehicleProtocol>,
    transport: Box<dyn VehicleTransport>,
    /// Frame lengths on the port \[bytes\].
    sizes: FrameSizes,
    air: Span,
    has_emergency_stop: bool,
    gate: CommandGate,
    schedule: Schedule,
    monitor: VehicleMonitor,
    outbox: Outbox,
    poses: PoseRelay,
    /// Periodic requests and poses that may still follow the last set-point \[-\].
    words_left: usize,
    read_at: Time,
    is_open: bool,
    /// The next frame is a zero set-point: bytes were discarded, or there was no vehicle to send to, and no frame has been sent since.
    zero_first: bool,
    /// Whether the last set-point was a flight command, which must not act beyond its time-out.
    flies: bool,
    /// Last writes of a tenant of the port.
    written: Option<WrittenSetpoint>,
    /// A command has arrived that no set-point has been sent for.
    command_waits: bool,
    emergency_stop_waits: bool,
    last_command: u64,
    commands_lost: u64,
    /// Instant since which an operator's stop is in force.
    stopped_since: Option<Time>,
    /// Whether the set-point on its way was selected since the stop, and whether one was handed to the port since: such a set-point is not
    /// a flight command.
    stop_begun: bool,
    stop_sent: bool,
    was_answering: bool,
    /// Instant at which the port was opened, until the vehicle answers or its silence is noted.
    unanswered_since: Option<Time>,
    rejected: u64,
    rejected_at: Time,
}

/// Set-point that a tenant wrote.
#[derive(Clone, Copy, Debug)]
struct WrittenSetpoint {
    /// Sequence of its command, the last 32 bits \[-\].
    sequence: u32,
    at: Time,
    /// Time until its last byte has left.
    on_wire: Span,
}

impl Bridge {
    /// Bridge of `config` through `protocol` and `transport`, without a port yet.
    pub fn new(
        config: &Config,
        protocol: Box<dyn VehicleProtocol>,
        transport: Box<dyn VehicleTransport>,
        now: Time,
    ) -> Self {
        let options = &config.bridge;
        let period = Span::period_of(config.control.rate_hz);
        let line = LineOccupancy::new(transport.byte_rate());
        let sizes = protocol.sizes().with_overhead(transport.overhead());
        // A configuration without room for periodic frames was rejected at start.
        let spacing =
            periodic_spacing(&line, period, sizes, protocol.periodic_count()).unwrap_or(period);
        let limits = limits(config, spacing);
        Self {
            poses: PoseRelay::new(limits.command_age),
            words_left: 0,
            read_at: Time::UNSET,
            gate: CommandGate::new(now, limits),
            schedule: Schedule::new(period, spacing),
            monitor: VehicleMonitor::new(millis(options.silence_ms)),
            outbox: Outbox::new(line, sizes.setpoint, period),
            protocol,
            transport,
            sizes,
            air: millis(options.air_latency_ms),
            has_emergency_stop: options.emergency_stop,
            is_open: false,
            zero_first: false,
            flies: false,
            written: None,
            command_waits: false,
            emergency_stop_waits: false,
            last_command: 0,
            commands_lost: 0,
            stopped_since: None,
            stop_begun: false,
            stop_sent: false,
            was_answering: false,
            unanswered_since: None,
            rejected: 0,
            rejected_at: Time::UNSET,
        }
    }

    /// Starts sending on a port that was opened; the first frame is a zero set-point.
    pub fn open(&mut self, now: Time) {
        self.is_open = true;
        self.unanswered_since = Some(now);
        self.gate.reset(now);
        self.monitor.reset();
        self.protocol.reset();
        self.transport.reset();
        self.schedule.restart();
        self.outbox.clear();
        self.poses.reset();
        (self.emergency_stop_waits, self.zero_first, self.words_left) = (false, false, 0);
        (self.flies, self.written) = (false, None);
    }

    /// Stops sending: the port is lost.
    pub fn close(&mut self, now: Time) {
        self.open(now);
        self.is_open = false;
    }

    /// Takes a pose that arrived from the bus at `now`.
    pub fn receive_pose(&mut self, now: Time, header: &Header, pose: &PoseV1) {
        self.poses.receive(now, header, pose);
    }

    /// Records that the port is read at `now`. Returns whether the vehicle at its other end answers.
    pub fn begin_read(&mut self, now: Time) -> bool {
        self.read_at = now;
        self.is_answering(now)
    }

    /// Takes a command that arrived at `now`; `lost` is the number of commands lost on the bus so far.
    pub fn receive_command(&mut self, now: Time, header: &Header, command: CommandV1, lost: u64) {
        self.commands_lost = lost;
        self.command_waits |= self.gate.receive(now, header, command);
    }

    /// Obeys the operator's stop that is in force since this instant; `None` without one. Returns whether this is a change.
    pub fn keep_stopped(&mut self, since: Option<Time>) -> bool {
        let changed = std::mem::replace(&mut self.stopped_since, since) != since;
        if changed {
            self.gate.keep_stopped(since);
            (self.stop_begun, self.stop_sent) = (false, false);
            self.command_waits = true;
        }
        changed
    }

    /// The motors under the stop that is in force; `None` until a set-point without flight was sent since.
    pub fn stopped_motors(&self) -> Option<StoppedMotors> {
        self.stop_sent.then(|| self.gate.stopped_motors())
    }

    /// Whether another has control: no set-points and no stop are sent.
    pub fn is_released(&self) -> bool {
        self.gate.is_released()
    }

    /// Whether the motors run, or may run because of what the bridge sent.
    pub fn motors_may_run(&self) -> bool {
        self.gate.may_run() || self.gate.last_motors().is_some_and(ReportedMotors::are_armed)
    }

    /// Takes bytes, or one packet, that the port received.
    pub fn receive_bytes(&mut self, now: Time, bytes: &[u8], note: &mut dyn FnMut(Note)) {
        let Self { transport, protocol, monitor, gate, .. } = self;
        let mut take = |reply| {
            match reply {
                VehicleReply::Motors(motors) => {
                    gate.update_status(MotorStatus { received_at: now, motors });
                }
                VehicleReply::Control(control) => gate.update_control(control),
                VehicleReply::Replaced => note(Note::Replaced),
                VehicleReply::Text(text) => note(Note::Text(text)),
                // Every attempt is refused in the same way.
                VehicleReply::Refused(refusal) if refusal != monitor.refusal() => {
                    note(Note::Refused(refusal));
                }
                _ => {}
            }
            monitor.receive(now, reply);
        };
        transport.unwrap(bytes, &mut |payload| protocol.decode(now, payload, &mut take));
    }

    /// Begins the set-point that is due, if the port is free. If none is sent, because there is no port or another has control, returns
    /// the report that is due.
    pub fn turn(&mut self, now: Time, note: &mut dyn FnMut(Note)) -> Option<VehicleReport> {
        self.note_changes(now, note);
        let waits = self.outbox.is_blocked() || self.holds_back(now);
        if waits || !self.is_setpoint_due(now) || now < self.outbox.clear_at(now) {
            return None;
        }
        if self.zero_first {
            self.begin_zero_setpoint(now);
            if !self.outbox.is_empty() {
                // A waiting command follows directly after this frame.
                self.schedule.add_setpoint(now, false);
                self.zero_first = false;
                return None;
            }
        }
        let may_stop_at_once = self.has_emergency_stop && self.gate.may_stop_at_once();
        let (setpoint, forwarded, event) = self.gate.select_command(now);
        self.flies = matches!(setpoint, VehicleSetpoint::Fly(_));
        if let Some(event) = event {
            let is_emergency = event == MotorEvent::StopFailed && may_stop_at_once;
            note(if is_emergency { Note::EmergencyStop } else { Note::Motors(event) });
            self.emergency_stop_waits |= is_emergency;
        }
        let with_command = std::mem::take(&mut self.command_waits);
        self.schedule.add_setpoint(now, with_command);
        self.words_left = self.protocol.periodic_count();
        if let Some(report) = self.report_written(now, forwarded) {
            return Some(report);
        }
        let frame = match setpoint {
            _ if !self.is_open => VehicleFrame::EMPTY,
            VehicleSetpoint::Released => VehicleFrame::EMPTY,
            _ => self.protocol.setpoint(now, &setpoint),
        };
        if frame.bytes().is_empty() {
            // A vehicle that is not there yet begins with a zero set-point, too.
            let is_unsent = self.is_open && setpoint != VehicleSetpoint::Released;
            self.zero_first |= is_unsent;
            // No set-point with thrust is sent: a stop has priority.
            self.stop_sent |= is_unsent && self.stopped_since.is_some();
            return Some(self.report(now, None, Span::ZERO));
        }
        self.begin(now, FrameKind::Setpoint(forwarded), &frame);
        None
    }

    /// Begins a frame that follows a set-point directly: the emergency stop, or a pose or a periodic frame if there is room for
    /// it. Returns whether a frame was begun; called until it returns false.
    pub fn follow_up(&mut self, now: Time) -> bool {
        if !self.is_open || !self.outbox.is_empty() {
            return false;
        }
        if std::mem::take(&mut self.emergency_stop_waits) && !self.gate.is_released() {
            let frame = self.protocol.emergency_stop();
            self.begin(now, FrameKind::EmergencyStop, &frame);
            return !self.outbox.is_empty();
        }
        let sending = self.outbox.time_for(self.sizes.periodic);
        if self.words_left == 0 || !self.schedule.has_room(now, self.outbox.ahead(now), sending) {
            return false;
        }
        let Some(word) = self.next_periodic(now) else { return false };
        self.words_left -= 1;
        self.schedule.add_periodic(now);
        let kind = FrameKind::Periodic { is_answered: word.is_answered };
        self.begin(now, kind, &word.frame);
        true
    }

    /// The pose that is due, or else the periodic frame.
    fn next_periodic(&mut self, now: Time) -> Option<PeriodicFrame> {
        let pose = self.protocol.pose_period().and_then(|period| self.poses.take(now, period));
        let frame = pose.map(|pose| self.protocol.pose(now, &pose));
        match frame.filter(|frame| !frame.bytes().is_empty()) {
            Some(frame) => Some(PeriodicFrame { frame, is_answered: false }),
            None => self.protocol.periodic(now, self.gate.is_in_sequence()),
        }
    }

    /// Bytes to write to the port: the rest of the frame being sent.
    pub fn outbox(&self) -> &[u8] {
        self.outbox.bytes()
    }

    /// Records that the port took `bytes` at `now`. With the last byte of a set-point, returns the report that is due.
    pub fn handed_over(&mut self, now: Time, bytes: usize) -> Option<VehicleReport> {
        let (kind, on_wire) = self.outbox.handed_over(now, bytes)?;
        match kind {
            FrameKind::Setpoint(forwarded) => {
                self.stop_sent |= self.stop_begun;
                if self.sizes.acknowledgement > 0 {
                    self.monitor.count_request(now);
                }
                Some(self.report(now, forwarded, on_wire))
            }
            FrameKind::Periodic { is_answered } => {
                if is_answered {
                    self.monitor.count_request(now);
                }
                None
            }
            FrameKind::EmergencyStop => None,
        }
    }

    /// Checks the port, which still has `queued` bytes to send; returns whether everything handed over is to be discarded, as
    /// `Outbox::is_stuck`.
    pub fn is_stuck(&mut self, now: Time, queued: usize) -> bool {
        self.outbox.is_stuck(now, queued)
    }

    /// Records that everything handed over was discarded: the next frame is a zero set-point.
    pub fn discard_outgoing(&mut self) {
        self.outbox.clear();
        // Nor does the frame of a tenant count that was written in part.
        self.written = None;
        self.zero_first = true;
    }

    /// Begins a zero set-point for any command; nothing if another has control.
    fn begin_zero_setpoint(&mut self, now: Time) {
        if !self.gate.is_released() {
            let frame = self.protocol.setpoint(now, &VehicleSetpoint::Zero);
            self.begin(now, FrameKind::Setpoint(None), &frame);
        }
    }

    /// Time until everything handed over has left.
    pub fn ahead(&self, now: Time) -> Span {
        self.outbox.ahead(now)
    }

    /// Whether a port is open and the vehicle has replied within the silence time.
    pub fn is_answering(&self, now: Time) -> bool {
        self.is_open && self.monitor.is_answering(now)
    }

    /// Logs when the vehicle stops answering or answers again, and rejected commands.
    fn note_changes(&mut self, now: Time, note: &mut dyn FnMut(Note)) {
        let is_answering = self.is_answering(now);
        let was_answering = std::mem::replace(&mut self.was_answering, is_answering);
        let never_answers =
            self.unanswered_since.is_some_and(|since| now.since(since) > LONGEST_START);
        if self.is_open && (was_answering != is_answering || never_answers) {
            self.unanswered_since = None;
            let damaged = self.protocol.damaged() + self.transport.damaged();
            note(if is_answering { Note::Answering } else { Note::Silent { damaged } });
        }
        let rejected = self.gate.rejected();
        if rejected > self.rejected {
            // Of a run of rejected commands the first is logged.
            if !self.rejected_at.is_set() || now.since(self.rejected_at) > REJECTION_PAUSE {
                note(Note::CommandRejected);
            }
            (self.rejected, self.rejected_at) = (rejected, now);
        }
    }

    /// Begins `frame`, unless it is empty: the protocol has no frame of this kind.
    fn begin(&mut self, now: Time, kind: FrameKind, frame: &VehicleFrame) {
        if frame.bytes().is_empty() {
            return;
        }
        if let FrameKind::Setpoint(_) = kind {
            self.stop_begun = self.stopped_since.is_some();
        }
        self.outbox.begin(now, kind, self.transport.wrap(frame));
    }
}
