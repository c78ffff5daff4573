//! On-board rate loop about one axis, solved exactly for a constant demand: the rate follows its demand through a lag and a
//! second, shorter lag.

/// Shortest lag \[s\].
const SHORTEST_S: f64 = 1e-4;
/// Greatest ratio of the shorter lag to the longer one \[-\].
const CLOSEST: f64 = 0.8;

/// Solution of the loop over a time step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopStep {
    /// Time step \[s\].
    h_s: f64,
    /// Remaining fraction of a rate deviation from the demand \[-\].
    keep: f64,
    /// Angle caused by a rate deviation, per unit of the deviation \[s\].
    lever_s: f64,
    /// Remaining fraction of a target deviation from the demand \[-\].
    target_keep: f64,
    /// Rate deviation caused by a target deviation, per unit of the latter \[-\].
    target_rate: f64,
    /// Angle caused by a target deviation, per unit of the deviation \[s\].
    target_lever_s: f64,
}

/// State of the loop about one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoopState {
    /// The rate \[rad/s\].
    pub rate: f64,
    /// Target of the rate: the demand after the shorter lag \[rad/s\].
    pub target: f64,
}

impl LoopStep {
    /// Solution over `h_s` for a loop with the time constants `lag_s` and `fast_s` \[s\].
    pub fn new(lag_s: f64, fast_s: f64, h_s: f64) -> Self {
        let lag_s = lag_s.max(SHORTEST_S);
        let fast_s = fast_s.min(CLOSEST * lag_s);
        let keep = (-h_s / lag_s).exp();
        let target_keep = if fast_s > 0.0 { (-h_s / fast_s).exp() } else { 0.0 };
        let share = fast_s / (lag_s - fast_s);
        let lever_s = lag_s * (1.0 - keep);
        Self {
            h_s,
            keep,
            lever_s,
            target_keep,
            target_rate: share * (keep - target_keep),
            target_lever_s: share * (lever_s - fast_s * (1.0 - target_keep)),
        }
    }

    /// Advances the loop under a constant demand \[rad/s\]; returns the change of angle \[rad\].
    #[inline]
    pub fn advance(&self, state: &mut LoopState, demand: f64) -> f64 {
        let off = state.rate - demand;
        let target_off = state.target - demand;
        state.rate = demand + off * self.keep + target_off * self.target_rate;
        state.target = demand + target_off * self.target_keep;
        demand * self.h_s + off * self.lever_s + target_off * self.target_lever_s
    }

    /// Remaining fraction of a rate deviation \[-\], and the resulting angle per unit of the deviation \[s\].
    pub fn of_rate(&self) -> (f64, f64) {
        (self.keep, self.lever_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Comparison with the equations `T r' = x - r`, `f x' = d - x`, integrated in small steps.
    #[test]
    fn the_loop_behind_a_second_lag_is_solved_exactly() {
        for (lag_s, fast_s) in [(50e-3, 0.0), (50e-3, 6e-3), (30e-3, 15e-3), (20e-3, 16e-3)] {
            let (h_s, demand, start) = (12e-3, 1.5, LoopState { rate: -0.4, target: 0.3 });
            let mut exact = start;
            let angle = LoopStep::new(lag_s, fast_s, h_s).advance(&mut exact, demand);
            let (steps, mut state, mut turned) = (200_000, start, 0.0);
            let dt = h_s / f64::from(steps);
            for _ in 0..steps {
                let target_rate = if fast_s > 0.0 { (demand - state.target) / fast_s } else { 0.0 };
                if fast_s == 0.0 {
                    state.target = demand;
                }
                turned += state.rate * dt;
                state.rate += (state.target - state.rate) / lag_s * dt;
                state.target += target_rate * dt;
            }
            let off = [angle - turned, exact.rate - state.rate, exact.target - state.target];
            assert!(off.iter().all(|off| off.abs() < 1e-5), "{lag_s}, {fast_s}: {off:?}");
        }
    }
}
