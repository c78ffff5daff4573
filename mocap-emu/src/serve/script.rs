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
        /// Playback of the recording.
        replay: Replay,
        /// Time from the last pose to the first one of the next playback.
        interval: Span,
        /// Number of frames before this playback \[-\].
        offset: u64,
        /// Time stamp and number of the last frame.
        last: (Time, u64),
    },
}

impl Script {
    /// Plays the recording if there is one, otherwise the scene at this rate \[Hz\], from the first [`Self::resume`] on.
    pub fn new(recording: Option<Recording>, scene: SceneName, rate_hz: f64) -> Self {
        let (interval, start) = (Span::period_of(rate_hz), Time::UNSET);
        match recording {
            None => Self::Scene { scene, period: interval, frame: 0, start },
            Some(recording) => {
                let replay = Replay::new(recording, start);
                Self::Recording { replay, interval, offset: 0, last: (start, 0) }
            }
        }
    }

    /// Continues at `now` with the next frame.
    pub fn resume(&mut self, now: Time) {
        let pause = now.since(self.next_event());
        match self {
            Self::Scene { start, .. } => *start = *start + pause,
            Self::Recording { replay, .. } => replay.delay(pause),
        }
    }

    /// Instant of the next frame. A recording that has ended starts again, one interval after its last pose.
    pub fn next_event(&mut self) -> Time {
        match self {
            Self::Scene { period, frame, start, .. } => *start + period.scaled(*frame as f64),
            Self::Recording { replay, interval, offset, last } => {
                if let Some(at) = replay.next_event() {
                    return at;
                }
                let again = last.0 + *interval;
                *offset = last.1;
                replay.restart(again);
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    const START: Time = Time::VIRTUAL_START;

    fn millis(count: i64) -> Span {
        Span::from_millis(count)
    }

    /// Numbers of the next `count` frames, and their instants after the start.
    fn frames(script: &mut Script, count: usize) -> Vec<(u64, Span)> {
        let frames = (0..count).map(|_| script.frame(1));
        frames.map(|frame| (frame.number, frame.captured_at.since(START))).collect()
    }

    #[test]
    fn a_recording_is_repeated_and_continues_after_a_pause_with_the_next_pose() {
        let rows = (0..3).map(|k| format!("{},0,0,1,0,0,0,1\n", f64::from(k) * 0.1));
        let text: String =
            std::iter::once("t,x,y,z,qx,qy,qz,qw\n".to_owned()).chain(rows).collect();
        let recording = Recording::parse(Path::new("test.csv"), text.as_bytes()).unwrap();
        let mut script = Script::new(Some(recording), SceneName::Hover, 10.0);
        script.resume(START);
        let at = |number, after| (number, millis(after));
        assert_eq!(frames(&mut script, 4), [at(1, 0), at(2, 100), at(3, 200), at(4, 300)]);
        script.resume(START + millis(5000));
        assert_eq!(frames(&mut script, 3), [at(5, 5000), at(6, 5100), at(7, 5200)]);
    }

    #[test]
    fn a_scene_continues_after_a_pause_with_the_next_frame() {
        let mut script = Script::new(None, SceneName::Lemniscate, 10.0);
        script.resume(START);
        let at = |number, after| (number, millis(after));
        assert_eq!(frames(&mut script, 2), [at(1, 0), at(2, 100)]);
        script.resume(START + millis(5000));
        assert_eq!(frames(&mut script, 2), [at(3, 5000), at(4, 5100)]);
    }
}
