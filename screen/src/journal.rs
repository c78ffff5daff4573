//! The newest events, with the time since the observation began.

use std::collections::VecDeque;

use oqtal_bus::time::{Span, Time};

/// Events kept at most \[-\]: more than a terminal is high.
const KEPT: usize = 200;

/// An event in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JournalEntry {
    /// Time since the observation began.
    pub at: Span,
    /// What happened.
    pub text: String,
}

/// The newest events.
#[derive(Debug)]
pub struct Journal {
    began: Time,
    /// Oldest first.
    entries: VecDeque<JournalEntry>,
}

impl Journal {
    /// An empty journal of an observation that began at `began`.
    #[must_use]
    pub fn new(began: Time) -> Self {
        Self { began, entries: VecDeque::new() }
    }

    /// Adds an event that was received at `at`.
    pub fn add(&mut self, at: Time, text: impl Into<String>) {
        if self.entries.len() == KEPT {
            self.entries.pop_front();
        }
        self.entries.push_back(JournalEntry { at: at.since(self.began), text: text.into() });
    }

    /// The newest `count` events, the oldest of them first.
    pub fn newest(&self, count: usize) -> impl Iterator<Item = &JournalEntry> {
        self.entries.iter().skip(self.entries.len().saturating_sub(count))
    }

    /// Time from the beginning of the observation to `now`.
    #[must_use]
    pub fn age(&self, now: Time) -> Span {
        now.since(self.began)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_events_are_forgotten() {
        let began = Time::VIRTUAL_START;
        let mut journal = Journal::new(began);
        for number in 0..KEPT + 5 {
            journal.add(began + Span::from_millis(number as i64), format!("event {number}"));
        }
        assert_eq!(journal.newest(usize::MAX).count(), KEPT);
        let last: Vec<_> = journal.newest(2).map(|entry| &*entry.text).collect();
        assert_eq!(last, [format!("event {}", KEPT + 3), format!("event {}", KEPT + 4)]);
        assert_eq!(journal.newest(1).next().unwrap().at, Span::from_millis(KEPT as i64 + 4));
    }
}
