//! Definitions of bodies, as a server writes them.

use super::message::{MessageId, NatNetVersion, write_content};
use crate::bytes::{ByteOrder, ByteWriter, count_u32};

/// Definition of a rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyDefinition {
    /// Name.
    pub name: String,
    /// Number, by which frames name the body \[-\].
    pub id: i32,
    /// Markers \[m, body\].
    pub markers_m: Vec<[f64; 3]>,
}

/// Answer to *request model definitions*.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelDefinitions {
    /// Rigid bodies.
    pub bodies: Vec<BodyDefinition>,
}

impl ModelDefinitions {
    /// Appends the message to `out`, as a server of this version writes it.
    pub fn write(&self, version: NatNetVersion, out: &mut Vec<u8>) {
        write_content(out, MessageId::Models, |writer| {
            writer.u32(count_u32(self.bodies.len()));
            for body in &self.bodies {
                let mut definition = Vec::new();
                write_body(body, version, &mut ByteWriter::new(&mut definition, ByteOrder::Little));
                // Type 1 is a rigid body.
                writer.u32(1);
                if version >= NatNetVersion::SIZED {
                    writer.u32(count_u32(definition.len()));
                }
                writer.bytes(&definition);
            }
        });
    }
}

fn write_body(body: &BodyDefinition, version: NatNetVersion, writer: &mut ByteWriter<'_>) {
    // No parent, no offset from it.
    writer.text(&body.name).i32(body.id).i32(-1).f32s(&[0.0; 3]);
    if version >= NatNetVersion::MODEL_ATTITUDES {
        writer.f32s(&[0.0, 0.0, 0.0, 1.0]);
    }
    writer.u32(count_u32(body.markers_m.len()));
    for marker in &body.markers_m {
        writer.f32s(&marker.map(|x| x as f32));
    }
    for _ in &body.markers_m {
        writer.i32(0);
    }
    if version >= NatNetVersion::MARKER_NAMES {
        for number in 1..=body.markers_m.len() {
            writer.text(&format!("Marker {number:03}"));
        }
    }
}
