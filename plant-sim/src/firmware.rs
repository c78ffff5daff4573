//! Plant as the body of a Crazyflie firmware that runs as a program: the firmware drives the rotors and reads the simulated
//! sensors, and CRTP packets of a client are relayed. The vehicle's state is reported over CRTP only; the truth is published for
//! the cameras.
//!
//! The rotors and inertial sensors are in `body.rs`, the time of the body in `clock.rs`; `betaflight.rs` is the body of a Betaflight
//! that runs as a program.

pub mod betaflight;
mod body;
mod clock;

use std::net::SocketAddr;

use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Failure, ProcessContext};
use oqtal_wire::crazyflie_sitl::{
    FirmwarePacket, HELLO, MAX_DATAGRAM, imu_datagram, is_from_client,
};

use crate::disturbance::{DisturbanceClock, SceneDisturbance};
use crate::socket::{self, MOST_READ, PeerSocket};
use crate::truth::TruthPorts;
use crate::turn::log_skipped;
use crate::wire::{DatagramModel, LinkDirection, LinkModel};

pub use body::{BodyOutput, FirmwareBody, InertialSample};
use clock::BodyClock;

/// Maximum number of sensor samples sent in one turn \[-\]: the firmware's queue holds five packets.
const MOST_IMU: usize = 3;
/// Time after the start of a firmware after which its calibration counts as failed; it needs 1.1 s.
const CALIBRATED_WITHIN: Span = Span::from_millis(5000);

/// Addresses of a firmware's body.
#[derive(Clone, Copy, Debug)]
pub struct BodyAddresses {
    /// Address at which the body waits for the firmware.
    pub body: SocketAddr,
    /// Address at which a client reaches the firmware.
    pub crtp: SocketAddr,
}

/// Simulates the body of a firmware. Returns when a stop is requested.
///
/// # Errors
/// An address cannot be used, or the bus refuses or fails.
pub fn run(context: &ProcessContext, addresses: BodyAddresses) -> Result<(), Failure> {
    let bus = context.bus()?;
    let mut ports = TruthPorts::open(context, &bus)?;
    let mut disturbances = DisturbanceClock::open(&bus, &context.config)?;
    let mut link = FirmwareLink::open(context, addresses)?;
    tracing::info!(address = %addresses.body, "the body waits for its firmware");
    context.enter_realtime();
    while !context.stop.is_set() {
        context.health.count_turn();
        socket::wait(&[&link.firmware, &link.client], link.next_event())?;
        ports.beat()?;
        let now = Time::now();
        link.disturb(disturbances.at(now)?);
        log_skipped(link.body.skip_pause(now - link.clock.slip()));
        if link.read(now)? {
            context.health.count_input();
        }
        let mut published = Ok(());
        link.advance(now, |truth| {
            if published.is_ok() {
                published = ports.publish(truth);
            }
        })?;
        published?;
        context.health.count_output();
        link.forward(now)?;
    }
    tracing::info!(
        lost_packets = link.lost_packets(),
        late_samples = link.late_samples,
        waited_s = link.clock.slip().seconds(),
        "the body is at rest"
    );
    Ok(())
}

/// Buffer for a datagram and one more byte, which detects an oversized one.
type Buffer = [u8; MAX_DATAGRAM + 1];

/// Reads the next datagram at `socket`; an oversized one counts as empty.
fn receive<'a>(
    socket: &PeerSocket,
    buffer: &'a mut Buffer,
) -> Result<Option<(&'a [u8], SocketAddr)>, Failure> {
    let received = socket.receive(buffer)?;
    Ok(received.map(|(length, sender)| {
        let length = if length > MAX_DATAGRAM { 0 } else { length };
        (&buffer[..length], sender)
    }))
}

/// Body, firmware, and the client that commands it.
#[derive(Debug)]
struct FirmwareLink {
    body: FirmwareBody,
    /// CRTP packets in transit between client and firmware, with radio faults.
    relay: DatagramModel,
    /// Scratch memory for one packet.
    packet: Vec<u8>,
    firmware: PeerSocket,
    client: PeerSocket,
    clock: BodyClock,
    /// Start of a firmware that has not calibrated its sensors yet.
    uncalibrated_since: Option<Time>,
    /// Number of samples not sent because the process was late \[-\].
    late_samples: u64,
}

impl FirmwareLink {
    /// Sets the disturbance of body and radio from now on.
    fn disturb(&mut self, disturbance: SceneDisturbance) {
        self.relay.disturb(disturbance.radio);
        self.body.disturb(disturbance, self.clock.slip());
    }

    fn open(context: &ProcessContext, addresses: BodyAddresses) -> Result<Self, Failure> {
        let config = &context.config;
        Ok(Self {
            firmware: PeerSocket::open(&addresses.body, "the firmware")?,
            client: PeerSocket::open(&addresses.crtp, "its client")?,
            body: FirmwareBody::new(config, Time::now()),
            relay: DatagramModel::relay(config.clock.seed),
            packet: Vec::with_capacity(MAX_DATAGRAM),
            clock: BodyClock::new(),
            uncalibrated_since: None,
            late_samples: 0,
        })
    }

    /// Reads the datagrams at both sockets; returns whether they contained motor values.
    fn read(&mut self, now: Time) -> Result<bool, Failure> {
        let (mut buffer, mut is_driven) = ([0; MAX_DATAGRAM + 1], false);
        for _ in 0..MOST_READ {
            let Some((datagram, sender)) = receive(&self.firmware, &mut buffer)? else { break };
            match FirmwarePacket::decode(datagram) {
                FirmwarePacket::Hello => self.greet(now, sender)?,
                FirmwarePacket::Motors(motors) => {
                    is_driven = true;
                    self.clock.drive(now, self.body.time());
                    self.body.drive(motors);
                }
                FirmwarePacket::Calibrated => {
                    self.uncalibrated_since = None;
                    tracing::info!("the firmware has calibrated");
                }
                FirmwarePacket::Client => self.relay.send(LinkDirection::Down, now, datagram),
                FirmwarePacket::Invalid => {}
            }
        }
        for _ in 0..MOST_READ {
            let Some((datagram, sender)) = receive(&self.client, &mut buffer)? else { break };
            if is_from_client(datagram) {
                self.client.accept(sender);
                self.relay.send(LinkDirection::Up, now, datagram);
            }
        }
        self.clock.watch(now);
        self.watch_calibration(now);
        Ok(is_driven)
    }

    /// Logs once that the firmware hangs in its start: only another start helps.
    fn watch_calibration(&mut self, now: Time) {
        let hangs = |since: &mut Time| now.since(*since) > CALIBRATED_WITHIN;
        if self.uncalibrated_since.take_if(hangs).is_some() {
            tracing::warn!("the firmware does not calibrate its sensors: start it again");
        }
    }

    /// Answers a firmware that has just started.
    fn greet(&mut self, now: Time, sender: SocketAddr) -> Result<(), Failure> {
        if self.firmware.accept(sender) {
            self.uncalibrated_since = Some(now);
            tracing::info!(firmware = %sender, "the firmware has started");
        }
        self.firmware.send(&HELLO)
    }

    /// The next instant at which the loop must act without a datagram.
    fn next_event(&self) -> Time {
        self.clock.next_event(self.body.next_event())
    }

    /// Integrates to `now`, and sends the sensor samples and at most one packet of the client: the firmware has one short queue for
    /// both.
    fn advance(&mut self, now: Time, mut truth: impl FnMut(TruthV1)) -> Result<(), Failure> {
        let until = self.clock.body_time(now, self.body.time());
        let Self { body, relay, packet, firmware, late_samples, .. } = self;
        let slip = self.clock.slip();
        let (mut count, mut sent) = (0, Ok(()));
        body.advance(until, |output| match output {
            BodyOutput::Truth(sample) => truth(TruthV1 { time: sample.time + slip, ..sample }),
            BodyOutput::Sensors(_) if count >= MOST_IMU => *late_samples += 1,
            BodyOutput::Sensors(sample) => {
                count += 1;
                if sent.is_ok() {
                    sent = firmware.send(&imu_datagram(sample.force, sample.rate));
                }
            }
        });
        sent?;
        packet.clear();
        let sends = count > 0 && firmware.has_peer();
        if sends && relay.receive(LinkDirection::Up, now, packet) {
            firmware.send(packet)?;
        }
        Ok(())
    }

    /// Forwards packets of the firmware to its client.
    fn forward(&mut self, now: Time) -> Result<(), Failure> {
        self.packet.clear();
        while self.relay.receive(LinkDirection::Down, now, &mut self.packet) {
            self.client.send(&self.packet)?;
            self.packet.clear();
        }
        Ok(())
    }

    /// Number of CRTP packets lost \[-\].
    fn lost_packets(&self) -> u64 {
        let directions = [LinkDirection::Up, LinkDirection::Down];
        directions.map(|direction| self.relay.traffic(direction).lost).iter().sum()
    }
}
