//! Packet descriptors, and the bits of a poll.

/// Packet descriptors of known size.
///
/// The camera's descriptors (0x30, 0x31) have no published size. The CRC does not cover the descriptor, so a frame whose length
/// cannot be checked against it is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Descriptor {
    /// `IMU_RAWDATA`.
    ImuRaw = 0x01,
    /// `LL_STATUS`.
    LlStatus = 0x02,
    /// `IMU_CALCDATA`.
    ImuCalc = 0x03,
    /// `CONTROLLER_OUTPUT`.
    ControllerOutput = 0x11,
    /// `RC_DATA`.
    RcData = 0x15,
    /// `CTRL_INPUT`, in acknowledgements.
    ControlInput = 0x17,
    /// `CURRENT_WAY`.
    CurrentWaypoint = 0x21,
    /// `GPS_DATA`.
    GpsData = 0x23,
    /// `GPS_DATA_ADVANCED`.
    GpsDataAdvanced = 0x29,
}

impl Descriptor {
    /// All descriptors.
    pub const ALL: [Self; 9] = [
        Self::ImuRaw,
        Self::LlStatus,
        Self::ImuCalc,
        Self::ControllerOutput,
        Self::RcData,
        Self::ControlInput,
        Self::CurrentWaypoint,
        Self::GpsData,
        Self::GpsDataAdvanced,
    ];

    /// The descriptor of a number on the wire; `None` if unknown.
    pub fn from_wire(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|descriptor| *descriptor as u8 == number)
    }

    /// Length of the telemetry payload \[bytes\].
    pub const fn payload_len(self) -> usize {
        match self {
            Self::ImuRaw => 28,
            Self::LlStatus | Self::ControllerOutput => 16,
            Self::ImuCalc => 92,
            Self::RcData => 33,
            Self::ControlInput | Self::CurrentWaypoint => 12,
            Self::GpsData => 44,
            Self::GpsDataAdvanced => 60,
        }
    }
}

/// Telemetry requested by a poll: bits, to be joined by `|`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Poll(u16);

impl Poll {
    /// [`Descriptor::LlStatus`].
    pub const LL_STATUS: Self = Self(0x0001);
    /// [`Descriptor::ImuRaw`].
    pub const IMU_RAW: Self = Self(0x0002);
    /// [`Descriptor::ImuCalc`].
    pub const IMU_CALC: Self = Self(0x0004);
    /// [`Descriptor::RcData`].
    pub const RC_DATA: Self = Self(0x0008);
    /// [`Descriptor::ControllerOutput`].
    pub const CONTROLLER_OUTPUT: Self = Self(0x0010);
    /// [`Descriptor::GpsData`].
    pub const GPS_DATA: Self = Self(0x0080);
    /// [`Descriptor::CurrentWaypoint`].
    pub const CURRENT_WAYPOINT: Self = Self(0x0100);
    /// [`Descriptor::GpsDataAdvanced`].
    pub const GPS_DATA_ADVANCED: Self = Self(0x0200);
    /// The camera's data.
    pub const CAMERA: Self = Self(0x0800);

    const KNOWN: u16 = 0x0B9F;

    /// The poll of these bits; `None` if a bit is unknown or no bit is set.
    pub const fn from_wire(bits: u16) -> Option<Self> {
        if bits == 0 || bits & !Self::KNOWN != 0 { None } else { Some(Self(bits)) }
    }

    /// The bits as on the wire \[-\].
    pub const fn bits(self) -> u16 {
        self.0
    }

    /// Whether all telemetry of `other` is requested.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl std::ops::BitOr for Poll {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_polls_are_those_that_have_a_name() {
        let named = Poll::LL_STATUS
            | Poll::IMU_RAW
            | Poll::IMU_CALC
            | Poll::RC_DATA
            | Poll::CONTROLLER_OUTPUT
            | Poll::GPS_DATA
            | Poll::CURRENT_WAYPOINT
            | Poll::GPS_DATA_ADVANCED
            | Poll::CAMERA;
        assert_eq!(named.bits(), Poll::KNOWN);
        assert_eq!(Poll::from_wire(0), None);
        assert_eq!(Poll::from_wire(0x0020), None);
    }

    #[test]
    fn no_wrong_bit_makes_another_descriptor_of_the_same_length() {
        for one in Descriptor::ALL {
            for other in Descriptor::ALL {
                let apart = (one as u8 ^ other as u8).count_ones();
                assert!(
                    apart != 1 || one.payload_len() != other.payload_len(),
                    "{one:?} {other:?}"
                );
            }
        }
    }
}
