//! Model of a network between host and vehicle: datagrams arrive late, out of order, or not at all. Pure and seeded.

use std::collections::VecDeque;

use oqtal_bus::time::{Span, Time};
use oqtal_config::PlantWireOptions;
use oqtal_runtime::faults::RadioDisturbance;
use oqtal_runtime::random::{Generator, RandomSource, stream};
use rand::RngExt;

use super::link::{LinkDirection, LinkModel, Traffic};

/// Maximum number of datagrams in transit in one direction \[-\]; further ones are lost, as in a full queue.
const NETWORK_QUEUE: usize = 256;
/// Maximum number of datagrams in transit in one direction of a relay, as in the queues of a radio \[-\].
const RELAY_QUEUE: usize = 64;

/// Model of the network.
#[derive(Debug)]
pub struct DatagramModel {
    latency: Span,
    jitter: Span,
    loss_probability: f64,
    disturbance: RadioDisturbance,
    /// Maximum number of datagrams in transit in one direction \[-\].
    capacity: usize,
    /// Whether a datagram never overtakes another one.
    keeps_order: bool,
    /// Lanes, indexed by [`LinkDirection`].
    lanes: [DatagramLane; 2],
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
    pub fn new(options: &PlantWireOptions, seed: u64) -> Self {
        Self {
            latency: Span::from_seconds(options.latency_ms * 1e-3),
            jitter: Span::from_seconds(options.jitter_ms * 1e-3),
            loss_probability: options.loss_probability,
            keeps_order: false,
            ..Self::undisturbed(NETWORK_QUEUE, seed)
        }
    }

    /// Relay that adds no latency or losses; datagrams keep their order, also behind a delayed one.
    pub fn relay(seed: u64) -> Self {
        Self::undisturbed(RELAY_QUEUE, seed)
    }

    fn undisturbed(capacity: usize, seed: u64) -> Self {
        let lane = |losses, jitters| DatagramLane {
            under_way: VecDeque::with_capacity(capacity),
            losses: stream(seed, losses),
            jitters: stream(seed, jitters),
            traffic: Traffic::default(),
        };
        Self {
            latency: Span::ZERO,
            jitter: Span::ZERO,
            loss_probability: 0.0,
            disturbance: RadioDisturbance::default(),
            capacity,
            keeps_order: true,
            lanes: [
                lane(RandomSource::UplinkLoss, RandomSource::UplinkErrors),
                lane(RandomSource::DownlinkLoss, RandomSource::DownlinkErrors),
            ],
        }
    }
}

impl LinkModel for DatagramModel {
    fn disturb(&mut self, disturbance: RadioDisturbance) {
        self.disturbance = disturbance;
    }

    fn send(&mut self, direction: LinkDirection, now: Time, bytes: &[u8]) {
        let lane = &mut self.lanes[direction as usize];
        let lost = [self.loss_probability, self.disturbance.loss_probability];
        let is_lost = lost.into_iter().any(|share| lane.losses.random_bool(share.clamp(0.0, 1.0)));
        let latency = self.latency + self.disturbance.delay;
        let arrival = now + latency + self.jitter.scaled(lane.jitters.random());
        lane.traffic.frames += 1;
        lane.traffic.bytes += bytes.len() as u64;
        if is_lost || lane.under_way.len() >= self.capacity {
            lane.traffic.lost += 1;
            return;
        }
        let last = lane.under_way.back().filter(|_| self.keeps_order);
        let at = last.map_or(arrival, |(last, _)| arrival.max(*last));
        let behind = lane.under_way.partition_point(|(arrival, _)| *arrival <= at);
        lane.under_way.insert(behind, (at, bytes.to_vec()));
    }

    fn receive(&mut self, direction: LinkDirection, now: Time, out: &mut Vec<u8>) -> bool {
        let lane = &mut self.lanes[direction as usize].under_way;
        let has_arrived = lane.front().is_some_and(|(at, _)| *at <= now);
        let datagram = if has_arrived { lane.pop_front() } else { None };
        out.extend(datagram.into_iter().flat_map(|(_, bytes)| bytes));
        has_arrived
    }

    fn next_arrival(&self, direction: LinkDirection) -> Option<Time> {
        self.lanes[direction as usize].under_way.front().map(|(at, _)| *at)
    }

    fn traffic(&self, direction: LinkDirection) -> Traffic {
        self.lanes[direction as usize].traffic
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UP: LinkDirection = LinkDirection::Up;

    fn next(relay: &mut DatagramModel, now: Time) -> Option<u8> {
        let mut bytes = Vec::new();
        relay.receive(UP, now, &mut bytes).then(|| bytes[0])
    }

    #[test]
    fn packets_of_a_relay_keep_their_order_and_a_full_queue_loses_the_newest() {
        let (mut relay, now) = (DatagramModel::relay(7), Time::VIRTUAL_START);
        (0..70).for_each(|byte| relay.send(UP, now, &[byte]));
        let passed: Vec<u8> = std::iter::from_fn(|| next(&mut relay, now)).collect();
        assert_eq!(passed, (0..64).collect::<Vec<u8>>());
        assert_eq!(relay.traffic(UP).lost, 6);
        assert!(!relay.receive(LinkDirection::Down, now, &mut Vec::new()));
    }

    #[test]
    fn a_disturbed_relay_delays_and_loses_and_never_overtakes() {
        let (mut relay, now) = (DatagramModel::relay(7), Time::VIRTUAL_START);
        let delay = Span::from_millis(30);
        relay.disturb(RadioDisturbance { delay, ..RadioDisturbance::default() });
        relay.send(UP, now, &[1]);
        relay.disturb(RadioDisturbance::default());
        relay.send(UP, now, &[2]);
        assert_eq!(next(&mut relay, now + Span::from_millis(29)), None);
        assert_eq!(next(&mut relay, now + delay), Some(1));
        assert_eq!(next(&mut relay, now + delay), Some(2));
        relay.disturb(RadioDisturbance { loss_probability: 1.0, ..RadioDisturbance::default() });
        relay.send(UP, now, &[3]);
        assert_eq!((next(&mut relay, now + delay), relay.traffic(UP).lost), (None, 1));
    }
}
