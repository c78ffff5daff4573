//! The vehicle behind its radio, bytes in and bytes out. Pure: time comes in as an argument.

use oqtal_bus::config::Config;
use oqtal_bus::time::{Span, Time};
use oqtal_wire::asctec::{Command, ControlInput, Scales, VehicleDecoder};
use oqtal_wire::link::LinkSpec;
use oqtal_wire::stream::Counters;

use super::on_board::{Measured, OnBoard};
use super::radio::{Radio, Way};
use crate::plant::{Output, Plant};

/// A vehicle that is flown through its radio.
#[derive(Debug)]
pub struct WiredVehicle {
    plant: Plant,
    radio: Radio,
    decoder: VehicleDecoder,
    on_board: OnBoard,
    heard: Vec<u8>,
    commands: Vec<Command>,
    answer: Vec<u8>,
}

impl WiredVehicle {
    /// The vehicle of `config` on the floor at `start`, at the other end of `link`; counts mean what `scales` say.
    #[must_use]
    pub fn new(config: &Config, link: &LinkSpec, scales: &Scales, start: Time) -> Self {
        let options = &config.vehicle.wire;
        Self {
            plant: Plant::new(config, start),
            radio: Radio::new(options, config.clock.seed, link.baud(), latency(config, link)),
            decoder: VehicleDecoder::new(),
            on_board: OnBoard::new(&config.vehicle, scales),
            heard: Vec::with_capacity(1024),
            commands: Vec::with_capacity(64),
            answer: Vec::with_capacity(1024),
        }
    }

    /// The next instant at which something happens.
    #[must_use]
    pub fn next_event(&self) -> Time {
        let arrivals = [Way::Up, Way::Down].map(|way| self.radio.next_arrival(way));
        let events = arrivals.into_iter().chain([self.on_board.next_event()]);
        events.flatten().fold(self.plant.next_sample(), Time::min)
    }

    /// Whether the wire has room for what the host writes; else it has to wait.
    #[must_use]
    pub fn listens(&self, now: Time) -> bool {
        self.radio.has_room(Way::Up, now)
    }

    /// Takes what the host wrote together.
    pub fn host_writes(&mut self, now: Time, bytes: &[u8]) {
        self.radio.send(Way::Up, now, bytes);
    }

    /// Appends to `bytes` what has arrived at the host by `now`.
    pub fn host_reads(&mut self, now: Time, bytes: &mut Vec<u8>) {
        self.radio.receive(Way::Down, now, bytes);
    }

    /// Flies on to `until`, and tells `out` what happens. Commands act at the very instant at which their last byte arrives.
    pub fn advance(&mut self, until: Time, mut out: impl FnMut(Output)) {
        loop {
            let up = self.radio.next_arrival(Way::Up);
            let events = [up, self.on_board.next_event()].into_iter().flatten();
            let next = events.fold(self.plant.next_sample(), Time::min).min(until);
            self.plant.advance(next, &mut out);
            self.listen(next);
            self.on_board.tick(next);
            self.plant.steer(&self.on_board.command(&self.plant.truth()));
            if next >= until {
                return;
            }
        }
    }

    /// What the vehicle could read, and what not.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.decoder.counters()
    }

    /// The radio.
    #[must_use]
    pub fn radio(&self) -> &Radio {
        &self.radio
    }

    /// Whether the motors run.
    #[must_use]
    pub fn motors_run(&self) -> bool {
        self.on_board.motors_run()
    }

    /// The simulated vehicle.
    #[must_use]
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Obeys what has arrived, and answers.
    fn listen(&mut self, now: Time) {
        self.radio.receive(Way::Up, now, &mut self.heard);
        self.commands.extend(self.decoder.push(&self.heard));
        self.heard.clear();
        let measured = Measured { truth: self.plant.truth(), battery_v: self.plant.battery_v() };
        for command in self.commands.drain(..) {
            self.on_board.obey(now, &command, &measured, &mut self.answer);
            self.radio.send(Way::Down, now, &self.answer);
            self.answer.clear();
        }
    }
}

/// What is left of the radio's delay for its latency, once a command's bytes have taken their time.
fn latency(config: &Config, link: &LinkSpec) -> Span {
    let delay = Span::from_seconds(config.vehicle.radio_delay_ms * 1e-3);
    let bits = 10.0 * ControlInput::FRAME_LEN as f64;
    (delay - Span::from_seconds(bits / f64::from(link.baud()))).max(Span::ZERO)
}
