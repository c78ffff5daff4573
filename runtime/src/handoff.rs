//! Hand-off between the real-time thread of a process and its background thread: bounded queues that drop and count instead of
//! blocking.

use crossbeam_channel::{Receiver, Sender, bounded};

/// Capacity of every queue \[entries\].
const CAPACITY: usize = 64;

/// The real-time thread's side. No call blocks or allocates.
#[derive(Debug)]
pub struct RtHandle<Note, Request, Reply> {
    notes: Sender<Note>,
    requests: Receiver<Request>,
    replies: Sender<Reply>,
    dropped_notes: u64,
}

/// The background thread's side.
#[derive(Debug)]
pub struct BackgroundHandle<Note, Request, Reply> {
    notes: Receiver<Note>,
    requests: Sender<Request>,
    replies: Receiver<Reply>,
}

/// Both sides: notes and replies go to the background thread, requests come from it.
pub fn handoff<Note, Request, Reply>()
-> (RtHandle<Note, Request, Reply>, BackgroundHandle<Note, Request, Reply>) {
    let (notes, notes_out) = bounded(CAPACITY);
    let (requests_in, requests) = bounded(CAPACITY);
    let (replies, replies_out) = bounded(CAPACITY);
    (
        RtHandle { notes, requests, replies, dropped_notes: 0 },
        BackgroundHandle { notes: notes_out, requests: requests_in, replies: replies_out },
    )
}

impl<Note, Request, Reply> RtHandle<Note, Request, Reply> {
    /// Passes a note to the log. If the queue is full, the note is dropped and counted.
    pub fn note(&mut self, note: Note) {
        if self.notes.try_send(note).is_err() {
            self.dropped_notes += 1;
        }
    }

    /// Number of notes dropped so far.
    pub fn dropped_notes(&self) -> u64 {
        self.dropped_notes
    }

    /// Next request of the background thread; `None` if none is waiting.
    pub fn request(&self) -> Option<Request> {
        self.requests.try_recv().ok()
    }

    /// Sends a reply, or drops it if the queue is full: the requester has stopped waiting by then.
    pub fn reply(&self, reply: Reply) {
        let _ = self.replies.try_send(reply);
    }
}

impl<Note, Request, Reply> BackgroundHandle<Note, Request, Reply> {
    /// The notes that have arrived.
    pub fn notes(&self) -> impl Iterator<Item = Note> {
        self.notes.try_iter()
    }

    /// Sends a request to the real-time thread; returns it if the queue is full.
    ///
    /// # Errors
    /// The queue is full: the real-time thread is not running.
    pub fn send(&self, request: Request) -> Result<(), Request> {
        self.requests.try_send(request).map_err(crossbeam_channel::TrySendError::into_inner)
    }

    /// Whether a request would find the queue full.
    pub fn is_full(&self) -> bool {
        self.requests.is_full()
    }

    /// Replies of the real-time thread, for waiting.
    pub fn replies(&self) -> &Receiver<Reply> {
        &self.replies
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_that_find_the_queue_full_are_counted_and_older_ones_kept() {
        let (mut rt, background) = handoff::<usize, (), ()>();
        for note in 0..CAPACITY + 3 {
            rt.note(note);
        }
        assert_eq!(rt.dropped_notes(), 3);
        assert_eq!(background.notes().collect::<Vec<_>>(), (0..CAPACITY).collect::<Vec<_>>());
    }

    #[test]
    fn a_request_that_finds_the_queue_full_is_returned() {
        let (rt, background) = handoff::<(), usize, ()>();
        for request in 0..CAPACITY {
            assert_eq!(background.send(request), Ok(()));
        }
        assert_eq!(background.send(CAPACITY), Err(CAPACITY));
        assert_eq!(rt.request(), Some(0));
        assert_eq!(background.send(CAPACITY), Ok(()));
    }
}
