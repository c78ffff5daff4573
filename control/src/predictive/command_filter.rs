//! A critically damped low-pass of second order on the acceleration that corrects: measurement
//! noise must not shake the attitude, and the derivatives that the feed-forward takes come with it.

use nalgebra::Vector2;

/// The corrective acceleration with its first two derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Smooth {
    /// \[m/s^2\].
    pub value: Vector2<f64>,
    /// \[m/s^3\].
    pub slope: Vector2<f64>,
    /// \[m/s^4\].
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
    #[must_use]
    pub fn new(bandwidth: f64) -> Self {
        Self { bandwidth, smooth: Smooth::default() }
    }

    /// Back to rest.
    pub fn reset(&mut self) {
        self.smooth = Smooth::default();
    }

    /// Follows `x`, constant over the last `dt_s` \[s\]: exact.
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
