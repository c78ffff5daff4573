//! Model of a link that carries packets whole: each arrives after a latency, in order, or is lost. Pure and seeded.

use std::collections::VecDeque;

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::faults::RadioDisturbance;
use oqtal_runtime::random::Generator;
use rand::RngExt;

/// Most packets on their way \[-\]; further ones are lost.
const MAX_ON_AIR: usize = 256;

/// One direction of the link.
#[derive(Clone, Debug)]
pub struct PacketAir<P> {
    latency: Span,
    jitter: Span,
    loss_probability: f64,
    disturbance: RadioDisturbance,
    generator: Generator,
    on_air: VecDeque<(Time, P)>,
    sent: u64,
    lost: u64,
}

impl<P> PacketAir<P> {
    /// Link of this latency, and of up to `jitter` more for each packet.
    #[must_use]
    pub fn new(latency: Span, jitter: Span, loss_probability: f64, generator: Generator) -> Self {
        Self {
            latency,
            jitter,
            loss_probability,
            disturbance: RadioDisturbance::default(),
            generator,
            on_air: VecDeque::with_capacity(MAX_ON_AIR),
            sent: 0,
            lost: 0,
        }
    }

    /// Disturbs the link from now on: a longer latency, further losses.
    pub fn disturb(&mut self, disturbance: RadioDisturbance) {
        self.disturbance = disturbance;
    }

    /// Takes a packet at `now`.
    pub fn send(&mut self, now: Time, packet: P) {
        self.sent += 1;
        // Two numbers for each packet, whatever becomes of it.
        let (loss, jitter) = (self.generator.random::<f64>(), self.generator.random::<f64>());
        let remains = (1.0 - self.loss_probability) * (1.0 - self.disturbance.loss_probability);
        if loss >= remains || self.on_air.len() >= MAX_ON_AIR {
            self.lost += 1;
            return;
        }
        let delay = self.latency + self.disturbance.delay + self.jitter.scaled(jitter);
        let arrival = self.on_air.back().map_or(now + delay, |(last, _)| (now + delay).max(*last));
        self.on_air.push_back((arrival, packet));
    }

    /// Takes the next packet that has arrived by `now`.
    pub fn receive(&mut self, now: Time) -> Option<P> {
        self.next_arrival().filter(|at| *at <= now)?;
        self.on_air.pop_front().map(|(_, packet)| packet)
    }

    /// Instant at which the next packet arrives.
    #[must_use]
    pub fn next_arrival(&self) -> Option<Time> {
        self.on_air.front().map(|(at, _)| *at)
    }

    /// Number of packets sent, and of those lost \[-\].
    #[must_use]
    pub fn counts(&self) -> (u64, u64) {
        (self.sent, self.lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_runtime::random::{RandomSource, stream};

    #[test]
    fn packets_arrive_late_in_order_and_some_never() {
        let generator = stream(7, RandomSource::UplinkLoss);
        let (latency, jitter) = (Span::from_millis(10), Span::from_millis(5));
        let mut air = PacketAir::new(latency, jitter, 0.1, generator);
        let at = |micros: i64| Time::VIRTUAL_START + Span::from_nanos(1000 * micros);
        (0..1000).for_each(|packet: i64| air.send(at(1000 * packet % 200_000), packet));
        assert_eq!(air.counts().0, 1000);
        let mut last = -1;
        let mut received = 0;
        while let Some(arrival) = air.next_arrival() {
            assert!(air.receive(arrival - Span::from_nanos(1)).is_none());
            let packet = air.receive(arrival).unwrap();
            assert!(packet > last);
            (last, received) = (packet, received + 1);
        }
        assert_eq!(received + air.counts().1, 1000);
        assert!((700..950).contains(&air.counts().1), "more than fit on the air");
    }
}
