//! Health of the loop's input and timing: age and losses of poses, late ticks.

use oqtal_bus::time::Span;
use oqtal_config::SafetyOptions;

use crate::limits::LimitConditions;

/// Weight of a frame in the shares of frames \[-\]: a window of five seconds at 60 Hz.
const LOSS_WEIGHT: f64 = 1.0 / 300.0;
/// Late ticks in a row that make an overrun \[-\].
const OVERRUN_TICKS: u32 = 3;

/// Health of poses and ticks.
#[derive(Clone, Debug)]
pub struct LoopHealth {
    age_warning: Span,
    age_limit: Span,
    loss_warning: f64,
    /// Age of the last accepted pose when it was used.
    age: Span,
    /// Frames lost and poses refused so far \[-\].
    bad: u64,
    /// Share of such frames lately \[0..1\].
    loss: f64,
    late_ticks: u32,
}

impl LoopHealth {
    /// The health of a loop that has not begun, with the limits of `safety`.
    #[must_use]
    pub fn new(safety: &SafetyOptions) -> Self {
        let millis = |millis: f64| Span::from_seconds(millis * 1e-3);
        Self {
            age_warning: millis(safety.pose_age_warning_ms),
            age_limit: millis(safety.pose_age_limit_ms),
            loss_warning: safety.pose_loss_warning,
            age: Span::default(),
            bad: 0,
            loss: 0.0,
            late_ticks: 0,
        }
    }

    /// Records a tick: the age of the pose that it uses, if any, and the frames lost and refused so far, in total.
    pub fn tick(&mut self, used: Option<Span>, bad: u64) {
        let lost = bad.saturating_sub(self.bad) as f64;
        self.bad = bad;
        let used_frames = f64::from(u8::from(used.is_some()));
        let frames = lost + used_frames;
        if frames > 0.0 {
            self.loss += (frames * LOSS_WEIGHT).min(1.0) * (lost / frames - self.loss);
        }
        self.age = used.unwrap_or(self.age);
    }

    /// Records whether the command of a tick was late.
    pub fn sent(&mut self, late: bool) {
        self.late_ticks = if late { self.late_ticks.saturating_add(1) } else { 0 };
    }

    /// Fills in the conditions of poses and loop.
    pub fn judge(&self, conditions: &mut LimitConditions) {
        conditions.poses_old = self.age > self.age_warning;
        conditions.poses_too_old = self.age > self.age_limit;
        conditions.poses_lost = self.loss > self.loss_warning;
        conditions.overrun = self.late_ticks >= OVERRUN_TICKS;
    }
}
