//! Set-point of roll, pitch, yaw rate and thrust, used for rates and attitudes.

use super::packet::{CrtpPacket, CrtpPort};
use crate::bytes::{ByteOrder, ByteReader};

/// Thrust of full power \[counts\].
pub const MAX_CRTP_THRUST: u16 = 60_000;

/// Set-point of the commander port, x forward, y left, z up. On the wire pitch and yaw rate have the other sign, and all three are
/// in degrees.
///
/// The meaning of roll and pitch depends on the vehicle's parameters `flightmode.stabModeRoll`, `…Pitch`: 0 for rates, 1 for angles; yaw is a rate
/// while `flightmode.stabModeYaw` is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LegacySetpoint {
    /// Angle or rate about x \[rad or rad/s, body\].
    pub roll: f64,
    /// Angle or rate about y \[rad or rad/s, body\].
    pub pitch: f64,
    /// Rate about z \[rad/s, body\].
    pub yaw_rate: f64,
    /// Thrust \[counts, 0..60000\].
    pub thrust: u16,
}

impl LegacySetpoint {
    /// Set-point without thrust. The first one unlocks the thrust of those after it.
    pub const ZERO: Self = Self { roll: 0.0, pitch: 0.0, yaw_rate: 0.0, thrust: 0 };

    pub(super) fn packet(&self) -> CrtpPacket {
        let mut packet = CrtpPacket::new(CrtpPort::Commander, 0, &[]);
        // Zero has no sign: a negated zero would be another packet than every other host's.
        let signed = [self.roll, -self.pitch, -self.yaw_rate].map(|number| number + 0.0);
        for number in signed {
            packet.put(&(number.to_degrees() as f32).to_le_bytes());
        }
        packet.with(&self.thrust.min(MAX_CRTP_THRUST).to_le_bytes())
    }

    pub(super) fn read(payload: &[u8]) -> Option<Self> {
        let mut fields = ByteReader::new(payload, ByteOrder::Little);
        let [roll, pitch, yaw] = fields.f32s::<3>()?.map(|degrees| f64::from(degrees).to_radians());
        Some(Self { roll, pitch: -pitch, yaw_rate: -yaw, thrust: fields.u16()? })
    }
}
