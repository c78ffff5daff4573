//! Playback of a recording with its own timing, gaps and bursts included.
//!
//! A recording contains only the frames that arrived. Frame numbers are reconstructed from arrival times and the nominal rate of
//! the recording, so that a gap skips one number per lost frame. Poses that arrived late, as in the burst after a stall, do not
//! count as lost: each pose has the greatest number that is consistent with its arrival and the poses after it.
//!
//! Poses are delivered at their recorded arrivals. `captured_at` is the capture estimated by [`Captures`], never after the
//! arrival.

use oqtal_bus::message::{PoseV1, Stamps};
use oqtal_bus::time::{Span, Time};
use oqtal_runtime::pose_source::Delivery;

use crate::body::BODY;
use crate::capture::Captures;
use crate::recording::Recording;

/// A recording during playback. Pure: time is an argument.
#[derive(Clone, Debug)]
pub struct Replay {
    recording: Recording,
    /// Frame number of each pose, from 1 \[-\].
    frames: Vec<u64>,
    /// Time from the capture of each pose to its arrival.
    ages: Vec<Span>,
    start: Time,
    played: usize,
}

impl Replay {
    /// Starts the playback of `recording`; its first pose arrives at `start`.
    pub fn new(recording: Recording, start: Time) -> Self {
        let frames = number_frames(&recording);
        let captured = Captures::of(&recording).captured_s;
        let ages = recording.poses().iter().zip(&captured).map(|(pose, captured_s)| {
            Span::from_nanos(pose.time_ns.cast_signed()) - Span::from_seconds(*captured_s)
        });
        let ages = ages.map(|age| age.max(Span::ZERO)).collect();
        Self { recording, frames, ages, start, played: 0 }
    }

    /// Arrival of the next pose; `None` at the end of the recording.
    pub fn next_event(&self) -> Option<Time> {
        let pose = self.recording.poses().get(self.played)?;
        Some(self.start + Span::from_nanos(pose.time_ns.cast_signed()))
    }

    /// Plays the recording from its first pose again, which arrives at `start`.
    pub fn restart(&mut self, start: Time) {
        (self.start, self.played) = (start, 0);
    }

    /// Delays the remaining poses by `pause`.
    pub fn delay(&mut self, pause: Span) {
        self.start = self.start + pause;
    }

    /// The next pose that has arrived by `now`, one per call; `None` if there is none.
    pub fn deliver(&mut self, now: Time) -> Option<Delivery> {
        let arrives_at = self.next_event().filter(|arrives_at| *arrives_at <= now)?;
        let pose = self.recording.poses()[self.played];
        let (frame, age) = (self.frames[self.played], self.ages[self.played]);
        self.played += 1;
        Some(Delivery {
            frame,
            stamps: Stamps { captured_at: arrives_at - age, ..Stamps::default() },
            pose: PoseV1 {
                position: pose.position.into(),
                attitude: pose.attitude.xyzw(),
                // Recordings do not contain a residual.
                residual_m: f64::NAN,
                body: BODY,
                tracked: 1,
                simulated: 1,
                ..PoseV1::default()
            },
        })
    }
}

/// The frame number of each pose of a recording, at its nominal rate.
fn number_frames(recording: &Recording) -> Vec<u64> {
    let rate_hz = recording.nominal_rate_hz();
    let mut limit = i64::MAX;
    let latest = recording.poses().iter().rev().map(|pose| {
        let by_time = (pose.time_ns as f64 * 1e-9 * rate_hz).round() as i64;
        limit = by_time.min(limit - 1);
        limit
    });
    let latest: Vec<i64> = latest.collect();
    let first = latest.last().copied().unwrap_or_default();
    latest.iter().rev().map(|frame| 1 + (frame - first).unsigned_abs()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// The frame numbers of poses that arrived at these times \[ms\].
    fn frames(millis: &[u64]) -> Vec<u64> {
        let rows = millis.iter().map(|t| format!("{},0,0,1,0,0,0,1\n", *t as f64 * 1e-3));
        let text = std::iter::once("t,x,y,z,qx,qy,qz,qw\n".to_owned()).chain(rows);
        let recording =
            Recording::parse(Path::new("test.csv"), text.collect::<String>().as_bytes());
        number_frames(&recording.unwrap())
    }

    #[test]
    fn regular_poses_are_numbered_one_by_one() {
        let millis: Vec<u64> = (0..500).map(|k| k * 20).collect();
        assert_eq!(frames(&millis), (1..=500).collect::<Vec<u64>>());
    }

    #[test]
    fn a_gap_leaves_out_as_many_numbers_as_frames_were_lost() {
        let millis: Vec<u64> =
            (0..500).filter(|k| !(200..207).contains(k)).map(|k| k * 20).collect();
        let frames = frames(&millis);
        assert_eq!(frames[200] - frames[199], 8);
        assert_eq!(frames.last(), Some(&500));
    }

    #[test]
    fn a_stall_whose_poses_come_in_a_burst_loses_none() {
        let millis = (0..500).map(|k| if (200..207).contains(&k) { 207 * 20 } else { k * 20 });
        let frames = frames(&millis.collect::<Vec<u64>>());
        assert_eq!(frames.last(), Some(&500));
        assert!(frames.windows(2).all(|pair| pair[1] == pair[0] + 1));
    }

    #[test]
    fn poses_of_a_polling_host_are_all_counted() {
        // 60 Hz, delivered at multiples of 10 ms.
        let millis: Vec<u64> = (0..2000_u64).map(|k| (k * 1000).div_ceil(600) * 10).collect();
        let frames = frames(&millis);
        assert!(frames.last().unwrap().abs_diff(2000) <= 1, "{:?}", frames.last());
    }
}
