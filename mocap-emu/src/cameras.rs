//! Emulated cameras, from the true state to the delivery of a pose: a model of the measurement, of the transit, and of the
//! stamp.

use std::collections::VecDeque;

use oqtal_bus::message::{PoseV1, Stamps, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{CaptureStamp, MocapModel, MocapOptions};
use oqtal_runtime::pose_source::Delivery;
use oqtal_runtime::random::{Generator, RandomSource, stream};
use rand::RngExt;

use crate::markers::MarkerCameras;
use crate::pose_noise;
use crate::room::{Room, RoomFrame, WORDS_PER_FRAME};
use crate::transit::{FrameSender, Transit};

/// Emulated cameras, from the capture of a frame to the delivery of its pose. Pure: time is an argument.
#[derive(Clone, Debug)]
pub struct Cameras {
    mocap: MocapOptions,
    generator: Generator,
    room: Room,
    /// Marker model, used if `mocap.model = "markers"`.
    markers: Option<MarkerCameras>,
    sender: FrameSender,
    transit: Transit,
    in_flight: VecDeque<(Time, Delivery)>,
    /// Instant of the first frame.
    began: Option<Time>,
}

impl Cameras {
    /// The cameras of a configuration.
    pub fn new(mocap: &MocapOptions, seed: u64) -> Self {
        let transit = Transit::new(mocap);
        Self {
            generator: stream(seed, RandomSource::Cameras),
            room: Room::new(mocap, seed),
            markers: (mocap.model == MocapModel::Markers).then(|| MarkerCameras::new(mocap, seed)),
            sender: FrameSender::new(mocap),
            in_flight: VecDeque::with_capacity(transit.capacity()),
            transit,
            began: None,
            mocap: mocap.clone(),
        }
    }

    /// Captures a frame of the true state; its pose is queued for delivery unless the frame is not sent or dropped.
    pub fn capture(&mut self, truth: &TruthV1) {
        self.generator.set_word_pos(u128::from(truth.capture) * WORDS_PER_FRAME);
        let room = self.room.draw(truth.capture);
        self.began.get_or_insert(truth.time);
        let pose = self.measure(truth, &room);
        let jitter: f64 = self.generator.random();
        let latency_ms = self.mocap.latency_ms + jitter * self.mocap.jitter_ms;
        let latency = Span::from_seconds(latency_ms * 1e-3);
        let is_lost = self.transit.loses_frame(&mut self.generator);
        self.transit.advance(truth.time, room.stall);
        let Some(sent) = self.sender.send(truth.capture, truth.time, room.sending) else {
            return;
        };
        if is_lost {
            return;
        }
        if let Some(deliver_at) = self.transit.arrival(sent.at, latency, room.spacing) {
            let captured_at = self.stamp(truth.time, deliver_at);
            let stamps = Stamps { captured_at, ..Stamps::default() };
            self.in_flight.push_back((deliver_at, Delivery { frame: sent.number, stamps, pose }));
        }
    }

    /// Arrival of the next pose.
    pub fn next_event(&self) -> Option<Time> {
        self.in_flight.front().map(|(deliver_at, _)| *deliver_at)
    }

    /// The next pose that has arrived by `now`, one per call; `None` if there is none.
    pub fn deliver(&mut self, now: Time) -> Option<Delivery> {
        let (deliver_at, _) = self.in_flight.front()?;
        if *deliver_at > now {
            return None;
        }
        self.in_flight.pop_front().map(|(_, delivery)| delivery)
    }

    fn measure(&mut self, truth: &TruthV1, room: &RoomFrame) -> PoseV1 {
        match &mut self.markers {
            Some(markers) => markers.pose(truth),
            None => pose_noise::measure(&self.mocap, truth, room.noise, &mut self.generator),
        }
    }

    /// Stamp of a pose's capture.
    fn stamp(&self, captured_at: Time, deliver_at: Time) -> Time {
        match self.mocap.stamp {
            CaptureStamp::Exact => captured_at,
            CaptureStamp::Arrival => deliver_at,
            CaptureStamp::Clock => {
                let room = &self.mocap.room;
                let since = captured_at.since(self.began.unwrap_or(captured_at));
                let gained = since.scaled(room.clock_drift_ppm * 1e-6);
                captured_at + gained + Span::from_seconds(room.clock_offset_ms * 1e-3)
            }
        }
    }
}
