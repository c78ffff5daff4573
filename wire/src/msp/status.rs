//! Replies about the state of the vehicle.

use crate::bytes::{ByteOrder, ByteReader};

/// Number of the mode "armed" \[-\].
pub const MSP_ARM: u8 = 0;

/// Reasons that prevent arming, by their bit. The last bit of every version, which follows these or later ones, is the arming
/// switch itself.
const OBSTACLES: [&str; 25] = [
    "NO_GYRO",
    "FAILSAFE",
    "RXLOSS",
    "NOT_DISARMED",
    "BOXFAILSAFE",
    "RUNAWAY",
    "CRASH",
    "THROTTLE",
    "ANGLE",
    "BOOTGRACE",
    "NOPREARM",
    "LOAD",
    "CALIB",
    "CLI",
    "CMS",
    "BST",
    "MSP",
    "PARALYZE",
    "GPS",
    "RESCUE_SW",
    "RPMFILTER",
    "REBOOT_REQD",
    "DSHOT_BBANG",
    "ACC_CALIB",
    "MOTOR_PROTO",
];

/// Range of an auxiliary channel that switches a mode on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MspModeRange {
    /// Number of the mode \[-\].
    pub mode: u8,
    /// Index of the auxiliary channel, from 0 \[-\].
    pub channel: u8,
    /// Lowest value of the range, in steps of 25 us from 900 us \[-\].
    pub low: u8,
    /// First value above the range, in the same steps \[-\].
    pub high: u8,
}

/// State of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MspStatus {
    /// Modes that are on, a bit each in the order of [`super::command::MODES`]; "armed" is bit 0 \[-\].
    pub modes: u64,
    /// Reasons that prevent arming \[-\].
    pub obstacles: u32,
    /// Number of reasons of this firmware \[-\].
    pub obstacle_count: u8,
}

impl MspModeRange {
    /// Ranges of a payload; those that are not used have no width.
    pub fn all(payload: &[u8]) -> impl Iterator<Item = Self> + Clone {
        payload.chunks_exact(4).map(|bytes| Self {
            mode: bytes[0],
            channel: bytes[1],
            low: bytes[2],
            high: bytes[3],
        })
    }

    /// Whether a vehicle is armed in the range.
    pub fn arms(&self) -> bool {
        self.mode == MSP_ARM && self.low < self.high
    }

    /// Value in the middle of the range \[us\].
    pub fn middle_us(&self) -> u16 {
        900 + 25 * (u16::from(self.low) + u16::from(self.high)) / 2
    }

    /// Whether the range contains the channel value `us` \[us\].
    pub fn contains(&self, us: u16) -> bool {
        let limit = |step: u8| 900 + 25 * u16::from(step);
        (limit(self.low)..limit(self.high)).contains(&us)
    }
}

impl MspStatus {
    /// State in a payload; `None` if it is too short.
    pub fn read(payload: &[u8]) -> Option<Self> {
        let mut fields = ByteReader::new(payload, ByteOrder::Little);
        fields.take::<6>()?;
        let first = fields.u32()?;
        fields.take::<5>()?;
        // Number of bytes of further modes: the low four bits.
        let count = fields.u8()? & 0xF;
        let further = fields.bytes(usize::from(count))?.iter().take(4).enumerate();
        let modes = further.fold(u64::from(first), |modes, (index, byte)| {
            modes | u64::from(*byte) << (32 + 8 * index)
        });
        Some(Self { modes, obstacle_count: fields.u8()?, obstacles: fields.u32()? })
    }

    /// Payload of the state, with zero in every other field.
    pub fn payload(&self) -> [u8; 25] {
        let mut payload = [0; 25];
        let (first, further) = (self.modes as u32, (self.modes >> 32) as u32);
        payload[6..10].copy_from_slice(&first.to_le_bytes());
        payload[15] = 4;
        payload[16..20].copy_from_slice(&further.to_le_bytes());
        payload[20] = self.obstacle_count;
        payload[21..].copy_from_slice(&self.obstacles.to_le_bytes());
        payload
    }

    /// Whether the motors run.
    pub fn is_armed(&self) -> bool {
        self.modes & 1 != 0
    }
}

/// Betaflight's name of the first reason that prevents arming, apart from the arming switch; `None` without one.
pub fn arming_obstacle(status: &MspStatus) -> Option<&'static str> {
    let switch = 1_u32.checked_shl(u32::from(status.obstacle_count).saturating_sub(1)).unwrap_or(0);
    let others = status.obstacles & !switch;
    let index = others.trailing_zeros() as usize;
    (others != 0).then(|| OBSTACLES.get(index).copied().unwrap_or("another reason"))
}

/// Battery voltage in a payload \[V\]; `None` if the vehicle measures none.
pub fn battery_v(payload: &[u8]) -> Option<f64> {
    let mut fields = ByteReader::new(payload, ByteOrder::Little);
    let tenths = fields.u8()?;
    fields.take::<6>()?;
    let volts =
        fields.u16().map_or(f64::from(tenths) / 10.0, |hundredths| f64::from(hundredths) / 100.0);
    (volts > 0.0).then_some(volts)
}
