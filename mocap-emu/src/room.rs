//! Random numbers behind the effects of a real room on a frame: drift of the noise, stalls, instants of sending.

use oqtal_config::MocapOptions;
use oqtal_runtime::random::{Generator, RandomSource, stream};
use rand::RngExt;

use crate::drift::{Drift, UnitError};

/// Random words reserved for each frame: the effects on a frame do not depend on the numbers drawn for earlier frames.
pub const WORDS_PER_FRAME: u128 = 256;

/// Random numbers for one frame; all but the noise are uniform.
#[derive(Clone, Copy, Debug)]
pub struct RoomFrame {
    /// Drift of the pose, and scale factor of all its noise \[-\].
    pub noise: (UnitError, f64),
    /// Beginning, length and loss of a stall \[0..1\].
    pub stall: [f64; 3],
    /// Whether the camera computer misses a period, whether it sends late, and how late \[0..1\].
    pub sending: [f64; 3],
    /// Time from the pose before in a queue, over twice its mean \[0..1\].
    pub spacing: f64,
}

/// The frame of a room without effects.
const WITHOUT_EFFECT: RoomFrame =
    RoomFrame { noise: (UnitError::ZERO, 1.0), stall: [0.0; 3], sending: [0.0; 3], spacing: 0.0 };

/// Effects of a room, `[mocap.room]`.
#[derive(Clone, Debug)]
pub struct Room {
    /// Random numbers and drift; `None` for effects without random numbers.
    random: Option<(Generator, Drift)>,
}

impl Room {
    /// The room of a configuration.
    pub fn new(mocap: &MocapOptions, seed: u64) -> Self {
        let random = || (stream(seed, RandomSource::Room), Drift::new(mocap));
        Self { random: mocap.room.is_random().then(random) }
    }

    /// Draws the numbers of the camera frame `capture`.
    pub fn draw(&mut self, capture: u64) -> RoomFrame {
        let Some((generator, drift)) = &mut self.random else { return WITHOUT_EFFECT };
        generator.set_word_pos(u128::from(capture) * WORDS_PER_FRAME);
        let noise = drift.advance(generator);
        let mut three = || [(); 3].map(|()| generator.random::<f64>());
        RoomFrame { noise, stall: three(), sending: three(), spacing: generator.random() }
    }
}

#[cfg(test)]
mod tests {
    use oqtal_config::{Config, Setting};

    use super::*;

    #[test]
    fn only_a_room_with_random_effects_draws_numbers() {
        let drawn = |preset| {
            let preset = Setting::flag("test", "mocap.preset", preset);
            let mut room = Room::new(&Config::from_settings(&[preset]).unwrap().mocap, 7);
            (room.draw(1).spacing, room.draw(2).spacing)
        };
        assert_eq!(drawn("qualisys"), (0.0, 0.0));
        let (first, second) = drawn("room");
        assert!(first > 0.0 && second > 0.0 && first != second);
    }
}
