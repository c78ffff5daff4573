//! Captures of recorded poses, estimated from their arrivals and from the motion.
//!
//! A recording contains the arrival of each pose. Poses that a stall held back arrive together after it, and even without stalls
//! the time from capture to arrival varies by milliseconds: velocities computed from arrivals have the same relative error. Two
//! constraints improve the estimate. Poses are not captured faster than the rate of the cameras, so the poses behind a stall are
//! spread out. The body moves smoothly, so a pose that is ahead of the curve through its neighbours was captured later than its
//! arrival suggests. The constant part of the latency cannot be estimated.

use nalgebra::{Matrix4, Matrix4x3, Vector3, Vector4};

use crate::recording::Recording;

/// Number of passes of the motion-based correction.
const PASSES: u32 = 10;
/// Share of a correction that a pass applies \[-\]: the neighbours are corrected at the same time.
const STEP: f64 = 0.6;
/// Poses on each side of a pose through which the curve is fitted.
const NEIGHBOURS: usize = 8;
/// Time by which the curve's argument is scaled, so that its equations are well conditioned \[s\].
const SCALE_S: f64 = 0.1;
/// Speed at which position and arrival of a pose determine its capture equally well \[m/s\]: noise of a tenth of a millimetre and
/// the errors of the curve correspond to some milliseconds.
const EQUAL_WEIGHT_M_S: f64 = 0.15;
/// Greatest correction in one pass \[s\].
const GREATEST_S: f64 = 0.01;
/// Share by which a pass pulls captures back towards arrivals \[-\]: the motion does not show slow drifts.
const RETURN: f64 = 0.02;
/// Shortest time between two captures \[s\].
const LEAST_S: f64 = 1e-6;

/// Estimated captures of the poses of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Captures {
    /// Capture of each pose after the first arrival \[s\], increasing, and never after the pose's arrival.
    pub captured_s: Vec<f64>,
    /// Speed at each pose \[m/s\].
    pub speed_m_s: Vec<f64>,
}

impl Captures {
    /// Estimates the captures of `recording`.
    pub fn of(recording: &Recording) -> Self {
        let poses = recording.poses();
        let positions: Vec<_> = poses.iter().map(|pose| pose.position).collect();
        let arrivals: Vec<_> = poses.iter().map(|pose| pose.time_ns as f64 * 1e-9).collect();
        let spread = spread(&arrivals, recording.nominal_rate_hz());
        let mut captured_s = spread.clone();
        let mut speed_m_s = vec![0.0; poses.len()];
        for _ in 0..PASSES {
            let corrections: Vec<f64> = (0..poses.len())
                .map(|k| {
                    let (correction_s, speed) = correction(&captured_s, &positions, k);
                    speed_m_s[k] = speed;
                    STEP * correction_s + RETURN * (spread[k] - captured_s[k])
                })
                .collect();
            captured_s.iter_mut().zip(corrections).for_each(|(time, by)| *time += by);
        }
        settle(&mut captured_s, &arrivals);
        Self { captured_s, speed_m_s }
    }
}

/// Spreads the arrivals that a stall held back over the stall, at the rate of the recording.
fn spread(arrivals: &[f64], rate_hz: f64) -> Vec<f64> {
    let period_s = 1.0 / rate_hz;
    let mut times = arrivals.to_vec();
    let mut k = 1;
    while k < times.len() {
        if arrivals[k] - arrivals[k - 1] <= 3.0 * period_s {
            k += 1;
            continue;
        }
        // Poses delayed by the stall: up to the pose at which the arrivals have caught up with the captures.
        let before = arrivals[k - 1];
        let is_behind = |j: usize| ((j - k + 1) as f64) < (arrivals[j] - before) * rate_hz - 0.5;
        let gained = |j: usize| j > k && arrivals[j] - arrivals[j - 1] > 0.75 * period_s;
        let mut last = k;
        while last + 1 < times.len() && is_behind(last) && !(gained(last) && gained(last + 1)) {
            last += 1;
        }
        let step_s = period_s.min((arrivals[last] - before) / (last - k + 1) as f64);
        let stalled = times[k..=last].iter_mut().zip(&arrivals[k..]).enumerate();
        for (index, (time, arrival)) in stalled {
            let even = arrivals[last] - (last - k - index) as f64 * step_s;
            *time = even.min(*arrival);
        }
        k = last + 1;
    }
    times
}

/// Correction of the capture of pose `k` in `times` \[s\], by its place on the cubic through its neighbours, and the speed there
/// \[m/s\].
fn correction(times: &[f64], positions: &[Vector3<f64>], k: usize) -> (f64, f64) {
    let first = k.saturating_sub(NEIGHBOURS);
    let last = (k + NEIGHBOURS + 1).min(times.len());
    let (mut normal, mut right) = (Matrix4::zeros(), Matrix4x3::zeros());
    for j in (first..last).filter(|j| *j != k) {
        let x = (times[j] - times[k]) / SCALE_S;
        let powers = Vector4::new(1.0, x, x * x, x * x * x);
        normal += powers * powers.transpose();
        right += powers * (positions[j] - positions[k]).transpose();
    }
    let Some(curve) = normal.cholesky().map(|normal| normal.solve(&right)) else {
        return (0.0, 0.0);
    };
    let offset: Vector3<f64> = -curve.row(0).transpose();
    let velocity: Vector3<f64> = curve.row(1).transpose() / SCALE_S;
    let squared = velocity.norm_squared();
    let by_s = offset.dot(&velocity) / (squared + EQUAL_WEIGHT_M_S * EQUAL_WEIGHT_M_S);
    if !by_s.is_finite() {
        return (0.0, 0.0);
    }
    (by_s.clamp(-GREATEST_S, GREATEST_S), squared.sqrt())
}

/// Shifts `times` by a constant such that 99 % of them precede their arrivals, then limits the others to their arrivals and keeps all in
/// order.
fn settle(times: &mut [f64], arrivals: &[f64]) {
    let mut ahead: Vec<f64> = times.iter().zip(arrivals).map(|(time, at)| time - at).collect();
    ahead.sort_unstable_by(f64::total_cmp);
    let shift = ahead[ahead.len() - 1 - ahead.len() / 100].max(0.0);
    let mut latest = f64::INFINITY;
    for (time, arrival) in times.iter_mut().zip(arrivals).rev() {
        *time = (*time - shift).min(*arrival).min(latest - LEAST_S);
        latest = *time;
    }
}
