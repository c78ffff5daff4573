//! Network thread: waits for sockets and frames, and serves both.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use oqtal_bus::time::Time;
use oqtal_runtime::stop::StopFlag;
use oqtal_wire::motion::{MarkerSample, MotionFrame};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::feed::{FrameQueue, ServedFrame};
use super::model::BodyModels;
use super::server::{Endpoint, FrameServer};
use super::trouble::NetworkTrouble;

/// Longest wait, after which the stop flag is checked.
const WAIT: Timespec = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };

/// Counters of the network thread.
#[derive(Debug, Default)]
pub struct ServeCounters {
    /// Frames handed to the servers \[-\].
    pub frames: AtomicU64,
    /// Number of connected clients: QTM, VRPN, and NatNet by unicast \[-\].
    pub clients: AtomicUsize,
}

/// Servers and their frame queue; runs on a separate thread.
pub struct NetworkThread {
    servers: Vec<Box<dyn FrameServer>>,
    trouble: NetworkTrouble,
    queue: FrameQueue,
    models: BodyModels,
    counters: Arc<ServeCounters>,
    markers: Vec<MarkerSample>,
}

impl NetworkThread {
    pub(super) fn new(
        (servers, trouble): (Vec<Box<dyn FrameServer>>, NetworkTrouble),
        queue: FrameQueue,
        models: BodyModels,
    ) -> Self {
        Self { servers, trouble, queue, models, counters: Arc::default(), markers: Vec::new() }
    }

    /// Endpoints of all servers.
    pub fn endpoints(&self) -> Vec<Endpoint> {
        self.servers.iter().flat_map(|server| server.endpoints()).collect()
    }

    /// Counters, updated while the thread runs.
    pub fn counters(&self) -> Arc<ServeCounters> {
        self.counters.clone()
    }

    /// Serves until a stop is requested. A client's error closes its own connection at most.
    pub fn run(mut self, stop: &StopFlag) {
        let mut clients = 0;
        while !stop.is_set() {
            self.wait();
            let mut count = [0; 8];
            // Resets the counter; an empty counter is not an error.
            let _ = rustix::io::read(&*self.queue.event, &mut count);
            let now = Time::now();
            self.servers.iter_mut().for_each(|server| server.serve(now));
            while let Ok(frame) = self.queue.frames.try_recv() {
                self.forward(frame);
            }
            let connected = self.servers.iter().map(|server| server.clients()).sum();
            if connected != clients {
                clients = connected;
                self.counters.clients.store(clients, Ordering::Relaxed);
                tracing::info!(clients, "clients of the served poses");
            }
        }
        let dropped = self.queue.dropped.load(Ordering::Relaxed);
        if dropped > 0 {
            tracing::warn!(dropped, "frames were not served: the network thread had no time");
        }
    }

    fn wait(&self) {
        let mut sockets = vec![PollFd::new(&*self.queue.event, PollFlags::IN)];
        self.servers.iter().for_each(|server| server.add_sockets(&mut sockets));
        // An interrupted wait is treated as a short one.
        let _ = poll(&mut sockets, Some(&WAIT));
    }

    /// Broadcasts a frame through the emulated network faults.
    fn forward(&mut self, frame: ServedFrame) {
        let Self { trouble, servers, models, markers, counters, .. } = self;
        trouble.forward(frame, &mut |frame| {
            broadcast(frame, servers, (models, &mut *markers));
            counters.frames.fetch_add(1, Ordering::Relaxed);
        });
    }
}

fn broadcast(
    frame: &ServedFrame,
    servers: &mut [Box<dyn FrameServer>],
    (models, markers): (&BodyModels, &mut Vec<MarkerSample>),
) {
    models.markers(frame.bodies(), markers);
    let frame = MotionFrame {
        number: frame.number as u32,
        captured_ns: frame.captured_at.nanos(),
        sent_ns: Time::now().nanos(),
        bodies: frame.bodies(),
        markers,
    };
    servers.iter_mut().for_each(|server| server.broadcast(&frame));
}
