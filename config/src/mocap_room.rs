//! `[mocap.room]`: timing and noise of a real camera system that the simple model lacks.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

/// Greatest delay of a pose by any one cause \[ms\].
const LONGEST_DELAY_MS: f64 = 60_000.0;
/// Rule of a delay \[ms\].
pub(crate) const DELAY: Rule = Rule::Between(0.0, LONGEST_DELAY_MS);

/// `[mocap.room]`. Has no effect with every probability, rate and period at zero.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RoomOptions {
    /// Period at which the camera computer sends its newest frame \[ms\]; 0 sends every frame.
    pub send_period_ms: f64,
    /// Probability that the camera computer misses a period \[0..1\].
    pub send_skip_probability: f64,
    /// Probability that it sends late \[0..1\].
    pub send_late_probability: f64,
    /// Greatest lateness \[ms\], uniform from 0.
    pub send_late_ms: f64,
    /// Mean number of stalls of the connection in 1000 s \[-\].
    pub stalls_per_1000_s: f64,
    /// Duration of the shortest stall \[ms\]; durations are log-uniform.
    pub stall_from_ms: f64,
    /// Duration of the longest stall \[ms\].
    pub stall_to_ms: f64,
    /// Probability that the poses of a stall never arrive \[0..1\]; otherwise they arrive after it, in order.
    pub stall_loss_probability: f64,
    /// Mean time between the poses that arrive after a stall \[ms\].
    pub queue_spacing_ms: f64,
    /// Standard deviation of the noise of the position that is correlated in time \[mm, per axis\].
    pub position_drift_mm: f64,
    /// Standard deviation of the noise of the attitude that is correlated in time \[deg, per body axis\].
    pub attitude_drift_deg: f64,
    /// Correlation of the noise of roll with that of z, of pitch with x, of yaw with y \[0..1\].
    pub pose_coupling_ratio: f64,
    /// Probability that the noise of a frame is greater than usual \[0..1\].
    pub heavy_tail_probability: f64,
    /// Factor of the noise in such a frame \[-\].
    pub heavy_tail_ratio: f64,
    /// For `stamp = "clock"`: the foreign clock minus that of this machine at the start \[ms\].
    pub clock_offset_ms: f64,
    /// For `stamp = "clock"`: rate of the foreign clock over that of this machine, minus one, times one million \[-\].
    pub clock_drift_ppm: f64,
}

impl RoomOptions {
    /// Whether any effect draws random numbers.
    pub fn is_random(&self) -> bool {
        [
            self.send_period_ms,
            self.stalls_per_1000_s,
            self.position_drift_mm,
            self.attitude_drift_deg,
            self.heavy_tail_probability,
        ]
        .iter()
        .any(|amount| *amount > 0.0)
    }

    pub(crate) fn check(&self) -> Result<(), OptionError> {
        let share = Rule::Between(0.0, 1.0);
        check_options([
            ("send-period-ms", self.send_period_ms, DELAY),
            ("send-skip-probability", self.send_skip_probability, Rule::Between(0.0, 0.99)),
            ("send-late-probability", self.send_late_probability, share),
            ("send-late-ms", self.send_late_ms, DELAY),
            ("stalls-per-1000-s", self.stalls_per_1000_s, Rule::NotNegative),
            ("stall-from-ms", self.stall_from_ms, Rule::Positive),
            ("stall-to-ms", self.stall_to_ms, Rule::Between(self.stall_from_ms, LONGEST_DELAY_MS)),
            ("stall-loss-probability", self.stall_loss_probability, share),
            ("queue-spacing-ms", self.queue_spacing_ms, DELAY),
            ("position-drift-mm", self.position_drift_mm, Rule::NotNegative),
            ("attitude-drift-deg", self.attitude_drift_deg, Rule::NotNegative),
            ("pose-coupling-ratio", self.pose_coupling_ratio, share),
            ("heavy-tail-probability", self.heavy_tail_probability, share),
            ("heavy-tail-ratio", self.heavy_tail_ratio, Rule::Between(1.0, 1000.0)),
            ("clock-offset-ms", self.clock_offset_ms, Rule::Between(-1e6, 1e6)),
            ("clock-drift-ppm", self.clock_drift_ppm, Rule::Between(-1e5, 1e5)),
        ])
    }
}
