//! Lowerings of the line below the arrivals, by which a small step forward of a server's clock is told.
//!
//! Nothing arrives before it was captured: the line falls with the first frames behind a step forward, by the step and within a few
//! frames. As more and more fast frames are seen it falls too, but slowly.

use oqtal_bus::time::{Span, Time};

/// Time over which lowerings add up: [`BINS`] times [`BIN`].
const BIN: Span = Span::from_millis(100);
const BINS: usize = 10;

/// The lowerings of a tenth of a second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Lowerings {
    /// Number of the tenth of a second \[-\].
    tenth: u64,
    /// Stamp before the first of them \[ns, server clock\].
    before_ns: u64,
    /// Their sum \[ns\].
    by_ns: f64,
}

/// Watch for lowerings of the line within a second. Bounded work and memory; nothing is allocated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoweringWatch {
    bins: [Lowerings; BINS],
}

impl LoweringWatch {
    /// Takes a lowering by `by_ns` \[ns\] with the frame that arrived at `arrival`, the frame before which had the stamp `before_ns`
    /// \[ns, server clock\].
    pub fn add(&mut self, by_ns: f64, arrival: Time, before_ns: u64) {
        let tenth = arrival.nanos() / BIN.nanos().unsigned_abs();
        let bin = &mut self.bins[(tenth % BINS as u64) as usize];
        if bin.tenth != tenth {
            *bin = Lowerings { tenth, before_ns, by_ns: 0.0 };
        }
        bin.by_ns += by_ns;
        for old in &mut self.bins {
            if old.tenth + BINS as u64 <= tenth {
                *old = Lowerings::default();
            }
        }
    }

    /// Stamp before the first lowering of the last second \[ns, server clock\], if they add up to more than `least`.
    #[must_use]
    pub fn exceeding(&self, least: Span) -> Option<u64> {
        let lowered = self.bins.iter().filter(|bin| bin.by_ns > 0.0);
        let first = lowered.clone().min_by_key(|bin| bin.tenth)?;
        let sum_ns: f64 = lowered.map(|bin| bin.by_ns).sum();
        (sum_ns > least.nanos() as f64).then_some(first.before_ns)
    }
}
