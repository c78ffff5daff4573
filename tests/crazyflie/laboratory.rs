//! Bridges and a radio in virtual time, with a simple height control in place of a daemon.

use std::cell::RefCell;
use std::rc::Rc;

use oqtal_bridge::{Bridge, Crtp, Note, RadioCounts, RadioWorker, TableStore, transport};
use oqtal_bus::code::{Actuation, VehicleRefusal};
use oqtal_bus::message::{CommandV1, Header, PoseV1, Stamps, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_wire::crtp::CrtpPacket;
use oqtal_wire::link::RadioSpec;
use oqtal_wire::xbee::Address;

use super::air::{Air, EmulatedRadio};

const PERIOD: Span = Span::from_nanos(16_666_667);
/// Packets other than set-points for each vehicle \[1/s\].
const SHARE: f64 = 250.0;

/// One vehicle's bridge.
struct Station {
    bridge: Bridge,
    commands: u64,
    commanded_at: Time,
    is_commanded: bool,
}

/// Bridges, one radio, and vehicles.
pub struct Laboratory {
    pub air: Rc<RefCell<Air>>,
    config: Config,
    stations: Vec<Station>,
    radio: RadioWorker<EmulatedRadio>,
    pub notes: Vec<Note>,
    /// Position that each vehicle reports \[m, world\].
    estimates: Vec<[f64; 3]>,
}

/// The shipped Crazyflie in still air, without additional delay behind its radio.
pub fn configuration() -> Config {
    let preset = Setting::flag("test", "vehicle.preset", "crazyflie-2.1");
    let mut config = Config::load(&[], &[preset]).unwrap();
    let plant = &mut config.plant;
    (plant.gust_sd_m_s2, plant.rate_drift_deg_s, plant.force_n) = (0.0, [0.0; 3], [0.0; 3]);
    plant.wire.latency_ms = 0.5;
    config
}

impl Laboratory {
    pub fn new(config: &Config, count: usize, loss: f64) -> Self {
        let air = Air::new(config, count, loss);
        let start = air.borrow().now;
        let radios: Vec<RadioSpec> =
            (1..=count).map(|id| format!("80/2M/E7E7E7E7{id:02X}").parse().unwrap()).collect();
        let station = |radio: &RadioSpec| {
            let store = TableStore::without_file();
            let protocol = Crtp::new(config, store, Some(radio.vehicle_id())).unwrap();
            let link = format!("crtp:radio:{radio}").parse().unwrap();
            let carrier = transport(&link, Address::BROADCAST);
            let mut bridge = Bridge::new(config, Box::new(protocol), carrier, start);
            bridge.open(start);
            Station { bridge, commands: 0, commanded_at: start, is_commanded: false }
        };
        let stations = radios.iter().map(station).collect();
        let radio = RadioWorker::new(EmulatedRadio(air.clone()), radios, SHARE);
        let estimates = vec![[f64::NAN; 3]; count];
        Self { air, config: config.clone(), stations, radio, notes: Vec::new(), estimates }
    }

    /// Sends the poses of two vehicles in one packet from now on.
    pub fn pack_poses(&mut self) {
        self.radio.pack_poses();
    }

    /// Commands every vehicle from now on to hover at a metre, or "disarmed".
    pub fn command(&mut self, flies: bool) {
        self.stations.iter_mut().for_each(|station| station.is_commanded = flies);
    }

    pub fn counts(&self, vehicle: usize) -> RadioCounts {
        self.radio.counts(vehicle)
    }

    /// Position that a vehicle reports \[m, world\].
    pub fn estimate(&self, vehicle: usize) -> [f64; 3] {
        self.estimates[vehicle]
    }

    /// Reason why a vehicle did not execute the last request, as its bridge reports it.
    pub fn refusal(&mut self, vehicle: usize) -> Option<VehicleRefusal> {
        let now = self.air.borrow().now;
        let (_, _, report) = self.stations[vehicle].bridge.report(now, None, Span::ZERO);
        VehicleRefusal::from_code(report.refusal)
    }

    pub fn truth(&self, vehicle: usize) -> TruthV1 {
        self.air.borrow().vehicles[vehicle].plant().truth()
    }

    pub fn motors_run(&self, vehicle: usize) -> bool {
        self.air.borrow().vehicles[vehicle].board().motors_run()
    }

    /// Advances the time by `millis` \[ms\].
    pub fn pass(&mut self, millis: i64) {
        let end = self.air.borrow().now + Span::from_millis(millis);
        while self.air.borrow().now < end {
            for index in 0..self.stations.len() {
                self.turn(index);
            }
            let air = self.air.clone();
            let exchanged = self.radio.exchange(&mut || air.borrow().now).unwrap();
            match exchanged {
                Some((vehicle, Some(reply))) => self.receive(vehicle, &reply),
                Some(_) => {}
                None => self.air.borrow_mut().pass(Span::from_nanos(200_000)),
            }
        }
    }

    fn receive(&mut self, vehicle: usize, reply: &CrtpPacket) {
        let now = self.air.borrow().now;
        let notes = &mut self.notes;
        let station = &mut self.stations[vehicle];
        station.bridge.receive_bytes(now, reply.as_bytes(), &mut |note| notes.push(note));
    }

    /// Passes command and pose to the bridge, and the bridge's packets to the radio.
    fn turn(&mut self, index: usize) {
        let now = self.air.borrow().now;
        if now.since(self.stations[index].commanded_at) >= PERIOD {
            self.give_command(now, index);
        }
        let Self { stations, radio, notes, estimates, .. } = self;
        let bridge = &mut stations[index].bridge;
        if bridge.next_event(now) > now {
            return;
        }
        bridge.begin_read(now);
        let mut send = |bridge: &mut Bridge| {
            let bytes = bridge.outbox();
            if let Ok(packet) = CrtpPacket::parse(bytes) {
                radio.push(now, index, packet);
                if let Some((_, _, report)) = bridge.handed_over(now, packet.as_bytes().len()) {
                    estimates[index] = report.estimate_position;
                }
            }
        };
        bridge.turn(now, &mut |note| notes.push(note));
        send(bridge);
        while bridge.follow_up(now) {
            send(bridge);
        }
    }

    fn give_command(&mut self, now: Time, index: usize) {
        let truth = self.truth(index);
        let command = self.hover(&truth);
        let station = &mut self.stations[index];
        station.commanded_at = station.commanded_at + PERIOD;
        station.commands += 1;
        let command = if station.is_commanded { command } else { CommandV1::default() };
        let stamps = Stamps {
            captured_at: now,
            pose_published_at: now,
            command_published_at: now,
            ..Stamps::default()
        };
        let header = Header { sequence: station.commands, stamps, ..Header::default() };
        station.bridge.receive_command(now, &header, command, 0);
        let (position, attitude) = (truth.position, truth.attitude);
        let pose = PoseV1 { position, attitude, tracked: 1, ..PoseV1::default() };
        station.bridge.receive_pose(now, &header, &pose);
    }

    /// Thrust for a height of a metre, without rotation.
    fn hover(&self, truth: &TruthV1) -> CommandV1 {
        let vehicle = &self.config.vehicle;
        let wanted = 4.0 * (1.0 - truth.position[2]) - 3.0 * truth.velocity[2];
        let force = vehicle.mass_kg * (vehicle.gravity_m_s2 + wanted);
        let thrust = (force / vehicle.max_thrust_n).clamp(0.0, 1.0);
        let actuation = Actuation::Sticks.code();
        CommandV1 { actuation, thrust, ..CommandV1::default() }
    }
}
