//! Fields of API frames.

use std::ops::Deref;

use super::packet::{ApiPacket, MAX_DATA, MAX_PAYLOAD, WireBytes};

/// Network address for an unknown one \[-\].
pub const UNKNOWN_NETWORK: u16 = 0xFFFE;

/// Payload of up to [`MAX_PAYLOAD`] bytes.
#[derive(Clone, Copy)]
pub struct Payload {
    bytes: [u8; MAX_PAYLOAD],
    length: usize,
}

/// Error: more bytes than a radio packet holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0} bytes of payload, a radio packet holds {MAX_PAYLOAD}")]
pub struct TooLong(pub usize);

impl TryFrom<&[u8]> for Payload {
    type Error = TooLong;

    fn try_from(bytes: &[u8]) -> Result<Self, TooLong> {
        let mut payload = Self { bytes: [0; MAX_PAYLOAD], length: bytes.len() };
        let place = payload.bytes.get_mut(..bytes.len()).ok_or(TooLong(bytes.len()))?;
        place.copy_from_slice(bytes);
        Ok(payload)
    }
}

impl Deref for Payload {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

impl PartialEq for Payload {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl Eq for Payload {}

impl std::fmt::Debug for Payload {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:02x?}", &**self)
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
        let mut fields = FieldReader(packet.body());
        let frame = match kind {
            0x10 => fields.tx_request(),
            0x01 => fields.tx_request_16(),
            0x90 => fields.rx_packet(),
            0x80 => fields.rx_packet_64(),
            0x81 => fields.rx_packet_16(),
            0x89 => fields.tx_status(),
            0x8B => fields.tx_status_extended(),
            0x8A => fields.byte().map(Self::ModemStatus),
            _ => return Err(ApiFrameError::Kind(kind)),
        };
        // Frames without payload must end where their fields do.
        frame.filter(|_| fields.0.is_empty()).ok_or(ApiFrameError::Length { kind, length })
    }

    /// Encodes the frame for the serial port, with escapes (API mode 2) or without (mode 1).
    pub fn to_wire(&self, escaped: bool) -> WireBytes {
        let mut data = FrameData { bytes: [0; MAX_DATA], length: 0 };
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
        WireBytes::framed(&data.bytes[..data.length], escaped)
    }
}

/// Content of a frame between length and checksum, under construction.
struct FrameData {
    bytes: [u8; MAX_DATA],
    length: usize,
}

impl FrameData {
    /// Appends a field. No frame exceeds [`MAX_DATA`], since no payload exceeds [`MAX_PAYLOAD`].
    fn put(&mut self, field: &[u8]) -> &mut Self {
        let end = self.length + field.len();
        if let Some(place) = self.bytes.get_mut(self.length..end) {
            place.copy_from_slice(field);
            self.length = end;
        }
        self
    }
}

/// Reader of the fields of a frame, one after another.
struct FieldReader<'a>(&'a [u8]);

impl FieldReader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (field, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*field)
    }

    fn byte(&mut self) -> Option<u8> {
        self.take().map(|[byte]| byte)
    }

    fn short(&mut self) -> Option<u16> {
        self.take().map(u16::from_be_bytes)
    }

    fn long(&mut self) -> Option<u64> {
        self.take().map(u64::from_be_bytes)
    }

    fn payload(&mut self) -> Option<Payload> {
        Payload::try_from(std::mem::take(&mut self.0)).ok()
    }

    fn tx_request(&mut self) -> Option<ApiFrame> {
        let (id, to, network) = (self.byte()?, self.long()?, self.short()?);
        let [radius, options] = self.take()?;
        Some(ApiFrame::TxRequest { id, to, network, radius, options, payload: self.payload()? })
    }

    fn tx_request_16(&mut self) -> Option<ApiFrame> {
        let (id, to, options) = (self.byte()?, self.short()?, self.byte()?);
        Some(ApiFrame::TxRequest16 { id, to, options, payload: self.payload()? })
    }

    fn rx_packet(&mut self) -> Option<ApiFrame> {
        let (from, network, options) = (self.long()?, self.short()?, self.byte()?);
        Some(ApiFrame::RxPacket { from, network, options, payload: self.payload()? })
    }

    fn rx_packet_64(&mut self) -> Option<ApiFrame> {
        let (from, [rssi, options]) = (self.long()?, self.take()?);
        Some(ApiFrame::RxPacket64 { from, rssi, options, payload: self.payload()? })
    }

    fn rx_packet_16(&mut self) -> Option<ApiFrame> {
        let (from, [rssi, options]) = (self.short()?, self.take()?);
        Some(ApiFrame::RxPacket16 { from, rssi, options, payload: self.payload()? })
    }

    fn tx_status(&mut self) -> Option<ApiFrame> {
        self.take().map(|[id, status]| ApiFrame::TxStatus { id, status })
    }

    fn tx_status_extended(&mut self) -> Option<ApiFrame> {
        let (id, network) = (self.byte()?, self.short()?);
        let [retries, delivery, discovery] = self.take()?;
        Some(ApiFrame::TxStatusExtended { id, network, retries, delivery, discovery })
    }
}
