//! A critically damped second-order low-pass on the corrective acceleration. It keeps measurement noise out of the
//! attitude command and provides the derivatives for the feed-forward.

use nalgebra::Vector2;

/// The corrective acceleration with its first two derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Smooth {
    /// Acceleration \[m/s^2, world\].
    pub value: Vector2<f64>,
    /// First derivative of the acceleration \[m/s^3, world\].
    pub slope: Vector2<f64>,
    /// Second derivative of the acceleration \[m/s^4, world\].
    pub curvature: Vector2<f64>,
}

/// The filter `y'' = w^2 (x - y) - 2 w y'`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandFilter {
    bandwidth: f64,
    smooth: Smooth,
}

impl CommandFilter {
    /// A filter at rest with `w = bandwidth` \[rad/s\].
    pub fn new(bandwidth: f64) -> Self {
        Self { bandwidth, smooth: Smooth::default() }
    }

    /// Takes over the state of `old`.
    pub fn adopt(&mut self, old: &Self) {
        self.smooth = old.smooth;
    }

    /// Sets the filter to rest.
    pub fn reset(&mut self) {
        self.smooth = Smooth::default();
    }

    /// Drops the part of the output that accelerates along `velocity` \[m/s, world\].
    pub fn stop(&mut self, velocity: &Vector2<f64>) {
        if self.smooth.value.dot(velocity) > 0.0 {
            let along = velocity.normalize();
            for part in [&mut self.smooth.value, &mut self.smooth.slope] {
                *part -= along * part.dot(&along);
            }
        }
    }

    /// Advances by `dt_s` \[s\] with constant input `x`; exact.
    pub fn update(&mut self, x: &Vector2<f64>, dt_s: f64) -> Smooth {
        let (w, Smooth { value, slope, .. }) = (self.bandwidth, self.smooth);
        // y - x = (c + d t) e^{-wt}
        let c = value - x;
        let d = slope + c * w;
        let decay = (-w * dt_s).exp();
        let value = x + (c + d * dt_s) * decay;
        let slope = (d - (c + d * dt_s) * w) * decay;
        let curvature = (x - value) * (w * w) - slope * (2.0 * w);
        self.smooth = Smooth { value, slope, curvature };
        self.smooth
    }
}
