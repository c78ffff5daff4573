//! Updates to every open page. The queue of a page is bounded; a page that does not read is disconnected.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use oqtal_bus::time::Time;

use crate::collect::Collected;
use crate::history::History;
use crate::live::{LiveStatus, line};

/// Length of the queue of a page \[updates\]: two seconds.
const MOST_WAITING: usize = 80;

/// Pages of one instance, and the history for new pages.
#[derive(Debug, Default)]
pub struct Hub {
    shared: Mutex<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    history: History,
    status: Option<LiveStatus>,
    /// Instant of the newest update.
    at: Time,
    pages: Vec<SyncSender<Arc<str>>>,
}

impl Hub {
    /// Sends the rows and events collected at `at`, and a new status, to all pages.
    pub fn publish(&self, at: Time, collected: &Collected, status: Option<LiveStatus>) {
        let mut shared = self.lock();
        shared.history.add(collected);
        let is_news = !collected.is_empty() || status.is_some();
        if is_news && !shared.pages.is_empty() {
            let update: Arc<str> = line(at, collected, status.as_ref()).into();
            shared.pages.retain(|page| page.try_send(Arc::clone(&update)).is_ok());
        }
        shared.status = status.or(shared.status.take());
        shared.at = at;
    }

    /// Opens a page; its first line is the history. The stream ends when the page is too slow.
    pub fn subscribe(&self) -> (String, Receiver<Arc<str>>) {
        let (page, updates) = sync_channel(MOST_WAITING);
        let mut shared = self.lock();
        shared.pages.push(page);
        (line(shared.at, &shared.history.collected(), shared.status.as_ref()), updates)
    }

    /// Number of open pages \[-\].
    pub fn pages(&self) -> usize {
        self.lock().pages.len()
    }

    /// Locks the shared state, which is consistent even after a panic.
    fn lock(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tick(t_s: f64) -> Collected {
        let mut row = [0.0; _];
        row[0] = t_s;
        Collected { ticks: vec![row], ..Collected::default() }
    }

    #[test]
    fn a_page_sees_the_past_and_then_every_update() {
        let hub = Hub::default();
        hub.publish(Time::VIRTUAL_START, &tick(1.0), None);
        let (past, updates) = hub.subscribe();
        hub.publish(Time::VIRTUAL_START, &tick(2.0), None);
        let update = updates.try_recv().unwrap();
        assert!(past.contains("[1.0,") && update.contains("[2.0,"), "{past}{update}");
    }
}
