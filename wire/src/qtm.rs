//! The RT protocol of Qualisys Track Manager (QTM), versions 1.8 to 1.28.
//!
//! | port | what |
//! |---|---|
//! | TCP 22223 | little endian: commands, parameters, events, and frames unless they go over UDP |
//! | TCP 22224 | the same, big endian |
//! | UDP 22226 | discovery |
//! | UDP, the client's | frames, one packet a datagram |
//!
//! A packet is its size (u32, the header included), its type (u32) and its content: an error, a command or its answer (text that ends
//! in a NUL), parameters (XML), a frame, an event (u8). A frame is time (u64, us), number (u32), number of components (u32) and the
//! components: size (u32), type (u32), number of records (u32), lost and unsynchronised camera frames (u16 each, per mille), records.
//! Numbers are f32, lengths mm, angles degrees. Every number of a body or labelled marker that is not seen is the NaN `FFFFFFFF`.
//!
//! [`QtmClient`] and [`QtmSession`] are the two ends of a connection: bytes in, packets and bytes out, no I/O.
//!
//! Sources: qualisys/Real-Time-Protocol-Documentation (versions 1.19 and 1.20), the layouts of qualisys/qualisys_cpp_sdk and
//! qualisys/qualisys_python_sdk. The matrix of a body is stored column by column, which the document leaves open and
//! Bitcraze's examples show.

mod client;
mod command;
mod component;
mod data;
mod discovery;
mod event;
mod host;
mod packet;
mod parameters;
mod parameters_reading;
mod parameters_writing;
mod record;
mod selection;
mod session;
mod stream_request;
mod version;
mod writer;

pub use client::{QtmClient, QtmClientError, QtmClientEvent, QtmClientOptions};
pub use command::{InvalidQtmCommand, QtmCommand};
pub use component::{ComponentKind, ComponentSet};
pub use data::{Component, DataError, DataPacket};
pub use discovery::{DISCOVERY_PORT, DiscoveryReply, DiscoveryRequest};
pub use event::QtmEvent;
pub use host::QtmHost;
pub use packet::{MAX_FROM_CLIENT, MAX_FROM_SERVER, QtmPacket, QtmPacketError, QtmStream};
pub use parameters::{QtmBody, QtmParameters, QtmParametersError, QtmPoint};
pub use record::{BodyOrientation, BodyRecord, MarkerRecord, NoPose};
pub use selection::ParameterSelection;
pub use session::QtmSession;
pub use stream_request::{StreamRate, StreamRequest, StreamTarget};
pub use version::{InvalidQtmVersion, QtmVersion};
pub use writer::QtmWriter;

/// Port of the little-endian server \[-\].
pub const LITTLE_ENDIAN_PORT: u16 = 22223;
/// Port of the big-endian server \[-\].
pub const BIG_ENDIAN_PORT: u16 = 22224;
