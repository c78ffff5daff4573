//! Frames from host to vehicle: commands, polls, the emergency stop.

use super::Poll;

/// Greatest deflection of a stick \[counts\].
pub const FULL_STICK: i16 = 2047;
/// Greatest thrust \[counts\].
pub const FULL_THRUST: i16 = 4095;

/// Frame that stops the motors at once, also in flight.
pub const EMERGENCY_STOP: [u8; 5] = *b">*>me";

pub(super) const COMMAND_HEAD: &[u8] = b">*>di";
pub(super) const POLL_HEAD: &[u8] = b">*>p";
pub(super) const POLL_LEN: usize = 6;

/// Control input: the fields of `CTRL_INPUT` as on the wire, without the checksum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ControlInput {
    /// Pitch stick \[counts, -2047..2047\].
    pub pitch: i16,
    /// Roll stick \[counts, -2047..2047\].
    pub roll: i16,
    /// Yaw stick \[counts, -2047..2047\].
    pub yaw: i16,
    /// Thrust \[counts, 0..4095\].
    pub thrust: i16,
    /// Axes that the vehicle takes from the host instead of the remote control: bits `ENABLE_*` \[-\].
    pub enabled: i16,
}

impl ControlInput {
    /// Pitch is the host's.
    pub const ENABLE_PITCH: i16 = 1;
    /// Roll is the host's.
    pub const ENABLE_ROLL: i16 = 2;
    /// Yaw is the host's.
    pub const ENABLE_YAW: i16 = 4;
    /// Thrust is the host's.
    pub const ENABLE_THRUST: i16 = 8;
    /// All four are the host's.
    pub const ENABLE_ALL: i16 = 15;

    /// Zero set-point: sticks centred, no thrust, all axes the host's.
    pub const ZERO_SETPOINT: Self =
        Self { pitch: 0, roll: 0, yaw: 0, thrust: 0, enabled: Self::ENABLE_ALL };

    /// Length of the frame \[bytes\].
    pub const FRAME_LEN: usize = 17;

    /// Whether every field is within the range of the manual.
    pub fn in_range(&self) -> bool {
        let stick = |counts: i16| (-FULL_STICK..=FULL_STICK).contains(&counts);
        stick(self.pitch)
            && stick(self.roll)
            && stick(self.yaw)
            && (0..=FULL_THRUST).contains(&self.thrust)
            && (0..=Self::ENABLE_ALL).contains(&self.enabled)
    }

    /// Encodes the frame. Values are not limited: see [`ControlInput::in_range`].
    pub fn frame(&self) -> [u8; Self::FRAME_LEN] {
        let mut frame = [0; Self::FRAME_LEN];
        frame[..5].copy_from_slice(COMMAND_HEAD);
        let [pitch, roll, yaw, thrust, enabled] = self.fields();
        let words = [pitch, roll, yaw, thrust, enabled, self.checksum()];
        for (place, word) in frame[5..].chunks_exact_mut(2).zip(words) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        frame
    }

    /// Decodes the frame: checks length, head, checksum and ranges.
    ///
    /// # Errors
    /// The first check that fails.
    pub fn read(bytes: &[u8]) -> Result<Self, CommandError> {
        check_shape(bytes, COMMAND_HEAD, Self::FRAME_LEN)?;
        let word = |index: usize| {
            let at = COMMAND_HEAD.len() + 2 * index;
            i16::from_le_bytes([bytes[at], bytes[at + 1]])
        };
        let [pitch, roll, yaw, thrust, enabled, found] = [0, 1, 2, 3, 4, 5].map(word);
        let input = Self { pitch, roll, yaw, thrust, enabled };
        let (found, wanted) = (found as u16, input.checksum() as u16);
        if found != wanted {
            return Err(CommandError::Checksum { found, wanted });
        }
        if input.in_range() { Ok(input) } else { Err(CommandError::Range) }
    }

    fn fields(&self) -> [i16; 5] {
        [self.pitch, self.roll, self.yaw, self.thrust, self.enabled]
    }

    fn checksum(&self) -> i16 {
        self.fields().into_iter().fold(0xAAAA_u16 as i16, i16::wrapping_add)
    }
}

/// Encodes the frame that requests telemetry.
pub fn poll_frame(poll: Poll) -> [u8; POLL_LEN] {
    let [low, high] = poll.bits().to_le_bytes();
    [b'>', b'*', b'>', b'p', low, high]
}

/// Decodes the frame that requests telemetry: checks length, head and bits.
///
/// # Errors
/// The first check that fails.
pub fn read_poll(bytes: &[u8]) -> Result<Poll, CommandError> {
    check_shape(bytes, POLL_HEAD, POLL_LEN)?;
    Poll::from_wire(u16::from_le_bytes([bytes[4], bytes[5]])).ok_or(CommandError::Range)
}

/// Message from host to vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostCommand {
    /// Control input; acknowledged with [`super::Descriptor::ControlInput`].
    Control(ControlInput),
    /// Request to send telemetry once.
    Poll(Poll),
    /// Request to stop the motors at once.
    EmergencyStop,
}

/// Error in bytes that should be a frame to a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CommandError {
    /// Number of bytes that does not agree with the head.
    #[error("{found} bytes, expected {wanted}")]
    Length {
        /// Length found \[bytes\].
        found: usize,
        /// Length of such a frame \[bytes\].
        wanted: usize,
    },
    /// Unknown first bytes.
    #[error("unknown head")]
    Head,
    /// Checksum that does not agree with the fields.
    #[error("checksum {found:#06x}, expected {wanted:#06x}")]
    Checksum {
        /// Checksum found.
        found: u16,
        /// Checksum of the fields found.
        wanted: u16,
    },
    /// Field outside its range, or a poll with unknown bits or none.
    #[error("a field is out of range")]
    Range,
}

fn check_shape(bytes: &[u8], head: &[u8], wanted: usize) -> Result<(), CommandError> {
    if !bytes.starts_with(head) {
        return Err(CommandError::Head);
    }
    let found = bytes.len();
    if found == wanted { Ok(()) } else { Err(CommandError::Length { found, wanted }) }
}
