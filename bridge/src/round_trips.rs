//! Round trips over a network: how long a frame is on its way.

use oqtal_bus::time::Span;

/// Round trips that are kept \[-\]: three seconds of ten a second, longer than the pauses of a busy vehicle.
const KEPT: usize = 32;
/// Longest round trip that is kept; a longer one waited somewhere.
const LONGEST: Span = Span::from_millis(100);

/// The latest round trips of requests that a vehicle answers at once.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RoundTrips {
    latest: [Option<Span>; KEPT],
    next: usize,
    /// Number of longer ones since the last one that was kept \[-\].
    longer: usize,
}

impl RoundTrips {
    /// Records a round trip; a negative one is ignored, and so is one above [`LONGEST`], unless so many of these follow one another that the
    /// way has become longer: then it is unknown.
    pub(crate) fn record(&mut self, span: Span) {
        if (Span::ZERO..=LONGEST).contains(&span) {
            self.latest[self.next] = Some(span);
            (self.next, self.longer) = ((self.next + 1) % KEPT, 0);
        } else if span > LONGEST {
            self.longer += 1;
            if self.longer >= KEPT {
                *self = Self::default();
            }
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

    #[test]
    fn replies_that_a_vehicle_held_back_are_not_its_way() {
        let mut trips = RoundTrips::default();
        trips.record(Span::from_millis(577));
        assert_eq!(trips.one_way(), None, "the first reply, of a vehicle that was starting");
        trips.record(Span::from_millis(5));
        // Requests every 100 ms are answered together after two seconds, then late.
        (0..20).for_each(|held| trips.record(Span::from_millis(2000 - 100 * held)));
        (0..10).for_each(|_| trips.record(Span::from_millis(78)));
        assert_eq!(trips.one_way(), Some(Span::from_millis(5).scaled(0.5)));
        (0..KEPT).for_each(|_| trips.record(Span::from_millis(300)));
        assert_eq!(trips.one_way(), None, "a longer way");
    }
}
