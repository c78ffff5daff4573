//! Repeatable random numbers: one stream per (seed, source), so that the draws of one source never affect those of another. The
//! generator (ChaCha, eight rounds) yields the same stream on every platform and in every version.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Generator of every source.
pub type Generator = ChaCha8Rng;

/// Random sources of a testbed. The number of a source never changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum RandomSource {
    /// Gusts, one draw per millisecond.
    Gust = 1,
    /// Constant disturbances of the vehicle.
    Imperfection = 2,
    /// Camera noise, by frame.
    Cameras = 3,
    /// Loss of frames to the vehicle, one draw per frame.
    UplinkLoss = 4,
    /// Wrong bits to the vehicle.
    UplinkErrors = 5,
    /// Loss of frames from the vehicle, one draw per frame.
    DownlinkLoss = 6,
    /// Wrong bits from the vehicle.
    DownlinkErrors = 7,
    /// Deviations of the simulated vehicle's parameters from their nominal values.
    Spread = 8,
    /// Image points of markers, and hidden or swapped markers, by frame.
    Markers = 9,
    /// Drift of the camera system's noise, frames sent, and stalls of the connection, by frame.
    Room = 10,
    /// Emulated faults of the network over which poses are served, by frame.
    Network = 11,
    /// Loss of commands on the simulated radio, one draw per command.
    CommandLoss = 12,
    /// Jitter of the simulated radio, one draw per command.
    CommandJitter = 13,
    /// Bias and noise of the vehicle's gyroscope, by millisecond.
    Gyroscope = 14,
    /// Injected faults.
    Fault = 20,
    /// Loss of commands on a radio with a fault, one draw per command.
    RadioFault = 21,
}

/// The stream of `source` under `seed`.
pub fn stream(seed: u64, source: RandomSource) -> Generator {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(source as u64);
    generator
}

/// Three independent standard normal numbers \[-\].
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
        assert_eq!(first(7, RandomSource::Gust), first(7, RandomSource::Gust));
        assert_ne!(first(7, RandomSource::Gust), first(8, RandomSource::Gust));
        assert_ne!(first(7, RandomSource::Gust), first(7, RandomSource::Cameras));
    }
}
