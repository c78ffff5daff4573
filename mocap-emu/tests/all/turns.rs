//! Recording of a body that is turned about each of its axes, which reveals errors of frame, handedness and axes.

use std::io::Write;

use nalgebra::{Rotation3, Unit, Vector3};
use tempfile::NamedTempFile;

/// Number of frames of the recording; it is played repeatedly.
pub const FRAMES: usize = 1200;
/// Rate of the recording \[Hz\].
pub const RATE_HZ: f64 = 100.0;
/// Number of frames for which the body is turned about one axis.
const HOLD: usize = 30;
/// Displacement along x per frame, which numbers the frames \[m\].
const STEP_M: f64 = 1e-4;
/// Angle of the turn about each axis \[rad\].
const TURN_RAD: f64 = 0.7;
/// Error of 32-bit numbers, positions in m and direction cosines.
const TOLERANCE: f64 = 5e-6;

/// A frame as a client received it.
#[derive(Clone, Copy, Debug)]
pub struct SeenFrame {
    /// Number of the frame, if the client reports it.
    pub number: Option<u64>,
    /// Position \[m\].
    pub position: [f64; 3],
    /// Directions of the axes x, y and z of the body, one after the other.
    pub axes: [f64; 9],
}

/// Axis about which the body is turned in frame `frame`.
fn axis(frame: usize) -> usize {
    frame / HOLD % 3
}

fn position(frame: usize) -> [f64; 3] {
    let mut position = [0.0, 0.0, 0.5];
    position[axis(frame)] += 1.0;
    position[0] += frame as f64 * STEP_M;
    position
}

/// Writes the recording.
pub fn recording() -> NamedTempFile {
    let mut file = NamedTempFile::with_suffix(".csv").unwrap();
    writeln!(file, "t,x,y,z,qx,qy,qz,qw").unwrap();
    for frame in 0..FRAMES {
        let mut turn = [0.0, 0.0, 0.0, (TURN_RAD / 2.0).cos()];
        turn[axis(frame)] = (TURN_RAD / 2.0).sin();
        let ([x, y, z], [qx, qy, qz, qw]) = (position(frame), turn);
        let t = frame as f64 / RATE_HZ;
        writeln!(file, "{t},{x},{y},{z},{qx},{qy},{qz},{qw}").unwrap();
    }
    file
}

/// Index of the frame that a client received; asserts that the pose agrees with the recording.
fn identified(seen: &SeenFrame) -> usize {
    let [x, y, z] = seen.position;
    let axis = if z > 1.0 { 2 } else { usize::from(y > 0.5) };
    let start = if axis == 0 { 1.0 } else { 0.0 };
    let frame = ((x - start) / STEP_M).round() as usize;
    let expected = position(frame);
    let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(Vector3::ith(axis, 1.0)), TURN_RAD);
    let apart = expected.iter().zip(seen.position).map(|(a, b)| (a - b).abs());
    let turned = turn.matrix().iter().zip(seen.axes).map(|(a, b)| (a - b).abs());
    let error = apart.chain(turned).fold(0.0, f64::max);
    assert!(error < TOLERANCE, "frame {frame}: {seen:?}, expected {expected:?} and {turn}");
    frame
}

/// Checks that every frame belongs to the recording and that all three turns were received; returns the number of frames that
/// were left out or out of order.
pub fn check(seen: &[SeenFrame]) -> usize {
    let frames: Vec<usize> = seen.iter().map(identified).collect();
    for turned in 0..3 {
        assert!(frames.iter().any(|frame| axis(*frame) == turned), "no turn about axis {turned}");
    }
    let wrong = frames.windows(2).filter(|pair| (pair[0] + 1) % FRAMES != pair[1]).count();
    let numbers: Vec<u64> = seen.iter().filter_map(|frame| frame.number).collect();
    assert!(numbers.is_empty() || numbers.len() == seen.len());
    let gaps = numbers.windows(2).filter(|pair| pair[0] + 1 != pair[1]).count();
    assert_eq!(
        if numbers.is_empty() { wrong } else { gaps },
        wrong,
        "numbers do not show the gaps"
    );
    wrong
}
