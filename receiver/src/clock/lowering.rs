//! Lowerings of the line below the arrivals, which indicate a small step forward of a server's clock.
//!
//! Nothing arrives before it was captured: the line falls with the first frames behind a step forward, by the step and within a few frames.
//! The line also falls as more and more fast frames arrive, but slowly.

use oqtal_bus::time::{Span, Time};

/// Part of the time over which lowerings add up.
const BIN: Span = Span::from_millis(100);
/// Number of these parts \[-\]: one second.
const BINS: usize = 10;

/// The lowerings of a tenth of a second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Lowerings {
    /// Number of the tenth of a second \[-\].
    tenth: u64,
    /// Stamp before the first lowering \[ns, server clock\].
    before_ns: u64,
    /// Sum of the lowerings \[ns\].
    by_ns: f64,
}

/// Watch for lowerings of the line within a second. Bounded work and memory; nothing is allocated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoweringWatch {
    bins: [Lowerings; BINS],
}

impl LoweringWatch {
    /// Takes a lowering by `by_ns` \[ns\] with the frame that arrived at `arrival`; the frame before had the stamp `before_ns`
    /// \[ns, server clock\]. Returns the stamp before the first lowering of the last second if the lowerings in it add up to more than
    /// `least`. A slight lowering long before a step makes this stamp too early, by at most a second: the pairs from before the step
    /// that are then kept lie above the line, and change its slope by no more than the greatest drift.
    pub fn add(
        &mut self,
        by_ns: f64,
        (before_ns, arrival): (u64, Time),
        least: Span,
    ) -> Option<u64> {
        let tenth = arrival.nanos() / BIN.nanos().unsigned_abs();
        for old in self.bins.iter_mut().filter(|bin| bin.tenth + BINS as u64 <= tenth) {
            *old = Lowerings::default();
        }
        let bin = &mut self.bins[(tenth % BINS as u64) as usize];
        if bin.by_ns == 0.0 {
            *bin = Lowerings { tenth, before_ns, by_ns: 0.0 };
        }
        bin.by_ns += by_ns;
        let lowered = self.bins.iter().filter(|bin| bin.by_ns > 0.0);
        let sum_ns: f64 = lowered.clone().map(|bin| bin.by_ns).sum();
        let first = lowered.min_by_key(|bin| bin.tenth)?;
        (sum_ns > least.nanos() as f64).then_some(first.before_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAST: Span = Span::from_millis(1);

    /// Lowerings by 0.4 ms at these instants \[ms\]; the frame before has the instant as its stamp \[ns\].
    fn after(instants_ms: &[i64]) -> Option<u64> {
        let mut watch = LoweringWatch::default();
        let mut add = |at_ms: &i64| {
            let arrival = Time::UNSET + Span::from_millis(*at_ms);
            watch.add(0.4e6, (arrival.nanos(), arrival), LEAST)
        };
        instants_ms.iter().map(&mut add).last().flatten()
    }

    #[test]
    fn lowerings_of_a_second_add_up() {
        assert_eq!(after(&[5_000, 5_050]), None);
        assert_eq!(after(&[5_020, 5_450, 5_990]), Some(5_020_000_000));
        assert_eq!(after(&[20, 450, 990]), Some(20_000_000));
        assert_eq!(after(&[5_000, 5_100, 6_000]), None, "the first is over");
        assert_eq!(after(&[5_000, 6_000, 6_100, 6_200]), Some(6_000_000_000));
    }
}
