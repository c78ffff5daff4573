//! Poses of a process, served at their delivery.

use oqtal_bus::error::BusError;
use oqtal_bus::message::PoseV1;
use oqtal_bus::time::Time;
use oqtal_runtime::pose_source::{Delivery, PoseSource};
use oqtal_runtime::turn::{Turn, TurnClock};
use oqtal_wire::motion::{BodySample, RigidPose};

use super::feed::{FrameFeed, ServedFrame};

/// Pose source whose poses are also served.
#[derive(Debug)]
pub struct ServedPoses<S> {
    source: S,
    feed: FrameFeed,
}

impl<S: PoseSource> ServedPoses<S> {
    /// Serves the poses of `source`, one body a frame.
    pub fn new(source: S, feed: FrameFeed) -> Self {
        Self { source, feed }
    }
}

impl<S: PoseSource> PoseSource for ServedPoses<S> {
    fn next_event(&self) -> Option<Time> {
        self.source.next_event()
    }

    fn gather(&mut self, now: Time) -> Result<(), BusError> {
        self.source.gather(now)
    }

    fn deliver(&mut self, now: Time) -> Option<Delivery> {
        let delivery = self.source.deliver(now)?;
        let mut frame = ServedFrame::new(delivery.frame, delivery.stamps.captured_at);
        frame.push(sample(&delivery.pose));
        self.feed.send(frame);
        Some(delivery)
    }
}

/// Turn of a process that serves poses without publishing them, as the receiver does.
#[derive(Debug)]
pub struct ServeTurn<S>(pub ServedPoses<S>);

impl<S: PoseSource> Turn for ServeTurn<S> {
    fn next_event(&self, _now: Time) -> Option<Time> {
        self.0.next_event()
    }

    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        let now = clock.now();
        self.0.gather(now)?;
        while self.0.deliver(now).is_some() {}
        Ok(())
    }
}

/// Converts a pose to the types of `oqtal-wire`. The residual of a recording is unknown and is served as zero.
pub(super) fn sample(pose: &PoseV1) -> BodySample {
    let residual_m = if pose.residual_m.is_finite() { pose.residual_m } else { 0.0 };
    let tracked = RigidPose::new(pose.position, pose.attitude).filter(|_| pose.tracked != 0);
    BodySample { pose: tracked, residual_m }
}
