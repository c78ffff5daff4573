//! Encodes frames as a NatNet server writes them.

use super::message::{MessageId, NatNetVersion, write_content};
use super::model::BodyDefinition;
use crate::bytes::{ByteOrder, ByteWriter, count_u32};
use crate::motion::{BodySample, MotionFrame};

/// Bits of a labelled marker: solved by its cameras, part of a model.
const POINT_SOLVED: i16 = 0x02;
const HAS_MODEL: i16 = 0x08;
/// Diameter of a marker \[m\].
const MARKER_SIZE_M: f32 = 0.014;

/// Rate of the clock in the frames \[Hz\].
pub(super) const CLOCK_HZ: u64 = 10_000_000;

/// Appends the message of a frame to `out`, as a server of this version writes it; `bodies` defines those of the frame.
pub(super) fn write_frame(
    frame: &MotionFrame<'_>,
    bodies: &[BodyDefinition],
    version: NatNetVersion,
    out: &mut Vec<u8>,
) {
    let sized = version >= NatNetVersion::SIZED;
    write_content(out, MessageId::Frame, |writer| {
        writer.u32(frame.number);
        let empty = |writer: &mut ByteWriter<'_>| section(writer, sized, (0, &[]));
        // Marker sets and markers without a label.
        empty(writer);
        empty(writer);
        section(
            writer,
            sized,
            (count_u32(frame.bodies.len().min(bodies.len())), &rigid_bodies(frame, bodies)),
        );
        // Skeletons, and assets from 4.1 on.
        empty(writer);
        if sized {
            empty(writer);
        }
        let (count, labelled) = labelled_markers(frame, bodies);
        section(writer, sized, (count, &labelled));
        // Force plates and devices.
        empty(writer);
        empty(writer);
        write_suffix(writer, frame, sized);
    });
}

fn section(writer: &mut ByteWriter<'_>, sized: bool, (count, elements): (u32, &[u8])) {
    writer.u32(count);
    if sized {
        writer.u32(count_u32(elements.len()));
    }
    writer.bytes(elements);
}

fn rigid_bodies(frame: &MotionFrame<'_>, bodies: &[BodyDefinition]) -> Vec<u8> {
    let mut elements = Vec::new();
    let mut writer = ByteWriter::new(&mut elements, ByteOrder::Little);
    for (definition, BodySample { pose, residual_m }) in bodies.iter().zip(frame.bodies) {
        let position = pose.map_or([0.0; 3], |pose| pose.position_m);
        let attitude = pose.map_or([0.0, 0.0, 0.0, 1.0], |pose| pose.attitude);
        writer.i32(definition.id).f32s(&position.map(|x| x as f32));
        writer.f32s(&attitude.map(|x| x as f32)).f32(*residual_m as f32);
        writer.i16(i16::from(pose.is_some()));
    }
    elements
}

/// The labelled markers seen by the cameras, with their number.
fn labelled_markers(frame: &MotionFrame<'_>, bodies: &[BodyDefinition]) -> (u32, Vec<u8>) {
    let mut elements = Vec::new();
    let mut writer = ByteWriter::new(&mut elements, ByteOrder::Little);
    // The number of a marker contains the number of its body in the upper half and its place in the lower half.
    let ids = bodies.iter().flat_map(|body| {
        (1..).zip(&body.markers_m).map(|(place, _): (i32, _)| (body.id << 16) | place)
    });
    let mut count = 0;
    for (id, marker) in ids.zip(frame.markers) {
        let Some(position) = marker.position_m else { continue };
        writer.i32(id).f32s(&position.map(|x| x as f32)).f32(MARKER_SIZE_M);
        writer.i16(POINT_SOLVED | HAS_MODEL).f32(marker.residual_m as f32);
        count += 1;
    }
    (count, elements)
}

fn write_suffix(writer: &mut ByteWriter<'_>, frame: &MotionFrame<'_>, sized: bool) {
    let ticks = |nanos: u64| (u128::from(nanos) * u128::from(CLOCK_HZ) / 1_000_000_000) as u64;
    let (captured, sent) = (ticks(frame.captured_ns), ticks(frame.sent_ns));
    // No timecode.
    writer.u32(0).u32(0).f64(frame.captured_ns as f64 * 1e-9);
    writer.u64(captured).u64(sent).u64(sent);
    if sized {
        // No precision time: the server has no reference clock.
        writer.u32(0).u32(0);
    }
    writer.i16(0).i32(0);
}
