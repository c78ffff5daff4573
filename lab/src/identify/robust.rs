//! Bounded influence of single poses (Huber, *Robust Statistics*, 1981).

use nalgebra::Vector3;

/// Standard deviations from which on a residual counts in proportion to its size instead of its square \[-\].
const HUBER: f64 = 2.5;
/// Standard deviations to which an innovation that corrects a filter is limited \[-\].
const LIMIT: f64 = 4.0;
/// Standard deviations beyond which the influence of a residual no longer grows \[-\].
const LARGEST: f64 = 12.0;
/// Innovations in a row beyond [`LIMIT`] after which a filter is reset \[-\].
const LOST: u32 = 4;
/// Mean square of a normally distributed number that is limited to [`HUBER`] \[-\].
const LIMITED_SQUARE: f64 = 0.977_56;

/// The residual whose square is Huber's loss of `residual` \[standard deviations\].
#[must_use]
pub fn huber(residual: f64) -> f64 {
    let size = residual.abs().min(LARGEST);
    if size <= HUBER {
        return residual;
    }
    (2.0 * HUBER * size - HUBER * HUBER).sqrt().copysign(residual)
}

/// Detector of motion that the model does not contain: rotors at their limit, a strong gust, a hand.
#[derive(Clone, Copy, Debug, Default)]
pub struct LostTrack {
    /// Innovations in a row beyond the limit \[-\].
    beyond: u32,
}

impl LostTrack {
    /// Whether, with this innovation of the expected deviation `sd`, the filter must be reset.
    pub fn detects(&mut self, innovation: &Vector3<f64>, sd: f64) -> bool {
        self.beyond = if innovation.amax() > LIMIT * sd { self.beyond + 1 } else { 0 };
        if self.beyond < LOST {
            return false;
        }
        self.beyond = 0;
        true
    }
}

/// `innovation` with each component limited to `LIMIT` times `sd`.
#[must_use]
pub fn limited(innovation: &Vector3<f64>, sd: f64) -> Vector3<f64> {
    innovation.map(|component| component.clamp(-LIMIT * sd, LIMIT * sd))
}

/// The standard deviation of normally distributed `values` of which some are outliers; 0 without values \[unit of the values\].
#[must_use]
pub fn deviation(values: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    // The median of a normally distributed number's size is .6745 standard deviations.
    let mut sd = sizes.get(sizes.len() / 2).map_or(0.0, |median| median / 0.6745);
    for _ in 0..8 {
        let square = |size: &f64| (size.min(HUBER * sd)).powi(2);
        let mean = sizes.iter().map(square).sum::<f64>() / sizes.len().max(1) as f64;
        sd = (mean / LIMITED_SQUARE).sqrt();
    }
    sd
}
