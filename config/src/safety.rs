//! `[safety]`: acceptance of poses, conditions of a flight, and limits that stop the motors.

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
    /// Greatest distance in flight of a pose from the motion predicted from the sent commands \[standard deviations\].
    pub gate_sigma: f64,
    /// Evidence against poses that do not follow the vehicle, above which they are not accepted \[-\].
    pub consistency_limit: f64,
    /// Amplitude of the oscillation of the heading reference of a vehicle without rates, or while no rotation confirms the poses
    /// \[deg\]. 0: no oscillation, and frozen poses with noise may not be found in a hover.
    pub probe_yaw_deg: f64,
    /// Greatest noise of a position that is learned \[mm\].
    pub max_position_noise_mm: f64,
    /// Greatest noise of an attitude that is learned \[deg\].
    pub max_attitude_noise_deg: f64,
    /// Number of consecutive good poses after which poses are accepted again.
    pub recovery_poses: u32,
    /// Time without accepted poses during which the vehicle is flown on the predicted motion \[ms\].
    pub predict_ms: f64,
    /// Time without accepted poses after which the motors stop, or a vehicle with its own attitude loop descends \[ms\].
    pub coast_ms: f64,
    /// Longest descent without poses of a vehicle with its own attitude loop, after which its motors stop \[ms\].
    pub descend_ms: f64,
    /// Thrust in such a descent over the hover thrust \[-\].
    pub descend_thrust: f64,
    /// Time without a reply after which the vehicle counts as silent \[ms\]: no take-off, and in flight the motors stop.
    pub vehicle_silence_ms: f64,
    /// Time after the beginning of a flight within which the motors of a real vehicle must run \[ms\]; otherwise the flight is
    /// stopped.
    pub motor_start_ms: f64,
    /// Greatest time-out of a real vehicle, after which it acts by itself without set-points \[ms\]; infinite: also none.
    pub vehicle_time_out_ms: f64,
    /// Greatest speed in flight \[m/s\].
    pub speed_limit_m_s: f64,
    /// Tilt in flight above which the daemon warns \[deg\].
    pub tilt_warning_deg: f64,
    /// Greatest tilt in flight \[deg\].
    pub tilt_limit_deg: f64,
    /// Greatest distance from the reference position \[m\]; not applied with a prescribed attitude.
    pub tracking_limit_m: f64,
    /// Battery voltage under load below which the daemon warns and arming is refused \[V\].
    pub battery_low_v: f64,
    /// Battery voltage under load below which the vehicle lands \[V\].
    pub battery_empty_v: f64,
    /// Share of answered requests to the vehicle below which the daemon warns \[0..1\].
    pub link_poor: f64,
    /// Share of answered requests to the vehicle below which the vehicle lands \[0..1\].
    pub link_bad: f64,
    /// Age of poses in use above which the daemon warns \[ms since capture\].
    pub pose_age_warning_ms: f64,
    /// Age of poses in use above which the vehicle lands \[ms since capture\].
    pub pose_age_limit_ms: f64,
    /// Fraction of frames lost or refused above which the daemon warns \[0..1\].
    pub pose_loss_warning: f64,
    /// Least and greatest height of the vehicle's body at which it may be armed \[m, world z\].
    pub arming_z_m: [f64; 2],
    /// Greatest tilt at which the vehicle may be armed \[deg\].
    pub arming_tilt_deg: f64,
    /// Whether a real vehicle may be armed on emulated poses: on the table, propellers off, or tied down (operations.md, steps 8 to 10).
    pub allow_emulated_poses: bool,
    /// Whether the daemon runs its loop and publishes telemetry but never flies. Set automatically during playback of a
    /// recording.
    pub observe_only: bool,
    /// Whether the daemon flies once without an operator, as soon as poses and vehicle are ready. Applies only to a simulated
    /// vehicle.
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
            ("consistency-limit", self.consistency_limit, Rule::Positive),
            ("probe-yaw-deg", self.probe_yaw_deg, Rule::Between(0.0, 10.0)),
            ("max-position-noise-mm", self.max_position_noise_mm, Rule::Between(1e-3, 100.0)),
            ("max-attitude-noise-deg", self.max_attitude_noise_deg, Rule::Between(1e-3, 5.0)),
            ("recovery-poses", f64::from(self.recovery_poses), Rule::Between(1.0, f64::MAX)),
            ("predict-ms", self.predict_ms, Rule::NotNegative),
            ("coast-ms", self.coast_ms, Rule::Positive),
            ("descend-ms", self.descend_ms, Rule::Between(0.0, 10_000.0)),
            ("descend-thrust", self.descend_thrust, Rule::Between(0.5, 0.97)),
            ("vehicle-time-out-ms", self.vehicle_time_out_ms, Rule::PositiveOrInfinite),
            ("speed-limit-m-s", self.speed_limit_m_s, Rule::Positive),
            ("tilt-warning-deg", self.tilt_warning_deg, Rule::Between(0.0, 180.0)),
            ("tilt-limit-deg", self.tilt_limit_deg, Rule::Between(0.0, 180.0)),
            ("tracking-limit-m", self.tracking_limit_m, Rule::Positive),
            ("battery-low-v", self.battery_low_v, Rule::NotNegative),
            ("battery-empty-v", self.battery_empty_v, Rule::NotNegative),
            ("link-poor", self.link_poor, Rule::Between(0.0, 1.0)),
            ("link-bad", self.link_bad, Rule::Between(0.0, 1.0)),
            ("pose-age-warning-ms", self.pose_age_warning_ms, Rule::Positive),
            ("pose-age-limit-ms", self.pose_age_limit_ms, Rule::Positive),
            ("pose-loss-warning", self.pose_loss_warning, Rule::Between(0.0, 1.0)),
            ("arming-tilt-deg", self.arming_tilt_deg, Rule::Between(0.0, 180.0)),
            ("vehicle-silence-ms", self.vehicle_silence_ms, Rule::Positive),
            ("motor-start-ms", self.motor_start_ms, Rule::Positive),
        ])
        .map_err(|error| error.within("safety"))?;
        self.filter.check().map_err(|error| error.within("safety.filter"))
    }
}
