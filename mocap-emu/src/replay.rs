//! A recording in place of the cameras, with its own timing: gaps and bursts included.

use oqtal_bus::message::{PoseV1, Stamps};
use oqtal_bus::time::{Span, Time};

use crate::Delivery;
use crate::recording::Recording;

/// A recording being played. Pure: time comes in as an argument.
#[derive(Clone, Debug)]
pub struct Replay {
    recording: Recording,
    start: Time,
    played: usize,
}

impl Replay {
    /// Plays `recording`; its first pose arrives at `start`.
    #[must_use]
    pub fn new(recording: Recording, start: Time) -> Self {
        Self { recording, start, played: 0 }
    }

    /// When the next pose arrives; `None` once all have been played.
    #[must_use]
    pub fn next_event(&self) -> Option<Time> {
        let pose = self.recording.poses().get(self.played)?;
        Some(self.start + Span::from_nanos(pose.time_ns.cast_signed()))
    }

    /// The pose that has arrived by `now`, one a call.
    pub fn deliver(&mut self, now: Time) -> Option<Delivery> {
        let arrives_at = self.next_event().filter(|arrives_at| *arrives_at <= now)?;
        let pose = self.recording.poses()[self.played];
        self.played += 1;
        Some(Delivery {
            frame: self.played as u64,
            // A recording knows when its poses arrived, not when they were captured.
            stamps: Stamps { captured_at: arrives_at, ..Stamps::default() },
            pose: PoseV1 {
                position: pose.position.into(),
                attitude: pose.attitude.xyzw(),
                tracked: 1,
            },
        })
    }
}
