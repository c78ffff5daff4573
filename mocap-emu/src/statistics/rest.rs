//! Noise of the poses of a body at rest.

use nalgebra::Vector3;
use oqtal_control::statistics::{correlation, mean, population_deviation};

use crate::recording::{RecordedPose, Recording};

/// Greatest distance from the start of a rest at which the body still counts as resting \[m\].
const RESTING_M: f64 = 2e-3;
/// Number of poses whose mean is the start of a rest.
const ANCHOR: usize = 30;
/// Least number of poses for statistics.
const LEAST: usize = 300;
/// Poses over which the Allan deviation is averaged.
const AVERAGED: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];

/// Noise of a body at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestStatistics {
    /// Standard deviation of the position, mean of the axes \[mm\].
    pub position_mm: f64,
    /// Standard deviation of the attitude, mean of the axes \[deg\].
    pub attitude_deg: f64,
    /// Slope of the Allan deviation over the averaging time, both logarithmic, mean of the axes of the position \[-\]: -0.5 for
    /// white noise.
    pub position_slope_ratio: f64,
    /// The same of the attitude \[-\].
    pub attitude_slope_ratio: f64,
    /// Greatest correlation, without its sign, of an axis of the position with one of the attitude \[-\].
    pub coupling_ratio: f64,
    /// Greatest kurtosis of an axis \[-\]: 3 for normal noise.
    pub kurtosis_ratio: f64,
}

impl RestStatistics {
    /// Statistics of the longest rest in a recording; `None` without a rest of some seconds.
    pub fn of(recording: &Recording) -> Option<Self> {
        let rest = longest_rest(recording.poses());
        let first = rest.first().filter(|_| rest.len() >= LEAST)?;
        let axis = |of: &dyn Fn(&RecordedPose) -> f64| rest.iter().map(of).collect::<Vec<f64>>();
        let positions = [0, 1, 2].map(|k| axis(&|pose| pose.position[k]));
        let attitudes =
            [0, 1, 2].map(|k| axis(&|pose| first.attitude.rotation_to(&pose.attitude)[k]));
        let average = |axes: &[Vec<f64>; 3], of: fn(&[f64]) -> f64| {
            axes.iter().map(|axis| of(axis)).sum::<f64>() / 3.0
        };
        let pairs = positions.iter().flat_map(|p| attitudes.iter().map(move |a| (p, a)));
        let all = positions.iter().chain(&attitudes);
        Some(Self {
            position_mm: average(&positions, population_deviation) * 1e3,
            attitude_deg: average(&attitudes, population_deviation).to_degrees(),
            position_slope_ratio: average(&positions, slope),
            attitude_slope_ratio: average(&attitudes, slope),
            coupling_ratio: pairs.map(|(p, a)| correlation(p, a).abs()).fold(0.0, f64::max),
            kurtosis_ratio: all.map(|axis| kurtosis(axis)).fold(0.0, f64::max),
        })
    }
}

/// The longest run of poses near their start.
fn longest_rest(poses: &[RecordedPose]) -> &[RecordedPose] {
    let (mut longest, mut from): (&[RecordedPose], usize) = (&[], 0);
    while from + ANCHOR < poses.len() {
        let anchor = &poses[from..from + ANCHOR];
        let centre = anchor.iter().map(|pose| pose.position).sum::<Vector3<f64>>() / ANCHOR as f64;
        let rests = |pose: &&RecordedPose| (pose.position - centre).norm() < RESTING_M;
        let length = poses[from..].iter().take_while(rests).count();
        if length > longest.len() {
            longest = &poses[from..from + length];
        }
        from += length.max(ANCHOR / 3);
    }
    longest
}

/// Allan deviation of `values` averaged over `averaged` of them at a time; `None` with fewer than three averages.
pub fn allan_deviation(values: &[f64], averaged: usize) -> Option<f64> {
    let means: Vec<f64> = values.chunks_exact(averaged.max(1)).map(mean).collect();
    if means.len() < 3 {
        return None;
    }
    let squares: f64 = means.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
    Some((squares / 2.0 / (means.len() - 1) as f64).sqrt())
}

/// Slope of the logarithm of the Allan deviation over that of the averaging time, by least squares.
fn slope(values: &[f64]) -> f64 {
    let points: Vec<(f64, f64)> = AVERAGED
        .iter()
        .filter_map(|averaged| Some((*averaged as f64, allan_deviation(values, *averaged)?)))
        .filter(|(_, deviation)| *deviation > 0.0)
        .map(|(averaged, deviation)| (averaged.ln(), deviation.ln()))
        .collect();
    let (x, y): (Vec<f64>, Vec<f64>) = points.into_iter().unzip();
    let spread = population_deviation(&x);
    let slope = correlation(&x, &y) * population_deviation(&y) / spread;
    if slope.is_finite() { slope } else { 0.0 }
}

/// Fourth moment over the squared second moment.
fn kurtosis(values: &[f64]) -> f64 {
    let centre = mean(values);
    let fourths: Vec<f64> = values.iter().map(|value| (value - centre).powi(4)).collect();
    let kurtosis = mean(&fourths) / population_deviation(values).powi(4);
    if kurtosis.is_finite() { kurtosis } else { 0.0 }
}
