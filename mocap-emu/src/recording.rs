//! Recordings of motion capture: poses with the times of their arrival at the host.
//!
//! Three formats are recognised by their content:
//! - comma-separated with a header that names `t,x,y,z,qx,qy,qz,qw`, in any order and case, `t` in seconds;
//! - TUM trajectory text, `timestamp tx ty tz qx qy qz qw`, seconds, without a header;
//! - EuRoC ground truth, comma-separated under `#timestamp, p_RS_R_x [m], ...`, nanoseconds, scalar first.
//!
//! A header may name further columns, which are ignored; every line must have as many fields as the header. Blank lines,
//! `#` comments, a byte-order mark and carriage returns are skipped. Positions are in metres. Quaternions are Hamilton,
//! body to world; a norm within 1 % of one is normalised, any other norm is an error.
//!
//! Times are kept as recorded, with bursts and gaps. Consecutive poses may have equal times, as in a burst stamped by a
//! coarse clock; a time before the previous one is an error.

mod error;
mod format;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use nalgebra::Vector3;
use oqtal_control::quaternion::Attitude;
use oqtal_runtime::process::{Exit, Failure};

pub use error::{ErrorKind, MAX_BYTES, RecordingError};
use format::{Layout, PoseRow};

/// One pose as it reached the host.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordedPose {
    /// Arrival after the first pose of the recording \[ns\].
    pub time_ns: u64,
    /// Position of the body \[m, world\].
    pub position: Vector3<f64>,
    /// Attitude of the body \[body to world\].
    pub attitude: Attitude,
}

/// A recording: at least two poses in the order of their arrival, the first at time zero, the last at a later time.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    poses: Vec<RecordedPose>,
}

impl Recording {
    /// Reads a recording from a file of at most [`MAX_BYTES`].
    ///
    /// # Errors
    /// The file cannot be read, or [`Recording::parse`] fails.
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        let mut bytes = Vec::new();
        // Reading one byte above the limit detects a file that is too large, even an endless one.
        File::open(path)
            .and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes))
            .map_err(|reason| RecordingError::new(path, None, ErrorKind::Unreadable(reason)))?;
        Self::parse(path, &bytes)
    }

    /// Parses the content of a file; `path` names the file in errors.
    ///
    /// # Errors
    /// The first fault in the file, with its line.
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self, RecordingError> {
        if bytes.len() as u64 > MAX_BYTES {
            return Err(RecordingError::new(path, None, ErrorKind::TooLarge));
        }
        // Bytes that are not UTF-8 are accepted in comments; elsewhere they fail to parse as a number.
        let text = String::from_utf8_lossy(bytes);
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        parse_lines(text).map_err(|(line, kind)| RecordingError::new(path, Some(line), kind))
    }

    /// Recording of `poses`, in the order of their arrival; `None` if they do not span any time, or are out of order.
    pub fn from_poses(mut poses: Vec<RecordedPose>) -> Option<Self> {
        let first_ns = poses.first()?.time_ns;
        let is_ordered = poses.is_sorted_by_key(|pose| pose.time_ns);
        poses.iter_mut().for_each(|pose| pose.time_ns = pose.time_ns.saturating_sub(first_ns));
        (is_ordered && poses.last()?.time_ns > 0).then_some(Self { poses })
    }

    /// The poses in the order of their arrival.
    pub fn poses(&self) -> &[RecordedPose] {
        &self.poses
    }

    /// Rate of the cameras \[Hz\], estimated from arrivals: the mean rate without pauses of more than three median intervals.
    /// A pause includes the burst of poses after it.
    pub fn nominal_rate_hz(&self) -> f64 {
        let Timing { mean_rate_hz, median_ns, .. } = self.timing();
        let pause_ns = 3 * median_ns.max((1e9 / mean_rate_hz) as u64);
        let (mut count, mut regular_ns, mut paused) = (0_u64, 0_u64, false);
        for pair in self.poses.windows(2) {
            let interval = pair[1].time_ns - pair[0].time_ns;
            paused = interval > pause_ns || (paused && interval < median_ns / 2);
            if !paused {
                count += 1;
                regular_ns += interval;
            }
        }
        if regular_ns > 0 { 1e9 * count as f64 / regular_ns as f64 } else { mean_rate_hz }
    }

    /// Statistics of the intervals between arrivals.
    pub fn timing(&self) -> Timing {
        let mut intervals: Vec<u64> =
            self.poses.windows(2).map(|pair| pair[1].time_ns - pair[0].time_ns).collect();
        intervals.sort_unstable();
        let duration_ns = intervals.iter().sum();
        Timing {
            mean_rate_hz: 1e9 * intervals.len() as f64 / duration_ns as f64,
            duration_ns,
            // The smallest interval that is at least as long as half of all.
            median_ns: intervals[intervals.len().div_ceil(2) - 1],
        }
    }
}

/// Reads the recording at `path`.
///
/// # Errors
/// `FILE:LINE: kind of fault`, exit code 65.
pub fn read_recording(path: impl AsRef<Path>) -> Result<Recording, Failure> {
    Recording::read(path.as_ref()).map_err(|error| Failure::new(Exit::Data, error.to_string()))
}

/// Statistics of the intervals between the poses of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Mean rate over the whole recording \[Hz\].
    pub mean_rate_hz: f64,
    /// Time from the first pose to the last \[ns\].
    pub duration_ns: u64,
    /// Median interval \[ns\].
    pub median_ns: u64,
}

fn parse_lines(text: &str) -> Result<Recording, (usize, ErrorKind)> {
    let lines = (1..).zip(text.lines().map(str::trim)).filter(|(_, line)| !line.is_empty());
    let (layout, first_row) = find_layout(lines.clone())?;

    let mut poses = Vec::new();
    let mut first_ns = None;
    let mut previous: Option<PoseRow> = None;
    let rows =
        lines.clone().filter(|&(number, line)| number >= first_row && !line.starts_with('#'));
    for (number, line) in rows {
        let row = layout.row(line).map_err(|kind| (number, kind))?;
        if let Some(previous) = previous.filter(|previous| row.time_ns < previous.time_ns) {
            return Err((number, ErrorKind::time_backwards(previous.time_text, row.time_text)));
        }
        poses.push(RecordedPose {
            time_ns: row.time_ns.abs_diff(*first_ns.get_or_insert(row.time_ns)),
            position: row.position,
            attitude: row.attitude,
        });
        previous = Some(row);
    }
    if poses.last().is_none_or(|last| last.time_ns == 0) {
        let last_line = lines.last().map_or(1, |(number, _)| number);
        return Err((last_line, ErrorKind::TooShort(poses.len())));
    }
    Ok(Recording { poses })
}

/// The layout, and the number of the first line that may contain a pose.
fn find_layout<'a>(
    lines: impl Iterator<Item = (usize, &'a str)>,
) -> Result<(Layout, usize), (usize, ErrorKind)> {
    for (number, line) in lines {
        if let Some(layout) = Layout::detect(line).map_err(|kind| (number, kind))? {
            let first_row = if layout.has_header() { number + 1 } else { number };
            return Ok((layout, first_row));
        }
    }
    Err((1, ErrorKind::Empty))
}
