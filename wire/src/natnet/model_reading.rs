//! Definitions of bodies, as a client reads them.

use super::message::{NatNetError, NatNetVersion};
use super::model::{BodyDefinition, ModelDefinitions};
use crate::bytes::{ByteOrder, ByteReader};

impl ModelDefinitions {
    /// Parses the content of the message, as a server of this version writes it.
    ///
    /// # Errors
    /// A definition ends too early.
    pub fn parse(content: &[u8], version: NatNetVersion) -> Result<Self, NatNetError> {
        read(content, version).ok_or(NatNetError::Content("the list of bodies"))
    }
}

fn read(content: &[u8], version: NatNetVersion) -> Option<ModelDefinitions> {
    let mut reader = ByteReader::new(content, ByteOrder::Little);
    let mut models = ModelDefinitions::default();
    for _ in 0..reader.u32()? {
        let kind = reader.u32()?;
        if version >= NatNetVersion::SIZED {
            let size = reader.u32()? as usize;
            let mut definition = ByteReader::new(reader.bytes(size)?, ByteOrder::Little);
            if kind == 1 {
                models.bodies.push(read_body(&mut definition, version)?);
            }
            continue;
        }
        match kind {
            0 => skip_marker_set(&mut reader)?,
            1 => models.bodies.push(read_body(&mut reader, version)?),
            2 => skip_skeleton(&mut reader, version)?,
            // Force plates, devices or an unknown kind, whose length is not known: the rest cannot be read.
            _ => break,
        }
    }
    Some(models)
}

fn read_body(reader: &mut ByteReader<'_>, version: NatNetVersion) -> Option<BodyDefinition> {
    let name = reader.text()?.to_owned();
    let (id, _parent, _offset) = (reader.i32()?, reader.i32()?, reader.f32s::<3>()?);
    if version >= NatNetVersion::MODEL_ATTITUDES {
        reader.f32s::<4>()?;
    }
    let count = reader.u32()?;
    let mut markers_m = Vec::new();
    // Each marker takes bytes, so that a wrong count ends where they do.
    for _ in 0..count {
        markers_m.push(reader.f32s::<3>()?.map(f64::from));
    }
    for _ in 0..count {
        reader.i32()?;
    }
    if version >= NatNetVersion::MARKER_NAMES {
        for _ in 0..count {
            reader.text()?;
        }
    }
    Some(BodyDefinition { name, id, markers_m })
}

fn skip_marker_set(reader: &mut ByteReader<'_>) -> Option<()> {
    reader.text()?;
    for _ in 0..reader.u32()? {
        reader.text()?;
    }
    Some(())
}

fn skip_skeleton(reader: &mut ByteReader<'_>, version: NatNetVersion) -> Option<()> {
    reader.text()?;
    reader.i32()?;
    for _ in 0..reader.u32()? {
        read_body(reader, version)?;
    }
    Some(())
}
