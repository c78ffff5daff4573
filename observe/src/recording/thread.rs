//! The thread that writes a recording, behind a bounded queue: a disk that stalls costs the observer nothing.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use mcap::{McapError, McapResult};

use super::facts::Facts;
use super::writer::{McapFile, McapMessage, MessageBatch, Preamble};

/// Batches that wait at most \[-\]: eight seconds of a flight at 60 Hz.
const QUEUE: usize = 32;
/// Age and size at which a batch goes to the thread \[ns\], \[-\]. With the age of a chunk, less than a second is lost if the process
/// is killed.
const BATCH_NS: u64 = 200_000_000;
const BATCH: usize = 256;
/// Time without messages after which the present chunk is written.
const IDLE: Duration = Duration::from_millis(500);

/// Where a recording is written, and when another file begins.
#[derive(Clone, Debug)]
pub struct FilePlan {
    /// The first file; the following ones have a number before the extension.
    pub path: PathBuf,
    /// Size of a file after which another begins \[bytes\]; `None` for one file.
    pub max_bytes: Option<u64>,
    /// Duration of a file after which another begins \[ns\]; `None` for one file.
    pub max_ns: Option<u64>,
    /// Whether the sink waits for a full queue instead of dropping messages: in virtual time nothing is lost by waiting.
    pub waits: bool,
    /// Tells people, once, that nothing more can be written.
    pub complain: fn(&str),
}

/// What became of a recording.
#[derive(Clone, Debug, Default)]
pub struct RecordingResult {
    /// Its files, in order.
    pub files: Vec<PathBuf>,
    /// Messages written \[-\].
    pub messages: u64,
    /// Size of the messages written \[bytes\].
    pub bytes: u64,
    /// Messages that found the queue full \[-\].
    pub dropped: u64,
    /// Why it ended early; `None` if it did not.
    pub failure: Option<String>,
}

/// An item of the queue.
enum QueuedRecord {
    Batch(MessageBatch),
    Facts(Facts),
}

/// The sending end: the queue, and the thread behind it.
#[derive(Debug)]
pub struct RecordingThread {
    queue: Option<SyncSender<QueuedRecord>>,
    /// Messages that are not queued yet.
    batch: MessageBatch,
    thread: Option<JoinHandle<RecordingResult>>,
    waits: bool,
    dropped: u64,
    failed: Arc<AtomicBool>,
}

impl RecordingThread {
    /// Creates the first file and starts the thread.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn start(plan: FilePlan, preamble: Preamble) -> io::Result<Self> {
        let waits = plan.waits;
        let file = McapFile::create(&plan.path, &preamble).map_err(to_io)?;
        let (queue, records) = sync_channel(QUEUE);
        let (failed, result) = (Arc::new(AtomicBool::new(false)), RecordingResult::default());
        let has_failed = Arc::clone(&failed);
        let files = Files { plan, preamble, file: Some(file), result, failed };
        let thread = std::thread::Builder::new()
            .name("recording".to_owned())
            .spawn(move || files.run(&records))?;
        let (queue, thread) = (Some(queue), Some(thread));
        let batch = MessageBatch::default();
        Ok(Self { queue, batch, thread, waits, dropped: 0, failed: has_failed })
    }

    /// Takes a message, encoded in `data`.
    pub fn message(&mut self, message: McapMessage, data: &[u8]) {
        self.batch.push(message, data);
        self.hand_over_at(message.log_time);
    }

    /// Queues the messages taken so far if they are many, or old at `now` \[ns since the epoch\].
    pub fn hand_over_at(&mut self, now: u64) {
        let is_old = self.batch.began().is_some_and(|began| now.saturating_sub(began) >= BATCH_NS);
        if is_old || self.batch.len() >= BATCH {
            self.hand_over();
        }
    }

    fn hand_over(&mut self) {
        let count = self.batch.len() as u64;
        let next = self.batch.replacement();
        let batch = std::mem::replace(&mut self.batch, next);
        if count > 0 && !self.send(QueuedRecord::Batch(batch)) {
            self.dropped += count;
        }
    }

    /// Queues a table of facts.
    pub fn facts(&mut self, facts: Facts) {
        self.hand_over();
        if !self.send(QueuedRecord::Facts(facts)) {
            self.dropped += 1;
        }
    }

    /// Whether nothing more can be written.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        self.failed.load(Ordering::Acquire)
    }

    /// Queues a record; `false` if there is no room.
    fn send(&self, record: QueuedRecord) -> bool {
        let Some(queue) = &self.queue else { return true };
        if self.waits {
            queue.send(record).is_ok()
        } else {
            !matches!(queue.try_send(record), Err(TrySendError::Full(_)))
        }
    }

    /// Writes what waits, closes the file, and ends the thread.
    #[must_use]
    pub fn finish(mut self) -> RecordingResult {
        let result = self.join();
        RecordingResult { dropped: self.dropped, ..result }
    }

    fn join(&mut self) -> RecordingResult {
        self.hand_over();
        drop(self.queue.take());
        let result = self.thread.take().and_then(|thread| thread.join().ok());
        let failure = || Some("the thread that writes ended by an internal error".to_owned());
        result.unwrap_or_else(|| RecordingResult { failure: failure(), ..Default::default() })
    }
}

impl Drop for RecordingThread {
    /// A recording that is dropped, by a failure around it, is complete up to there.
    fn drop(&mut self) {
        if self.thread.is_some() {
            self.join();
        }
    }
}

/// The files of a recording, on the thread that writes.
struct Files {
    plan: FilePlan,
    preamble: Preamble,
    /// `None` after an error.
    file: Option<McapFile>,
    result: RecordingResult,
    failed: Arc<AtomicBool>,
}

impl Files {
    fn run(mut self, records: &Receiver<QueuedRecord>) -> RecordingResult {
        self.result.files.push(self.plan.path.clone());
        loop {
            let done = match records.recv_timeout(IDLE) {
                Ok(QueuedRecord::Batch(batch)) => {
                    batch.iter().try_for_each(|(message, data)| self.message(message, data))
                }
                Ok(QueuedRecord::Facts(facts)) => self.with_file(|file| file.facts(&facts)),
                Err(RecvTimeoutError::Timeout) => self.with_file(McapFile::flush),
                Err(RecvTimeoutError::Disconnected) => break,
            };
            if let Err(error) = done {
                self.fail(&error);
            }
        }
        if let Some(Err(error)) = self.file.take().map(McapFile::finish) {
            self.fail(&error);
        }
        self.result
    }

    /// Does something with the file, if nothing failed so far.
    fn with_file(&mut self, work: impl FnOnce(&mut McapFile) -> McapResult<()>) -> McapResult<()> {
        self.file.as_mut().map_or(Ok(()), work)
    }

    fn message(&mut self, message: &McapMessage, data: &[u8]) -> McapResult<()> {
        let FilePlan { max_bytes, max_ns, .. } = self.plan;
        let Some(file) = &self.file else { return Ok(()) };
        let full = max_bytes.is_some_and(|most| file.bytes() >= most)
            || max_ns.is_some_and(|most| file.age(message.log_time) >= most);
        if full {
            self.begin_another()?;
        }
        self.with_file(|file| file.message(message, data))?;
        self.result.messages += 1;
        self.result.bytes += data.len() as u64;
        Ok(())
    }

    fn begin_another(&mut self) -> McapResult<()> {
        self.file.take().map_or(Ok(()), McapFile::finish)?;
        let mut number = self.result.files.len() + 1;
        loop {
            let path = numbered(&self.plan.path, number);
            match McapFile::create(&path, &self.preamble) {
                // Of another recording: it is kept, and this one goes on beside it.
                Err(McapError::Io(error)) if error.kind() == io::ErrorKind::AlreadyExists => {
                    number += 1;
                }
                Err(error) => return Err(error),
                Ok(file) => {
                    self.file = Some(file);
                    self.result.files.push(path);
                    return Ok(());
                }
            }
        }
    }

    fn fail(&mut self, error: &McapError) {
        if let Some(file) = self.file.take() {
            file.abandon();
        }
        let path = self.result.files.last().unwrap_or(&self.plan.path).display();
        let reason = match error {
            McapError::Io(error) => error.to_string(),
            other => other.to_string(),
        };
        let message = format!("{path}: {reason}; the recording ends here");
        self.failed.store(true, Ordering::Release);
        (self.plan.complain)(&message);
        self.result.failure = Some(message);
    }
}

/// The path of the file with this number: `flight.mcap`, `flight.2.mcap`, …
fn numbered(path: &Path, number: usize) -> PathBuf {
    path.with_extension(format!("{number}.mcap"))
}

/// An error of the format's library as one of the operating system, whose text says most.
fn to_io(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other.to_string()),
    }
}
