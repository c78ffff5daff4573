//! Model of a network between host and vehicle: datagrams arrive late, out of order, or not at all. Pure and seeded.

use std::collections::VecDeque;

use oqtal_bus::time::{Span, Time};
use oqtal_config::PlantWireOptions;
use oqtal_runtime::faults::RadioDisturbance;
use oqtal_runtime::random::{Generator, RandomSource, stream};
use rand::RngExt;

use super::radio::{LinkDirection, Traffic};

/// Most datagrams under way in one direction \[-\]; more are lost, as in a full queue.
const QUEUE: usize = 256;

/// Model of the network.
#[derive(Debug)]
pub struct DatagramModel {
    latency: Span,
    jitter: Span,
    loss_probability: f64,
    disturbance: RadioDisturbance,
    up: DatagramLane,
    down: DatagramLane,
}

/// One direction.
#[derive(Debug)]
struct DatagramLane {
    under_way: VecDeque<(Time, Vec<u8>)>,
    losses: Generator,
    jitters: Generator,
    traffic: Traffic,
}

impl DatagramModel {
    /// Network of `options`.
    #[must_use]
    pub fn new(options: &PlantWireOptions, seed: u64) -> Self {
        let lane = |losses, jitters| DatagramLane {
            under_way: VecDeque::with_capacity(QUEUE),
            losses: stream(seed, losses),
            jitters: stream(seed, jitters),
            traffic: Traffic::default(),
        };
        Self {
            latency: Span::from_seconds(options.latency_ms * 1e-3),
            jitter: Span::from_seconds(options.jitter_ms * 1e-3),
            loss_probability: options.loss_probability,
            disturbance: RadioDisturbance { delay: Span::ZERO, loss_probability: 0.0 },
            up: lane(RandomSource::UplinkLoss, RandomSource::UplinkErrors),
            down: lane(RandomSource::DownlinkLoss, RandomSource::DownlinkErrors),
        }
    }

    /// Disturbs both directions from now on: a longer latency, further losses.
    pub fn disturb(&mut self, disturbance: RadioDisturbance) {
        self.disturbance = disturbance;
    }

    /// Takes a datagram.
    pub fn send(&mut self, direction: LinkDirection, now: Time, bytes: &[u8]) {
        let lost = [self.loss_probability, self.disturbance.loss_probability];
        let latency = self.latency + self.disturbance.delay;
        let jitter = self.jitter;
        let lane = self.lane_mut(direction);
        let is_lost = lost.into_iter().any(|share| lane.losses.random_bool(share.clamp(0.0, 1.0)));
        let at = now + latency + jitter.scaled(lane.jitters.random());
        lane.traffic.frames += 1;
        lane.traffic.bytes += bytes.len() as u64;
        if is_lost || lane.under_way.len() >= QUEUE {
            lane.traffic.lost += 1;
            return;
        }
        let behind = lane.under_way.partition_point(|(arrival, _)| *arrival <= at);
        lane.under_way.insert(behind, (at, bytes.to_vec()));
    }

    /// The next datagram that has arrived by `now`.
    pub fn receive(&mut self, direction: LinkDirection, now: Time) -> Option<Vec<u8>> {
        let lane = self.lane_mut(direction);
        let arrived = lane.under_way.front().is_some_and(|(at, _)| *at <= now);
        if arrived { lane.under_way.pop_front().map(|(_, bytes)| bytes) } else { None }
    }

    /// Instant at which the next datagram in this direction arrives.
    #[must_use]
    pub fn next_arrival(&self, direction: LinkDirection) -> Option<Time> {
        self.lane(direction).under_way.front().map(|(at, _)| *at)
    }

    /// Traffic in this direction since the start.
    #[must_use]
    pub fn traffic(&self, direction: LinkDirection) -> Traffic {
        self.lane(direction).traffic
    }

    fn lane(&self, direction: LinkDirection) -> &DatagramLane {
        match direction {
            LinkDirection::Up => &self.up,
            LinkDirection::Down => &self.down,
        }
    }

    fn lane_mut(&mut self, direction: LinkDirection) -> &mut DatagramLane {
        match direction {
            LinkDirection::Up => &mut self.up,
            LinkDirection::Down => &mut self.down,
        }
    }
}
