//! Health of the loop's input and timing: age and losses of poses, late ticks.

use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_runtime::overrun::OverrunMonitor;

use crate::limits::LimitConditions;

/// Window of the share of frames that were lost or refused \[ticks\]: five seconds at 60 Hz.
const LOSS_WINDOW: f64 = 300.0;

/// Frames of the cameras so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct TickFrames {
    /// Frames whose pose was accepted \[-\].
    pub accepted: u64,
    /// Frames that were lost, or whose pose was refused \[-\].
    pub bad: u64,
}

/// Health of poses and ticks.
#[derive(Clone, Debug)]
pub struct LoopHealth {
    age_warning: Span,
    age_limit: Span,
    loss_warning: f64,
    /// Age of the last accepted pose when it was used.
    age: Span,
    /// Frames of the camera in the window of the loss \[-\].
    window: f64,
    frames: TickFrames,
    /// Share of lost and refused frames in the window \[0..1\].
    loss: f64,
    overruns: OverrunMonitor,
}

impl LoopHealth {
    /// The health of a loop that has not begun, with the limits of `config`.
    pub fn new(config: &Config) -> Self {
        let safety = &config.safety;
        let millis = |millis: f64| Span::from_seconds(millis * 1e-3);
        Self {
            age_warning: millis(safety.pose_age_warning_ms),
            age_limit: millis(safety.pose_age_limit_ms),
            loss_warning: safety.pose_loss_warning,
            age: Span::default(),
            window: LOSS_WINDOW * config.poses_per_tick(),
            frames: TickFrames::default(),
            loss: 0.0,
            overruns: OverrunMonitor::new(Span::period_of(config.control.rate_hz)),
        }
    }

    /// Records a tick: the age of the pose that it uses, if any, and the frames so far.
    pub fn tick(&mut self, used: Option<Span>, frames: TickFrames) {
        let before = std::mem::replace(&mut self.frames, frames);
        let bad = frames.bad.saturating_sub(before.bad) as f64;
        let all = bad + frames.accepted.saturating_sub(before.accepted) as f64;
        if all > 0.0 {
            self.loss += (all / self.window).min(1.0) * (bad / all - self.loss);
        }
        self.age = used.unwrap_or(self.age);
    }

    /// Begins a flight: frames lost on the ground, where a person may cover the markers, do not count for the flight.
    pub fn begin_flight(&mut self) {
        self.loss = 0.0;
    }

    /// Records a command that was sent at `sent_at` and due at `due`: the publication of its pose, or the deadline of its tick if that is
    /// earlier.
    pub fn sent(&mut self, due: Time, sent_at: Time) {
        self.overruns.turn_ended(due, sent_at);
    }

    /// Number of commands sent more than a period after they were due \[-\].
    pub fn deadline_misses(&self) -> u64 {
        self.overruns.late_turns()
    }

    /// Fills in the conditions of poses and loop.
    pub fn check(&self, conditions: &mut LimitConditions) {
        conditions.poses_old = self.age > self.age_warning;
        conditions.poses_too_old = self.age > self.age_limit;
        conditions.poses_lost = self.loss > self.loss_warning;
        conditions.overrun = self.overruns.runs_late();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a loss of one frame in `one_in` causes a warning at this frame rate of the cameras.
    fn warns(frame_rate_hz: f64, one_in: u64) -> bool {
        let mut config = Config::default();
        config.plant.frame_rate_hz = frame_rate_hz;
        let mut health = LoopHealth::new(&config);
        let mut frames = TickFrames::default();
        let per_tick = config.poses_per_tick().round() as u64;
        for frame in 0..6000 * per_tick {
            match frame % one_in {
                0 => frames.bad += 1,
                _ => frames.accepted += 1,
            }
            if frame % per_tick == 0 {
                health.tick(Some(Span::from_millis(15)), frames);
            }
        }
        let mut conditions = LimitConditions::default();
        health.check(&mut conditions);
        conditions.poses_lost
    }

    #[test]
    fn f11_the_share_of_lost_frames_is_that_of_all_frames_at_any_rate_of_the_cameras() {
        let one_in = (1.0 / Config::default().safety.pose_loss_warning) as u64;
        for frame_rate_hz in [60.0, 180.0, 240.0] {
            assert!(warns(frame_rate_hz, one_in / 2), "{frame_rate_hz} Hz");
            assert!(!warns(frame_rate_hz, one_in * 2), "{frame_rate_hz} Hz");
        }
    }
}
