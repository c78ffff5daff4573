//! Emulated vehicle with Betaflight: channels over MSP control the plant. Pure: time is an argument.
//!
//! The vehicle is set up as `oqtal bridge setup` leaves it, except for the failsafe, whose time is `plant.wire.time-out-ms`. Settings
//! can be changed. Sources of the rules of arming: betaflight/betaflight, `core.c`, `rc_controls.c`, `failsafe.c`.

use oqtal_bus::message::{CommandV1, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, PlantOptions};
use oqtal_control::options::OptionError;
use oqtal_wire::ThrustCurve;
use oqtal_wire::msp::{
    MSP_ARM, MSP_RATE_UNIT, MspChannelMap, MspDecoder, MspKind, MspModeRange, MspPacket, MspStatus,
    MspSticks, command, msp_rates,
};

use super::command::rate_command;
use super::datagrams::DatagramModel;
use super::vehicle::{EmulatedVehicle, FrameCounters, Measured, OnBoardComputer};
use crate::plant::Plant;

/// Emulated vehicle controlled over MSP.
pub type MspVehicle = EmulatedVehicle<DatagramModel, MspBoard>;

/// Time without channels after which the receiver has lost its signal.
const SIGNAL_LOST: Span = Span::from_millis(150);
/// Time for which channels must have arrived before the vehicle can be armed.
const RECOVERY: Span = Span::from_millis(500);
/// Frames with the arming switch off after which the motors stop \[-\].
const DISARM_FRAMES: u32 = 4;
/// Bits of the reasons "signal lost", "not disarmed before" and "throttle", and number of reasons \[-\].
const RXLOSS: u32 = 1 << 2;
const NOT_DISARMED: u32 = 1 << 3;
const THROTTLE: u32 = 1 << 7;
const OBSTACLES: u8 = 29;
/// Range of the arming switch: the first auxiliary channel from 1700 to 2100 us.
const ARMING: MspModeRange = MspModeRange { mode: MSP_ARM, channel: 0, low: 32, high: 48 };
/// Requests that set what another one reads \[-\].
const SETTERS: [(u8, u8); 5] = [
    (command::SET_RATES, command::RATES),
    (command::SET_FAILSAFE, command::FAILSAFE),
    (command::SET_RECEIVER, command::RECEIVER),
    (command::SET_DEAD_BANDS, command::DEAD_BANDS),
    (command::SET_CONTROLLER, command::CONTROLLER),
];

impl MspVehicle {
    /// The vehicle of `config` on the floor at `start`.
    ///
    /// # Errors
    /// An option of `[plant.wire.msp]`, or a rate, is invalid.
    pub fn new(config: &Config, start: Time) -> Result<Self, OptionError> {
        let air = DatagramModel::new(&config.plant.wire, config.clock.seed);
        let board = MspBoard::new(&config.plant)?;
        Ok(Self::with_parts(Plant::new(config, start), air, board))
    }
}

/// On-board computer with Betaflight.
#[derive(Clone, Debug)]
pub struct MspBoard {
    thrust: ThrustCurve,
    authority: [f64; 3],
    /// Replies to requests of settings: command, payload.
    settings: Vec<(u8, Vec<u8>)>,
    decoder: MspDecoder,
    replies: Vec<MspPacket>,
    sticks: MspSticks,
    received_at: Option<Time>,
    /// Beginning of the present signal.
    signal_since: Time,
    is_armed: bool,
    /// Whether the arming switch was off since the signal began.
    was_off: bool,
    /// Frames since the switch was on \[-\].
    off_frames: u32,
}

impl MspBoard {
    fn new(plant: &PlantOptions) -> Result<Self, OptionError> {
        let table = &plant.wire.msp.thrust_table;
        let thrust = ThrustCurve::new(table).map_err(|error| {
            OptionError::new("plant.wire.msp.thrust-table", "unusable", error.to_string())
        })?;
        let authority = plant.rate_authority_rad_s;
        let rates = msp_rates(authority).ok_or_else(|| {
            let (found, rule) = (format!("{authority:?}"), "at most 34.9 for Betaflight");
            OptionError::new("plant.rate-authority-rad-s", found, rule)
        })?;
        Ok(Self {
            thrust,
            authority,
            settings: settings(rates, plant.wire.time_out_ms),
            decoder: MspDecoder::new(),
            replies: Vec::with_capacity(16),
            sticks: MspSticks::ZERO,
            received_at: None,
            signal_since: Time::UNSET,
            is_armed: false,
            was_off: false,
            off_frames: DISARM_FRAMES,
        })
    }

    /// Whether the motors run.
    pub fn motors_run(&self) -> bool {
        self.is_armed
    }

    fn setting(&self, number: u8) -> &[u8] {
        let known = self.settings.iter().find(|(known, _)| *known == number);
        known.map_or(&[], |(_, payload)| payload)
    }

    /// The reply to a request; `None` for an unknown one.
    fn execute(&mut self, now: Time, request: &MspPacket, volts: f64) -> Option<Vec<u8>> {
        let payload = request.payload();
        match request.command {
            command::CHANNELS => self.take_channels(now, payload),
            command::STATUS => return Some(self.status(now).payload().to_vec()),
            command::BATTERY => return Some(battery(volts)),
            command::SAVE => {}
            number => {
                let setter = SETTERS.iter().find(|(setter, _)| *setter == number);
                let read = setter.map_or(number, |(_, read)| *read);
                let known = self.settings.iter_mut().find(|(known, _)| *known == read)?;
                if setter.is_none() {
                    return Some(known.1.clone());
                }
                known.1 = payload.to_vec();
            }
        }
        Some(Vec::new())
    }

    fn take_channels(&mut self, now: Time, payload: &[u8]) {
        let Some((sticks, switches)) = MspSticks::read(payload, MspChannelMap::FACTORY) else {
            return;
        };
        if self.is_signal_lost(now) {
            (self.signal_since, self.was_off) = (now, false);
        }
        (self.sticks, self.received_at) = (sticks, Some(now));
        let is_on = ARMING.contains(switches[usize::from(ARMING.channel)]);
        self.off_frames = if is_on { 0 } else { self.off_frames.saturating_add(1) };
        self.was_off |= !is_on;
        if self.is_armed {
            self.is_armed = self.off_frames < DISARM_FRAMES;
        } else if is_on && self.obstacles(now) == 0 {
            (self.is_armed, self.was_off) = (true, false);
        }
    }

    fn is_signal_lost(&self, now: Time) -> bool {
        self.received_at.is_none_or(|at| now.since(at) > SIGNAL_LOST)
    }

    fn obstacles(&self, now: Time) -> u32 {
        let is_early = now.since(self.signal_since) < RECOVERY;
        let obstacles = [
            (self.is_signal_lost(now) || is_early, RXLOSS),
            (!self.was_off, NOT_DISARMED),
            (self.sticks.throttle > 0.0, THROTTLE),
        ];
        obstacles.iter().filter(|(holds, _)| *holds).fold(0, |all, (_, bit)| all | bit)
    }

    fn status(&self, now: Time) -> MspStatus {
        let obstacles = if self.is_armed { 0 } else { self.obstacles(now) };
        MspStatus { modes: u64::from(self.is_armed), obstacles, obstacle_count: OBSTACLES }
    }
}

impl OnBoardComputer for MspBoard {
    fn next_event(&self) -> Option<Time> {
        None
    }

    fn receive(&mut self, now: Time, bytes: &[u8], measured: &Measured) {
        let mut decoder = std::mem::take(&mut self.decoder);
        for request in decoder.push(bytes).filter(|packet| packet.kind == MspKind::Request) {
            let reply = self.execute(now, &request, measured.battery_v);
            let kind = if reply.is_some() { MspKind::Reply } else { MspKind::Refusal };
            self.replies.push(MspPacket::new(kind, request.command, &reply.unwrap_or_default()));
        }
        self.decoder = decoder;
    }

    /// Failsafe "drop": without channels the motors stop.
    fn tick(&mut self, now: Time, _: &Measured) {
        let delay = self.setting(command::FAILSAFE).first().copied().unwrap_or_default();
        let delay = Span::from_millis(100 * i64::from(delay.max(1)));
        self.is_armed &= self.received_at.is_some_and(|at| now.since(at) <= delay);
    }

    fn reply(&mut self, send: &mut dyn FnMut(&[u8])) {
        self.replies.drain(..).for_each(|packet| send(packet.as_bytes()));
    }

    fn command(&self, _: Time, _: &TruthV1) -> CommandV1 {
        if !self.is_armed {
            return CommandV1::default();
        }
        let full = self.setting(command::RATES);
        let rate = |axis: usize| {
            let full = full.get(2 + axis).copied().unwrap_or_default();
            self.sticks.deflections[axis] * f64::from(full) * MSP_RATE_UNIT
        };
        let thrust = self.thrust.delta(self.sticks.throttle);
        rate_command([0, 1, 2].map(rate), self.authority, thrust)
    }

    fn counters(&self) -> FrameCounters {
        let decoded = self.decoder.counters();
        FrameCounters { read: decoded.frames, damaged: decoded.damaged }
    }
}

/// Settings with these rates at full stick \[10 deg/s\] and this time of the failsafe \[ms\].
fn settings([roll, pitch, yaw]: [u8; 3], time_out_ms: f64) -> Vec<(u8, Vec<u8>)> {
    let MspModeRange { mode, channel, low, high } = ARMING;
    let mut ranges = vec![0; 80];
    ranges[..4].copy_from_slice(&[mode, channel, low, high]);
    let rates = [
        &[roll, 0, roll, pitch, yaw, 0, 50, 0, 0, 0, 0, yaw, pitch, 0, 0, 100][..],
        &[0xCE, 7, 0xCE, 7, 0xCE, 7, 3, 50],
    ];
    let delay = (time_out_ms / 100.0).round() as u8;
    vec![
        (command::FIRMWARE, b"BTFL".to_vec()),
        (command::CHANNEL_MAP, vec![0, 1, 3, 2, 4, 5, 6, 7]),
        (command::MODES, vec![MSP_ARM]),
        (command::MODE_RANGES, ranges),
        (command::FEATURES, (1_u32 << 14).to_le_bytes().to_vec()),
        (command::RECEIVER, [&[0, 0x6C, 7, 0xDC, 5, 0x1A, 4][..], &[0; 25]].concat()),
        (command::RATES, rates.concat()),
        (command::FAILSAFE, vec![delay, 60, 0xE8, 3, 0, 100, 0, 1]),
        (command::DEAD_BANDS, vec![0; 5]),
        (command::CONTROLLER, vec![0; 38]),
    ]
}

fn battery(volts: f64) -> Vec<u8> {
    // Conversions saturate.
    let mut payload = vec![(volts * 10.0).round() as u8, 0, 0, 0, 0, 0, 0];
    payload.extend(((volts * 100.0).round() as u16).to_le_bytes());
    payload
}
