//! `[safety]`: which poses the daemon accepts, when it flies, and when it stops the motors.

use oqtal_control::options::{OptionError, Rule, check_options};
use oqtal_control::predictive::FilterOptions;
use serde::{Deserialize, Serialize};

/// `[safety]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct SafetyOptions {
    /// Rate at which poses are expected \[Hz\].
    pub pose_rate_hz: f64,
    /// Greatest age of a pose that is accepted \[ms since its capture\].
    pub max_pose_age_ms: f64,
    /// Greatest speed between two poses on the ground \[m/s\]; a faster pose is a jump.
    pub max_speed_m_s: f64,
    /// Greatest rate of turn between two poses on the ground \[rad/s\]; a faster pose is a jump.
    pub max_rate_rad_s: f64,
    /// Greatest distance in flight of a pose from the motion that the commands sent predict \[standard deviations\].
    pub gate_sigma: f64,
    /// Good poses in a row after which poses are accepted again.
    pub recovery_poses: u32,
    /// Time without accepted poses during which the vehicle is flown on the predicted motion \[ms\].
    pub predict_ms: f64,
    /// Time without accepted poses after which the motors stop \[ms\].
    pub coast_ms: f64,
    /// Time without a reply after which the vehicle counts as silent \[ms\]: no take-off, and in flight the motors stop.
    pub vehicle_silence_ms: f64,
    /// Time within which the motors of a real vehicle must run once a flight begins \[ms\]; after it the flight is stopped.
    pub motor_start_ms: f64,
    /// Whether the daemon runs its loop and publishes telemetry but never flies. Set by itself where a recording is played.
    pub observe_only: bool,
    /// Whether the daemon flies once without an operator, as soon as poses and vehicle allow it. Only a simulated vehicle is
    /// flown so.
    pub arm_at_start: bool,
    /// `[safety.filter]`: noise of poses and of the motion, for the gate.
    pub filter: FilterOptions,
}

impl SafetyOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("pose-rate-hz", self.pose_rate_hz, Rule::Between(f64::MIN_POSITIVE, 1000.0)),
            ("max-pose-age-ms", self.max_pose_age_ms, Rule::Positive),
            ("max-speed-m-s", self.max_speed_m_s, Rule::Positive),
            ("max-rate-rad-s", self.max_rate_rad_s, Rule::Positive),
            ("gate-sigma", self.gate_sigma, Rule::Positive),
            ("recovery-poses", f64::from(self.recovery_poses), Rule::Between(1.0, f64::MAX)),
            ("predict-ms", self.predict_ms, Rule::NotNegative),
            ("coast-ms", self.coast_ms, Rule::Positive),
            ("vehicle-silence-ms", self.vehicle_silence_ms, Rule::Positive),
            ("motor-start-ms", self.motor_start_ms, Rule::Positive),
        ])
        .map_err(|error| error.within("safety"))?;
        self.filter.check().map_err(|error| error.within("safety.filter"))
    }
}
