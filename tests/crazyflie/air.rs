//! Emulated Crazyradio: exchanges packets with emulated vehicles in virtual time and loses some of them.

use std::cell::RefCell;
use std::io;
use std::rc::Rc;

use oqtal_bridge::{RadioAck, RadioDongle};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_plant_sim::wire::CrtpVehicle;
use oqtal_wire::crtp::{CrtpPacket, CrtpRequest};
use oqtal_wire::link::RadioSpec;

use crate::common::random::Random;

/// Duration of an exchange: two USB transfers of a full-speed device, 32 bytes each way at 2 Mbit/s, and turn-around.
const EXCHANGE: Span = Span::from_nanos(1_200_000);
/// Duration of a packet without acknowledgement, between two settings of the radio.
const BROADCAST: Span = Span::from_nanos(1_200_000);
/// Additional duration of each repetition.
const REPETITION: Span = Span::from_nanos(500_000);
/// Number of repetitions of an unacknowledged packet \[-\].
const REPETITIONS: u32 = 3;

/// Vehicles within range of the radio, and the present instant.
#[derive(Debug)]
pub struct Air {
    pub now: Time,
    pub vehicles: Vec<CrtpVehicle>,
    /// Probability that a transmission, or its acknowledgement, is lost \[0..1\].
    pub loss: f64,
    random: Random,
}

/// Radio on the [`Air`].
#[derive(Debug)]
pub struct EmulatedRadio(pub Rc<RefCell<Air>>);

impl Air {
    /// `count` vehicles of `config` on the floor.
    pub fn new(config: &Config, count: usize, loss: f64) -> Rc<RefCell<Self>> {
        let now = Time::VIRTUAL_START;
        let vehicle = || CrtpVehicle::new(config, now).unwrap();
        let vehicles = std::iter::repeat_with(vehicle).take(count).collect();
        Rc::new(RefCell::new(Self { now, vehicles, loss, random: Random(7) }))
    }

    /// Advances the time.
    pub fn pass(&mut self, span: Span) {
        self.now = self.now + span;
        let now = self.now;
        self.vehicles.iter_mut().for_each(|vehicle| vehicle.advance(now, |_| ()));
    }

    fn is_lost(&mut self) -> bool {
        self.random.between(0.0, 1.0) < self.loss
    }
}

impl RadioDongle for EmulatedRadio {
    fn exchange(&mut self, target: &RadioSpec, packet: &CrtpPacket) -> io::Result<RadioAck> {
        let mut air = self.0.borrow_mut();
        let vehicle = usize::from(target.vehicle_id()) - 1;
        for repeated in 0..=REPETITIONS {
            let span = if repeated == 0 { EXCHANGE } else { REPETITION };
            air.pass(span);
            if air.is_lost() {
                continue;
            }
            let now = air.now;
            air.vehicles[vehicle].host_writes(now, packet.as_bytes());
            let reply = air.vehicles[vehicle].host_receives(now);
            return Ok(RadioAck { is_acknowledged: true, repeated, reply });
        }
        Ok(RadioAck { is_acknowledged: false, repeated: REPETITIONS, reply: None })
    }
    fn broadcast(&mut self, _: &RadioSpec, packet: &CrtpPacket) -> io::Result<()> {
        let mut air = self.0.borrow_mut();
        air.pass(BROADCAST);
        let now = air.now;
        let Some(CrtpRequest::Poses(poses)) = CrtpRequest::read(packet) else {
            panic!("{packet:?}: only poses are broadcast")
        };
        for pose in poses.poses() {
            let is_lost = air.is_lost();
            // All emulated vehicles have the same address; the radio selects one.
            let alone = CrtpRequest::Pose(pose.pose()).packet();
            let vehicle = &mut air.vehicles[usize::from(pose.vehicle) - 1];
            if !is_lost {
                vehicle.host_writes(now, alone.as_bytes());
            }
        }
        Ok(())
    }
}
