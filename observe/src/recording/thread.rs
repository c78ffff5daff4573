//! Writing thread of a recording, behind a bounded queue: a stalled disk does not delay the observer.

use std::collections::HashSet;
use std::fs::{self, File, Metadata};
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

use oqtal_bus::code::Answer;
use oqtal_bus::message::EventV1;

use super::chunk::{Chunk, McapMessage};
use super::facts::Facts;
use super::writer::{AttachedFile, McapFile, Preamble};
use crate::event::changed_keys;

/// Maximum number of waiting chunks \[-\]: eight seconds of a flight.
const QUEUE: usize = 16;

/// Files of a recording.
#[derive(Clone, Debug)]
pub struct FilePlan {
    /// Path of the first file; later files have a number before the extension.
    pub path: PathBuf,
    /// Size of a file above which the next one is started \[bytes\]; `None` for a single file.
    pub max_bytes: Option<u64>,
    /// Duration of a file above which the next one is started \[ns\]; `None` for a single file.
    pub max_ns: Option<u64>,
    /// Whether the sink waits if the queue is full instead of dropping messages, as in virtual time.
    pub waits: bool,
    /// Reports, once, that writing has failed.
    pub complain: fn(&str),
}

/// Result of a recording.
#[derive(Clone, Debug, Default)]
pub struct RecordingResult {
    /// Paths of the files, in order: of a file that was renamed while it was written, the new one.
    pub files: Vec<PathBuf>,
    /// Files that were removed while they were written.
    pub removed: Vec<PathBuf>,
    /// Messages written \[-\].
    pub messages: u64,
    /// Size of the files, also of one that could not be finished \[bytes\].
    pub bytes: u64,
    /// Number of messages dropped because the queue was full \[-\].
    pub dropped: u64,
    /// Reason why the recording ended early; `None` if it is complete.
    pub failure: Option<String>,
}

/// An item of the queue.
enum QueuedRecord {
    Chunk(Chunk),
    Facts(Facts),
    File(AttachedFile),
    Repeated(Box<RepeatedChange>),
    ClearRepeated,
}

/// Change of settings that is written again at the beginning of every later file.
#[derive(Clone, Debug)]
struct RepeatedChange {
    event: EventV1,
    message: McapMessage,
    /// The message, encoded.
    data: Vec<u8>,
}

/// Sending side: the queue and its thread.
#[derive(Debug)]
pub struct RecordingThread {
    queue: Option<SyncSender<QueuedRecord>>,
    /// Messages not yet queued.
    chunk: Chunk,
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
        let file = McapFile::create(&plan.path, &preamble)?;
        let (queue, records) = sync_channel(QUEUE);
        let (failed, result) = (Arc::new(AtomicBool::new(false)), RecordingResult::default());
        let has_failed = Arc::clone(&failed);
        let repeated = Vec::new();
        let files = Files { plan, preamble, repeated, file: Some(file), result, failed };
        let thread = std::thread::Builder::new()
            .name("recording".to_owned())
            .spawn(move || files.run(&records))?;
        let (queue, thread) = (Some(queue), Some(thread));
        Ok(Self { queue, chunk: Chunk::default(), thread, waits, dropped: 0, failed: has_failed })
    }

    /// Adds a message, encoded in `data`.
    pub fn message(&mut self, message: McapMessage, data: &[u8]) {
        self.hand_over_at(message.log_time);
        self.chunk.push(message, data);
    }

    /// Queues the collected messages if they are many, or old at `now` \[ns since the epoch\].
    pub fn hand_over_at(&mut self, now: u64) {
        if self.chunk.is_due(now) {
            self.hand_over();
        }
    }

    fn hand_over(&mut self) {
        let chunk = std::mem::take(&mut self.chunk);
        if chunk.messages > 0 {
            self.send(QueuedRecord::Chunk(chunk));
        }
    }

    /// Queues a table of facts, which is written to this file of the recording and to those after it.
    pub fn facts(&mut self, facts: Facts) {
        self.hand_over();
        self.send(QueuedRecord::Facts(facts));
    }

    /// Queues a file, which is attached to this file of the recording and to those after it.
    pub fn file(&mut self, file: AttachedFile) {
        self.send(QueuedRecord::File(file));
    }

    /// Repeats the message last added, of a change of settings and encoded in `data`, at the beginning of later files, each of which has
    /// the settings of the daemon's start only.
    pub fn repeat(&mut self, event: &EventV1, message: McapMessage, data: &[u8]) {
        // If this chunk begins a file, the message is in it already.
        self.hand_over();
        let repeated = RepeatedChange { event: *event, message, data: data.to_vec() };
        self.send(QueuedRecord::Repeated(Box::new(repeated)));
    }

    /// Discards the messages with which later files begin.
    pub fn clear_repeated(&mut self) {
        self.hand_over();
        self.send(QueuedRecord::ClearRepeated);
    }

    /// Whether writing has failed.
    pub fn has_failed(&self) -> bool {
        self.failed.load(Ordering::Acquire)
    }

    /// Queues a record; if the queue is full, its messages are dropped and counted.
    fn send(&mut self, record: QueuedRecord) {
        let Some(queue) = &self.queue else { return };
        let messages = match &record {
            QueuedRecord::Chunk(chunk) => chunk.messages,
            _ => 1,
        };
        let is_dropped = match self.waits {
            true => queue.send(record).is_err(),
            false => matches!(queue.try_send(record), Err(TrySendError::Full(_))),
        };
        if is_dropped {
            self.dropped += messages;
        }
    }

    /// Writes the queued messages, closes the file, and ends the thread.
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
    /// Completes a recording that is dropped because of another failure.
    fn drop(&mut self) {
        if self.thread.is_some() {
            self.join();
        }
    }
}

/// Files of a recording, on the writing thread.
struct Files {
    plan: FilePlan,
    preamble: Preamble,
    /// Changes of settings with which the next file begins.
    repeated: Vec<RepeatedChange>,
    /// The present file; `None` after an error.
    file: Option<McapFile>,
    result: RecordingResult,
    failed: Arc<AtomicBool>,
}

impl Files {
    fn run(mut self, records: &Receiver<QueuedRecord>) -> RecordingResult {
        self.result.files.push(self.plan.path.clone());
        for record in records {
            let done = match record {
                QueuedRecord::Chunk(chunk) => self.chunk(&chunk),
                QueuedRecord::Facts(facts) => {
                    let done = self.file.as_mut().map_or(Ok(()), |file| file.facts(&facts));
                    self.preamble.facts.push(facts);
                    done
                }
                QueuedRecord::File(attached) => {
                    let file = self.file.as_mut();
                    let done = file.map_or(Ok(()), |file| file.attachment(&attached));
                    self.preamble.files.push(attached);
                    done
                }
                QueuedRecord::Repeated(change) => {
                    self.repeat(*change);
                    Ok(())
                }
                QueuedRecord::ClearRepeated => {
                    self.repeated.clear();
                    Ok(())
                }
            };
            done.unwrap_or_else(|error| self.fail(&error));
        }
        self.finish_file().unwrap_or_else(|error| self.fail(&error));
        self.result
    }

    fn chunk(&mut self, chunk: &Chunk) -> io::Result<()> {
        let FilePlan { max_bytes, max_ns, .. } = self.plan;
        let Some(file) = &self.file else { return Ok(()) };
        let begin = chunk.extent.map_or(0, |(first, _)| first);
        let is_full = max_bytes.is_some_and(|most| file.size() >= most)
            || max_ns.is_some_and(|most| file.age(begin) >= most);
        if is_full {
            self.begin_another()?;
            self.write(&self.repeated_at(begin))?;
        }
        self.write(chunk)
    }

    fn write(&mut self, chunk: &Chunk) -> io::Result<()> {
        self.file.as_mut().map_or(Ok(()), |file| file.chunk(chunk))?;
        self.result.messages += chunk.messages;
        Ok(())
    }

    /// Adds a change to those repeated, or removes one that the loop has refused. Of the earlier ones, each of which is final by now, those
    /// remain that changed a setting last.
    fn repeat(&mut self, change: RepeatedChange) {
        if change.event.answer == Answer::Refused.code() {
            self.repeated.retain(|earlier| earlier.event.number != change.event.number);
            return;
        }
        let mut changed_later = HashSet::new();
        self.repeated.reverse();
        self.repeated.retain(|earlier| {
            let new =
                changed_keys(&earlier.event).filter(|key| changed_later.insert((*key).to_owned()));
            new.count() > 0
        });
        self.repeated.reverse();
        self.repeated.push(change);
    }

    /// The repeated messages, with the time of reception `log_time` \[ns since the epoch\].
    fn repeated_at(&self, log_time: u64) -> Chunk {
        let mut chunk = Chunk::default();
        for RepeatedChange { message, data, .. } in &self.repeated {
            chunk.push(McapMessage { log_time, ..*message }, data);
        }
        chunk
    }

    fn finish_file(&mut self) -> io::Result<()> {
        let Some(file) = self.file.take() else { return Ok(()) };
        let handle = file.handle();
        let finished = file.finish();
        if let Ok(handle) = handle {
            self.note(&handle);
        }
        finished
    }

    /// Records size and path of the latest file, open as `file`.
    fn note(&mut self, file: &File) {
        let (Ok(found), Some(path)) = (file.metadata(), self.result.files.last_mut()) else {
            return;
        };
        self.result.bytes += found.len();
        let is_same = |other: Metadata| (other.dev(), other.ino()) == (found.dev(), found.ino());
        if fs::metadata(&path).is_ok_and(is_same) {
            return;
        }
        if found.nlink() == 0 {
            self.result.removed.push(path.clone());
        } else if let Ok(present) = fs::read_link(format!("/proc/self/fd/{}", file.as_raw_fd()))
            && fs::metadata(&present).is_ok_and(is_same)
        {
            *path = present;
        }
    }

    fn begin_another(&mut self) -> io::Result<()> {
        self.finish_file()?;
        let mut number = self.result.files.len() + 1;
        loop {
            let path = numbered(&self.plan.path, number);
            match McapFile::create(&path, &self.preamble) {
                // A file of another recording is kept; this recording takes the next number.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
                created => {
                    self.file = Some(created?);
                    self.result.files.push(path);
                    return Ok(());
                }
            }
        }
    }

    /// Ends the recording after an error; the chunks written so far remain readable.
    fn fail(&mut self, error: &io::Error) {
        if let Some(Ok(handle)) = self.file.take().map(|file| file.handle()) {
            self.note(&handle);
        }
        let path = self.result.files.last().unwrap_or(&self.plan.path).display();
        let message = format!("{path}: {error}; the recording ends here");
        self.failed.store(true, Ordering::Release);
        (self.plan.complain)(&message);
        self.result.failure = Some(message);
    }
}

/// The path of the file with this number: `flight.mcap`, `flight.2.mcap`, …
fn numbered(path: &Path, number: usize) -> PathBuf {
    path.with_extension(format!("{number}.mcap"))
}
