//! Motion shown by the command `serve`: a scene, or a recording.

use oqtal_bus::time::{Span, Time};
use oqtal_wire::motion::{BodySample, RigidPose};

use super::feed::ServedFrame;
use super::source::sample;
use crate::recording::Recording;
use crate::replay::Replay;
use crate::scene::SceneName;

/// Distance between two bodies, along y \[m\].
const BODY_DISTANCE_M: f64 = 1.0;

/// Source of the poses.
pub enum Script {
    /// A scene at a constant rate.
    Scene {
        /// Motion.
        scene: SceneName,
        /// Time between frames.
        period: Span,
        /// Frames so far \[-\].
        frame: u64,
        /// Instant of the first frame.
        start: Time,
    },
    /// A recording, repeated endlessly.
    Recording {
        /// Content of the recording.
        recording: Recording,
        /// Playback of the recording.
        replay: Replay,
        /// Number of frames before this playback \[-\].
        offset: u64,
        /// Time stamp and number of the last frame.
        last: (Time, u64),
    },
}

impl Script {
    /// Plays the recording if there is one, otherwise the scene at this rate \[Hz\], starting at this instant.
    pub fn new(
        recording: Option<Recording>,
        scene: SceneName,
        (rate_hz, start): (f64, Time),
    ) -> Self {
        match recording {
            None => Self::Scene { scene, period: Span::period_of(rate_hz), frame: 0, start },
            Some(recording) => {
                let replay = Replay::new(recording.clone(), start);
                Self::Recording { recording, replay, offset: 0, last: (start, 0) }
            }
        }
    }

    /// Instant of the next frame. A recording that has ended starts again, one interval after its last pose.
    pub fn next_event(&mut self) -> Time {
        match self {
            Self::Scene { period, frame, start, .. } => *start + period.scaled(*frame as f64),
            Self::Recording { recording, replay, offset, last } => {
                if let Some(at) = replay.next_event() {
                    return at;
                }
                let again = last.0 + Span::period_of(recording.nominal_rate_hz());
                *offset = last.1;
                *replay = Replay::new(recording.clone(), again);
                again
            }
        }
    }

    /// The frame that is due.
    pub fn frame(&mut self, bodies: usize) -> ServedFrame {
        let at = self.next_event();
        let (number, body) = match self {
            Self::Scene { scene, period, frame, .. } => {
                let pose = scene.pose(period.seconds() * *frame as f64);
                *frame += 1;
                (*frame, BodySample { pose: Some(pose), residual_m: 0.0 })
            }
            Self::Recording { replay, offset, last, .. } => match replay.deliver(at) {
                Some(delivery) => {
                    *last = (at, *offset + delivery.frame);
                    (last.1, sample(&delivery.pose))
                }
                None => (last.1, BodySample::LOST),
            },
        };
        let mut frame = ServedFrame::new(number, at);
        for place in 0..bodies {
            frame.push(displaced(body, place as f64 * BODY_DISTANCE_M));
        }
        frame
    }
}

/// The same body, displaced along y.
fn displaced(body: BodySample, by_m: f64) -> BodySample {
    let pose = body.pose.map(|pose| {
        let [x, y, z] = pose.position_m;
        RigidPose { position_m: [x, y + by_m, z], ..pose }
    });
    BodySample { pose, ..body }
}
