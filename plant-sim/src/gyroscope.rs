//! Gyroscope of the simulated vehicle: its rate with bias and noise. For reports only: control never uses them.

use nalgebra::Vector3;
use oqtal_bus::time::Time;
use oqtal_runtime::random::{Generator, RandomSource, normal3, stream};

/// Standard deviation of the bias of an axis, drawn once per seed \[rad/s\]: half a degree per second, as that of cheap sensors after
/// the autopilot's calibration at rest.
const BIAS_SD: f64 = 0.0087;
/// Standard deviation of a sample \[rad/s\]: one degree per second, mostly vibration.
const NOISE_SD: f64 = 0.0175;
/// Words of the stream that belong to one millisecond \[-\]: more than three normal numbers take.
const WORDS: u128 = 64;

/// The gyroscope. A sample depends on the seed and its instant alone, not on the samples before it.
#[derive(Clone, Debug)]
pub(crate) struct Gyroscope {
    stream: Generator,
    bias: Vector3<f64>,
}

impl Gyroscope {
    /// The gyroscope of a vehicle drawn by `seed`.
    pub(crate) fn new(seed: u64) -> Self {
        let mut stream = stream(seed, RandomSource::Gyroscope);
        let bias = normal3(&mut stream) * BIAS_SD;
        Self { stream, bias }
    }

    /// The measurement of `rate` \[rad/s, body\] at `now`.
    pub(crate) fn measure(&self, now: Time, rate: &Vector3<f64>) -> [f64; 3] {
        let mut stream = self.stream.clone();
        // The first block is that of the bias.
        stream.set_word_pos((1 + u128::from(now.nanos() / 1_000_000)) * WORDS);
        (rate + self.bias + normal3(&mut stream) * NOISE_SD).into()
    }
}

#[cfg(test)]
mod tests {
    use oqtal_bus::time::Span;

    use super::*;

    #[test]
    fn samples_scatter_about_the_rate_and_repeat() {
        let (gyroscope, rate) = (Gyroscope::new(3), Vector3::new(1.0, -2.0, 0.5));
        let at = |millis| Time::VIRTUAL_START + Span::from_millis(millis);
        let sample = |millis| Vector3::from(gyroscope.measure(at(millis), &rate));
        let mean = (0..1000).map(sample).sum::<Vector3<f64>>() / 1000.0;
        let square = (0..1000).map(|ms| (sample(ms) - mean).norm_squared()).sum::<f64>();
        assert!((mean - rate).norm() < 0.05 && mean != rate, "{mean}");
        assert!(((square / 3000.0).sqrt() / NOISE_SD - 1.0).abs() < 0.1);
        assert_eq!(sample(17), Vector3::from(Gyroscope::new(3).measure(at(17), &rate)));
    }
}
