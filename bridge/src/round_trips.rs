//! Round trips over a network: how long a frame is on its way.

use oqtal_bus::time::Span;

/// Round trips that are kept \[-\].
const KEPT: usize = 8;

/// The latest round trips of requests that a vehicle answers at once.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RoundTrips {
    latest: [Option<Span>; KEPT],
    next: usize,
}

impl RoundTrips {
    /// Records a round trip; a negative one is ignored.
    pub(crate) fn record(&mut self, span: Span) {
        if span >= Span::ZERO {
            self.latest[self.next] = Some(span);
            self.next = (self.next + 1) % KEPT;
        }
    }

    /// One-way time of a frame: half of the shortest of the latest round trips, since longer ones include waiting; `None` before the first.
    /// It includes half of the vehicle's time to answer.
    pub(crate) fn one_way(&self) -> Option<Span> {
        self.latest.iter().flatten().min().map(|shortest| shortest.scaled(0.5))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_is_half_of_the_shortest_of_the_latest_round_trips() {
        let mut trips = RoundTrips::default();
        assert_eq!(trips.one_way(), None);
        trips.record(Span::from_millis(-1));
        assert_eq!(trips.one_way(), None);
        for millis in [4, 90, 6] {
            trips.record(Span::from_millis(millis));
            assert_eq!(trips.one_way(), Some(Span::from_millis(2)));
        }
        (0..KEPT).for_each(|_| trips.record(Span::from_millis(10)));
        assert_eq!(trips.one_way(), Some(Span::from_millis(5)), "the way may become longer");
    }
}
