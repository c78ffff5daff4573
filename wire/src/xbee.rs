//! Frames on the serial port of an XBee radio between host and vehicle.
//!
//! | framing | on the radio's serial port |
//! |---|---|
//! | transparent | the payload's bytes alone, as in AscTec's kits |
//! | API mode 1 | `7E`, length (u16, big endian), frame, checksum (0xFF - sum of the frame) |
//! | API mode 2 | the same, with `7E`, `7D`, `11`, `13` after the first byte written as `7D`, byte XOR 0x20 |
//!
//! | frame | direction | fields before the payload |
//! |---|---|---|
//! | 0x10 TX request | host to radio | frame id, address (u64), network address (u16), radius, options |
//! | 0x01 TX request | host to radio | frame id, address (u16), options |
//! | 0x90 RX packet | radio to host | address (u64), network address (u16), options |
//! | 0x80 RX packet | radio to host | address (u64), RSSI, options |
//! | 0x81 RX packet | radio to host | address (u16), RSSI, options |
//! | 0x89 TX status | radio to host | frame id, status |
//! | 0x8B TX status | radio to host | frame id, network address (u16), retries, delivery, discovery |
//! | 0x8A modem status | radio to host | status |
//!
//! Sources: Digi, *XBee/XBee-PRO 802.15.4 OEM RF Modules* and *XBee-PRO ZB* manuals; digi-xbee 1.5.0 is the reference of the tests.

mod carrier;
mod decoder;
mod frame;
mod framing;
mod packet;

pub use carrier::{Address, Carrier, InvalidAddress, RadioEvent, RadioEvents, Side};
pub use decoder::{Api1Decoder, Api1Grammar, Api2Decoder, Api2Grammar};
pub use frame::{ApiFrame, ApiFrameError, Payload, TooLong, UNKNOWN_NETWORK};
pub use framing::{Framing, InvalidFraming};
pub use packet::{ApiPacket, MAX_PAYLOAD, MAX_WIRE, PacketError, START, WireBytes};
