//! History for a page that is opened later: the latest minutes, thinned, in bounded memory.

use std::collections::VecDeque;

use crate::collect::{Collected, ViewedEvent};
use crate::row::{TickRow, VehicleRow};

/// Thinning: one row in this many is stored.
const THINNING: u64 = 3;
/// Maximum number of stored rows of each kind: two minutes at 60 Hz.
const MOST_ROWS: usize = 2400;
/// Maximum number of stored events.
const MOST_EVENTS: usize = 200;

/// History of an instance.
#[derive(Debug, Default)]
pub struct History {
    ticks: Thinned<TickRow>,
    vehicles: Thinned<VehicleRow>,
    events: VecDeque<ViewedEvent>,
}

/// The newest rows of a stream, thinned.
#[derive(Debug, Default)]
struct Thinned<T> {
    rows: VecDeque<T>,
    seen: u64,
}

impl<T: Copy> Thinned<T> {
    fn add(&mut self, row: T) {
        if self.seen.is_multiple_of(THINNING) {
            if self.rows.len() == MOST_ROWS {
                self.rows.pop_front();
            }
            self.rows.push_back(row);
        }
        self.seen += 1;
    }
}

impl History {
    /// Adds collected rows and events. If the time restarts, it is that of another daemon: earlier rows are discarded, as on the page,
    /// which searches its rows by time.
    pub fn add(&mut self, collected: &Collected) {
        let begins_again =
            |first: &TickRow| self.ticks.rows.back().is_some_and(|last| first[0] < last[0]);
        if collected.ticks.first().is_some_and(begins_again) {
            *self = Self::default();
        }
        collected.ticks.iter().for_each(|row| self.ticks.add(*row));
        collected.vehicles.iter().for_each(|row| self.vehicles.add(*row));
        for event in &collected.events {
            if self.events.len() == MOST_EVENTS {
                self.events.pop_front();
            }
            self.events.push_back(event.clone());
        }
    }

    /// The history as rows and events.
    pub fn collected(&self) -> Collected {
        Collected {
            ticks: self.ticks.rows.iter().copied().collect(),
            vehicles: self.vehicles.rows.iter().copied().collect(),
            events: self.events.iter().cloned().collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::collect::EventMood;

    #[test]
    fn time_that_begins_again_forgets_what_was_before() {
        let mut history = History::default();
        let of_ticks = |ticks: Vec<TickRow>| Collected { ticks, ..Collected::default() };
        history.add(&of_ticks(vec![[1.0; _], [2.0; _], [3.0; _], [4.0; _]]));
        history.add(&of_ticks(vec![[0.0; _], [0.1; _]]));
        assert_eq!(history.collected().ticks, [[0.0; _]]);
    }

    #[test]
    fn the_past_is_thinned_and_bounded() {
        let mut history = History::default();
        for second in 0..600 {
            let rows = (0..60).map(|i| [f64::from(second) + f64::from(i) / 60.0; _]);
            let event = ViewedEvent {
                t_s: f64::from(second),
                mood: EventMood::Neutral,
                text: String::new(),
            };
            let ticks = rows.collect();
            history.add(&Collected { ticks, vehicles: Vec::new(), events: vec![event] });
        }
        let past = history.collected();
        assert_eq!((past.ticks.len(), past.events.len()), (MOST_ROWS, MOST_EVENTS));
        assert!((past.ticks[0][0] - 480.0).abs() < 0.1);
        assert_eq!(past.events[0].t_s, 400.0);
    }
}
