//! Emulated autopilot behind a network, datagrams in and datagrams out. Pure: time is an argument.

use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_runtime::faults::RadioDisturbance;
use oqtal_wire::link::{AutopilotKind, MavlinkLink};
use oqtal_wire::mavlink::{MavlinkContent, MavlinkDecoder, MavlinkEncoder};

use super::autopilot::EmulatedAutopilot;
use super::datagrams::DatagramModel;
use super::end::{EmulatedVehicle, WireCounters};
use super::on_board::Measured;
use super::radio::LinkDirection;
use crate::disturbance::SceneDisturbance;
use crate::plant::{Plant, PlantOutput};

/// System id of an emulated vehicle whose link names none.
const DEFAULT_SYSTEM: u8 = 1;

/// Emulated vehicle that is flown through MAVLink.
#[derive(Debug)]
pub struct MavlinkVehicle {
    plant: Plant,
    network: DatagramModel,
    decoder: MavlinkDecoder,
    encoder: MavlinkEncoder,
    autopilot: EmulatedAutopilot,
    said: Vec<MavlinkContent>,
    answers: Vec<MavlinkContent>,
}

impl MavlinkVehicle {
    /// The vehicle of `config` on the floor at `start`, at the other end of `link`.
    ///
    /// # Errors
    /// An option of `[plant.wire.mavlink]` cannot be used.
    pub fn new(config: &Config, link: &MavlinkLink, start: Time) -> Result<Self, OptionError> {
        let kind = link.autopilot.unwrap_or(AutopilotKind::ArduPilot);
        let system = link.system.unwrap_or(DEFAULT_SYSTEM);
        let autopilot = EmulatedAutopilot::new(config, kind, system, start)?;
        Ok(Self {
            plant: Plant::new(config, start),
            network: DatagramModel::new(&config.plant.wire, config.clock.seed),
            decoder: MavlinkDecoder::new(),
            encoder: MavlinkEncoder::new(autopilot.own()),
            autopilot,
            said: Vec::with_capacity(16),
            answers: Vec::with_capacity(16),
        })
    }

    /// The emulated autopilot.
    pub fn autopilot(&mut self) -> &mut EmulatedAutopilot {
        &mut self.autopilot
    }

    /// The simulated vehicle.
    #[must_use]
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    fn next_instant(&self) -> Time {
        let arrival = self.network.next_arrival(LinkDirection::Up);
        let own = self.autopilot.next_event().min(self.plant.next_sample());
        arrival.map_or(own, |arrival| arrival.min(own))
    }

    /// Executes the messages that have arrived, lets time pass, and sends what is due.
    fn act(&mut self, now: Time) {
        let Self { network, decoder, autopilot, said, answers, .. } = self;
        while let Some(datagram) = network.receive(LinkDirection::Up, now) {
            said.extend(decoder.push(&datagram).map(|packet| packet.content));
        }
        for content in said.drain(..) {
            autopilot.execute(now, &content, answers);
        }
        let measured = Measured { truth: self.plant.truth(), battery_v: self.plant.battery_v() };
        autopilot.tick(now, &measured, answers);
        for content in answers.drain(..) {
            if let Some(wire) = self.encoder.encode(&content) {
                network.send(LinkDirection::Down, now, wire.as_bytes());
            }
        }
        self.plant.apply_command(&autopilot.command(now, &measured.truth));
    }
}

impl EmulatedVehicle for MavlinkVehicle {
    fn next_event(&self) -> Time {
        let down = self.network.next_arrival(LinkDirection::Down);
        down.map_or(self.next_instant(), |down| down.min(self.next_instant()))
    }

    fn has_room(&self, _: Time) -> bool {
        true
    }

    fn disturb(&mut self, disturbance: SceneDisturbance) {
        self.network.disturb(disturbance.radio);
        // The network disturbs the commands, not a second time the vehicle's own radio.
        self.plant.disturb(SceneDisturbance { radio: RadioDisturbance::default(), ..disturbance });
    }

    fn skip_pause(&mut self, now: Time) -> Span {
        self.plant.skip_pause(now)
    }

    fn host_writes(&mut self, now: Time, bytes: &[u8]) {
        self.network.send(LinkDirection::Up, now, bytes);
    }

    fn advance(&mut self, until: Time, out: &mut dyn FnMut(PlantOutput)) {
        loop {
            let next = self.next_instant().min(until);
            self.plant.advance(next, &mut *out);
            self.act(next);
            if next >= until {
                return;
            }
        }
    }

    fn host_reads(&mut self, now: Time, packet: &mut dyn FnMut(&[u8])) {
        while let Some(datagram) = self.network.receive(LinkDirection::Down, now) {
            packet(&datagram);
        }
    }

    fn counters(&self) -> WireCounters {
        let decoded = self.decoder.counters();
        WireCounters {
            read: decoded.frames,
            damaged: decoded.damaged,
            up: self.network.traffic(LinkDirection::Up),
            down: self.network.traffic(LinkDirection::Down),
        }
    }
}
