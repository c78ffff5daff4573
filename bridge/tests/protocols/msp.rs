//! Vehicles with Betaflight, for the rules of the bridge: one whose receiver is MSP, and one whose pilot has a receiver, with MSP
//! override behind the first page of modes.

use oqtal_bridge::{Bridge, Msp, transport};
use oqtal_bus::time::Time;
use oqtal_config::{Config, Setting};
use oqtal_wire::msp::{
    MSP_RATE_UNIT, MspChannelMap, MspKind, MspPacket, MspStatus, MspSticks, command,
};
use oqtal_wire::xbee::Address;

use super::protocol::{Protocol, ProtocolVehicle, Understood};

/// The rows of this protocol.
pub const RX_MSP: Protocol =
    Protocol { name: "msp", bridge: |now| bridge(now, 1000.0), vehicle: || with_failsafe(3) };
pub const OVERRIDE: Protocol = Protocol {
    name: "msp override",
    bridge: |now| bridge(now, f64::INFINITY),
    vehicle: || Box::new(Betaflight { has_pilot: true, ..Betaflight::new(3) }),
};
/// MSP override, which has no time-out, with the limit as shipped.
pub const LIMITED_OVERRIDE: Protocol = Protocol { bridge: RX_MSP.bridge, ..OVERRIDE };

/// Roll rate at full stick of a command, as shipped \[rad/s\], and of the vehicle \[10 deg/s\].
const AUTHORITY: f64 = 2.0;
const FULL: u8 = 12;
/// Number of the mode "MSP override" \[-\].
const MSP_OVERRIDE: u8 = 50;

fn bridge(now: Time, time_out_ms: f64) -> Bridge {
    let preset = Setting::flag("test", "vehicle.preset", "betaflight-quad");
    let mut config = Config::load(&[], &[preset]).unwrap();
    config.safety.vehicle_time_out_ms = time_out_ms;
    let link = "msp:tcp:127.0.0.1:5761".parse().unwrap();
    let protocol = Msp::new(&config).unwrap();
    Bridge::new(&config, Box::new(protocol), transport(&link, Address::BROADCAST), now)
}

/// Frames with the arming switch off after which the vehicle disarms \[-\].
const DISARM_FRAMES: u8 = 4;

/// Number of the mode "MSP override" among those of a status \[-\].
const OVERRIDE_BIT: usize = 32;

/// A vehicle whose receiver is MSP and whose failsafe acts after `delay` \[0.1 s\].
pub fn with_failsafe(delay: u8) -> Box<dyn ProtocolVehicle> {
    Box::new(Betaflight::new(delay))
}

struct Betaflight {
    delay: u8,
    /// Whether its receiver is a pilot's, and MSP overrides it.
    has_pilot: bool,
    is_armed: bool,
    /// Frames since the switch was on \[-\].
    off_frames: u8,
    /// The pilot has switched MSP override off.
    is_piloted: bool,
    told_piloted: bool,
}

impl ProtocolVehicle for Betaflight {
    fn take(&mut self, _: Time, frame: &[u8], answers: &mut Vec<Vec<u8>>) -> Understood {
        let mut decoder = oqtal_wire::msp::MspDecoder::new();
        let request = decoder.push(frame).next().unwrap();
        let (payload, understood) = match request.command {
            command::CHANNELS => (Vec::new(), self.channels(request.payload())),
            command::MODES => {
                let page = request.payload().first().copied().unwrap_or_default();
                (self.modes(page), Understood::Word)
            }
            number => (self.reply(number), Understood::Word),
        };
        let reply = MspPacket::new(MspKind::Reply, request.command, &payload);
        answers.push(reply.as_bytes().to_vec());
        understood
    }

    fn tick(&mut self, _: Time, _: &mut Vec<Vec<u8>>) {}

    fn manual_override(&mut self, motors_on: bool, is_piloted: bool) {
        (self.is_armed, self.is_piloted) = (motors_on, self.has_pilot && motors_on && is_piloted);
        self.off_frames = 0;
    }

    fn motors_on(&self) -> bool {
        self.is_armed
    }

    fn told_piloted(&self) -> bool {
        self.told_piloted
    }
}

impl Betaflight {
    fn new(delay: u8) -> Self {
        Self {
            delay,
            has_pilot: false,
            is_armed: false,
            off_frames: 0,
            is_piloted: false,
            told_piloted: false,
        }
    }

    /// A page of the modes: armed, beeper 31 times, MSP override.
    fn modes(&self, page: u8) -> Vec<u8> {
        match (self.has_pilot, page) {
            (false, _) => vec![0],
            (true, 0) => [&[0][..], &[13; OVERRIDE_BIT - 1]].concat(),
            (true, _) => vec![MSP_OVERRIDE],
        }
    }

    fn channels(&mut self, payload: &[u8]) -> Understood {
        let (sticks, switches) = MspSticks::read(payload, MspChannelMap::FACTORY).unwrap();
        let is_on = switches[0] > 1700;
        let was_armed = self.is_armed;
        self.off_frames = if is_on { 0 } else { self.off_frames.saturating_add(1) };
        if !self.is_piloted {
            self.is_armed = is_on || was_armed && self.off_frames < DISARM_FRAMES;
        }
        match sticks.throttle > 0.0 {
            true => {
                let full = f64::from(FULL) * MSP_RATE_UNIT;
                Understood::Flight(sticks.deflections[0] * full / AUTHORITY)
            }
            // A switch that is off stops motors; it has no thrust.
            false if is_on && !was_armed => Understood::Motors,
            false => Understood::Zero,
        }
    }

    fn reply(&mut self, number: u8) -> Vec<u8> {
        match number {
            command::FIRMWARE => b"BTFL".to_vec(),
            command::CHANNEL_MAP => vec![0, 1, 3, 2],
            command::MODE_RANGES => vec![0, 0, 32, 48],
            // `RX_SERIAL` or `RX_MSP`.
            command::FEATURES => vec![8, if self.has_pilot { 0 } else { 1 << 6 }, 0, 0],
            command::RECEIVER => [&[0, 0x6C, 7, 0xDC, 5, 0x1A, 4][..], &[0; 25]].concat(),
            command::CONTROLLER => vec![0; 38],
            command::RATES => {
                let mut rates = [FULL, 0, FULL, FULL, FULL, 0, 50, 0, 0, 0, 0, FULL, FULL].to_vec();
                rates.extend([0; 9]);
                rates.extend([3, 50]);
                rates
            }
            command::FAILSAFE => vec![self.delay, 0, 0, 0, 0, 0, 0, 1],
            command::DEAD_BANDS => vec![0, 0],
            command::STATUS => {
                self.told_piloted = self.is_armed && self.is_piloted;
                let is_overridden = self.has_pilot && !self.is_piloted;
                let modes = u64::from(self.is_armed) | u64::from(is_overridden) << OVERRIDE_BIT;
                MspStatus { modes, ..MspStatus::default() }.payload().to_vec()
            }
            _ => Vec::new(),
        }
    }
}
