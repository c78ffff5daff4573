//! Emulated cameras: the pose of the true state with noise, quantisation, latency, dropouts and outliers.

use std::collections::VecDeque;

use nalgebra::Vector3;
use oqtal_bus::message::{PoseV1, Stamps, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::MocapOptions;
use oqtal_control::quaternion::Attitude;
use oqtal_runtime::random::{Generator, RandomSource, normal3, stream};
use rand::RngExt;
use rand_distr::{Distribution, Geometric};

use crate::body::BODY;
use oqtal_runtime::pose_source::Delivery;

/// Random words reserved for each frame: the noise of a frame does not depend on earlier frames.
const WORDS_PER_FRAME: u128 = 256;

/// Emulated cameras, from the capture of a frame to the delivery of its pose. Pure: time is an argument.
#[derive(Clone, Debug)]
pub struct Cameras {
    mocap: MocapOptions,
    generator: Generator,
    in_flight: VecDeque<(Time, Delivery)>,
    /// Remaining frames of the current dropout.
    gap: u64,
}

impl Cameras {
    /// The cameras of a configuration.
    #[must_use]
    pub fn new(mocap: &MocapOptions, seed: u64) -> Self {
        Self {
            mocap: mocap.clone(),
            generator: stream(seed, RandomSource::Cameras),
            in_flight: VecDeque::with_capacity(64),
            gap: 0,
        }
    }

    /// Captures a frame of the true state; its pose is queued for delivery unless the frame is dropped.
    pub fn capture(&mut self, truth: &TruthV1) {
        self.generator.set_word_pos(u128::from(truth.capture) * WORDS_PER_FRAME);
        let pose = self.measure(truth);
        let jitter: f64 = self.generator.random();
        let latency_ms = self.mocap.latency_ms + jitter * self.mocap.jitter_ms;
        if self.loses_frame() {
            return;
        }
        // Frames share one connection and keep their order; frames behind a late one arrive with it, as a burst.
        let arrival = self.polled(truth.time + Span::from_seconds(latency_ms * 1e-3));
        let deliver_at =
            self.in_flight.back().map_or(arrival, |(previous, _)| arrival.max(*previous));
        let stamps = Stamps { captured_at: truth.time, ..Stamps::default() };
        self.in_flight.push_back((deliver_at, Delivery { frame: truth.capture, stamps, pose }));
    }

    /// Arrival of the next pose.
    #[must_use]
    pub fn next_event(&self) -> Option<Time> {
        self.in_flight.front().map(|(deliver_at, _)| *deliver_at)
    }

    /// The next pose that has arrived by `now`; one per call, `None` when there is none.
    pub fn deliver(&mut self, now: Time) -> Option<Delivery> {
        let (deliver_at, _) = self.in_flight.front()?;
        if *deliver_at > now {
            return None;
        }
        self.in_flight.pop_front().map(|(_, delivery)| delivery)
    }

    /// The first instant of the receiver's polling (`mocap.poll-ms`) not before `arrival`.
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
            // The markers scatter about the fitted body as much as the fit about the truth.
            residual_m: position_noise.norm(),
            body: BODY,
            tracked: u8::from(attitude.is_some()),
            simulated: 1,
        }
    }

    /// Whether this frame is dropped. Dropouts begin at random and have a geometrically distributed length.
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

/// `value` rounded to the nearest multiple of `step`; unchanged if `step` is zero.
fn quantised(value: f64, step: f64) -> f64 {
    if step > 0.0 { (value / step).round() * step } else { value }
}
