//! A camera server with its own clock behind a network with delays, in virtual time.
#![allow(dead_code, reason = "each test uses its part")]

#[path = "../../../tests/common/random.rs"]
mod random;

use oqtal_bus::time::{Span, Time};
pub use random::Random;

/// A server with its own clock behind a network with delays.
pub struct Server {
    pub rate_hz: f64,
    /// Rate of the server's clock minus one.
    drift: f64,
    /// Server clock at the true time zero.
    pub offset_ns: u64,
    jitter: Jitter,
    pub random: Random,
    /// Arrival of the frame before: a connection keeps the order.
    last_arrival: Time,
    pub frame: u64,
}

#[derive(Clone, Copy, Debug)]
pub enum Jitter {
    /// Uniform from 0.1 to 5 ms.
    Uniform,
    /// 0.1 ms and an exponential delay of 1.5 ms.
    Exponential,
    /// As exponential, and a stall of 0.1 to 0.5 s every few seconds, after which all arrive at once.
    Stalls,
}

pub const LEAST_DELAY: Span = Span::from_nanos(100_000);

impl Server {
    pub fn new(seed: u64, drift: f64, jitter: Jitter) -> Self {
        let mut random = Random(seed);
        let offset_ns = (1.7e18 * random.uniform()) as u64;
        Self {
            rate_hz: 60.0,
            drift,
            offset_ns,
            jitter,
            random,
            last_arrival: Time::UNSET,
            frame: 0,
        }
    }

    /// The next frame: true instant of capture, stamp, arrival.
    pub fn next(&mut self) -> (Time, u64, Time) {
        self.frame += 1;
        let true_s = self.frame as f64 / self.rate_hz;
        let captured = Time::VIRTUAL_START + Span::from_seconds(true_s);
        let stamp_ns = self.offset_ns + (true_s * (1.0 + self.drift) * 1e9) as u64;
        let delay_ms = match self.jitter {
            Jitter::Uniform => 4.9 * self.random.uniform(),
            Jitter::Exponential => exponential_ms(1.5, &mut self.random),
            Jitter::Stalls if self.random.uniform() < 0.005 => {
                100.0 + 400.0 * self.random.uniform()
            }
            Jitter::Stalls => exponential_ms(1.5, &mut self.random),
        };
        let arrival = captured + LEAST_DELAY + Span::from_seconds(delay_ms * 1e-3);
        self.last_arrival = arrival.max(self.last_arrival + Span::from_nanos(1000));
        (captured, stamp_ns, self.last_arrival)
    }
}

fn exponential_ms(mean_ms: f64, random: &mut Random) -> f64 {
    -mean_ms * (1.0 - random.uniform()).ln()
}
