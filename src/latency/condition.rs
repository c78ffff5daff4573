//! Conditions under which the test chain is measured, in sequence.

use oqtal_config::Config;

/// Greatest delay of a pose under [`RigCondition::Jitter`] \[ms\]: less than the time to the next message of the cameras'
/// stand-in.
pub const MAX_JITTER_MS: f64 = 3.0;

/// A condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RigCondition {
    /// The configured cache warm-up, and poses at regular instants.
    Regular,
    /// No cache warm-up.
    WithoutWarmup,
    /// The configured cache warm-up, and poses with random delays up to [`MAX_JITTER_MS`].
    Jitter,
}

impl RigCondition {
    /// All conditions; the main figures are those of the first.
    pub const ALL: [Self; 3] = [Self::Regular, Self::WithoutWarmup, Self::Jitter];

    /// Name in the figures.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Regular => "with warm-up",
            Self::WithoutWarmup => "without warm-up",
            Self::Jitter => "with warm-up, cameras that jitter",
        }
    }

    /// `config` under this condition.
    pub fn applied_to(self, config: &Config) -> Config {
        let mut config = config.clone();
        config.mocap.jitter_ms = 0.0;
        match self {
            Self::Regular => {}
            Self::WithoutWarmup => config.realtime.warmup_us = 0.0,
            Self::Jitter => config.mocap.jitter_ms = MAX_JITTER_MS,
        }
        config
    }
}

/// Delay of the pose of round `round`, uniformly distributed between zero and `jitter_ms` \[ms\].
pub fn delay_ms(round: u64, jitter_ms: f64) -> f64 {
    // Multiples of the golden ratio fill the interval uniformly in an irregular order.
    const GOLDEN: f64 = 0.618_033_988_749_895;
    jitter_ms.min(MAX_JITTER_MS) * (round as f64 * GOLDEN).fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_fill_their_range_and_a_regular_camera_has_none() {
        let delays: Vec<f64> = (0..1000).map(|round| delay_ms(round, MAX_JITTER_MS)).collect();
        assert!(delays.iter().all(|delay| (0.0..MAX_JITTER_MS).contains(delay)));
        let mean = delays.iter().sum::<f64>() / 1000.0;
        assert!((mean - 0.5 * MAX_JITTER_MS).abs() < 0.01, "{mean}");
        assert_eq!(delay_ms(7, 0.0), 0.0);
    }

    #[test]
    fn each_condition_changes_one_thing() {
        let config = Config::default();
        let changed = RigCondition::ALL.map(|condition| {
            let config = condition.applied_to(&config);
            (config.realtime.warmup_us, config.mocap.jitter_ms)
        });
        let warmup = config.realtime.warmup_us;
        assert!(warmup > 0.0);
        assert_eq!(changed, [(warmup, 0.0), (0.0, 0.0), (warmup, MAX_JITTER_MS)]);
    }
}
