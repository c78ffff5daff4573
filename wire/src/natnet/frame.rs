//! Frames, as a client reads them.

use super::message::{NatNetError, NatNetVersion};
use crate::bytes::{ByteOrder, ByteReader};
use crate::motion::RigidPose;

/// Length of a rigid body in a frame \[bytes\].
const BODY_BYTES: usize = 38;
/// Length of a labelled marker in a frame \[bytes\].
const LABELLED_BYTES: usize = 26;
/// Length of a body of an asset, and of its markers \[bytes\].
const ASSET_BODY_BYTES: usize = 38;
const ASSET_MARKER_BYTES: usize = 26;
/// Bit of a body that is tracked.
const TRACKED: i16 = 1;

/// A rigid body in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NatNetBody {
    /// Number of its definition \[-\].
    pub id: i32,
    /// Position \[m, volume\].
    pub position_m: [f32; 3],
    /// Quaternion x, y, z, w \[body to volume\].
    pub attitude: [f32; 4],
    /// Mean distance of the markers from the fitted body \[m\].
    pub mean_error_m: f32,
    /// Whether the cameras see the body in this frame. If not, its pose is an old one.
    pub tracked: bool,
}

impl NatNetBody {
    /// Pose in the volume; `None` if the body is not tracked or its numbers are not finite.
    pub fn pose(&self) -> Option<RigidPose> {
        let pose = RigidPose::new(self.position_m.map(f64::from), self.attitude.map(f64::from));
        pose.filter(|_| self.tracked)
    }

    fn read(reader: &mut ByteReader<'_>) -> Option<Self> {
        Some(Self {
            id: reader.i32()?,
            position_m: reader.f32s()?,
            attitude: reader.f32s()?,
            mean_error_m: reader.f32()?,
            tracked: reader.i16()? & TRACKED != 0,
        })
    }
}

/// Times of a frame on the server's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NatNetTimes {
    /// Time since the server was started \[s\].
    pub timestamp_s: f64,
    /// Middle of the exposure, in ticks of [`super::ServerInfo::clock_hz`]; 0 if unknown \[-\].
    pub mid_exposure: u64,
    /// Arrival of the cameras' data, in ticks \[-\].
    pub received: u64,
    /// Transmission of the frame, in ticks \[-\].
    pub transmitted: u64,
}

/// Checked view of a frame: its bodies are complete.
#[derive(Clone, Copy, Debug)]
pub struct NatNetFrame<'a> {
    number: i32,
    bodies: ByteReader<'a>,
    count: u32,
    times: NatNetTimes,
    models_changed: bool,
}

impl<'a> NatNetFrame<'a> {
    /// Parses the content of the message, as a server of this version writes it.
    ///
    /// # Errors
    /// A section ends too early.
    pub fn parse(content: &'a [u8], version: NatNetVersion) -> Result<Self, NatNetError> {
        Self::read(content, version).ok_or(NatNetError::Content("a frame"))
    }

    fn read(content: &'a [u8], version: NatNetVersion) -> Option<Self> {
        let mut reader = ByteReader::new(content, ByteOrder::Little);
        let number = reader.i32()?;
        let sized = version >= NatNetVersion::SIZED;
        section(&mut reader, sized, marker_sets)?;
        section(&mut reader, sized, |reader, count| fixed(reader, count, 12))?;
        let (mut bodies, mut count) = (reader, 0);
        section(&mut reader, sized, |content, found| {
            (bodies, count) = (*content, found);
            fixed(content, found, BODY_BYTES)
        })?;
        section(&mut reader, sized, skeletons)?;
        if sized {
            section(&mut reader, sized, assets)?;
        }
        section(&mut reader, sized, |reader, count| fixed(reader, count, LABELLED_BYTES))?;
        // Force plates and devices.
        section(&mut reader, sized, channels)?;
        section(&mut reader, sized, channels)?;
        let (_timecode, _subframe) = (reader.u32()?, reader.u32()?);
        let times = NatNetTimes {
            timestamp_s: reader.f64()?,
            mid_exposure: reader.u64()?,
            received: reader.u64()?,
            transmitted: reader.u64()?,
        };
        if sized {
            reader.bytes(8)?;
        }
        let models_changed = reader.i16()? & 2 != 0;
        Some(Self { number, bodies, count, times, models_changed })
    }

    /// Number of the frame \[-\].
    pub fn number(&self) -> i32 {
        self.number
    }

    /// Times.
    pub fn times(&self) -> NatNetTimes {
        self.times
    }

    /// Whether the definitions have changed: ask for them again.
    pub fn models_changed(&self) -> bool {
        self.models_changed
    }

    /// The rigid bodies, in any order.
    pub fn bodies(&self) -> impl Iterator<Item = NatNetBody> + use<'a> {
        let mut reader = self.bodies;
        (0..self.count).map_while(move |_| NatNetBody::read(&mut reader))
    }
}

/// Reads one section: number of elements, length if `sized`, and the elements.
fn section<'a>(
    reader: &mut ByteReader<'a>,
    sized: bool,
    read: impl FnOnce(&mut ByteReader<'a>, u32) -> Option<()>,
) -> Option<()> {
    let count = reader.u32()?;
    if !sized {
        return read(reader, count);
    }
    let size = reader.u32()? as usize;
    read(&mut ByteReader::new(reader.bytes(size)?, ByteOrder::Little), count)
}

/// Skips elements of one length.
fn fixed(reader: &mut ByteReader<'_>, count: u32, bytes: usize) -> Option<()> {
    reader.bytes((count as usize).checked_mul(bytes)?).map(drop)
}

// Each element of the following takes bytes, so that a wrong count ends where they do.

fn marker_sets(reader: &mut ByteReader<'_>, count: u32) -> Option<()> {
    for _ in 0..count {
        reader.text()?;
        let markers = reader.u32()?;
        fixed(reader, markers, 12)?;
    }
    Some(())
}

fn skeletons(reader: &mut ByteReader<'_>, count: u32) -> Option<()> {
    for _ in 0..count {
        reader.i32()?;
        let bodies = reader.u32()?;
        fixed(reader, bodies, BODY_BYTES)?;
    }
    Some(())
}

fn assets(reader: &mut ByteReader<'_>, count: u32) -> Option<()> {
    for _ in 0..count {
        reader.i32()?;
        let bodies = reader.u32()?;
        fixed(reader, bodies, ASSET_BODY_BYTES)?;
        let markers = reader.u32()?;
        fixed(reader, markers, ASSET_MARKER_BYTES)?;
    }
    Some(())
}

fn channels(reader: &mut ByteReader<'_>, count: u32) -> Option<()> {
    for _ in 0..count {
        reader.i32()?;
        for _ in 0..reader.u32()? {
            let values = reader.u32()?;
            fixed(reader, values, 4)?;
        }
    }
    Some(())
}
