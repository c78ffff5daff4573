//! The background thread of the bridge: writes the log, closes a lost port and opens it again.

use std::fmt::Debug;

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::background::BackgroundWorker;
use oqtal_runtime::handoff::{BackgroundHandle, RtHandle};

use crate::lender::PortLender;
use crate::link::{PortOpenError, PortOptions};
use crate::note::Note;
use crate::tenant::PortPart;

/// Pause before a lost port is first tried again.
const SHORTEST_PAUSE: Span = Span::from_millis(100);
/// Longest pause between two tries.
const LONGEST_PAUSE: Span = Span::from_millis(2000);

/// The real-time thread's end of the hand-off: notes and lost parts go to the background thread, opened ones come from it.
pub type BridgeHandle = RtHandle<Note, PortPart, PortPart>;

/// Worker of the background thread.
#[derive(Debug)]
pub struct PortKeeper {
    handle: BackgroundHandle<Note, PortPart, PortPart>,
    port: Box<dyn PortOptions>,
    search: Option<PortSearch>,
    chore: Option<Box<dyn Chore>>,
    lender: Option<PortLender>,
}

/// Further work of the background thread.
pub trait Chore: BackgroundWorker + Debug + Send {}

impl<W: BackgroundWorker + Debug + Send> Chore for W {}

impl PortKeeper {
    /// Worker that opens `port` again whenever it is lost.
    pub fn new(
        handle: BackgroundHandle<Note, PortPart, PortPart>,
        port: Box<dyn PortOptions>,
    ) -> Self {
        Self { handle, port, search: None, chore: None, lender: None }
    }

    /// The worker, which also lends the port.
    pub fn lending(self, lender: Option<PortLender>) -> Self {
        Self { lender, ..self }
    }

    /// The worker, which also does `chore`.
    pub fn beside(self, chore: Option<Box<dyn Chore>>) -> Self {
        Self { chore, ..self }
    }
}

impl BackgroundWorker for PortKeeper {
    fn poll(&mut self) {
        self.handle.notes().for_each(Note::log);
        if let Some(chore) = &mut self.chore {
            chore.poll();
        }
        match self.handle.replies().try_recv() {
            Ok(PortPart::Link(lost)) => {
                tracing::warn!("the port is lost: zero set-point first when it is back");
                drop(lost);
                self.lender.iter_mut().for_each(PortLender::lose_port);
                self.search = Some(PortSearch::new(Time::now()));
            }
            Ok(_) => self.lender.iter_mut().for_each(PortLender::take_back),
            Err(_) => {}
        }
        if let Some(part) = self.lender.as_mut().and_then(PortLender::poll) {
            // The queue has room: there is one tenant.
            let _ = self.handle.send(part);
        }
        let Some(search) = &mut self.search else { return };
        if let Some(link) = search.poll(Time::now(), || self.port.open()) {
            tracing::info!("the port is open again");
            self.search = None;
            self.lender.iter_mut().for_each(|lender| lender.set_port(&*link));
            // The queue has room: there is one link.
            let _ = self.handle.send(PortPart::Link(link));
        }
    }
}

/// Search for a lost port.
#[derive(Clone, Debug)]
struct PortSearch {
    next: Time,
    pause: Span,
    last_reason: String,
}

impl PortSearch {
    fn new(now: Time) -> Self {
        Self { next: now + SHORTEST_PAUSE, pause: SHORTEST_PAUSE, last_reason: String::new() }
    }

    /// Tries to open the port if a try is due. A reason for a failure is logged once.
    fn poll<L>(&mut self, now: Time, open: impl FnOnce() -> Result<L, PortOpenError>) -> Option<L> {
        if now < self.next {
            return None;
        }
        match open() {
            Ok(link) => Some(link),
            Err(error) => {
                let reason = error.to_string();
                if reason != self.last_reason {
                    tracing::warn!("{reason}");
                    self.last_reason = reason;
                }
                self.pause = self.pause.scaled(2.0).min(LONGEST_PAUSE);
                self.next = now + self.pause;
                None
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lost_port_is_tried_with_growing_pauses_of_two_seconds_at_most() {
        let mut now = Time::VIRTUAL_START;
        let mut search = PortSearch::new(now);
        let mut pauses = Vec::new();
        let missing = || Err::<(), _>(PortOpenError::Missing { path: "none".to_owned() });
        for _ in 0..7 {
            pauses.push(search.next.since(now).nanos() / 1_000_000);
            now = search.next;
            assert!(search.poll(now, missing).is_none());
        }
        assert_eq!(pauses, [100, 200, 400, 800, 1600, 2000, 2000]);
        assert!(search.poll(search.next, || Ok(())).is_some());
    }
}
