//! Settings for the rate at which cameras send poses.

use crate::config::{Config, RATE_TOLERANCE};

/// Deviation of the rate of the poses from `safety.pose-rate-hz` above which the loop runs at another rate than configured \[-\].
const OTHER_RATE: f64 = 0.1;
/// Rate of the cameras over that of the loop below which the loop is slowed down \[-\].
const LEAST_RATE_RATIO: f64 = 0.97;
/// Deviation of a measured rate from a whole number of hertz that is an error of the measurement \[-\].
const MEASUREMENT_ERROR: f64 = 0.005;

impl Config {
    /// Whether `measured_hz` \[Hz\] deviates from `safety.pose-rate-hz` by more than 10 %.
    pub fn is_other_pose_rate(&self, measured_hz: f64) -> bool {
        (measured_hz / self.safety.pose_rate_hz - 1.0).abs() > OTHER_RATE
    }

    /// Advice for cameras at `measured_hz` \[Hz\]: the mismatch with the settings, and settings that match; `None` if the settings match.
    pub fn camera_rate_advice(&self, measured_hz: f64) -> Option<CameraRateAdvice> {
        let (expected_hz, wanted_hz) = (self.safety.pose_rate_hz, self.control.rate_hz);
        let (is_slow, is_uneven) =
            (measured_hz < LEAST_RATE_RATIO * wanted_hz, self.rate_warning().is_some());
        if !(is_slow || is_uneven || self.is_other_pose_rate(measured_hz)) {
            return None;
        }
        let every = self.poses_per_tick();
        let found = if is_slow {
            format!("{measured_hz:.1} Hz, for a loop of {wanted_hz} Hz")
        } else {
            format!(
                "{measured_hz:.1} Hz, and safety.pose-rate-hz = {expected_hz}: the loop acts on one pose in {every}, at {:.1} Hz, while its laws are designed for {wanted_hz} Hz",
                measured_hz / every
            )
        };
        let [poses_hz, loop_hz] = self.rates_for(measured_hz);
        let settings = [
            ("safety.pose-rate-hz", expected_hz, poses_hz),
            ("control.rate-hz", wanted_hz, loop_hz),
        ];
        let changed = settings.into_iter().filter(|(_, present, next)| present != next);
        let changed: Vec<_> = changed.map(|(key, _, next)| format!("{key} = {next}")).collect();
        let raise = if is_slow && !is_uneven {
            format!("raise the cameras' rate to {expected_hz} Hz, or ")
        } else {
            String::new()
        };
        let remedy = format!("{raise}set {}", changed.join(" and "));
        Some(CameraRateAdvice { found, remedy, loop_hz })
    }

    /// `safety.pose-rate-hz` and `control.rate-hz` for cameras at `measured_hz` \[Hz\]: of the rates with a whole number of poses per tick,
    /// the one next to the present rate of the loop.
    fn rates_for(&self, measured_hz: f64) -> [f64; 2] {
        let (whole_hz, wanted_hz) = (measured_hz.round(), self.control.rate_hz);
        let is_whole = (measured_hz / whole_hz - 1.0).abs() < MEASUREMENT_ERROR;
        let poses_hz = if is_whole { whole_hz } else { (measured_hz * 10.0).round() / 10.0 };
        let loop_hz = poses_hz / (poses_hz / wanted_hz).round().max(1.0);
        let is_kept = (loop_hz / wanted_hz - 1.0).abs() <= RATE_TOLERANCE;
        [poses_hz, if is_kept { wanted_hz } else { (loop_hz * 1e3).round() / 1e3 }]
    }
}

/// Advice on the settings for the rate of the cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraRateAdvice {
    /// Rates of cameras and loop with the present settings.
    pub found: String,
    /// Settings for this rate of the cameras.
    pub remedy: String,
    /// Rate of the loop with these settings \[Hz\].
    pub loop_hz: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Setting;

    fn config(settings: &str) -> Config {
        let settings =
            settings.split(" and ").map(|text| Setting::parse("test", &text.replace(' ', "")));
        Config::from_settings(&settings.collect::<Result<Vec<_>, _>>().unwrap()).unwrap()
    }

    #[test]
    fn a_configuration_changed_as_advised_has_no_further_advice() {
        for (rates, measured_hz, remedy) in [
            ((60, 60), 100.02, "safety.pose-rate-hz = 100 and control.rate-hz = 50"),
            ((100, 60), 99.98, "control.rate-hz = 50"),
            ((60, 60), 240.0, "safety.pose-rate-hz = 240"),
            ((60, 60), 50.0, "safety.pose-rate-hz = 50 and control.rate-hz = 50"),
            ((60, 60), 57.3, "safety.pose-rate-hz = 57.3 and control.rate-hz = 57.3"),
            ((60, 60), 80.0, "safety.pose-rate-hz = 80 and control.rate-hz = 80"),
            ((60, 60), 30.0, "safety.pose-rate-hz = 30 and control.rate-hz = 30"),
            ((240, 60), 200.0, "safety.pose-rate-hz = 200 and control.rate-hz = 66.667"),
            ((66, 60), 60.0, "safety.pose-rate-hz = 60"),
        ] {
            let (poses_hz, loop_hz) = rates;
            let present =
                format!("safety.pose-rate-hz = {poses_hz} and control.rate-hz = {loop_hz}");
            let advice = config(&present).camera_rate_advice(measured_hz).unwrap();
            assert!(advice.remedy.ends_with(&format!("set {remedy}")), "{advice:?}");
            let advised = config(&format!("{present} and {remedy}"));
            assert_eq!(advised.camera_rate_advice(measured_hz), None, "{rates:?} {measured_hz}");
            assert_eq!(advised.control.rate_hz, advice.loop_hz);
        }
        for measured_hz in [58.5, 60.0, 65.0] {
            assert_eq!(Config::default().camera_rate_advice(measured_hz), None, "{measured_hz}");
        }
    }
}
