//! Recordings made by the emulated cameras, of a prescribed motion.

use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::MocapOptions;
use oqtal_control::quaternion::Attitude;

use crate::cameras::Cameras;
use crate::recording::{RecordedPose, Recording};

/// Recording of a motion by the emulated cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct EmulatedRecording {
    /// Poses with their arrivals.
    pub recording: Recording,
    /// Stamp of each pose's capture, after the first arrival \[s\].
    pub stamped_s: Vec<f64>,
    /// Number of each pose's frame among those sent, from 1 \[-\].
    pub frames: Vec<u64>,
}

/// Records `motion`, the true state as a function of time, with the cameras of `mocap` for `seconds`. Untracked poses are left
/// out. `None` if fewer than two poses arrive.
pub fn record(
    (mocap, seed): (&MocapOptions, u64),
    seconds: f64,
    motion: impl Fn(f64) -> TruthV1,
) -> Option<EmulatedRecording> {
    let mut cameras = Cameras::new(mocap, seed);
    let start = Time::VIRTUAL_START;
    let (mut poses, mut stamps, mut frames) = (Vec::new(), Vec::new(), Vec::new());
    for capture in 1..=(seconds * mocap.rate_hz) as u64 {
        let t_s = capture as f64 / mocap.rate_hz;
        let time = start + Span::from_seconds(t_s);
        cameras.capture(&TruthV1 { time, capture, ..motion(t_s) });
        while let Some(at) = cameras.next_event().filter(|at| *at <= time) {
            let Some(delivery) = cameras.deliver(at) else { break };
            let Some(attitude) = Attitude::from_xyzw(delivery.pose.attitude) else { continue };
            let position = delivery.pose.position.into();
            poses.push(RecordedPose { time_ns: at.nanos(), position, attitude });
            stamps.push(delivery.stamps.captured_at);
            frames.push(delivery.frame);
        }
    }
    let first = Time::from_nanos(poses.first()?.time_ns);
    let recording = Recording::from_poses(poses)?;
    let stamped_s = stamps.iter().map(|stamp| stamp.since(first).seconds()).collect();
    Some(EmulatedRecording { recording, stamped_s, frames })
}
