//! Channels of a remote control: sticks, throttle, switches.

/// Number of channels sent \[-\]: those of the sticks and the auxiliary ones.
pub const MSP_CHANNELS: usize = STICKS + MSP_AUX_CHANNELS;
/// Number of auxiliary channels \[-\].
pub const MSP_AUX_CHANNELS: usize = 12;
/// Channel value of no throttle, Betaflight's `min_check` \[us\]; below it a vehicle can be armed.
pub const MIN_CHECK_US: u16 = 1050;

/// Unit of a rate of Betaflight's rate profile, 10 deg/s \[rad/s\].
pub const MSP_RATE_UNIT: f64 = 10.0 * std::f64::consts::PI / 180.0;

/// Value of a centred stick, and deflection of a full one \[us\].
const CENTRE_US: f64 = 1500.0;
const STICK_US: f64 = 500.0;
/// Value of a switch that is off, and of throttle off \[us\].
const OFF_US: u16 = 1000;
/// Greatest value \[us\].
const FULL_US: f64 = 2000.0;
/// Number of channels of the sticks \[-\].
const STICKS: usize = 4;

/// Deflections of the sticks, x forward, y left, z up, and the throttle. In the channels yaw has the other sign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MspSticks {
    /// Deflection for rates about x, y and z \[-1..1, body\].
    pub deflections: [f64; 3],
    /// Throttle \[0..1\].
    pub throttle: f64,
}

/// Places of roll, pitch, yaw and throttle in the channels \[-\].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MspChannelMap([usize; STICKS]);

impl MspSticks {
    /// Centred sticks without throttle.
    pub const ZERO: Self = Self { deflections: [0.0; 3], throttle: 0.0 };

    /// Payload of the channels in the order `map`, with the auxiliary channel of `switch` at its value \[us\] and all others off.
    pub fn payload(
        &self,
        map: MspChannelMap,
        switch: Option<(usize, u16)>,
    ) -> [u8; 2 * MSP_CHANNELS] {
        let [roll, pitch, yaw] = self.deflections;
        let mut channels = [OFF_US; MSP_CHANNELS];
        // Conversions saturate; NaN becomes 0, which Betaflight treats as a lost channel.
        for (place, deflection) in map.0.into_iter().zip([roll, pitch, -yaw]) {
            channels[place] = (CENTRE_US + STICK_US * deflection.clamp(-1.0, 1.0)).round() as u16;
        }
        let least = f64::from(MIN_CHECK_US);
        if self.throttle > 0.0 {
            channels[map.0[3]] =
                (least + (FULL_US - least) * self.throttle.min(1.0)).round() as u16;
        }
        if let Some((index, value)) = switch
            && let Some(channel) = channels[STICKS..].get_mut(index)
        {
            *channel = value;
        }
        let mut payload = [0; 2 * MSP_CHANNELS];
        for (bytes, channel) in payload.chunks_exact_mut(2).zip(channels) {
            bytes.copy_from_slice(&channel.to_le_bytes());
        }
        payload
    }

    /// Sticks of a payload with channels in the order `map`, and the auxiliary channels \[us\]; `None` if it is too short.
    pub fn read(payload: &[u8], map: MspChannelMap) -> Option<(Self, [u16; MSP_AUX_CHANNELS])> {
        let mut channels = [0; MSP_CHANNELS];
        for (channel, bytes) in channels.iter_mut().zip(payload.chunks_exact(2)) {
            *channel = u16::from_le_bytes([bytes[0], bytes[1]]);
        }
        if payload.len() < 2 * STICKS {
            return None;
        }
        let stick = |axis: usize| (f64::from(channels[map.0[axis]]) - CENTRE_US) / STICK_US;
        let least = f64::from(MIN_CHECK_US);
        let throttle = (f64::from(channels[map.0[3]]) - least) / (FULL_US - least);
        let deflections = [stick(0), stick(1), -stick(2)].map(|stick| stick.clamp(-1.0, 1.0));
        let sticks = Self { deflections, throttle: throttle.clamp(0.0, 1.0) };
        Some((sticks, std::array::from_fn(|index| channels[STICKS + index])))
    }
}

impl MspChannelMap {
    /// Factory setting: roll, pitch, throttle, yaw.
    pub const FACTORY: Self = Self([0, 1, 3, 2]);

    /// Order in a payload: places of roll, pitch, yaw, throttle; `None` if they are not the first four channels.
    pub fn read(payload: &[u8]) -> Option<Self> {
        let places = payload.first_chunk::<STICKS>()?.map(usize::from);
        let is_order = (0..STICKS).all(|channel| places.contains(&channel));
        is_order.then_some(Self(places))
    }
}

/// Rates at full stick of a rate profile that permits `authority` \[rad/s, body\], rounded up to its unit \[10 deg/s\]; `None` if one is
/// not positive or beyond its greatest.
pub fn msp_rates(authority: [f64; 3]) -> Option<[u8; 3]> {
    // Of a rate that is a multiple of the unit, the quotient may be rounded up.
    let rates = authority.map(|rate| (rate / MSP_RATE_UNIT - 1e-9).ceil());
    rates.iter().all(|rate| (1.0..=200.0).contains(rate)).then(|| rates.map(|rate| rate as u8))
}
