//! Statistics of the poses that a probe receives.

use nalgebra::Vector3;
use oqtal_control::statistics::{self, standard_deviation};
use oqtal_wire::motion::RigidPose;

use super::figures::NoiseFigures;

/// The value that `percent` of 100 values do not exceed, by nearest rank \[unit of the values\]; 0 without values.
pub fn percentile(values: &[i64], percent: f64) -> i64 {
    let values = values.iter().map(|value| *value as f64);
    statistics::quantile(values, percent / 100.0).unwrap_or(0.0) as i64
}

/// Poses of one window of a second at most.
#[derive(Clone, Debug, Default)]
pub struct NoiseWindow {
    poses: Vec<RigidPose>,
}

impl NoiseWindow {
    /// Adds a pose.
    pub fn add(&mut self, pose: &RigidPose) {
        self.poses.push(*pose);
    }

    /// The noise of the window, which is then empty; `None` if it has too few poses.
    pub fn finish(&mut self) -> Option<NoiseFigures> {
        let poses = std::mem::take(&mut self.poses);
        let first = poses.first()?.rotation();
        if poses.len() < 10 {
            return None;
        }
        let positions = poses.iter().map(|pose| Vector3::from(pose.position_m) * 1e3);
        let turns = poses.iter().map(|pose| (first.inverse() * pose.rotation()).scaled_axis());
        let turns = turns.map(|turn| turn.map(f64::to_degrees));
        Some(NoiseFigures {
            position_mm: deviation(&positions.collect::<Vec<_>>()),
            attitude_deg: deviation(&turns.collect::<Vec<_>>()),
        })
    }
}

/// Standard deviation of each component.
fn deviation(values: &[Vector3<f64>]) -> [f64; 3] {
    [0, 1, 2]
        .map(|axis| standard_deviation(&values.iter().map(|value| value[axis]).collect::<Vec<_>>()))
}

/// The median of each component over the windows; `None` without windows.
pub fn median(of: fn(&NoiseFigures) -> [f64; 3], windows: &[NoiseFigures]) -> Option<[f64; 3]> {
    let axis = |axis: usize| statistics::median(windows.iter().map(|window| of(window)[axis]));
    Some([axis(0)?, axis(1)?, axis(2)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_nearest_rank() {
        let values: Vec<i64> = (1..=100).rev().collect();
        assert_eq!((percentile(&values, 50.0), percentile(&values, 99.0)), (50, 99));
        assert_eq!(percentile(&[], 50.0), 0);
    }

    #[test]
    fn the_noise_of_a_body_at_rest_is_that_of_each_axis() {
        let mut window = NoiseWindow::default();
        for k in 0..100 {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            let half = (sign * 0.2_f64.to_radians() / 2.0).sin();
            let pose = RigidPose::new([1.0 + sign * 1e-3, 2.0, 3.0], [0.0, half, 0.0, 1.0]);
            window.add(&pose.unwrap());
        }
        let noise = window.finish().unwrap();
        assert!((noise.position_mm[0] - 1.0).abs() < 0.02 && noise.position_mm[1] < 1e-9);
        assert!((noise.attitude_deg[1] - 0.2).abs() < 0.005, "{noise:?}");
        assert_eq!(window.finish(), None);
    }
}
