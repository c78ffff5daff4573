//! Randomness that repeats: one stream per (seed, source), so that one source never shifts another, from a generator whose
//! stream is the same on every platform and version (ChaCha, eight rounds).

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// The generator behind every source.
pub type Generator = ChaCha8Rng;

/// The random sources of a testbed; a number is a stream and never changes its meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Source {
    /// Gusts, one draw per millisecond.
    Gust = 1,
    /// The vehicle's constant imperfections.
    Imperfection = 2,
    /// The cameras, by frame.
    Cameras = 3,
    /// Which frames to a vehicle are lost, one draw a frame.
    UplinkLoss = 4,
    /// Which bits to a vehicle are wrong.
    UplinkErrors = 5,
    /// Which frames from a vehicle are lost, one draw a frame.
    DownlinkLoss = 6,
    /// Which bits from a vehicle are wrong.
    DownlinkErrors = 7,
    /// Deviations of the simulated vehicle's parameters from their nominal values.
    Spread = 8,
}

/// The stream of `source` under `seed`.
#[must_use]
pub fn stream(seed: u64, source: Source) -> Generator {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(source as u64);
    generator
}

/// Three standard normal numbers.
pub fn normal3(generator: &mut Generator) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(generator))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;

    #[test]
    fn streams_repeat_and_differ_by_seed_and_source() {
        let first = |seed, source| stream(seed, source).next_u64();
        assert_eq!(first(7, Source::Gust), first(7, Source::Gust));
        assert_ne!(first(7, Source::Gust), first(8, Source::Gust));
        assert_ne!(first(7, Source::Gust), first(7, Source::Cameras));
    }
}
