//! Queue of frames from the loop to the network thread: bounded, with a wake-up; neither blocks.

use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crossbeam_channel::{Receiver, Sender};
use oqtal_bus::time::Time;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::motion::BodySample;
use rustix::event::{EventfdFlags, eventfd};

use super::model::MAX_BODIES;

/// Capacity of the queue \[frames\]; further frames are dropped and counted.
const CAPACITY: usize = 256;

/// Frame of fixed size; passing it on does not allocate.
#[derive(Clone, Copy, Debug)]
pub struct ServedFrame {
    /// Number \[-\].
    pub number: u64,
    /// Instant of capture.
    pub captured_at: Time,
    bodies: [BodySample; MAX_BODIES],
    count: usize,
}

impl ServedFrame {
    /// A frame without bodies.
    pub fn new(number: u64, captured_at: Time) -> Self {
        Self { number, captured_at, bodies: [BodySample::LOST; MAX_BODIES], count: 0 }
    }

    /// Adds a body, up to [`MAX_BODIES`].
    pub fn push(&mut self, body: BodySample) {
        if let Some(place) = self.bodies.get_mut(self.count) {
            *place = body;
            self.count += 1;
        }
    }

    /// The bodies.
    pub fn bodies(&self) -> &[BodySample] {
        &self.bodies[..self.count]
    }
}

/// Sending end of the queue, used by the loop.
#[derive(Clone, Debug)]
pub struct FrameFeed {
    frames: Sender<ServedFrame>,
    event: Arc<OwnedFd>,
    dropped: Arc<AtomicU64>,
}

/// Receiving end of the queue, used by the network thread.
#[derive(Debug)]
pub struct FrameQueue {
    /// Frames.
    pub frames: Receiver<ServedFrame>,
    /// Event descriptor; readable when there are frames.
    pub event: Arc<OwnedFd>,
    /// Number of frames dropped because the queue was full \[-\].
    pub dropped: Arc<AtomicU64>,
}

/// A queue of frames.
pub fn frame_queue() -> Result<(FrameFeed, FrameQueue), Failure> {
    let event = eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC).map_err(|error| {
        Failure::new(Exit::System, format!("creating an eventfd failed: {error}"))
    })?;
    let (event, dropped) = (Arc::new(event), Arc::new(AtomicU64::new(0)));
    let (sender, receiver) = crossbeam_channel::bounded(CAPACITY);
    let feed = FrameFeed { frames: sender, event: event.clone(), dropped: dropped.clone() };
    Ok((feed, FrameQueue { frames: receiver, event, dropped }))
}

impl FrameFeed {
    /// Queues a frame, or drops it if the queue is full. Neither blocks nor allocates.
    pub fn send(&self, frame: ServedFrame) {
        if self.frames.try_send(frame).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        // Fails only if the counter is at its maximum; the network thread is then awake.
        let _ = rustix::io::write(&*self.event, &1_u64.to_ne_bytes());
    }
}
