//! Emulated Crazyflie behind its radio, packets in and packets out. Pure: time is an argument.

use std::collections::VecDeque;

use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_runtime::faults::RadioDisturbance;
use oqtal_runtime::random::{RandomSource, stream};
use oqtal_wire::crtp::CrtpPacket;

use super::super::on_board::Measured;
use super::super::packet_air::PacketAir;
use super::board::CrazyflieBoard;
use crate::plant::{Plant, PlantOutput};

/// Emulated Crazyflie that is flown through its radio.
#[derive(Debug)]
pub struct CrtpVehicle {
    plant: Plant,
    up: PacketAir<CrtpPacket>,
    down: PacketAir<CrtpPacket>,
    board: CrazyflieBoard,
    answers: VecDeque<CrtpPacket>,
}

impl CrtpVehicle {
    /// The vehicle of `config` on the floor at `start`.
    ///
    /// # Errors
    /// An option of `[plant.wire.crtp]` cannot be used.
    pub fn new(config: &Config, start: Time) -> Result<Self, OptionError> {
        let options = &config.plant.wire;
        let millis = |millis: f64| Span::from_seconds(millis * 1e-3);
        let air = |source| {
            let generator = stream(config.clock.seed, source);
            let (latency, jitter) = (millis(options.latency_ms), millis(options.crtp.jitter_ms));
            PacketAir::new(latency, jitter, options.loss_probability, generator)
        };
        Ok(Self {
            plant: Plant::new(config, start),
            up: air(RandomSource::UplinkLoss),
            down: air(RandomSource::DownlinkLoss),
            board: CrazyflieBoard::new(&config.plant, start)?,
            answers: VecDeque::with_capacity(64),
        })
    }

    /// Instant of the next event.
    #[must_use]
    pub fn next_event(&self) -> Time {
        let events = [self.up.next_arrival(), self.down.next_arrival(), self.board.next_event()];
        events.into_iter().flatten().fold(self.plant.next_sample(), Time::min)
    }

    /// Disturbs the radio from now on.
    pub fn disturb_radio(&mut self, disturbance: RadioDisturbance) {
        self.up.disturb(disturbance);
        self.down.disturb(disturbance);
    }

    /// Takes a packet that the host sent.
    pub fn host_sends(&mut self, now: Time, packet: CrtpPacket) {
        self.up.send(now, packet);
    }

    /// Takes the next packet that has arrived at the host by `now`.
    pub fn host_receives(&mut self, now: Time) -> Option<CrtpPacket> {
        self.down.receive(now)
    }

    /// Skips what a pause of the process that ends at `now` has too much: see [`Plant::skip_pause`].
    pub fn skip_pause(&mut self, now: Time) -> Span {
        self.plant.skip_pause(now)
    }

    /// Flies on to `until`, and tells `out` what happens. Packets act at the very instant at which they arrive.
    pub fn advance(&mut self, until: Time, mut out: impl FnMut(PlantOutput)) {
        loop {
            let events = [self.up.next_arrival(), self.board.next_event()].into_iter().flatten();
            let next = events.fold(self.plant.next_sample(), Time::min).min(until);
            self.plant.advance(next, &mut out);
            self.receive(next);
            self.plant.apply_command(&self.board.command(&self.plant.truth()));
            if next >= until {
                return;
            }
        }
    }

    /// Packets to the vehicle and from it: sent, and lost \[-\].
    #[must_use]
    pub fn traffic(&self) -> [(u64, u64); 2] {
        [self.up.counts(), self.down.counts()]
    }

    /// The on-board computer.
    #[must_use]
    pub fn board(&self) -> &CrazyflieBoard {
        &self.board
    }

    /// The simulated vehicle.
    #[must_use]
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Executes the packets that have arrived, and answers.
    fn receive(&mut self, now: Time) {
        while let Some(packet) = self.up.receive(now) {
            self.board.execute(now, &packet, &mut self.answers);
        }
        let measured = Measured { truth: self.plant.truth(), battery_v: self.plant.battery_v() };
        self.board.tick(now, &measured, &mut self.answers);
        for packet in self.answers.drain(..) {
            self.down.send(now, packet);
        }
    }
}
