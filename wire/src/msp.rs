//! MSP version 1, the protocol of Betaflight: requests of a host and replies of the vehicle, little endian, over any stream.
//!
//! | bytes | content |
//! |---|---|
//! | `$M` | head |
//! | `<`, `>` or `!` | request, reply, refusal |
//! | u8, u8 | length of the payload, at most 254; command |
//! | payload | |
//! | u8 | exclusive or of length, command and payload |
//!
//! | command | payload of the reply |
//! |---|---|
//! | 2 | name of the firmware, `BTFL` |
//! | 34; 35 sets one | ranges of channels that switch modes: mode, auxiliary channel, low and high limit in steps of 25 us from 900 us |
//! | 36, 37 | features, u32 |
//! | 44, 75, 94, 111, 125; set by 45, 76, 95, 204, 218 | settings of receiver, failsafe, controller, rates, dead bands |
//! | 64 | order of the channels |
//! | 110 | battery |
//! | 119 | modes in the order of the bits of 150 |
//! | 150 | modes that are on, reasons that prevent arming |
//! | 200 | request with the channels, us, u16 each; the reply is empty |
//! | 250 | saves the settings |
//!
//! Every request is answered. Betaflight executes at most one request every 10 ms. Signs of sticks are those of
//! [`MspSticks`]; everything else in this crate is in radians and axes x forward, y left, z up.
//!
//! Sources: betaflight/betaflight, `msp.c`, `rc.c`, `rx.c`, `failsafe.c`, version 2025.12; YAMSPy agrees byte for byte.
//!
//! No method allocates, and no input makes one panic.

mod channels;
mod packet;
mod status;

pub use channels::{
    MIN_CHECK_US, MSP_AUX_CHANNELS, MSP_CHANNELS, MSP_RATE_UNIT, MspChannelMap, MspSticks,
    msp_rates,
};
pub use packet::{MAX_MSP_PAYLOAD, MSP_ENVELOPE, MspDecoder, MspGrammar, MspKind, MspPacket};
pub use status::{MSP_ARM, MspModeRange, MspStatus, arming_obstacle, battery_v};

/// Commands.
pub mod command {
    /// Name of the firmware.
    pub const FIRMWARE: u8 = 2;
    /// Ranges that switch modes.
    pub const MODE_RANGES: u8 = 34;
    /// Sets one range of channels that switches a mode.
    pub const SET_MODE_RANGE: u8 = 35;
    /// Features.
    pub const FEATURES: u8 = 36;
    /// Settings of the receiver.
    pub const RECEIVER: u8 = 44;
    /// Sets the settings of the receiver.
    pub const SET_RECEIVER: u8 = 45;
    /// Order of the channels.
    pub const CHANNEL_MAP: u8 = 64;
    /// Settings of the failsafe.
    pub const FAILSAFE: u8 = 75;
    /// Sets the settings of the failsafe.
    pub const SET_FAILSAFE: u8 = 76;
    /// Settings of the controller.
    pub const CONTROLLER: u8 = 94;
    /// Sets the settings of the controller.
    pub const SET_CONTROLLER: u8 = 95;
    /// Battery.
    pub const BATTERY: u8 = 110;
    /// Rates and throttle curve.
    pub const RATES: u8 = 111;
    /// Modes in the order of the bits of the status: 32 on each page, the first without a payload.
    pub const MODES: u8 = 119;
    /// Dead bands of the sticks.
    pub const DEAD_BANDS: u8 = 125;
    /// Status.
    pub const STATUS: u8 = 150;
    /// Channels of the remote control.
    pub const CHANNELS: u8 = 200;
    /// Sets rates and throttle curve.
    pub const SET_RATES: u8 = 204;
    /// Sets the dead bands.
    pub const SET_DEAD_BANDS: u8 = 218;
    /// Saves the settings.
    pub const SAVE: u8 = 250;
}
