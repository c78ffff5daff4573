//! The background thread of the receiver: writes the log, reads definitions of bodies, reconnects to a lost server.

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::background::BackgroundWorker;
use oqtal_runtime::handoff::{BackgroundHandle, RtHandle};
use oqtal_runtime::health::Health;

use crate::attempt::{CameraConnection, ConnectError};
use crate::connect::connect;
use crate::definitions::BodyDefinitions;
use crate::note::ReceiverNote;
use crate::stream::CameraStream;
use oqtal_wire::link::CameraLink;

/// Pause before a lost server is first tried again.
const SHORTEST_PAUSE: Span = Span::from_millis(100);
/// Longest pause between two tries.
const LONGEST_PAUSE: Span = Span::from_millis(2000);
/// Duration of a good connection: after one, the next search begins with the shortest pause.
const GOOD_TIME: Span = Span::from_millis(5000);

/// Messages between the threads, in either direction. Definitions sent before a stream do not belong to it.
#[derive(Debug)]
pub enum StreamPart {
    /// A stream: one that was lost, or one that was opened.
    Stream(Box<dyn CameraStream>),
    /// Definitions of bodies: as received, or as read.
    Definitions(Box<BodyDefinitions>),
}

/// The real-time thread's end of the hand-off.
pub type ReceiverHandle = RtHandle<ReceiverNote, StreamPart, StreamPart>;
/// The background thread's end.
pub type ConnectorHandle = BackgroundHandle<ReceiverNote, StreamPart, StreamPart>;

/// Worker of the background thread.
#[derive(Debug)]
pub struct Connector {
    handle: ConnectorHandle,
    link: CameraLink,
    names: Vec<String>,
    health: Health,
    search: ServerSearch,
}

impl Connector {
    /// Worker that connects to `link` again whenever it is lost.
    pub fn new(handle: ConnectorHandle, link: CameraLink, health: Health) -> Self {
        let names = link.bodies.iter().map(|body| body.name.clone()).collect();
        Self { handle, link, names, health, search: ServerSearch::default() }
    }
}

impl Connector {
    /// Reads definitions and sends them back.
    fn read(&self, mut definitions: Box<BodyDefinitions>) {
        if !definitions.is_unread() {
            // Returned by the real-time thread: their stream is closed.
            return;
        }
        if let Err(reason) = definitions.read() {
            tracing::warn!(
                "the server's list of bodies cannot be read: {reason}; the bodies stay what they were"
            );
        }
        // The queue has room: there are one stream and its definitions.
        let _ = self.handle.send(StreamPart::Definitions(definitions));
    }
}

impl BackgroundWorker for Connector {
    fn poll(&mut self) {
        for note in self.handle.notes() {
            note.log(&self.names);
        }
        while let Ok(part) = self.handle.replies().try_recv() {
            match part {
                StreamPart::Stream(lost) => {
                    drop(lost);
                    self.health.set_status("looking for the camera system");
                    self.search.begin(Time::now());
                }
                StreamPart::Definitions(definitions) => self.read(definitions),
            }
        }
        let Self { search, link, .. } = self;
        if let Some(connection) = search.poll(Time::now(), || connect(link)) {
            tracing::info!("{}: connected again", connection.server);
            self.health.set_status("");
            // The queue has room: there is one stream.
            let _ = self.handle.send(StreamPart::Stream(connection.stream));
        }
    }
}

/// Search for a lost server.
#[derive(Clone, Debug, Default)]
struct ServerSearch {
    /// Instant of the next try; `None` while connected.
    next: Option<Time>,
    pause: Span,
    found_at: Time,
    last_reason: String,
}

impl ServerSearch {
    /// Begins to search. The pause grows over connections that are lost at once.
    fn begin(&mut self, now: Time) {
        let good = !self.found_at.is_set() || now.since(self.found_at) >= GOOD_TIME;
        self.pause = if good { SHORTEST_PAUSE } else { self.grown() };
        self.next = Some(now + self.pause);
    }

    /// Tries to connect if a try is due. A reason for a failure is logged once.
    fn poll(
        &mut self,
        now: Time,
        open: impl FnOnce() -> Result<CameraConnection, ConnectError>,
    ) -> Option<CameraConnection> {
        if self.next.is_none_or(|next| now < next) {
            return None;
        }
        match open() {
            Ok(connection) => {
                self.next = None;
                self.found_at = now;
                self.last_reason.clear();
                Some(connection)
            }
            Err(error) => {
                let reason = error.to_string();
                if reason != self.last_reason {
                    tracing::warn!("{reason}");
                    self.last_reason = reason;
                }
                self.pause = self.grown();
                self.next = Some(now + self.pause);
                None
            }
        }
    }

    fn grown(&self) -> Span {
        self.pause.max(SHORTEST_PAUSE).scaled(2.0).min(LONGEST_PAUSE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lost_server_is_tried_with_growing_pauses_of_two_seconds_at_most() {
        let mut search = ServerSearch::default();
        let mut now = Time::VIRTUAL_START;
        let mut pauses = Vec::new();
        search.begin(now);
        for _ in 0..7 {
            let next = search.next.unwrap();
            pauses.push(next.since(now).nanos() / 1_000_000);
            now = next;
            let missing = || Err(ConnectError::Idle { address: "none".to_owned() });
            assert!(search.poll(now, missing).is_none());
        }
        assert_eq!(pauses, [100, 200, 400, 800, 1600, 2000, 2000]);
    }

    #[test]
    fn a_server_that_closes_at_once_is_retried_after_a_growing_pause() {
        let now = Time::VIRTUAL_START;
        let mut search =
            ServerSearch { found_at: now, pause: SHORTEST_PAUSE, ..Default::default() };
        search.begin(now + Span::from_millis(10));
        assert_eq!(search.pause, Span::from_millis(200));
        search.found_at = now;
        search.begin(now + GOOD_TIME);
        assert_eq!(search.pause, SHORTEST_PAUSE);
    }
}
