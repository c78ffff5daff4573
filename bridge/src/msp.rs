//! Protocol of Betaflight: set-points to the channels of a remote control, replies to the state of the vehicle. Packets and signs of
//! sticks are `oqtal-wire`'s; `settings.rs` has the settings that the vehicle must have.
//!
//! Sticks are body rates (acro): the gyroscope alone closes the loop on board, at kilohertz, and attitude and heading are those of the
//! cameras. In angle mode the vehicle would hold its attitude by the accelerometer, and its heading would drift.
//!
//! The arming switch has a level: it is on while this bridge starts the motors and while they run, and off in every other set-point.
//! While a reason prevents arming it is off, too, because Betaflight arms only at the change.
//!
//! No set-point is sent until the settings are known. A vehicle that restarts may have others, and no reply of Betaflight reveals a
//! short restart: while the motors are off the settings are read again every second, and once more before they start.
//!
//! Every set-point is acknowledged; `backlog.rs` counts those that wait.

mod backlog;
mod settings;

use std::io::Write as _;

use oqtal_bus::code::{ControlHolder, VehicleRefusal};
use oqtal_bus::message::CommandV1;
use oqtal_bus::text::ShortText;
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Interface};
use oqtal_control::options::OptionError;
use oqtal_wire::ThrustCurve;
use oqtal_wire::msp::{
    MSP_CHANNELS, MSP_ENVELOPE, MSP_RATE_UNIT, MspChannelMap, MspDecoder, MspKind, MspPacket,
    MspStatus, MspSticks, arming_obstacle, battery_v, command, msp_rates,
};

use crate::options;
use crate::protocol::{
    FrameSizes, PeriodicFrame, PeriodicTimer, ReportedMotors, VehicleFrame, VehicleProtocol,
    VehicleReply, VehicleText,
};
use crate::setpoint::VehicleSetpoint;
use crate::timing::millis;

use backlog::Backlog;
pub(crate) use settings::{MspField, MspSettings};

/// Greatest rate of set-points \[Hz\]: Betaflight executes 100 requests a second, those of the status included.
const MAX_RATE_HZ: f64 = 75.0;
/// Shortest time between two requests of the status.
const STATUS_SPACING: Span = Span::from_millis(50);
/// Time between two requests of the battery.
const BATTERY_PERIOD: Span = Span::from_millis(1000);
/// Time after which a request of the settings is repeated.
const REPEAT: Span = Span::from_millis(250);
/// Age at which the settings of a vehicle with stopped motors are read again.
const SETTINGS_AGE: Span = Span::from_millis(1000);
/// Time of a start sequence after which reasons that prevent arming are reported; until then they may end without action.
const REFUSED_AFTER: Span = Span::from_millis(1000);
/// Deviation of a vehicle with a pilot's receiver from `safety.vehicle-time-out-ms`, for display.
const NO_TIME_OUT: &str = "MSP override: no time-out";
/// Lengths of the longest reply in flight, the status, and of a set-point \[bytes\].
const LONGEST_STATUS: usize = 32;
const SETPOINT_BYTES: usize = MSP_ENVELOPE + 2 * MSP_CHANNELS;

/// Rates at full stick of the vehicle's rate profile that `config` needs \[10 deg/s\].
///
/// # Errors
/// A rate is beyond what the profile can have.
pub(crate) fn full_rates(config: &Config) -> Result<[u8; 3], OptionError> {
    let authority = config.vehicle.rate_authority_rad_s;
    msp_rates(authority).ok_or_else(|| {
        let found = format!("{authority:?}");
        let rule = "at most 34.9, the greatest rate of Betaflight's rate profile";
        OptionError::new("vehicle.rate-authority-rad-s", found, rule)
    })
}

/// The protocol of Betaflight.
#[derive(Debug)]
pub struct Msp {
    /// Rates at full stick \[10 deg/s\].
    rates: [u8; 3],
    /// Rates of a full stick of a command \[rad/s\].
    authority: [f64; 3],
    thrust: ThrustCurve,
    /// `safety.vehicle-time-out-ms`; `None` for any time-out.
    longest_time_out: Option<Span>,
    decoder: MspDecoder,
    settings: MspSettings,
    status: Option<MspStatus>,
    /// Beginning of the start sequence.
    started_at: Option<Time>,
    /// Whether the arming switch is on.
    is_on: bool,
    /// Last reported reason why the vehicle does not arm.
    last_reported: Option<&'static str>,
    backlog: Backlog,
    received_at: Time,
    /// Time without a reply after which the settings are read again.
    silence: Span,
    setting_timer: PeriodicTimer,
    status_timer: PeriodicTimer,
    urgent_timer: PeriodicTimer,
    battery_timer: PeriodicTimer,
}

impl Msp {
    /// Protocol of `config`.
    ///
    /// # Errors
    /// The vehicle does not take body rates, they are too fast, set-points are too frequent, or the thrust curve cannot be used.
    pub fn new(config: &Config) -> Result<Self, OptionError> {
        if config.vehicle.interface != Interface::Rate {
            let found = config.vehicle.interface;
            let rule = "\"rate\" for Betaflight, whose angle mode does not know the heading";
            return Err(OptionError::new("vehicle.interface", format!("{found:?}"), rule));
        }
        if config.control.rate_hz > MAX_RATE_HZ {
            let rule = format!(
                "at most {MAX_RATE_HZ} for Betaflight, which executes 100 requests a second"
            );
            return Err(OptionError::new("control.rate-hz", config.control.rate_hz, rule));
        }
        let time_out_ms = config.safety.vehicle_time_out_ms;
        Ok(Self {
            rates: full_rates(config)?,
            authority: config.vehicle.rate_authority_rad_s,
            thrust: options::thrust_curve("msp", &config.bridge.msp.thrust_table)?,
            longest_time_out: time_out_ms.is_finite().then(|| millis(time_out_ms)),
            decoder: MspDecoder::new(),
            settings: MspSettings::default(),
            status: None,
            started_at: None,
            is_on: false,
            last_reported: None,
            backlog: Backlog::default(),
            received_at: Time::UNSET,
            silence: millis(config.bridge.silence_ms),
            setting_timer: PeriodicTimer::new(REPEAT),
            status_timer: PeriodicTimer::new(Span::period_of(config.bridge.status_rate_hz)),
            urgent_timer: PeriodicTimer::new(STATUS_SPACING),
            battery_timer: PeriodicTimer::new(BATTERY_PERIOD),
        })
    }

    /// Discards the state of the vehicle; its settings are read again.
    fn restart(&mut self) {
        (self.settings, self.status, self.last_reported) = (MspSettings::default(), None, None);
        (self.started_at, self.is_on) = (None, false);
        self.backlog = Backlog::default();
        self.setting_timer.restart();
    }

    /// Order of the channels, once the settings and the state of the vehicle are known.
    fn ready(&self) -> Option<MspChannelMap> {
        let is_known = self.settings.unread().is_none() && self.settings.is_betaflight();
        let map = self.settings.channel_map();
        map.filter(|_| is_known && self.status.is_some())
    }

    fn is_armed(&self) -> bool {
        self.status.is_some_and(|status| status.is_armed())
    }

    /// Name of the first setting with which the motors are not started. The time of the failsafe is compared here, too: the daemon
    /// has compared the one that was read before the start.
    fn deviation(&self) -> Option<&'static str> {
        let time_out = self.settings.time_out();
        let is_soon = |longest| time_out.is_some_and(|time_out| time_out <= longest);
        let acts = self.longest_time_out.is_none_or(is_soon);
        let name = match time_out {
            _ if !self.settings.has_msp_receiver() => NO_TIME_OUT,
            Some(_) => "failsafe_delay",
            None => "failsafe_procedure",
        };
        self.settings.deviation(self.rates).or((!acts).then_some(name))
    }

    /// Instant since which the settings are to be read at `now`, if they were read before.
    fn settings_since(&self, now: Time) -> Time {
        let at_rest = if self.is_armed() { Time::UNSET } else { now - SETTINGS_AGE };
        self.started_at.unwrap_or(at_rest)
    }

    /// Moves the arming switch for a set-point that is sent at `now`.
    fn switch(&mut self, now: Time, setpoint: &VehicleSetpoint) {
        self.is_on = match setpoint {
            VehicleSetpoint::StartMotors => {
                let since = *self.started_at.get_or_insert(now);
                let is_read = self.settings.unread_since(since).is_none();
                let is_free = self.status.is_some_and(|status| status.obstacles == 0);
                is_read && is_free && self.deviation().is_none()
            }
            VehicleSetpoint::StopMotors => false,
            // Motors that somebody else started, or that stopped by themselves, are not switched on.
            _ => self.is_on && self.is_armed(),
        };
        if *setpoint != VehicleSetpoint::StartMotors {
            self.started_at = None;
        }
    }

    fn sticks(&self, command: &CommandV1) -> MspSticks {
        let deflection = |axis: usize| {
            command.sticks[axis] * self.authority[axis]
                / (f64::from(self.rates[axis]) * MSP_RATE_UNIT)
        };
        let throttle = self.thrust.thrust(command.thrust);
        MspSticks { deflections: [0, 1, 2].map(deflection), throttle }
    }

    /// Channels of `sticks` and of the arming switch.
    fn channels(&self, map: MspChannelMap, sticks: MspSticks) -> VehicleFrame {
        let switch = self.settings.arming_switch().map(|switch| {
            let [on, off] = switch.values;
            (switch.channel, if self.is_on { on } else { off })
        });
        let packet = MspPacket::request(command::CHANNELS, &sticks.payload(map, switch));
        VehicleFrame::of(packet.as_bytes())
    }

    /// Takes a reply or a refusal, which counts as an empty reply.
    fn take(&mut self, now: Time, packet: &MspPacket, reply: &mut dyn FnMut(VehicleReply)) {
        self.received_at = now;
        reply(VehicleReply::Answer);
        match packet.command {
            command::CHANNELS => self.backlog.acknowledge(now),
            command::STATUS => {
                self.backlog.take_status(now);
                if let Some(status) = MspStatus::read(packet.payload()) {
                    self.take_status(now, status, reply);
                }
            }
            command::BATTERY => {
                if let Some(volts) = battery_v(packet.payload()) {
                    reply(VehicleReply::Battery(volts));
                }
            }
            _ => {
                self.settings.take(now, packet);
                self.setting_timer.restart();
                let is_named = !self.settings.payload(command::FIRMWARE).is_empty();
                if is_named && !self.settings.is_betaflight() {
                    reply(VehicleReply::Refused(VehicleRefusal::OtherAutopilot));
                }
            }
        }
    }

    fn take_status(&mut self, now: Time, status: MspStatus, reply: &mut dyn FnMut(VehicleReply)) {
        let is_armed = status.is_armed();
        self.status = Some(status);
        let is_overridden = self.settings.override_bit().is_none_or(|bit| status.modes & bit != 0);
        let is_ours = is_overridden && self.settings.other_mode(status.modes).is_none();
        reply(VehicleReply::Motors(ReportedMotors::of(is_armed)));
        reply(VehicleReply::Control(match (is_armed, is_ours) {
            (false, _) => ControlHolder::Nobody,
            (true, true) => ControlHolder::Bridge,
            (true, false) => ControlHolder::Another,
        }));
        let is_late = self.started_at.is_some_and(|since| now.since(since) >= REFUSED_AFTER);
        if is_late && !is_armed {
            let obstacle = self.obstacle(&status, is_overridden);
            self.refuse(obstacle, reply);
        }
    }

    /// Reason why the vehicle does not arm.
    fn obstacle(&self, status: &MspStatus, is_overridden: bool) -> Option<&'static str> {
        let switched = (!is_overridden).then_some("MSP OVERRIDE off");
        let deviation = self.deviation();
        let mode = self.settings.other_mode(status.modes);
        deviation.or(switched).or(mode).or_else(|| arming_obstacle(status))
    }

    /// Reports why the vehicle does not arm; the text once.
    fn refuse(&mut self, obstacle: Option<&'static str>, reply: &mut dyn FnMut(VehicleReply)) {
        let Some(name) = obstacle else { return };
        reply(VehicleReply::Refused(VehicleRefusal::Arming));
        if self.last_reported.replace(name) != Some(name) {
            let is_setting = self.deviation() == Some(name) && name != NO_TIME_OUT;
            let hint = if is_setting { ": run oqtal bridge setup" } else { "" };
            let mut text = [0; 56];
            // A longer text is cut.
            let _ = write!(&mut text[..], "{name}{hint}");
            let text = ShortText::from_ascii(&text);
            reply(VehicleReply::Text(VehicleText { is_trouble: true, text }));
        }
    }
}

impl VehicleProtocol for Msp {
    fn sizes(&self) -> FrameSizes {
        FrameSizes {
            setpoint: SETPOINT_BYTES,
            acknowledgement: MSP_ENVELOPE,
            // The request of the second page of modes.
            periodic: MSP_ENVELOPE + 1,
            periodic_reply: LONGEST_STATUS,
        }
    }

    fn setpoint(&mut self, now: Time, setpoint: &VehicleSetpoint) -> VehicleFrame {
        self.switch(now, setpoint);
        let sticks = match setpoint {
            VehicleSetpoint::Released => return VehicleFrame::EMPTY,
            VehicleSetpoint::Fly(command) if self.is_on => self.sticks(command),
            _ => MspSticks::ZERO,
        };
        let Some(map) = self.ready() else { return VehicleFrame::EMPTY };
        self.backlog.send(now);
        self.channels(map, sticks)
    }

    fn is_busy(&self, now: Time) -> bool {
        self.backlog.is_long(now)
    }

    fn periodic(&mut self, now: Time, is_status_urgent: bool) -> Option<PeriodicFrame> {
        if self.received_at.is_set() && now.since(self.received_at) > self.silence {
            self.received_at = Time::UNSET;
            self.restart();
        }
        let request = |number| Some(MspPacket::request(number, &[]));
        let due = match self.settings.unread() {
            Some(setting) => self.setting_timer.is_due(now, false).then_some(setting),
            None if is_status_urgent && self.urgent_timer.is_due(now, false) => {
                request(command::STATUS)
            }
            None if self.status_timer.is_due(now, false) => request(command::STATUS),
            None if self.battery_timer.is_due(now, false) => request(command::BATTERY),
            None => {
                let old = self.settings.unread_since(self.settings_since(now));
                old.filter(|_| self.setting_timer.is_due(now, false))
            }
        };
        due.map(|request| {
            if request.command == command::STATUS {
                self.backlog.request_status();
            }
            let frame = VehicleFrame::of(request.as_bytes());
            PeriodicFrame { frame, is_answered: true }
        })
    }

    fn time_out(&self) -> Option<Span> {
        self.settings.time_out()
    }

    fn is_set_up(&self) -> bool {
        self.settings.unread().is_none()
    }

    /// Switches the arming switch off. Betaflight disarms after four such frames, or by its failsafe.
    fn emergency_stop(&mut self) -> VehicleFrame {
        self.is_on = false;
        self.ready().map_or(VehicleFrame::EMPTY, |map| self.channels(map, MspSticks::ZERO))
    }

    fn end_flight(&mut self) {
        self.is_on = false;
    }

    fn decode(&mut self, now: Time, bytes: &[u8], reply: &mut dyn FnMut(VehicleReply)) {
        let mut decoder = std::mem::take(&mut self.decoder);
        for packet in decoder.push(bytes).filter(|packet| packet.kind != MspKind::Request) {
            self.take(now, &packet, reply);
        }
        self.decoder = decoder;
    }

    fn damaged(&self) -> u64 {
        self.decoder.counters().damaged
    }

    fn reset(&mut self) {
        self.decoder.reset();
        self.received_at = Time::UNSET;
        self.restart();
        for timer in [&mut self.status_timer, &mut self.urgent_timer, &mut self.battery_timer] {
            timer.restart();
        }
    }
}
