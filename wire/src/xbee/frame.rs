//! Fields of API frames.

use super::packet::{ApiPacket, MAX_DATA, MAX_PAYLOAD, WireBytes, framed};
use crate::bytes::{ByteArray, ByteOrder, ByteReader};

/// Network address for an unknown one \[-\].
pub const UNKNOWN_NETWORK: u16 = 0xFFFE;

/// Payload of up to [`MAX_PAYLOAD`] bytes.
pub type Payload = ByteArray<MAX_PAYLOAD>;

/// Error: more bytes than a radio packet holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0} bytes of payload, a radio packet holds {MAX_PAYLOAD}")]
pub struct TooLong(pub usize);

impl TryFrom<&[u8]> for Payload {
    type Error = TooLong;

    fn try_from(bytes: &[u8]) -> Result<Self, TooLong> {
        Self::of(bytes).ok_or(TooLong(bytes.len()))
    }
}

/// API frames with payload, or with reports of its delivery.
///
/// `id` numbers a request \[-\]; a radio reports its delivery by a TX status, unless it is 0. `rssi` is in -dBm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(
    missing_docs,
    reason = "fields are named as in Digi's manuals, and described in the table of the module"
)]
pub enum ApiFrame {
    /// 0x10: send to a 64-bit address.
    TxRequest { id: u8, to: u64, network: u16, radius: u8, options: u8, payload: Payload },
    /// 0x01: send to a 16-bit address.
    TxRequest16 { id: u8, to: u16, options: u8, payload: Payload },
    /// 0x90: received from a 64-bit address.
    RxPacket { from: u64, network: u16, options: u8, payload: Payload },
    /// 0x80: received from a 64-bit address (802.15.4).
    RxPacket64 { from: u64, rssi: u8, options: u8, payload: Payload },
    /// 0x81: received from a 16-bit address.
    RxPacket16 { from: u16, rssi: u8, options: u8, payload: Payload },
    /// 0x89: delivery of a request (802.15.4); status 0 is success.
    TxStatus { id: u8, status: u8 },
    /// 0x8B: delivery of a request; delivery 0 is success.
    TxStatusExtended { id: u8, network: u16, retries: u8, delivery: u8, discovery: u8 },
    /// 0x8A: status of the radio itself.
    ModemStatus(u8),
}

/// Error in an API frame whose checksum is right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ApiFrameError {
    /// Unsupported kind of frame.
    #[error("frame of kind {0:#04x}")]
    Kind(u8),
    /// Missing fields, or too much payload.
    #[error("{length} bytes in a frame of kind {kind:#04x}")]
    Length {
        /// Kind of frame \[-\].
        kind: u8,
        /// Number of bytes after the kind \[bytes\].
        length: usize,
    },
}

impl ApiFrame {
    /// Decodes the fields.
    ///
    /// # Errors
    /// An unsupported kind of frame, or a wrong length.
    pub fn parse(packet: &ApiPacket) -> Result<Self, ApiFrameError> {
        let (kind, length) = (packet.kind(), packet.body().len());
        let mut fields = ByteReader::new(packet.body(), ByteOrder::Big);
        let frame = match kind {
            0x10 => tx_request(&mut fields),
            0x01 => tx_request_16(&mut fields),
            0x90 => rx_packet(&mut fields),
            0x80 => rx_packet_64(&mut fields),
            0x81 => rx_packet_16(&mut fields),
            0x89 => tx_status(&mut fields),
            0x8B => tx_status_extended(&mut fields),
            0x8A => fields.u8().map(Self::ModemStatus),
            _ => return Err(ApiFrameError::Kind(kind)),
        };
        // Frames without payload must end where their fields do.
        frame.filter(|_| fields.rest().is_empty()).ok_or(ApiFrameError::Length { kind, length })
    }

    /// Encodes the frame for the serial port, with escapes (API mode 2) or without (mode 1).
    pub fn to_wire(&self, escaped: bool) -> WireBytes {
        let mut data = ByteArray::<MAX_DATA>::EMPTY;
        match self {
            Self::TxRequest { id, to, network, radius, options, payload } => data
                .put(&[0x10, *id])
                .put(&to.to_be_bytes())
                .put(&network.to_be_bytes())
                .put(&[*radius, *options])
                .put(payload),
            Self::TxRequest16 { id, to, options, payload } => {
                data.put(&[0x01, *id]).put(&to.to_be_bytes()).put(&[*options]).put(payload)
            }
            Self::RxPacket { from, network, options, payload } => data
                .put(&[0x90])
                .put(&from.to_be_bytes())
                .put(&network.to_be_bytes())
                .put(&[*options])
                .put(payload),
            Self::RxPacket64 { from, rssi, options, payload } => {
                data.put(&[0x80]).put(&from.to_be_bytes()).put(&[*rssi, *options]).put(payload)
            }
            Self::RxPacket16 { from, rssi, options, payload } => {
                data.put(&[0x81]).put(&from.to_be_bytes()).put(&[*rssi, *options]).put(payload)
            }
            Self::TxStatus { id, status } => data.put(&[0x89, *id, *status]),
            Self::TxStatusExtended { id, network, retries, delivery, discovery } => data
                .put(&[0x8B, *id])
                .put(&network.to_be_bytes())
                .put(&[*retries, *delivery, *discovery]),
            Self::ModemStatus(status) => data.put(&[0x8A, *status]),
        };
        framed(&data, escaped)
    }
}

// Fields of each kind of frame, in the order of the wire.

fn payload(fields: &mut ByteReader<'_>) -> Option<Payload> {
    let rest = fields.bytes(fields.rest().len())?;
    Payload::of(rest)
}

fn tx_request(fields: &mut ByteReader<'_>) -> Option<ApiFrame> {
    let (id, to, network) = (fields.u8()?, fields.u64()?, fields.u16()?);
    let [radius, options] = fields.take()?;
    Some(ApiFrame::TxRequest { id, to, network, radius, options, payload: payload(fields)? })
}

fn tx_request_16(fields: &mut ByteReader<'_>) -> Option<ApiFrame> {
    let (id, to, options) = (fields.u8()?, fields.u16()?, fields.u8()?);
    Some(ApiFrame::TxRequest16 { id, to, options, payload: payload(fields)? })
}

fn rx_packet(fields: &mut ByteReader<'_>) -> Option<ApiFrame> {
    let (from, network, options) = (fields.u64()?, fields.u16()?, fields.u8()?);
    Some(ApiFrame::RxPacket { from, network, options, payload: payload(fields)? })
}

fn rx_packet_64(fields: &mut ByteReader<'_>) -> Option<ApiFrame> {
    let (from, [rssi, options]) = (fields.u64()?, fields.take()?);
    Some(ApiFrame::RxPacket64 { from, rssi, options, payload: payload(fields)? })
}

fn rx_packet_16(fields: &mut ByteReader<'_>) -> Option<ApiFrame> {
    let (from, [rssi, options]) = (fields.u16()?, fields.take()?);
    Some(ApiFrame::RxPacket16 { from, rssi, options, payload: payload(fields)? })
}

fn tx_status(fields: &mut ByteReader<'_>) -> Option<ApiFrame> {
    fields.take().map(|[id, status]| ApiFrame::TxStatus { id, status })
}

fn tx_status_extended(fields: &mut ByteReader<'_>) -> Option<ApiFrame> {
    let (id, network) = (fields.u8()?, fields.u16()?);
    let [retries, delivery, discovery] = fields.take()?;
    Some(ApiFrame::TxStatusExtended { id, network, retries, delivery, discovery })
}
