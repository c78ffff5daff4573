//! Settings of a Betaflight vehicle that the bridge relies on, as they were read, and their rules.

use oqtal_bus::time::{Span, Time};
use oqtal_wire::msp::{MSP_ARM, MSP_AUX_CHANNELS, MspChannelMap, MspModeRange, MspPacket, command};

use crate::wanted::{WantedParameter, WantedValue};

/// Requests whose replies are read before the first set-point: command and payload.
const READ: [(u8, &[u8]); 11] = [
    (command::FIRMWARE, &[]),
    (command::CHANNEL_MAP, &[]),
    (command::MODES, &[]),
    (command::MODE_RANGES, &[]),
    (command::FEATURES, &[]),
    (command::RECEIVER, &[]),
    (command::RATES, &[]),
    (command::FAILSAFE, &[]),
    (command::DEAD_BANDS, &[]),
    (command::CONTROLLER, &[]),
    (command::MODES, &[1]),
];
/// Index of the second page of modes in [`READ`], which is read only if the first one is full.
const SECOND_PAGE: usize = READ.len() - 1;
/// Modes on a full page \[-\].
const PAGE: usize = 32;
/// Reply of the firmware's name.
const BETAFLIGHT: &[u8] = b"BTFL";
/// Feature "receiver over MSP".
const RX_MSP: u32 = 1 << 14;
/// Feature "3D": without throttle the rotors would turn backwards.
const FEATURE_3D: u32 = 1 << 12;
/// Unit of the failsafe's delay.
const DELAY_UNIT: Span = Span::from_millis(100);
/// Mode in which channels over MSP take the place of a pilot's.
const MSP_OVERRIDE: u8 = 50;
/// Modes that change the meaning of the sticks, or stop obeying them.
const OTHER_MODES: [(u8, &str); 15] = [
    (1, "ANGLE"),
    (2, "HORIZON"),
    (3, "ALTHOLD"),
    (5, "MAG"),
    (6, "HEADFREE"),
    (11, "POS HOLD"),
    (12, "PASSTHRU"),
    (27, "FAILSAFE"),
    (30, "FPV ANGLE MIX"),
    (35, "FLIP OVER AFTER CRASH"),
    (45, "PARALYZE"),
    (46, "GPS RESCUE"),
    (47, "ACRO TRAINER"),
    (49, "LAUNCH CONTROL"),
    (55, "CHIRP"),
];
/// Values of a switch that is off \[us\], in the order in which they are tried.
const OFF_US: [u16; 2] = [1000, 2000];

/// Setting with a rule.
#[derive(Clone, Copy, Debug)]
pub struct MspField {
    /// Name in Betaflight's command line, rule and reason. A rate is in 10 deg/s.
    pub parameter: WantedParameter,
    /// Request that reads it, and request that sets it with the same payload \[-\].
    pub commands: (u8, u8),
    /// Place in the payload, and length \[bytes\].
    place: (usize, usize),
    /// Axis whose rate at full stick the value has to be.
    axis: Option<usize>,
    /// Whether older versions have no such setting.
    is_recent: bool,
}

const RATES: (u8, u8) = (command::RATES, command::SET_RATES);
const FAILSAFE: (u8, u8) = (command::FAILSAFE, command::SET_FAILSAFE);
const RECEIVER: (u8, u8) = (command::RECEIVER, command::SET_RECEIVER);
const DEAD_BANDS: (u8, u8) = (command::DEAD_BANDS, command::SET_DEAD_BANDS);
const CONTROLLER: (u8, u8) = (command::CONTROLLER, command::SET_CONTROLLER);
const STRAIGHT: &str = "sticks and rates are proportional";
const RATE: &str = "rate at full stick: vehicle.rate-authority-rad-s, in 10 deg/s";
const AT_ONCE: &str = "set-points act at once; takes a restart";
const STEPS: &str = "set-points are steps, without a pilot's slope";
const THROTTLE: &str = "throttle is that of the set-point";

/// Shorthand for a setting of one byte.
const fn byte(
    name: &'static str,
    value: WantedValue,
    reason: &'static str,
    (commands, offset): ((u8, u8), usize),
) -> MspField {
    let parameter = WantedParameter { name, value, reason };
    MspField { parameter, commands, place: (offset, 1), axis: None, is_recent: false }
}

/// Shorthand for a rate.
const fn rate(name: &'static str, axis: usize, offset: usize) -> MspField {
    let field = byte(name, WantedValue::Exactly(0.0), RATE, (RATES, offset));
    MspField { axis: Some(axis), ..field }
}

const fn word(field: MspField) -> MspField {
    MspField { place: (field.place.0, 2), ..field }
}

const ZERO: WantedValue = WantedValue::Exactly(0.0);

/// All settings with rules.
const FIELDS: [MspField; 25] = [
    byte("rates_type", WantedValue::Exactly(3.0), "ACTUAL: straight without expo", (RATES, 22)),
    rate("roll_rc_rate", 0, 0),
    rate("pitch_rc_rate", 1, 12),
    rate("yaw_rc_rate", 2, 11),
    rate("roll_srate", 0, 2),
    rate("pitch_srate", 1, 3),
    rate("yaw_srate", 2, 4),
    byte("roll_expo", ZERO, STRAIGHT, (RATES, 1)),
    byte("pitch_expo", ZERO, STRAIGHT, (RATES, 13)),
    byte("yaw_expo", ZERO, STRAIGHT, (RATES, 10)),
    byte("thr_expo", ZERO, THROTTLE, (RATES, 7)),
    byte("thr_mid", WantedValue::Exactly(50.0), THROTTLE, (RATES, 6)),
    MspField {
        is_recent: true,
        ..byte("thr_hover", WantedValue::Exactly(50.0), THROTTLE, (RATES, 23))
    },
    byte("throttle_limit_type", ZERO, THROTTLE, (RATES, 14)),
    byte("throttle_boost", ZERO, THROTTLE, (CONTROLLER, 30)),
    byte("rc_smoothing", ZERO, AT_ONCE, (RECEIVER, 31)),
    word(byte("f_roll", ZERO, STEPS, (CONTROLLER, 32))),
    word(byte("f_pitch", ZERO, STEPS, (CONTROLLER, 34))),
    word(byte("f_yaw", ZERO, STEPS, (CONTROLLER, 36))),
    byte("deadband", ZERO, STRAIGHT, (DEAD_BANDS, 0)),
    byte("yaw_deadband", ZERO, STRAIGHT, (DEAD_BANDS, 1)),
    word(byte("mid_rc", WantedValue::Exactly(1500.0), "centred sticks", (RECEIVER, 3))),
    word(byte("min_check", WantedValue::Exactly(1050.0), THROTTLE, (RECEIVER, 5))),
    byte("failsafe_delay", WantedValue::AtMost(3.0), "0.1 s without a set-point", (FAILSAFE, 0)),
    byte("failsafe_procedure", WantedValue::Exactly(1.0), "then DROP: motors off", (FAILSAFE, 7)),
];

impl MspField {
    /// All settings with rules, for these rates at full stick \[10 deg/s\].
    pub fn all(rates: [u8; 3]) -> impl Iterator<Item = Self> {
        FIELDS.into_iter().map(move |mut field| {
            if let Some(axis) = field.axis {
                field.parameter.value = WantedValue::Exactly(f64::from(rates[axis]));
            }
            field
        })
    }

    /// The value in `payload` \[unit of the setting\]; `None` if it ends before.
    pub fn number(&self, payload: &[u8]) -> Option<f64> {
        let bytes = payload.get(self.place.0..self.place.0 + self.place.1)?;
        Some(bytes.iter().rev().fold(0.0, |number, byte| number * 256.0 + f64::from(*byte)))
    }

    /// Writes `number` \[unit of the setting\] in its place in `payload`.
    pub fn set(&self, payload: &mut [u8], number: f64) {
        let bytes = (number as u32).to_le_bytes();
        if let Some(place) = payload.get_mut(self.place.0..self.place.0 + self.place.1) {
            place.copy_from_slice(&bytes[..place.len()]);
        }
    }

    /// Whether the value in `payload` satisfies the rule.
    pub fn is_right(&self, payload: &[u8]) -> bool {
        self.number(payload).map_or(self.is_recent, |value| self.parameter.value.is_met_by(value))
    }
}

/// Switch that arms the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArmingSwitch {
    /// Index of the auxiliary channel, from 0 \[-\].
    pub channel: usize,
    /// Values of the channel for running motors, and for stopped ones \[us\].
    pub values: [u16; 2],
}

/// Settings as they were read: replies and their arrivals.
#[derive(Clone, Debug, Default)]
pub struct MspSettings([Option<(Time, MspPacket)>; READ.len()]);

impl MspSettings {
    /// The next request whose reply is not known; `None` if all are.
    pub fn unread(&self) -> Option<MspPacket> {
        self.unread_since(Time::UNSET)
    }

    /// The next request whose reply did not arrive at or after `since`; `None` if all did.
    pub fn unread_since(&self, since: Time) -> Option<MspPacket> {
        let count = if self.is_first_page_full() { READ.len() } else { SECOND_PAGE };
        let mut replies = self.0.iter().zip(READ).take(count);
        let is_old = |reply: &Option<(Time, MspPacket)>| reply.is_none_or(|(at, _)| at < since);
        let (_, (number, payload)) = replies.find(|(reply, _)| is_old(reply))?;
        Some(MspPacket::request(number, payload))
    }

    /// Takes the reply to a request of the settings, which arrived at `now`; any other is ignored.
    pub fn take(&mut self, now: Time, packet: &MspPacket) {
        // A reply does not name its page; the first one begins with the mode "armed".
        let is_second = packet.command == command::MODES
            && self.is_first_page_full()
            && packet.payload().first() != Some(&MSP_ARM);
        let index = READ.iter().position(|(number, _)| *number == packet.command);
        if let Some(index) = if is_second { Some(SECOND_PAGE) } else { index } {
            self.0[index] = Some((now, *packet));
        }
    }

    /// Payload of the first reply to the request `number`; empty if there is none.
    pub fn payload(&self, number: u8) -> &[u8] {
        let index = READ.iter().position(|(read, _)| *read == number);
        index.map_or(&[], |index| self.reply(index))
    }

    fn reply(&self, index: usize) -> &[u8] {
        self.0[index].as_ref().map_or(&[], |(_, packet)| packet.payload())
    }

    /// Whether the firmware is Betaflight.
    pub fn is_betaflight(&self) -> bool {
        self.payload(command::FIRMWARE) == BETAFLIGHT
    }

    /// Order of the channels; `None` if it is unusable.
    pub fn channel_map(&self) -> Option<MspChannelMap> {
        MspChannelMap::read(self.payload(command::CHANNEL_MAP))
    }

    /// The switch that arms the vehicle; `None` without a usable one.
    pub fn arming_switch(&self) -> Option<ArmingSwitch> {
        let ranges = || MspModeRange::all(self.payload(command::MODE_RANGES));
        let is_sent = |range: &MspModeRange| usize::from(range.channel) < MSP_AUX_CHANNELS;
        let range = ranges().find(MspModeRange::arms).filter(is_sent)?;
        let is_off = |us: &u16| {
            !ranges().any(|other| {
                other.arms() && (other.channel != range.channel || other.contains(*us))
            })
        };
        let off = OFF_US.into_iter().find(is_off)?;
        Some(ArmingSwitch { channel: usize::from(range.channel), values: [range.middle_us(), off] })
    }

    /// Bit of the mode "MSP override" in a status \[-\]; `None` if the vehicle has none, because no channels are overridden.
    pub fn override_bit(&self) -> Option<u64> {
        self.modes().find_map(|(bit, mode)| (mode == MSP_OVERRIDE).then_some(bit))
    }

    /// Name of a mode among `on`, bits of a status, in which the sticks are not rates; `None` without one.
    pub fn other_mode(&self, on: u64) -> Option<&'static str> {
        let name =
            |mode| OTHER_MODES.iter().find_map(|(known, name)| (*known == mode).then_some(*name));
        self.modes().filter(|(bit, _)| bit & on != 0).find_map(|(_, mode)| name(mode))
    }

    fn is_first_page_full(&self) -> bool {
        self.payload(command::MODES).len() >= PAGE
    }

    /// Bits of a status and numbers of their modes \[-\].
    fn modes(&self) -> impl Iterator<Item = (u64, u8)> {
        let second = if self.is_first_page_full() { self.reply(SECOND_PAGE) } else { &[] };
        let pages = [self.payload(command::MODES), second];
        let modes = pages.into_iter().flat_map(|page| page.iter().take(PAGE)).enumerate();
        modes.map(|(bit, mode)| (1 << bit, *mode))
    }

    /// Whether the vehicle's receiver is MSP, so that its failsafe acts when set-points end. With MSP override the failsafe depends on the
    /// pilot's receiver instead.
    pub fn has_msp_receiver(&self) -> bool {
        self.features() & RX_MSP != 0
    }

    fn features(&self) -> u32 {
        self.payload(command::FEATURES).first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes))
    }

    /// Rules that the bridge cannot enforce: name, whether it is met, and what is needed.
    pub fn rules(&self) -> [(&'static str, bool, &'static str); 4] {
        let features = self.features() & FEATURE_3D == 0;
        [
            (
                "receiver",
                self.has_msp_receiver() || self.override_bit().is_some(),
                "`feature RX_MSP`; or a msp_override_channels_mask with sticks and ARM, but without a time-out (F72)",
            ),
            ("ARM", self.arming_switch().is_some(), "one range of one auxiliary channel arms"),
            ("map", self.channel_map().is_some(), "sticks are the first four channels"),
            ("3D", features, "`feature -3D`: rotors turn one way"),
        ]
    }

    /// Settings against their rules, for these rates at full stick \[10 deg/s\].
    pub fn wrong_fields(&self, rates: [u8; 3]) -> impl Iterator<Item = MspField> {
        MspField::all(rates).filter(|field| !field.is_right(self.payload(field.commands.0)))
    }

    /// Name of the first setting with which set-points would be misunderstood, for these rates at full stick \[10 deg/s\]. The
    /// failsafe is not included: `Msp::deviation` and the daemon compare its time with `safety.vehicle-time-out-ms`.
    pub fn deviation(&self, rates: [u8; 3]) -> Option<&'static str> {
        let broken = self.rules().into_iter().find(|(_, is_met, _)| !is_met);
        let field = || self.wrong_fields(rates).find(|field| field.commands != FAILSAFE);
        broken.map(|(name, ..)| name).or_else(|| Some(field()?.parameter.name))
    }

    /// Time without set-points after which the vehicle stops its motors; `None` if it does something else, or flies on.
    pub fn time_out(&self) -> Option<Span> {
        let [.., procedure] = *self.payload(command::FAILSAFE).first_chunk::<8>()?;
        let delay = f64::from(*self.payload(command::FAILSAFE).first()?);
        (self.has_msp_receiver() && procedure == 1).then(|| DELAY_UNIT.scaled(delay.max(1.0)))
    }
}
