//! Noise of a pose that is correlated in time: three Ornstein-Uhlenbeck processes of different correlation times, whose sum
//! has an Allan deviation that falls more slowly than that of white noise over two decades.

use nalgebra::Vector3;
use oqtal_config::MocapOptions;
use oqtal_runtime::random::{Generator, normal3};
use rand::RngExt;

/// Correlation times of the three processes \[s\]; each has a third of the variance.
const CORRELATION_S: [f64; 3] = [0.05, 0.5, 5.0];

/// Random numbers for the error of a pose, of zero mean and unit variance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UnitError {
    /// For the position, along the axes of the world \[-\].
    pub position: Vector3<f64>,
    /// For the attitude, about the axes of the body \[-\].
    pub attitude: Vector3<f64>,
}

impl UnitError {
    /// No error.
    pub const ZERO: Self =
        Self { position: Vector3::new(0.0, 0.0, 0.0), attitude: Vector3::new(0.0, 0.0, 0.0) };

    /// Independent normal numbers.
    pub fn white(generator: &mut Generator) -> Self {
        Self { position: normal3(generator), attitude: normal3(generator) }
    }

    /// Correlates roll with z, pitch with x and yaw with y by `ratio`, at unchanged variance: a displaced marker shifts and tilts
    /// the body.
    pub fn coupled(self, ratio: f64) -> Self {
        let Vector3 { data, .. } = self.position;
        let [[x, y, z]] = data.0;
        let own = self.attitude * (1.0 - ratio * ratio).sqrt();
        Self { attitude: own + Vector3::new(z, x, y) * ratio, ..self }
    }
}

/// Drift of a camera system, and scale factor of its noise.
#[derive(Clone, Debug)]
pub struct Drift {
    /// State of each process.
    states: [UnitError; 3],
    /// Share of each state that is left after a frame \[-\].
    keep: [f64; 3],
    heavy_probability: f64,
    heavy_ratio: f64,
}

impl Drift {
    /// Drift of a configuration, initially zero.
    pub fn new(mocap: &MocapOptions) -> Self {
        Self {
            states: [UnitError::default(); 3],
            keep: CORRELATION_S.map(|time_s| (-1.0 / (mocap.rate_hz * time_s)).exp()),
            heavy_probability: mocap.room.heavy_tail_probability,
            heavy_ratio: mocap.room.heavy_tail_ratio,
        }
    }

    /// Drift of the next frame, and the scale factor for all its noise.
    pub fn advance(&mut self, generator: &mut Generator) -> (UnitError, f64) {
        let mut sum = UnitError::default();
        let share = (1.0 / CORRELATION_S.len() as f64).sqrt();
        for (state, keep) in self.states.iter_mut().zip(self.keep) {
            let fresh = UnitError::white(generator);
            let gain = (1.0 - keep * keep).sqrt();
            state.position = state.position * keep + fresh.position * gain;
            state.attitude = state.attitude * keep + fresh.attitude * gain;
            sum.position += state.position * share;
            sum.attitude += state.attitude * share;
        }
        let is_heavy = generator.random::<f64>() < self.heavy_probability;
        (sum, if is_heavy { self.heavy_ratio } else { 1.0 })
    }
}
