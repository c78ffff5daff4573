//! The background thread of the receiver: writes the log, reads definitions of bodies, reconnects to a lost server.

use std::sync::Arc;

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::background::BackgroundWorker;
use oqtal_runtime::handoff::{BackgroundHandle, RtHandle};
use oqtal_runtime::health::Health;
use oqtal_runtime::reopener::Reopener;

use crate::attempt::CameraConnection;
use crate::connect::connect;
use crate::definitions::BodyDefinitions;
use crate::note::ReceiverNote;
use crate::stream::CameraStream;
use oqtal_wire::link::CameraLink;

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
    link: Arc<CameraLink>,
    names: Vec<String>,
    health: Health,
    search: Reopener<CameraConnection>,
}

impl Connector {
    /// Worker that connects to `link` again whenever it is lost.
    pub fn new(handle: ConnectorHandle, link: CameraLink, health: Health) -> Self {
        let names = link.bodies.iter().map(|body| body.name.clone()).collect();
        let search = Reopener::new(GOOD_TIME);
        Self { handle, link: Arc::new(link), names, health, search }
    }

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
        let link = Arc::clone(&self.link);
        if let Some(connection) = self.search.poll(Time::now(), move || connect(&link)) {
            tracing::info!("{}: connected again", connection.server);
            self.health.set_status("");
            // The queue has room: there is one stream.
            let _ = self.handle.send(StreamPart::Stream(connection.stream));
        }
    }
}
