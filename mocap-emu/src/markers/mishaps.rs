//! Marker errors: markers that are hidden for a time, and pairs that are swapped.

use oqtal_config::MarkerOptions;
use oqtal_runtime::random::Generator;
use rand::RngExt;
use rand_distr::{Distribution, Geometric};

/// Greatest number of markers, as the configuration allows.
pub const MOST_MARKERS: usize = 16;

/// State of the marker errors, advanced once per frame.
#[derive(Clone, Debug, Default)]
pub struct Mishaps {
    /// Frames for which each marker is still missing \[frames\].
    missing: [u64; MOST_MARKERS],
    /// The markers that are swapped, and for how many frames.
    swapped: Option<(usize, usize)>,
    swapped_frames: u64,
}

impl Mishaps {
    /// Draws the marker errors of a frame with `markers` markers. The number of draws does not depend on the outcome of earlier
    /// frames.
    pub fn advance(&mut self, options: &MarkerOptions, markers: usize, random: &mut Generator) {
        for missing in &mut self.missing[..markers] {
            let begins: f64 = random.random();
            let frames = frames(options.vanish_frames, random);
            *missing = missing.saturating_sub(1);
            if *missing == 0 && begins < options.vanish_probability {
                *missing = frames;
            }
        }
        let begins: f64 = random.random();
        let frames = frames(options.swap_frames, random);
        let first = random.random_range(0..markers);
        let second = (first + random.random_range(1..markers)) % markers;
        self.swapped_frames = self.swapped_frames.saturating_sub(1);
        if self.swapped_frames == 0 {
            let swaps = begins < options.swap_probability;
            self.swapped = swaps.then_some((first, second));
            self.swapped_frames = if swaps { frames } else { 0 };
        }
    }

    /// Whether `marker` is visible.
    pub fn shows(&self, marker: usize) -> bool {
        self.missing[marker] == 0
    }

    /// Label that the camera system gives to `marker`.
    pub fn taken_for(&self, marker: usize) -> usize {
        match self.swapped {
            Some((a, b)) if marker == a => b,
            Some((a, b)) if marker == b => a,
            _ => marker,
        }
    }
}

/// A duration, 1 or more, with the mean `mean` \[frames\].
fn frames(mean: f64, random: &mut Generator) -> u64 {
    1 + Geometric::new(1.0 / mean).map_or(0, |length| length.sample(random))
}
