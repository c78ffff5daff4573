//! The background thread of the bridge: writes the log, closes a lost port and opens it again.

use std::sync::Arc;

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::background::BackgroundWorker;
use oqtal_runtime::handoff::{BackgroundHandle, RtHandle};
use oqtal_runtime::reopener::Reopener;
use oqtal_wire::link::LinkSpec;

use crate::crtp::TableKeeper;
use crate::lender::PortLender;
use crate::link::{PortOptions, VehicleLink};
use crate::note::Note;
use crate::tenant::PortPart;

/// The real-time thread's end of the hand-off: notes and lost parts go to the background thread, opened ones come from it.
pub type BridgeHandle = RtHandle<Note, PortPart, PortPart>;

/// Worker of the background thread.
#[derive(Debug)]
pub struct PortKeeper {
    handle: BackgroundHandle<Note, PortPart, PortPart>,
    port: Arc<dyn PortOptions>,
    /// Link to the vehicle, for the log.
    spec: LinkSpec,
    search: Reopener<Box<dyn VehicleLink>>,
    table_keeper: Option<TableKeeper>,
    lender: Option<PortLender>,
}

impl PortKeeper {
    /// Worker that opens `port`, of the link `spec`, again whenever it is lost, keeps the file of tables, and lends the port.
    pub fn new(
        handle: BackgroundHandle<Note, PortPart, PortPart>,
        port: Box<dyn PortOptions>,
        spec: LinkSpec,
        table_keeper: Option<TableKeeper>,
        lender: Option<PortLender>,
    ) -> Self {
        // Every port counts as a good one: the vehicle must soon receive a zero set-point.
        let search = Reopener::new(Span::ZERO);
        Self { handle, port: port.into(), spec, search, table_keeper, lender }
    }
}

impl BackgroundWorker for PortKeeper {
    fn poll(&mut self) {
        self.handle.notes().for_each(|note| note.log(&self.spec));
        self.table_keeper.iter_mut().for_each(TableKeeper::poll);
        match self.handle.replies().try_recv() {
            Ok(PortPart::Link(lost)) => {
                tracing::warn!("the port is lost: zero set-point first when it is back");
                drop(lost);
                self.lender.iter_mut().for_each(PortLender::lose_port);
                self.search.begin(Time::now());
            }
            Ok(_) => self.lender.iter_mut().for_each(PortLender::take_back),
            Err(_) => {}
        }
        if let Some(part) = self.lender.as_mut().and_then(PortLender::poll) {
            // The queue has room: there is one tenant.
            let _ = self.handle.send(part);
        }
        let port = Arc::clone(&self.port);
        if let Some(link) = self.search.poll(Time::now(), move || port.open()) {
            tracing::info!("the port is open again");
            self.lender.iter_mut().for_each(|lender| lender.set_port(&*link));
            // The queue has room: there is one link.
            let _ = self.handle.send(PortPart::Link(link));
        }
    }
}
