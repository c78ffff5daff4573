//! Poses, a transform, log entries and clock offsets for viewers, in Foxglove's well-known schemas if there is one.

use super::cdr::CdrWriter;

/// Schema of poses.
pub const POSE: (&str, &str) =
    ("foxglove_msgs/msg/PoseInFrame", include_str!("scene/PoseInFrame.msg"));

/// Schema of transforms.
pub const TRANSFORM: (&str, &str) =
    ("foxglove_msgs/msg/FrameTransform", include_str!("scene/FrameTransform.msg"));

/// Schema of log entries.
pub const LOG: (&str, &str) = ("foxglove_msgs/msg/Log", include_str!("scene/Log.msg"));

/// Schema of clock offsets.
pub const CLOCK: (&str, &str) =
    ("oqtal_msgs/msg/ClockOffset", include_str!("scene/ClockOffset.msg"));

/// Severity of a log entry, with the numbers of the schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum LogSeverity {
    /// As expected.
    Info = 2,
    /// A safety limit was reached.
    Warning = 3,
    /// Data are missing.
    Error = 4,
}

/// A pose in the world: instant \[ns since the epoch\], position \[m, world\], attitude, scalar last \[body to world\].
#[derive(Clone, Copy, Debug)]
pub struct ScenePose {
    /// Instant \[ns since the epoch\].
    pub at_ns: u64,
    /// Position \[m, world\].
    pub position: [f64; 3],
    /// Attitude, scalar last \[body to world\].
    pub attitude: [f64; 4],
}

impl ScenePose {
    /// Writes the pose as [`POSE`].
    pub fn write_pose(&self, bytes: &mut Vec<u8>) {
        let mut writer = CdrWriter::begin(bytes);
        writer.instant(self.at_ns);
        writer.text("world");
        self.write_numbers(&mut writer);
    }

    /// Writes the transform from the world to the body `child` as [`TRANSFORM`].
    pub fn write_transform(&self, child: &str, bytes: &mut Vec<u8>) {
        let mut writer = CdrWriter::begin(bytes);
        writer.instant(self.at_ns);
        writer.text("world");
        writer.text(child);
        self.write_numbers(&mut writer);
    }

    fn write_numbers(&self, writer: &mut CdrWriter<'_>) {
        // Viewers cannot draw an unknown attitude.
        let known = self.attitude.iter().all(|number| number.is_finite())
            && self.attitude.iter().any(|number| *number != 0.0);
        writer.numbers(&self.position);
        writer.numbers(if known { &self.attitude } else { &[0.0, 0.0, 0.0, 1.0] });
    }
}

/// Writes a log entry of the process `name` as [`LOG`].
pub fn write_log(at_ns: u64, severity: LogSeverity, entry: (&str, &str), bytes: &mut Vec<u8>) {
    let (name, message) = entry;
    let mut writer = CdrWriter::begin(bytes);
    writer.instant(at_ns);
    writer.u8(severity as u8);
    writer.text(message);
    writer.text(name);
    writer.text("");
    writer.u32(0);
}

/// Writes a clock offset as [`CLOCK`].
pub fn write_clock(monotonic_ns: u64, offset_ns: i64, bytes: &mut Vec<u8>) {
    let mut writer = CdrWriter::begin(bytes);
    writer.u64(monotonic_ns);
    writer.u64(offset_ns.cast_unsigned());
}
