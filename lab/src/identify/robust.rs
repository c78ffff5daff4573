//! Bounded influence of single poses (Huber, *Robust Statistics*, 1981).

use nalgebra::Vector3;

/// Number of standard deviations above which a residual counts linearly instead of quadratically \[-\].
const HUBER: f64 = 2.5;
/// Number of standard deviations to which an innovation that corrects a filter is limited \[-\].
const LIMIT: f64 = 4.0;
/// Number of standard deviations above which the influence of a residual no longer grows \[-\].
const LARGEST: f64 = 12.0;
/// Number of successive innovations beyond [`LIMIT`] after which a filter is reset \[-\].
const LOST: u32 = 4;
/// Mean square of a normal random number limited to [`HUBER`] \[-\].
const LIMITED_SQUARE: f64 = 0.977_56;

/// Residual whose square is Huber's loss of `residual` \[standard deviations\].
pub fn huber(residual: f64) -> f64 {
    let size = residual.abs().min(LARGEST);
    if size <= HUBER {
        return residual;
    }
    (2.0 * HUBER * size - HUBER * HUBER).sqrt().copysign(residual)
}

/// Detector of motion outside the model: rotors at their limit, a strong gust, contact with a hand.
#[derive(Clone, Copy, Debug, Default)]
pub struct LostTrack {
    /// Number of successive innovations beyond the limit \[-\].
    beyond: u32,
}

impl LostTrack {
    /// Whether the filter must be reset after this innovation; `sd` is its expected standard deviation.
    pub fn detects(&mut self, innovation: &Vector3<f64>, sd: f64) -> bool {
        self.beyond = if innovation.amax() > LIMIT * sd { self.beyond + 1 } else { 0 };
        if self.beyond < LOST {
            return false;
        }
        self.beyond = 0;
        true
    }
}

/// `innovation`, each component limited to `LIMIT` times `sd`.
pub fn limited(innovation: &Vector3<f64>, sd: f64) -> Vector3<f64> {
    innovation.map(|component| component.clamp(-LIMIT * sd, LIMIT * sd))
}

/// Robust standard deviation of normally distributed `values` with outliers; 0 without values \[unit of the values\].
pub fn deviation(values: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    // The median of the absolute value of a normal random number is 0.6745 standard deviations.
    let mut sd = sizes.get(sizes.len() / 2).map_or(0.0, |median| median / 0.6745);
    for _ in 0..8 {
        let square = |size: &f64| (size.min(HUBER * sd)).powi(2);
        let mean = sizes.iter().map(square).sum::<f64>() / sizes.len().max(1) as f64;
        sd = (mean / LIMITED_SQUARE).sqrt();
    }
    sd
}
