//! Sources of the poses of topic `pose`: emulated cameras, a recording, a receiver of a real camera system.

use oqtal_bus::error::BusError;
use oqtal_bus::message::{PoseV1, Stamps};
use oqtal_bus::time::Time;
use oqtal_bus::topic::POSE;
use oqtal_bus::transport::{Publish, Transport};

use crate::turn::{Turn, TurnClock};

/// Pose in transit to the daemon.
#[derive(Clone, Copy, Debug)]
pub struct Delivery {
    /// Number of the camera frame, from 1 \[-\]; a gap is a lost frame.
    pub frame: u64,
    /// Only `captured_at` is set: the instant of capture on the clock of this machine.
    pub stamps: Stamps,
    /// The measured pose.
    pub pose: PoseV1,
}

impl Delivery {
    /// The stamps with the instant of publication.
    pub fn stamps_at(&self, now: Time) -> Stamps {
        Stamps { pose_published_at: now, ..self.stamps }
    }
}

/// A source of poses. Several poses of one camera frame are several deliveries of the same frame number.
pub trait PoseSource {
    /// Instant at which the next pose is due; `None` if a pose can only follow an arrival.
    fn next_event(&self) -> Option<Time>;

    /// Takes the inputs that have arrived from the cameras, the plant or the network.
    ///
    /// # Errors
    /// The transport failed.
    fn gather(&mut self, now: Time) -> Result<(), BusError>;

    /// The next pose that is due at `now`, one per call; `None` if there is none.
    fn deliver(&mut self, now: Time) -> Option<Delivery>;
}

/// The turn of a process that publishes the poses of `S`.
#[derive(Debug)]
pub struct PoseTurn<T: Transport, S> {
    source: S,
    poses: T::Writer<PoseV1>,
}

impl<T: Transport, S: PoseSource> PoseTurn<T, S> {
    /// Opens the writer of topic `pose`.
    ///
    /// # Errors
    /// Another process publishes poses on this instance, or the transport failed.
    pub fn open(bus: &T, source: S) -> Result<Self, BusError> {
        Ok(Self { source, poses: bus.writer(&POSE)? })
    }
}

impl<T: Transport, S: PoseSource> Turn for PoseTurn<T, S> {
    fn next_event(&self, _now: Time) -> Option<Time> {
        self.source.next_event()
    }

    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        let now = clock.now();
        self.source.gather(now)?;
        while let Some(delivery) = self.source.deliver(now) {
            self.poses.send(delivery.frame, delivery.stamps_at(clock.now()), delivery.pose)?;
            clock.announce(&self.poses)?;
        }
        Ok(())
    }
}
