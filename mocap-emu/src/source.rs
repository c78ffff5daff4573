//! Pose sources of this process over their ports: emulated cameras, and playback of a recording.

use oqtal_bus::error::BusError;
use oqtal_bus::message::{CommandV1, TruthV1};
use oqtal_bus::time::Time;
use oqtal_bus::topic::{COMMAND, TRUTH};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_runtime::health::Health;
use oqtal_runtime::pose_source::{Delivery, PoseSource};

use crate::cameras::Cameras;
use crate::recording::Recording;
use crate::replay::Replay;

/// Emulated cameras that observe the truth of the plant.
#[derive(Debug)]
pub struct EmulatedCameras<T: Transport> {
    truths: T::Reader<TruthV1>,
    cameras: Cameras,
    health: Health,
}

impl<T: Transport> EmulatedCameras<T> {
    /// Opens the reader of the truth.
    ///
    /// # Errors
    /// The transport failed.
    pub fn open(bus: &T, cameras: Cameras) -> Result<Self, BusError> {
        // The truth is published every millisecond: no camera instant may be pushed out of the buffer.
        Ok(Self { truths: bus.observer(&TRUTH)?, cameras, health: Health::default() })
    }

    /// Counts the inputs in `health`.
    pub fn counted_in(self, health: Health) -> Self {
        Self { health, ..self }
    }
}

impl<T: Transport> PoseSource for EmulatedCameras<T> {
    fn next_event(&self) -> Option<Time> {
        self.cameras.next_event()
    }

    fn gather(&mut self, _now: Time) -> Result<(), BusError> {
        let Self { truths, cameras, health } = self;
        truths.drain(|_, _, truth| {
            if is_frame(truth) {
                health.count_input();
                cameras.capture(truth);
            }
        })
    }

    fn deliver(&mut self, now: Time) -> Option<Delivery> {
        self.cameras.deliver(now)
    }
}

/// Whether the cameras expose at this sample of the truth.
pub fn is_frame(truth: &TruthV1) -> bool {
    truth.capture > 0
}

/// Instant at which a recording starts to play.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// At this instant.
    At(Time),
    /// At the first command, which shows that a daemon is running.
    FirstCommand,
}

/// A recording that is played.
#[derive(Debug)]
pub struct Playback<T: Transport> {
    commands: T::Reader<CommandV1>,
    replay: Replay,
    /// Whether the playback starts with the first command, which has not come yet.
    is_waiting: bool,
}

impl<T: Transport> Playback<T> {
    /// Opens the reader of commands; `recording` plays from `start` on.
    ///
    /// # Errors
    /// The transport failed.
    pub fn open(bus: &T, recording: Recording, start: Start) -> Result<Self, BusError> {
        // The recording is prepared before the first command, because that takes time.
        let (begin, is_waiting) = match start {
            Start::At(begin) => (begin, false),
            Start::FirstCommand => (Time::UNSET, true),
        };
        let commands = bus.reader(&COMMAND)?;
        Ok(Self { commands, replay: Replay::new(recording, begin), is_waiting })
    }
}

impl<T: Transport> PoseSource for Playback<T> {
    fn next_event(&self) -> Option<Time> {
        if self.is_waiting { None } else { self.replay.next_event() }
    }

    fn gather(&mut self, now: Time) -> Result<(), BusError> {
        if self.is_waiting && self.commands.latest()?.is_some() {
            self.is_waiting = false;
            self.replay.restart(now);
        }
        Ok(())
    }

    fn deliver(&mut self, now: Time) -> Option<Delivery> {
        if self.is_waiting {
            return None;
        }
        let delivery = self.replay.deliver(now)?;
        if self.next_event().is_none() {
            // Written by the loop: it delays the last pose alone.
            tracing::info!("the recording has ended: no further poses");
        }
        Some(delivery)
    }
}
