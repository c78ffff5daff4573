//! Emulated vehicle behind its radio, bytes in and bytes out. Pure: time is an argument.

use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_runtime::faults::RadioDisturbance;
use oqtal_wire::asctec::{HostCommand, VehicleDecoder};
use oqtal_wire::link::AsctecLink;
use oqtal_wire::stream::DecoderCounters;
use oqtal_wire::xbee::{Carrier, MAX_PAYLOAD, RadioEvent, Side};

use super::end::{EmulatedVehicle, WireCounters};
use super::on_board::{Measured, OnBoard};
use super::options::{address, scales};
use super::radio::{LinkDirection, RadioModel};
use crate::disturbance::SceneDisturbance;
use crate::plant::{Plant, PlantOutput};

/// Emulated vehicle that is flown through its radio.
#[derive(Debug)]
pub struct WiredVehicle {
    plant: Plant,
    radio: RadioModel,
    /// The host's XBee, which is emulated with the vehicle.
    carrier: Carrier,
    decoder: VehicleDecoder,
    on_board: OnBoard,
    received: Vec<u8>,
    /// Frame ids for which the host requested a delivery report \[-\].
    requests: Vec<u8>,
    commands: Vec<HostCommand>,
    answer: Vec<u8>,
    /// Bytes that have arrived at the host.
    arrived: Vec<u8>,
}

impl WiredVehicle {
    /// The vehicle of `config` on the floor at `start`, at the other end of `link`.
    ///
    /// # Errors
    /// An option of `[plant.wire]` cannot be used.
    pub fn new(config: &Config, link: &AsctecLink, start: Time) -> Result<Self, OptionError> {
        // The frames of answers are of the kind that the host's requests are.
        let peer = address(config)?;
        Ok(Self {
            plant: Plant::new(config, start),
            radio: RadioModel::new(&config.plant.wire, config.clock.seed, link.serial.baud),
            carrier: Carrier::new(link.xbee, Side::Radio, peer),
            decoder: VehicleDecoder::new(),
            on_board: OnBoard::new(&config.plant, scales(config)?),
            received: Vec::with_capacity(1024),
            requests: Vec::with_capacity(64),
            commands: Vec::with_capacity(64),
            answer: Vec::with_capacity(1024),
            arrived: Vec::with_capacity(1024),
        })
    }

    /// Instant of the next event.
    #[must_use]
    pub fn next_event(&self) -> Time {
        let arrivals =
            [LinkDirection::Up, LinkDirection::Down].map(|way| self.radio.next_arrival(way));
        let events = arrivals.into_iter().chain([self.on_board.next_event()]);
        events.flatten().fold(self.plant.next_sample(), Time::min)
    }

    /// Whether the radio has room for what the host writes; otherwise the host has to wait.
    #[must_use]
    pub fn has_room(&self, now: Time) -> bool {
        self.radio.has_room(LinkDirection::Up, now)
    }

    /// Disturbs vehicle and radio from now on.
    pub fn disturb(&mut self, disturbance: SceneDisturbance) {
        self.radio.disturb(disturbance.radio);
        // Commands come over the wire, not over the plant's own radio.
        self.plant.disturb(SceneDisturbance { radio: RadioDisturbance::default(), ..disturbance });
    }

    /// Takes bytes that the host wrote together.
    pub fn host_writes(&mut self, now: Time, bytes: &[u8]) {
        self.radio.send(LinkDirection::Up, now, bytes);
    }

    /// Appends to `bytes` the bytes that have arrived at the host by `now`.
    pub fn host_reads(&mut self, now: Time, bytes: &mut Vec<u8>) {
        self.radio.receive(LinkDirection::Down, now, bytes);
    }

    /// Skips what a pause of the process that ends at `now` has too much: see [`Plant::skip_pause`].
    pub fn skip_pause(&mut self, now: Time) -> Span {
        self.plant.skip_pause(now)
    }

    /// Flies on to `until`, and tells `out` what happens. Commands act at the very instant at which their last byte arrives.
    pub fn advance(&mut self, until: Time, mut out: impl FnMut(PlantOutput)) {
        loop {
            let up = self.radio.next_arrival(LinkDirection::Up);
            let events = [up, self.on_board.next_event()].into_iter().flatten();
            let next = events.fold(self.plant.next_sample(), Time::min).min(until);
            self.plant.advance(next, &mut out);
            self.receive(next);
            self.on_board.tick(next);
            self.plant.apply_command(&self.on_board.command(&self.plant.truth()));
            if next >= until {
                return;
            }
        }
    }

    /// Counters of the frames received.
    #[must_use]
    pub fn counters(&self) -> DecoderCounters {
        self.decoder.counters()
    }

    /// Model of the radio.
    #[must_use]
    pub fn radio(&self) -> &RadioModel {
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

    /// Executes the messages that have arrived, and answers.
    fn receive(&mut self, now: Time) {
        let Self { radio, carrier, decoder, commands, answer, received, .. } = self;
        radio.receive(LinkDirection::Up, now, received);
        for arrival in carrier.push(received) {
            if let RadioEvent::Payload { id, payload } = arrival {
                commands.extend(decoder.push(&payload));
                self.requests.push(id);
            }
        }
        received.clear();
        for id in self.requests.drain(..) {
            radio.send(LinkDirection::Down, now, carrier.report(id, true).as_bytes());
        }
        let measured = Measured { truth: self.plant.truth(), battery_v: self.plant.battery_v() };
        for command in commands.drain(..) {
            self.on_board.execute(now, &command, &measured, answer);
            for piece in answer.chunks(MAX_PAYLOAD) {
                if let Ok(frame) = carrier.wrap(0, piece) {
                    radio.send(LinkDirection::Down, now, frame.as_bytes());
                }
            }
            answer.clear();
        }
    }
}

impl EmulatedVehicle for WiredVehicle {
    fn next_event(&self) -> Time {
        WiredVehicle::next_event(self)
    }

    fn has_room(&self, now: Time) -> bool {
        WiredVehicle::has_room(self, now)
    }

    fn disturb(&mut self, disturbance: SceneDisturbance) {
        WiredVehicle::disturb(self, disturbance);
    }

    fn skip_pause(&mut self, now: Time) -> Span {
        WiredVehicle::skip_pause(self, now)
    }

    fn host_writes(&mut self, now: Time, bytes: &[u8]) {
        WiredVehicle::host_writes(self, now, bytes);
    }

    fn advance(&mut self, until: Time, out: &mut dyn FnMut(PlantOutput)) {
        WiredVehicle::advance(self, until, out);
    }

    fn host_reads(&mut self, now: Time, packet: &mut dyn FnMut(&[u8])) {
        let mut bytes = std::mem::take(&mut self.arrived);
        WiredVehicle::host_reads(self, now, &mut bytes);
        if !bytes.is_empty() {
            packet(&bytes);
        }
        bytes.clear();
        self.arrived = bytes;
    }

    fn counters(&self) -> WireCounters {
        let DecoderCounters { frames, damaged, .. } = WiredVehicle::counters(self);
        let traffic = |direction| self.radio.traffic(direction);
        let (up, down) = (traffic(LinkDirection::Up), traffic(LinkDirection::Down));
        WireCounters { read: frames, damaged, up, down }
    }
}
