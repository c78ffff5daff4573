//! Noise and latency of the cameras, at rest and in flight.

use nalgebra::Vector3;
use oqtal_control::statistics::{median, quantile};
use serde::Serialize;

use super::data::{FlightData, PoseRecord};
use super::robust::deviation;

/// Least number of poses at rest for the noise figures \[-\].
const LEAST_POSES: usize = 20;

/// Latency of poses from capture to publication, by their stamps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PoseLatency {
    /// Median \[ms\].
    pub median_ms: f64,
    /// 95th percentile \[ms\].
    pub p95_ms: f64,
}

/// Noise of the cameras, from poses on the floor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RestFigures {
    /// Number of poses \[-\].
    pub poses: usize,
    /// Standard deviation of the position along each axis \[mm\].
    pub position_mm: f64,
    /// Standard deviation of the attitude about each axis \[deg\].
    pub attitude_deg: f64,
}

impl RestFigures {
    /// Noise of the poses before take-off; `None` if there are too few.
    pub fn of(flights: &[FlightData]) -> Option<Self> {
        let mut positions = Vec::new();
        let mut angles = Vec::new();
        for data in flights.iter().filter(|data| data.rest.len() >= LEAST_POSES) {
            let first = data.rest[0].attitude;
            positions.extend(scatter(&data.rest, |pose| pose.position));
            angles.extend(scatter(&data.rest, |pose| first.rotation_to(&pose.attitude)));
        }
        (!positions.is_empty()).then(|| Self {
            poses: positions.len() / 3,
            position_mm: deviation(&positions) * 1e3,
            attitude_deg: deviation(&angles).to_degrees(),
        })
    }
}

/// Components of a quantity minus their medians.
fn scatter(poses: &[PoseRecord], of: impl Fn(&PoseRecord) -> Vector3<f64>) -> Vec<f64> {
    let one = |axis: usize| {
        let values: Vec<f64> = poses.iter().map(|pose| of(pose)[axis]).collect();
        let middle = median(values.iter().copied()).unwrap_or(0.0);
        values.into_iter().map(move |value| value - middle)
    };
    (0..3).flat_map(one).collect()
}

impl PoseLatency {
    /// The latency of the poses that `of` selects; `None` without poses.
    pub fn of(flights: &[FlightData], of: fn(&FlightData) -> &Vec<PoseRecord>) -> Option<Self> {
        let latencies = || flights.iter().flat_map(of).map(|pose| pose.latency_s * 1e3);
        let median_ms = median(latencies())?;
        Some(Self { median_ms, p95_ms: quantile(latencies(), 0.95)? })
    }
}
