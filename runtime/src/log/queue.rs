//! Bounded queue between the logging threads and the log thread. If it is full, a record is dropped and counted.

use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, bounded};
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, time as wall_clock};
use tracing_subscriber::layer::Context;

/// Capacity of the queue \[records\].
const CAPACITY: usize = 1024;

/// Log record.
#[derive(Clone, Debug)]
pub(super) struct LogRecord {
    /// Wall-clock time, RFC 3339.
    pub time: String,
    /// Severity.
    pub level: Level,
    /// The message.
    pub message: String,
    /// Further fields: name and value.
    pub fields: Vec<(&'static str, String)>,
}

impl LogRecord {
    fn new(level: Level) -> Self {
        let mut time = String::new();
        // Fails only if writing to the string fails.
        let _ = wall_clock().format_time(&mut Writer::new(&mut time));
        Self { time, level, message: String::new(), fields: Vec::new() }
    }
}

impl Visit for LogRecord {
    fn record_str(&mut self, field: &Field, value: &str) {
        match field.name() {
            "message" => value.clone_into(&mut self.message),
            name => self.fields.push((name, value.to_owned())),
        }
    }

    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        self.record_str(field, &format!("{value:?}"));
    }
}

enum Entry {
    Record(LogRecord),
    /// Acknowledged once all earlier records are written.
    Flush(Sender<()>),
}

/// Sending side of the queue. No call blocks, except [`LogQueue::flush`].
#[derive(Clone)]
pub(super) struct LogQueue {
    entries: Sender<Entry>,
    dropped: Arc<AtomicU64>,
    /// Whether all records of iceoryx2 are logged unchanged. Otherwise only its errors are logged, without their fields, which contain
    /// whole data structures.
    is_detailed: bool,
}

/// The log thread's side.
pub(super) struct LogRecords {
    entries: Receiver<Entry>,
    dropped: Arc<AtomicU64>,
}

/// Both sides of a new queue, which takes all records of iceoryx2 if it is `is_detailed`.
pub(super) fn log_queue(is_detailed: bool) -> (LogQueue, LogRecords) {
    let (sender, receiver) = bounded(CAPACITY);
    let dropped = Arc::new(AtomicU64::new(0));
    (
        LogQueue { entries: sender, dropped: Arc::clone(&dropped), is_detailed },
        LogRecords { entries: receiver, dropped },
    )
}

impl Debug for LogQueue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LogQueue").field("waiting", &self.entries.len()).finish()
    }
}

impl LogQueue {
    /// Waits until the queued records are written, at most twice `timeout`.
    pub fn flush(&self, timeout: Duration) {
        let (done, is_done) = bounded(1);
        if self.entries.send_timeout(Entry::Flush(done), timeout).is_ok() {
            let _ = is_done.recv_timeout(timeout);
        }
    }
}

impl<S: Subscriber> Layer<S> for LogQueue {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let (level, target) = (*event.metadata().level(), event.metadata().target());
        let is_brief = !self.is_detailed && target.starts_with("iceoryx2");
        if is_brief && level != Level::ERROR {
            return;
        }
        let mut record = LogRecord::new(level);
        event.record(&mut record);
        if is_brief {
            record.fields.clear();
        }
        if self.entries.try_send(Entry::Record(record)).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl LogRecords {
    /// Passes every record to `write` until the process ends, with a warning whenever records were dropped.
    pub fn drain_into(&self, mut write: impl FnMut(&LogRecord)) {
        for entry in &self.entries {
            let dropped = self.dropped.swap(0, Ordering::Relaxed);
            if dropped > 0 {
                let mut warning = LogRecord::new(Level::WARN);
                warning.message =
                    format!("{dropped} log records were dropped: the output did not drain");
                write(&warning);
            }
            match entry {
                Entry::Record(record) => write(&record),
                Entry::Flush(done) => {
                    let _ = done.try_send(());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use tracing_subscriber::layer::SubscriberExt;

    use super::*;

    #[test]
    fn an_output_that_does_not_drain_blocks_no_thread_and_drops_are_reported() {
        let (queue, records) = log_queue(false);
        let subscriber = tracing_subscriber::registry().with(queue.clone());
        tracing::subscriber::with_default(subscriber, || {
            for number in 0..CAPACITY + 5 {
                tracing::info!(number, "a record");
            }
        });
        queue.flush(Duration::from_millis(1));
        drop(queue);
        let mut written = Vec::new();
        records.drain_into(|record| written.push(record.clone()));
        assert_eq!(written.len(), CAPACITY + 1);
        assert!(written[0].message.starts_with("5 log records were dropped"), "{:?}", written[0]);
        assert_eq!(written[1].fields, [("number", "0".to_owned())]);
    }

    #[test]
    fn of_iceoryx2_only_the_text_of_errors_is_logged_unless_details_are_wanted() {
        for (is_detailed, expected) in [(false, vec![0, 1]), (true, vec![1, 1, 1])] {
            let (queue, records) = log_queue(is_detailed);
            let subscriber = tracing_subscriber::registry().with(queue.clone());
            tracing::subscriber::with_default(subscriber, || {
                tracing::warn!(target: "iceoryx2_bb_loggers::tracing", origin = 1, "removed");
                tracing::error!(target: "iceoryx2_bb_loggers::tracing", origin = 1, "failed");
                tracing::warn!(origin = 1, "ours");
            });
            drop(queue);
            let mut fields = Vec::new();
            records.drain_into(|record| fields.push(record.fields.len()));
            assert_eq!(fields, expected);
        }
    }
}
