//! Six cameras as what comes out of them: a pose with noise, late, sometimes missing, sometimes wrong.

use std::collections::VecDeque;

use nalgebra::Vector3;
use oqtal_bus::message::{PoseV1, Stamps, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Mocap;
use oqtal_control::quaternion::Attitude;
use oqtal_runtime::random::{Generator, Source, normal3, stream};
use rand::RngExt;
use rand_distr::{Distribution, Geometric};

use oqtal_runtime::pose_source::Delivery;

/// Random words set aside for each frame, so that a frame's noise does not depend on what befell the frames before.
const WORDS_PER_FRAME: u128 = 256;

/// The cameras between capture and delivery. Pure: time comes in with the truth and as an argument.
#[derive(Clone, Debug)]
pub struct Cameras {
    mocap: Mocap,
    generator: Generator,
    in_flight: VecDeque<(Time, Delivery)>,
    /// Frames of the present gap still to drop.
    gap: u64,
}

impl Cameras {
    /// The cameras of a configuration.
    #[must_use]
    pub fn new(mocap: &Mocap, seed: u64) -> Self {
        Self {
            mocap: mocap.clone(),
            generator: stream(seed, Source::Cameras),
            in_flight: VecDeque::with_capacity(64),
            gap: 0,
        }
    }

    /// Takes the frame of a truth sample; its pose is on the way, unless the frame is lost.
    pub fn capture(&mut self, truth: &TruthV1) {
        self.generator.set_word_pos(u128::from(truth.capture) * WORDS_PER_FRAME);
        let pose = self.measure(truth);
        let jitter: f64 = self.generator.random();
        let latency_ms = self.mocap.latency_ms + jitter * self.mocap.jitter_ms;
        if self.loses_frame() {
            return;
        }
        // Frames travel on one connection: none overtakes another, so that a late one makes a burst.
        let arrival = self.polled(truth.time + Span::from_seconds(latency_ms * 1e-3));
        let deliver_at =
            self.in_flight.back().map_or(arrival, |(previous, _)| arrival.max(*previous));
        let stamps = Stamps { captured_at: truth.time, ..Stamps::default() };
        self.in_flight.push_back((deliver_at, Delivery { frame: truth.capture, stamps, pose }));
    }

    /// When the next pose arrives.
    #[must_use]
    pub fn next_event(&self) -> Option<Time> {
        self.in_flight.front().map(|(deliver_at, _)| *deliver_at)
    }

    /// The pose that has arrived by `now`, one a call.
    pub fn deliver(&mut self, now: Time) -> Option<Delivery> {
        let (deliver_at, _) = self.in_flight.front()?;
        if *deliver_at > now {
            return None;
        }
        self.in_flight.pop_front().map(|(_, delivery)| delivery)
    }

    /// The instant at which the receiver next looks.
    fn polled(&self, arrival: Time) -> Time {
        let period = Span::from_seconds(self.mocap.poll_ms * 1e-3).nanos().unsigned_abs();
        if period == 0 {
            return arrival;
        }
        Time::from_nanos(arrival.nanos().div_ceil(period) * period)
    }

    fn measure(&mut self, truth: &TruthV1) -> PoseV1 {
        let mocap = &self.mocap;
        let generator = &mut self.generator;
        let position_noise = normal3(generator) * (mocap.position_noise_mm * 1e-3);
        let attitude_noise = normal3(generator) * mocap.attitude_noise_deg.to_radians();
        let mut position = Vector3::from(truth.position) + position_noise;
        let wrong: f64 = generator.random();
        let direction = normal3(generator);
        if wrong < mocap.outlier_probability && direction.norm() > 0.0 {
            position += direction.normalize() * mocap.outlier_m;
        }
        let position = position.map(|x| quantised(x, mocap.position_quantum_mm * 1e-3));
        let attitude = Attitude::from_xyzw(truth.attitude).map(|attitude| {
            let rotation = Attitude::LEVEL.rotation_to(&attitude.turned_by(attitude_noise));
            let step = mocap.attitude_quantum_deg.to_radians();
            Attitude::from_rotation_vector(rotation.map(|angle| quantised(angle, step)))
        });
        PoseV1 {
            position: position.into(),
            attitude: attitude.map_or([f64::NAN; 4], |attitude| attitude.xyzw()),
            tracked: u8::from(attitude.is_some()),
        }
    }

    /// Whether this frame is part of a gap; gaps begin by chance and have a geometric length.
    fn loses_frame(&mut self) -> bool {
        let begins: f64 = self.generator.random();
        if self.gap == 0 && begins < self.mocap.dropout_probability {
            let further = Geometric::new(1.0 / self.mocap.dropout_frames)
                .map_or(0, |length| length.sample(&mut self.generator));
            self.gap = 1 + further;
        }
        let lost = self.gap > 0;
        self.gap = self.gap.saturating_sub(1);
        lost
    }
}

/// `value` to the nearest multiple of `step`; exact where `step` is zero.
fn quantised(value: f64, step: f64) -> f64 {
    if step > 0.0 { (value / step).round() * step } else { value }
}
