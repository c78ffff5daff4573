//! Relay of CRTP packets between a client and the firmware: a queue in each direction, with the disturbances of the radio. Pure.

use std::collections::VecDeque;

use oqtal_bus::time::Time;
use oqtal_runtime::faults::RadioDisturbance;
use oqtal_runtime::random::{Generator, RandomSource, stream};
use oqtal_wire::crazyflie_sitl::MAX_DATAGRAM;
use rand::RngExt;

use crate::wire::LinkDirection;

/// Most packets that wait in one direction \[-\]; further ones are lost, as in the queues of a radio.
const MOST_WAITING: usize = 64;

/// CRTP packet as it is on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Datagram {
    bytes: [u8; MAX_DATAGRAM],
    length: usize,
}

impl Datagram {
    /// The datagram of these bytes; `None` if they are too many.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Option<Self> {
        let mut datagram = Self { bytes: [0; MAX_DATAGRAM], length: bytes.len() };
        datagram.bytes.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(datagram)
    }

    /// Its bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

/// Packets on their way between a client and the firmware.
#[derive(Clone, Debug)]
pub struct CrtpRelay {
    lanes: [VecDeque<(Time, Datagram)>; 2],
    disturbance: RadioDisturbance,
    losses: Generator,
    lost: u64,
}

impl CrtpRelay {
    /// An empty relay, whose losses are drawn by `seed`.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self {
            lanes: [(); 2].map(|()| VecDeque::with_capacity(MOST_WAITING)),
            disturbance: RadioDisturbance::default(),
            losses: stream(seed, RandomSource::RadioFault),
            lost: 0,
        }
    }

    /// Disturbs both directions from now on.
    pub fn disturb(&mut self, disturbance: RadioDisturbance) {
        self.disturbance = disturbance;
    }

    /// Takes a packet.
    pub fn push(&mut self, way: LinkDirection, now: Time, packet: Datagram) {
        let probability = self.disturbance.loss_probability;
        let lane = &mut self.lanes[way as usize];
        if lane.len() >= MOST_WAITING
            || (probability > 0.0 && self.losses.random::<f64>() < probability)
        {
            self.lost += 1;
            return;
        }
        // Packets keep their order, also behind one that a fault delays.
        let due = now + self.disturbance.delay;
        let due = lane.back().map_or(due, |(last, _)| due.max(*last));
        lane.push_back((due, packet));
    }

    /// The next packet in this direction that has arrived by `now`.
    pub fn pop(&mut self, way: LinkDirection, now: Time) -> Option<Datagram> {
        let lane = &mut self.lanes[way as usize];
        let (due, packet) = *lane.front()?;
        (due <= now).then(|| {
            lane.pop_front();
            packet
        })
    }

    /// Packets that were lost \[-\].
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::time::Span;

    const UP: LinkDirection = LinkDirection::Up;

    fn packet(byte: u8) -> Datagram {
        Datagram::new(&[byte]).unwrap()
    }

    #[test]
    fn packets_keep_their_order_and_a_full_queue_loses_the_newest() {
        let (mut relay, now) = (CrtpRelay::new(7), Time::VIRTUAL_START);
        (0..70).for_each(|byte| relay.push(UP, now, packet(byte)));
        let passed: Vec<u8> =
            std::iter::from_fn(|| relay.pop(UP, now)).map(|packet| packet.as_bytes()[0]).collect();
        assert_eq!(passed, (0..64).collect::<Vec<u8>>());
        assert_eq!((relay.lost(), relay.pop(LinkDirection::Down, now)), (6, None));
    }

    #[test]
    fn a_disturbed_radio_delays_and_loses_and_never_overtakes() {
        let (mut relay, now) = (CrtpRelay::new(7), Time::VIRTUAL_START);
        let delay = Span::from_millis(30);
        relay.disturb(RadioDisturbance { delay, ..RadioDisturbance::default() });
        relay.push(UP, now, packet(1));
        relay.disturb(RadioDisturbance::default());
        relay.push(UP, now, packet(2));
        assert_eq!(relay.pop(UP, now + Span::from_millis(29)), None);
        assert_eq!(relay.pop(UP, now + delay), Some(packet(1)));
        assert_eq!(relay.pop(UP, now + delay), Some(packet(2)));
        relay.disturb(RadioDisturbance { loss_probability: 1.0, ..RadioDisturbance::default() });
        relay.push(UP, now, packet(3));
        assert_eq!((relay.pop(UP, now + delay), relay.lost()), (None, 1));
    }

    #[test]
    fn a_datagram_holds_as_many_bytes_as_a_packet_has() {
        assert!(Datagram::new(&[0; MAX_DATAGRAM]).is_some());
        assert!(Datagram::new(&[0; MAX_DATAGRAM + 1]).is_none());
    }
}
