//! Data packets: a frame of components.

use super::component::{ComponentKind, ComponentSet};
use super::record::{BodyRecord, MarkerRecord};
use super::writer::QtmWriter;
use crate::bytes::{ByteOrder, ByteReader, ByteWriter, count_u32};
use crate::motion::MotionFrame;

/// Length of a component before its records: size, type, count, drop rate, out-of-sync rate \[bytes\].
const COMPONENT_HEAD_BYTES: usize = 16;

/// Error in a data packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DataError {
    /// Packet that ends within its header or the header of a component.
    #[error("a data packet ends too early")]
    Truncated,
    /// Component whose size does not agree with the packet or with its count.
    #[error("component {index} of a data packet claims {size} bytes")]
    Component {
        /// Place in the packet, from 0 \[-\].
        index: u32,
        /// Size field \[bytes\].
        size: u32,
    },
}

/// Checked view of a data packet: every component is complete.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DataPacket<'a> {
    timestamp_us: u64,
    frame: u32,
    count: u32,
    components: &'a [u8],
    order: ByteOrder,
}

impl<'a> DataPacket<'a> {
    /// Checks the content of a packet.
    pub(super) fn parse(content: &'a [u8], order: ByteOrder) -> Result<Self, DataError> {
        let mut reader = ByteReader::new(content, order);
        let head = (reader.u64(), reader.u32(), reader.u32());
        let (Some(timestamp_us), Some(frame), Some(count)) = head else {
            return Err(DataError::Truncated);
        };
        let components = reader.rest();
        for index in 0..count {
            check_component(&mut reader, index, order)?;
        }
        Ok(Self { timestamp_us, frame, count, components, order })
    }

    /// Time of exposure since the measurement began, on the server's clock \[us\].
    pub fn timestamp_us(&self) -> u64 {
        self.timestamp_us
    }

    /// Number of the frame \[-\].
    pub fn frame(&self) -> u32 {
        self.frame
    }

    /// The components that are known here.
    pub fn components(&self) -> impl Iterator<Item = Component<'a>> + use<'a> {
        let (order, mut reader) = (self.order, ByteReader::new(self.components, self.order));
        (0..self.count).filter_map(move |_| {
            let size = reader.u32()? as usize;
            let kind = reader.u32()?;
            let mut content = ByteReader::new(reader.bytes(size.checked_sub(8)?)?, order);
            let kind = ComponentKind::from_number(kind)?;
            let count = content.u32()?;
            let (_drop_rate, _out_of_sync) = (content.u16()?, content.u16()?);
            Some(Component { kind, count, content })
        })
    }

    /// The bodies of the first component with bodies.
    pub fn bodies(&self) -> impl Iterator<Item = BodyRecord> + use<'a> {
        self.components().find(Component::has_bodies).into_iter().flat_map(|c| c.bodies())
    }
}

/// Checks and skips one component.
fn check_component(
    reader: &mut ByteReader<'_>,
    index: u32,
    order: ByteOrder,
) -> Result<(), DataError> {
    let (Some(size), Some(kind)) = (reader.u32(), reader.u32()) else {
        return Err(DataError::Truncated);
    };
    let wrong = DataError::Component { index, size };
    let content = (size as usize).checked_sub(8).and_then(|length| reader.bytes(length));
    let content = content.ok_or(wrong)?;
    let Some(kind) = ComponentKind::from_number(kind) else { return Ok(()) };
    let count = ByteReader::new(content, order).u32().ok_or(wrong)?;
    let records = (count as usize).checked_mul(kind.record_bytes());
    let expected = records.and_then(|records| records.checked_add(COMPONENT_HEAD_BYTES));
    if expected == Some(size as usize) { Ok(()) } else { Err(wrong) }
}

/// A component of a data packet.
#[derive(Clone, Copy, Debug)]
pub struct Component<'a> {
    kind: ComponentKind,
    count: u32,
    content: ByteReader<'a>,
}

impl<'a> Component<'a> {
    /// Kind.
    pub fn kind(&self) -> ComponentKind {
        self.kind
    }

    /// The bodies, in the order of the parameters; none in a component of markers.
    pub fn bodies(&self) -> impl Iterator<Item = BodyRecord> + use<'a> {
        let (kind, mut content) = (self.kind, self.content);
        (0..self.count).map_while(move |_| BodyRecord::read(&mut content, kind))
    }

    /// The markers; none in a component of bodies.
    pub fn markers(&self) -> impl Iterator<Item = MarkerRecord> + use<'a> {
        let (kind, mut content) = (self.kind, self.content);
        let count = if self.has_bodies() { 0 } else { self.count };
        (0..count).map_while(move |_| MarkerRecord::read(&mut content, kind))
    }

    /// Whether the records are bodies.
    pub fn has_bodies(&self) -> bool {
        has_bodies(self.kind)
    }
}

fn has_bodies(kind: ComponentKind) -> bool {
    matches!(
        kind,
        ComponentKind::Bodies
            | ComponentKind::BodiesEuler
            | ComponentKind::BodiesResidual
            | ComponentKind::BodiesEulerResidual
    )
}

impl QtmWriter<'_> {
    /// Writes a frame with the components requested by a client.
    pub fn data(&mut self, frame: &MotionFrame<'_>, components: &ComponentSet) {
        self.content(3, |writer| {
            let count = count_u32(components.iter().count());
            writer.u64(frame.captured_ns / 1000).u32(frame.number).u32(count);
            for kind in components.iter() {
                write_component(writer, kind, frame);
            }
        });
    }
}

fn write_component(writer: &mut ByteWriter<'_>, kind: ComponentKind, frame: &MotionFrame<'_>) {
    let start = writer.len();
    writer.u32(0).u32(kind.number()).u32(0).u16(0).u16(0);
    let mut count = 0;
    if has_bodies(kind) {
        for body in frame.bodies {
            BodyRecord::new(kind, body).write(writer);
            count += 1;
        }
    } else {
        for (id, marker) in (1..).zip(frame.markers) {
            let record = MarkerRecord::new(kind, id, marker);
            // A marker without a label that is not seen does not exist.
            if record.id.is_none() || marker.position_m.is_some() {
                record.write(writer);
                count += 1;
            }
        }
    }
    let size = count_u32(writer.len() - start);
    writer.set_u32(start, size);
    writer.set_u32(start + 8, count);
}
