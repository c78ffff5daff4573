//! Emulated Crazyflie behind its radio, one packet a datagram. Pure: time is an argument.

use std::collections::VecDeque;

use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_runtime::faults::RadioDisturbance;
use oqtal_wire::crtp::CrtpPacket;

use super::super::datagrams::DatagramModel;
use super::super::end::{EmulatedVehicle, WireCounters};
use super::super::on_board::Measured;
use super::super::radio::LinkDirection;
use super::board::CrazyflieBoard;
use crate::disturbance::SceneDisturbance;
use crate::plant::{Plant, PlantOutput};

/// Emulated Crazyflie that is flown through its radio.
#[derive(Debug)]
pub struct CrtpVehicle {
    plant: Plant,
    air: DatagramModel,
    board: CrazyflieBoard,
    answers: VecDeque<CrtpPacket>,
    read: u64,
    damaged: u64,
}

impl CrtpVehicle {
    /// The vehicle of `config` on the floor at `start`.
    ///
    /// # Errors
    /// An option of `[plant.wire.crtp]` cannot be used.
    pub fn new(config: &Config, start: Time) -> Result<Self, OptionError> {
        Ok(Self {
            plant: Plant::new(config, start),
            air: DatagramModel::new(&config.plant.wire, config.clock.seed),
            board: CrazyflieBoard::new(&config.plant, start)?,
            answers: VecDeque::with_capacity(64),
            read: 0,
            damaged: 0,
        })
    }

    /// Takes the next packet that has arrived at the host by `now`.
    pub fn host_receives(&mut self, now: Time) -> Option<CrtpPacket> {
        let bytes = self.air.receive(LinkDirection::Down, now)?;
        CrtpPacket::parse(&bytes).ok()
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
        while let Some(bytes) = self.air.receive(LinkDirection::Up, now) {
            match CrtpPacket::parse(&bytes) {
                Ok(packet) => {
                    self.read += 1;
                    self.board.execute(now, &packet, &mut self.answers);
                }
                Err(_) => self.damaged += 1,
            }
        }
        let measured = Measured { truth: self.plant.truth(), battery_v: self.plant.battery_v() };
        self.board.tick(now, &measured, &mut self.answers);
        for packet in self.answers.drain(..) {
            self.air.send(LinkDirection::Down, now, packet.as_bytes());
        }
    }
}

impl EmulatedVehicle for CrtpVehicle {
    fn next_event(&self) -> Time {
        let arrivals =
            [LinkDirection::Up, LinkDirection::Down].map(|way| self.air.next_arrival(way));
        let events = arrivals.into_iter().chain([self.board.next_event()]);
        events.flatten().fold(self.plant.next_sample(), Time::min)
    }

    fn has_room(&self, _now: Time) -> bool {
        true
    }

    fn disturb(&mut self, disturbance: SceneDisturbance) {
        self.air.disturb(disturbance.radio);
        // The network disturbs the commands, not a second time the vehicle's own radio.
        self.plant.disturb(SceneDisturbance { radio: RadioDisturbance::default(), ..disturbance });
    }

    fn skip_pause(&mut self, now: Time) -> Span {
        self.plant.skip_pause(now)
    }

    fn host_writes(&mut self, now: Time, bytes: &[u8]) {
        self.air.send(LinkDirection::Up, now, bytes);
    }

    /// Packets act at the very instant at which they arrive.
    fn advance(&mut self, until: Time, out: &mut dyn FnMut(PlantOutput)) {
        loop {
            let up = self.air.next_arrival(LinkDirection::Up);
            let events = [up, self.board.next_event()].into_iter().flatten();
            let next = events.fold(self.plant.next_sample(), Time::min).min(until);
            self.plant.advance(next, &mut *out);
            self.receive(next);
            self.plant.apply_command(&self.board.command(&self.plant.truth()));
            if next >= until {
                return;
            }
        }
    }

    fn host_reads(&mut self, now: Time, packet: &mut dyn FnMut(&[u8])) {
        while let Some(bytes) = self.air.receive(LinkDirection::Down, now) {
            packet(&bytes);
        }
    }

    fn counters(&self) -> WireCounters {
        let [up, down] = [LinkDirection::Up, LinkDirection::Down].map(|way| self.air.traffic(way));
        WireCounters { read: self.read, damaged: self.damaged, up, down }
    }
}
