//! Slow mean of a quantity without its latest values, so that a fault is detected before it enters the mean.

/// Duration of a block of values \[s\].
const BLOCK_S: f64 = 0.5;
/// Number of latest complete blocks that are not yet part of the mean \[-\]; together they are longer than the detection of a fault takes.
const WAITING: usize = 3;
/// Greatest value of a block, as a multiple of the mean \[-\]; a greater one, for example of a block with outliers, is clamped.
const GREATEST_GROWTH: f64 = 9.0;

/// Slow mean of values that are not negative.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DelayedMean {
    mean: f64,
    /// Time constant \[s\]; at the beginning the mean is that of all blocks.
    time_s: f64,
    /// Means of the latest blocks, the newest first.
    waiting: [Option<f64>; WAITING],
    /// Number of blocks in the mean \[-\].
    blocks: u32,
    sum: f64,
    count: u32,
    since_s: Option<f64>,
}

impl DelayedMean {
    /// A mean with the initial value `mean` and the time constant `time_s` \[s\].
    pub(crate) fn new(mean: f64, time_s: f64) -> Self {
        Self {
            mean,
            time_s,
            waiting: [None; WAITING],
            blocks: 0,
            sum: 0.0,
            count: 0,
            since_s: None,
        }
    }

    /// The mean.
    pub(crate) fn mean(&self) -> f64 {
        self.mean
    }

    /// Takes a value measured at `t_s` \[s\]; returns whether the mean may have changed.
    pub(crate) fn take(&mut self, t_s: f64, value: f64) -> bool {
        let since_s = *self.since_s.get_or_insert(t_s);
        self.sum += value;
        self.count += 1;
        if t_s - since_s < BLOCK_S {
            return false;
        }
        let oldest = self.waiting[WAITING - 1];
        if let Some(block) = oldest {
            self.blocks += 1;
            let share = (BLOCK_S / self.time_s).max(f64::from(1 + self.blocks).recip()).min(1.0);
            self.mean += share * (block.min(GREATEST_GROWTH * self.mean) - self.mean);
        }
        self.waiting.rotate_right(1);
        self.waiting[0] = Some(self.sum / f64::from(self.count));
        (self.sum, self.count, self.since_s) = (0.0, 0, Some(t_s));
        oldest.is_some()
    }

    /// Discards the values that the mean does not contain yet.
    pub(crate) fn discard(&mut self) {
        *self = Self { blocks: self.blocks, ..Self::new(self.mean, self.time_s) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn take(mean: &mut DelayedMean, from_s: f64, values: u32, value: f64) {
        (0..values).for_each(|k| {
            mean.take(from_s + f64::from(k) / 60.0, value);
        });
    }

    #[test]
    fn a_value_counts_after_a_second_and_a_half_and_never_if_it_is_discarded() {
        let mut mean = DelayedMean::new(1.0, 5.0);
        take(&mut mean, 0.0, 110, 1.0);
        take(&mut mean, 110.0 / 60.0, 85, 3.0);
        assert_eq!(mean.mean(), 1.0);
        mean.discard();
        take(&mut mean, 4.0, 100, 1.0);
        assert_eq!(mean.mean(), 1.0);
        take(&mut mean, 6.0, 1800, 2.0);
        assert!((1.9..2.0).contains(&mean.mean()), "{}", mean.mean());
    }
}
