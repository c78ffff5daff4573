//! Protocol of the Crazyflie: set-points to packets, reports to replies. Packets and their signs are `oqtal-wire`'s.
//!
//! | file | subject |
//! |---|---|
//! | `connection.rs` | the sequence that sets a vehicle up |
//! | `search.rs`, `known.rs`, `names.rs` | tables of contents: the search, what is known of earlier ones, the names that are used |
//! | `cache.rs` | the file of known tables, written by the background thread |
//! | `status.rs` | what the vehicle reports |
//! | `arming.rs` | what starts and stops its motors |
//! | `console.rs` | its text, line by line |
//!
//! | `vehicle.interface` | roll and pitch of a set-point | yaw |
//! |---|---|---|
//! | `rate`, Eq. (61) | the rates that the command's sticks stand for | the rate |
//! | `attitude` | roll and pitch of the commanded attitude, as 3-2-1 angles | the rate that the command's stick stands for |
//!
//! The vehicle does not acknowledge set-points; the quality of the link is the share of returned echoes. No set-point is sent
//! until the vehicle is set up, because another host may control it. The zero set-point has no thrust, so that the motors do not
//! run; it also unlocks the thrust of the set-points after it.

mod arming;
mod cache;
mod connection;
mod console;
mod known;
mod names;
mod search;
mod status;

use oqtal_bus::code::{EstimatorState, VehicleRefusal};
use oqtal_bus::lease::EncoderState;
use oqtal_bus::message::CommandV1;
use oqtal_bus::text::ShortText;
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, VehicleOptions};
use oqtal_control::euler::EulerAngles;
use oqtal_control::options::OptionError;
use oqtal_control::quaternion::Attitude;
use oqtal_wire::crtp::{
    CrtpPacket, CrtpPose, CrtpReply, CrtpRequest, CrtpThrustCurve, LegacySetpoint, MAX_CRTP_PACKET,
    MAX_CRTP_THRUST, PackedPose, PackedPoses, Supervision, SupervisorCommand,
};

use crate::protocol::{
    FrameSizes, PeriodicFrame, PeriodicTimer, ReportedMotors, VehicleEstimate, VehicleFrame,
    VehiclePose, VehicleProtocol, VehicleReply, VehicleText,
};
use crate::setpoint::VehicleSetpoint;
use arming::Arming;
use connection::{ConnectionOptions, CrtpConnection};
use console::ConsoleLine;
use status::{CrazyflieStatus, StatusUpdate};

pub use cache::{TableKeeper, TableStore};

/// Time between two echoes.
const ECHO_PERIOD: Span = Span::from_millis(100);
/// Time between two keep-alives; the vehicle needs one per second.
const KEEP_ALIVE_PERIOD: Span = Span::from_millis(200);
/// Time without a set-point after which the vehicle levels out, a constant of its firmware: COMMANDER_WDT_TIMEOUT_STABILIZE.
const LEVEL_AFTER: Span = Span::from_millis(500);
/// Most packets behind one set-point \[-\]: with it, what the shortest queue of firmware holds.
const WORDS: usize = 3;
/// Longest time between two reads of the port.
const READ_PERIOD: Span = Span::from_millis(5);
/// Share by which the greatest thrust of a command may exceed the thrust at maximum counts, because of rounded values \[-\].
const THRUST_TOLERANCE: f64 = 0.02;
/// Length of a set-point \[bytes\].
const SETPOINT_BYTES: usize = 15;

/// Conversion of commands to set-points.
#[derive(Clone, Copy, Debug)]
struct CrtpScales {
    holds_attitude: bool,
    /// Body rates at full stick \[rad/s\], Eq. (61).
    authority: [f64; 3],
    /// Collective thrust of a command of one \[N\].
    max_thrust: f64,
    curve: CrtpThrustCurve,
}

impl CrtpScales {
    fn new(config: &Config) -> Result<Self, OptionError> {
        let curve = config.bridge.crtp.thrust_curve_n;
        let refused = || {
            let rule = "coefficients of a thrust that rises from zero to full duty";
            OptionError::new("bridge.crtp.thrust-curve-n", format!("{curve:?}"), rule)
        };
        let (curve, max_thrust) =
            (CrtpThrustCurve::new(curve).ok_or_else(refused)?, config.vehicle.max_thrust_n);
        let greatest = curve.force(MAX_CRTP_THRUST);
        if max_thrust > greatest * (1.0 + THRUST_TOLERANCE) {
            let rule = format!(
                "at most {greatest:.3}, the thrust of {MAX_CRTP_THRUST} counts by bridge.crtp.thrust-curve-n; set vehicle.preset = \"crazyflie-2.1\", or the values of the vehicle"
            );
            return Err(OptionError::new("vehicle.max-thrust-n", max_thrust, rule));
        }
        let VehicleOptions { interface, rate_authority_rad_s: authority, .. } = config.vehicle;
        Ok(Self { holds_attitude: interface.holds_attitude(), authority, max_thrust, curve })
    }

    /// Converts a command; `None` if roll and pitch are angles and the command has no attitude.
    fn setpoint(&self, command: &CommandV1) -> Option<LegacySetpoint> {
        let [roll, pitch, yaw_rate] = [0, 1, 2].map(|i| command.sticks[i] * self.authority[i]);
        let thrust = self.curve.counts(command.thrust * self.max_thrust);
        if !self.holds_attitude {
            return Some(LegacySetpoint { roll, pitch, yaw_rate, thrust });
        }
        let angles = EulerAngles::from_attitude(&Attitude::from_xyzw(command.attitude)?);
        Some(LegacySetpoint { roll: angles.roll, pitch: angles.pitch, yaw_rate, thrust })
    }
}

/// The protocol of the Crazyflie.
#[derive(Debug)]
pub struct Crtp {
    scales: CrtpScales,
    connection: CrtpConnection,
    status: CrazyflieStatus,
    arming: Arming,
    console: ConsoleLine,
    /// Last reported reason why the vehicle cannot fly.
    last_reported: Option<ShortText>,
    /// Time without a report after which the connection begins again.
    silence: Span,
    pose_period: Option<Span>,
    /// Last byte of the vehicle's radio address; `None` without a radio.
    radio_id: Option<u8>,
    /// Whether another process has set the vehicle up.
    continues: bool,
    echo: PeriodicTimer,
    keep_alive: Option<PeriodicTimer>,
    damaged: u64,
}

impl Crtp {
    /// Protocol of `config`, with the tables of earlier connections. A vehicle on a radio has an address, which ends with `radio_id`.
    ///
    /// # Errors
    /// The thrust curve cannot be used.
    pub fn new(
        config: &Config,
        tables: TableStore,
        radio_id: Option<u8>,
    ) -> Result<Self, OptionError> {
        let options = &config.bridge.crtp;
        let scales = CrtpScales::new(config)?;
        let pose_period =
            (options.pose_rate_hz > 0.0).then(|| Span::period_of(options.pose_rate_hz));
        let connection = ConnectionOptions {
            holds_attitude: scales.holds_attitude,
            sends_poses: pose_period.is_some(),
            report_period: Span::period_of(options.log_rate_hz),
        };
        let keep_alive = options.keep_alive.then(|| PeriodicTimer::new(KEEP_ALIVE_PERIOD));
        Ok(Self {
            scales,
            connection: CrtpConnection::new(connection, tables),
            status: CrazyflieStatus::UNKNOWN,
            arming: Arming::new(),
            console: ConsoleLine::new(),
            last_reported: None,
            silence: Span::from_seconds(config.bridge.silence_ms * 1e-3),
            pose_period,
            radio_id,
            continues: false,
            echo: PeriodicTimer::new(ECHO_PERIOD),
            keep_alive,
            damaged: 0,
        })
    }

    fn restart(&mut self) {
        self.continues = false;
        self.connection.restart();
        (self.status, self.arming) = (CrazyflieStatus::UNKNOWN, Arming::new());
    }

    /// Takes one packet of the vehicle.
    fn take(&mut self, now: Time, packet: &CrtpPacket, reply: &mut dyn FnMut(VehicleReply)) {
        let Some(message) = CrtpReply::read(packet) else {
            self.damaged += 1;
            return;
        };
        match message {
            CrtpReply::Echo(sent) => {
                let sent_at = Time::UNSET + Span::from_nanos(sent.cast_signed());
                reply(VehicleReply::RoundTrip(now.since(sent_at)));
            }
            CrtpReply::Console(text) => {
                self.console.take(text, |text| {
                    reply(VehicleReply::Text(VehicleText { is_trouble: false, text }));
                });
            }
            CrtpReply::LogData { block, values, .. } => {
                let news = self.status.take(now, (block, values), &self.connection);
                self.report(now, news, reply);
            }
            CrtpReply::Granted(answer) if answer.is_arming && !answer.granted => {
                if self.arming.is_disarming() {
                    reply(VehicleReply::Refused(VehicleRefusal::Disarming));
                } else {
                    self.refuse(reply);
                }
            }
            other => {
                reply(VehicleReply::Other);
                self.connect(&other, reply);
            }
        }
    }

    fn connect(&mut self, message: &CrtpReply, reply: &mut dyn FnMut(VehicleReply)) {
        self.connection.take(message);
        if self.connection.is_unusable() {
            reply(VehicleReply::Refused(VehicleRefusal::OtherVersion));
        }
    }

    fn report(&mut self, now: Time, update: StatusUpdate, reply: &mut dyn FnMut(VehicleReply)) {
        match update {
            StatusUpdate::Status => {
                let state = self.status.supervision();
                reply(VehicleReply::Battery(self.status.battery_v()));
                let run = self.arming.motors_run(now, state);
                reply(VehicleReply::Motors(ReportedMotors::of(run)));
                reply(VehicleReply::BodyRate(self.status.body_rate()));
                if arming::obstacle(state).is_some() {
                    self.refuse(reply);
                } else if self.last_reported.take().is_some() {
                    reply(VehicleReply::Ready);
                }
            }
            StatusUpdate::Estimate => {
                if let Some((position, attitude)) = self.status.estimate() {
                    let state = EstimatorState::Unknown;
                    let estimate = VehicleEstimate { state, position, attitude };
                    reply(VehicleReply::Estimate(estimate));
                }
            }
            StatusUpdate::Nothing => reply(VehicleReply::Other),
        }
    }

    /// Tells why the vehicle cannot fly; its text once.
    fn refuse(&mut self, reply: &mut dyn FnMut(VehicleReply)) {
        let state = self.status.supervision();
        let is_locked = state.contains(Supervision::LOCKED);
        let refusal = if is_locked { VehicleRefusal::Locked } else { VehicleRefusal::Arming };
        reply(VehicleReply::Refused(refusal));
        let obstacle = arming::obstacle(state);
        if std::mem::replace(&mut self.last_reported, obstacle) != obstacle
            && let Some(text) = obstacle
        {
            reply(VehicleReply::Text(VehicleText { is_trouble: true, text }));
        }
    }

    fn supervisor(&self, command: SupervisorCommand) -> VehicleFrame {
        frame(&arming::request(self.connection.protocol(), command))
    }
}

impl VehicleProtocol for Crtp {
    fn sizes(&self) -> FrameSizes {
        FrameSizes {
            setpoint: SETPOINT_BYTES,
            acknowledgement: 0,
            periodic: MAX_CRTP_PACKET,
            periodic_reply: MAX_CRTP_PACKET,
        }
    }

    fn setpoint(&mut self, now: Time, setpoint: &VehicleSetpoint) -> VehicleFrame {
        if !self.connection.is_ready() && !self.continues {
            return VehicleFrame::EMPTY;
        }
        let state = self.status.supervision();
        let command = match setpoint {
            VehicleSetpoint::Released => return VehicleFrame::EMPTY,
            VehicleSetpoint::StartMotors => self.arming.start(now, state),
            VehicleSetpoint::StopMotors => self.arming.stop(now, state),
            VehicleSetpoint::Fly(_) => {
                self.arming.fly();
                None
            }
            VehicleSetpoint::Zero => None,
        };
        let sent = match setpoint {
            VehicleSetpoint::Fly(command) => self.scales.setpoint(command),
            _ => None,
        };
        match command {
            Some(command) => self.supervisor(command),
            None => frame(&CrtpRequest::Setpoint(sent.unwrap_or(LegacySetpoint::ZERO))),
        }
    }

    fn pose_period(&self) -> Option<Span> {
        self.pose_period
    }

    fn pose(&mut self, _now: Time, pose: &VehiclePose) -> VehicleFrame {
        if !self.connection.is_ready() {
            return VehicleFrame::EMPTY;
        }
        let q = pose.attitude.unit_quaternion();
        let pose = CrtpPose { position: pose.position, attitude: [q.i, q.j, q.k, q.w] };
        match self.radio_id {
            None => frame(&CrtpRequest::Pose(pose)),
            Some(id) => PackedPose::of(id, &pose).map_or(VehicleFrame::EMPTY, |packed| {
                frame(&CrtpRequest::Poses(PackedPoses::of(&[packed])))
            }),
        }
    }

    fn periodic_count(&self) -> usize {
        WORDS
    }

    fn read_period(&self) -> Option<Span> {
        Some(READ_PERIOD)
    }

    fn periodic(&mut self, now: Time, _is_status_urgent: bool) -> Option<PeriodicFrame> {
        if self.status.is_silent(now, self.silence) {
            self.restart();
        }
        let word = |frame| Some(PeriodicFrame { frame, is_answered: false });
        if let Some(request) = self.connection.request(now) {
            return word(frame(&request));
        }
        let keeps_alive = self.arming.was_started() && self.connection.is_ready();
        if keeps_alive && self.keep_alive.as_mut().is_some_and(|timer| timer.is_due(now, false)) {
            return word(self.supervisor(SupervisorCommand::KeepAlive));
        }
        let echo = || frame(&CrtpRequest::Echo(now.since(Time::UNSET).nanos().cast_unsigned()));
        self.echo.is_due(now, false).then(|| PeriodicFrame { frame: echo(), is_answered: true })
    }

    fn time_out(&self) -> Option<Span> {
        self.connection.is_ready().then_some(LEVEL_AFTER)
    }

    fn is_set_up(&self) -> bool {
        self.connection.is_ready()
    }

    fn emergency_stop(&mut self) -> VehicleFrame {
        self.supervisor(SupervisorCommand::EmergencyStop)
    }

    /// The end of the set-points: the vehicle continues without thrust, and counts as landed. The emergency stop would lock it.
    fn final_stop(&mut self) -> VehicleFrame {
        frame(&CrtpRequest::EndOfSetpoints(0))
    }

    fn decode(&mut self, now: Time, bytes: &[u8], reply: &mut dyn FnMut(VehicleReply)) {
        match CrtpPacket::parse(bytes) {
            Ok(packet) if packet.is_null() => reply(VehicleReply::Other),
            Ok(packet) => self.take(now, &packet, reply),
            Err(_) => self.damaged += 1,
        }
    }

    fn encoder_state(&self) -> Option<EncoderState> {
        self.connection.is_ready().then(EncoderState::default)
    }

    fn continue_encoder(&mut self, _state: &EncoderState) {
        self.continues = true;
    }

    fn damaged(&self) -> u64 {
        self.damaged
    }

    fn reset(&mut self) {
        self.restart();
        (self.console, self.last_reported) = (ConsoleLine::new(), None);
        self.echo.restart();
    }
}

fn frame(request: &CrtpRequest) -> VehicleFrame {
    VehicleFrame::of(request.packet().as_bytes())
}
