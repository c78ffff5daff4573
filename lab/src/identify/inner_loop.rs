//! The on-board rate loop about one axis, solved exactly for a constant demand: a rate that follows its demand with a lag.

/// Shortest lag \[s\].
const SHORTEST_S: f64 = 1e-4;

/// The solution of the loop over a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopStep {
    /// The time \[s\].
    h_s: f64,
    /// What remains of a deviation of the rate from its demand \[-\].
    keep: f64,
    /// The angle that a deviation of the rate turns meanwhile, over the deviation \[s\].
    lever_s: f64,
}

impl LoopStep {
    /// The solution over `h_s` for a loop of time constant `lag_s` \[s\].
    #[must_use]
    pub fn new(lag_s: f64, h_s: f64) -> Self {
        let lag_s = lag_s.max(SHORTEST_S);
        let keep = (-h_s / lag_s).exp();
        Self { h_s, keep, lever_s: lag_s * (1.0 - keep) }
    }

    /// Advances a rate under a constant demand \[rad/s\]; returns the angle turned \[rad\].
    #[inline]
    pub fn advance(&self, rate: &mut f64, demand: f64) -> f64 {
        let off = *rate - demand;
        *rate = demand + off * self.keep;
        demand * self.h_s + off * self.lever_s
    }

    /// What remains of a deviation of the rate \[-\], and the angle that it turns meanwhile over it \[s\].
    #[must_use]
    pub fn of_rate(&self) -> (f64, f64) {
        (self.keep, self.lever_s)
    }
}
