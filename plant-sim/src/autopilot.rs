//! Simulator inside an autopilot that runs as a program, in place of the plant. Its truth, reported over MAVLink, is published
//! for the cameras. A bridge commands the autopilot over a separate link.

mod observer;

use std::net::SocketAddr;

use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Grid, Span, Time};
use oqtal_runtime::process::{Failure, ProcessContext};
use oqtal_wire::mavlink::{
    CommandKind, MavlinkAddress, MavlinkContent, MavlinkDecoder, MavlinkEncoder, VehicleCommandLong,
};

use crate::socket::{self, MOST_READ, PeerSocket};
use crate::truth::TruthPorts;

pub use observer::SimulatorObserver;

/// Longest datagram that is read \[bytes\].
const MAX_DATAGRAM: usize = 2048;
/// MAVLink address of this process: a ground program that does not control the vehicle.
const OWN: MavlinkAddress = MavlinkAddress { system: 254, component: 191 };
/// Messages with the truth: SIM_STATE of ArduPilot, HIL_STATE_QUATERNION of PX4.
const TRUTH_MESSAGES: [u32; 2] = [108, 115];
/// Requested period of these messages \[us\]; an autopilot sends as often as it can.
const TRUTH_INTERVAL_US: u32 = 4000;
/// Time without the truth after which the request is repeated, since a rebooted autopilot has lost it.
const REQUEST_PERIOD: Span = Span::from_millis(1000);

/// Publishes the truth of the autopilot that sends to `address`. Returns when a stop is requested.
///
/// # Errors
/// The address cannot be used, or the bus refuses or fails.
pub fn run(context: &ProcessContext, address: SocketAddr) -> Result<(), Failure> {
    let bus = context.bus()?;
    let mut ports = TruthPorts::open(context, &bus)?;
    let mut autopilot = SimulatedAutopilot::open(address)?;
    let mut camera = Grid::new(Time::now(), context.config.plant.frame_rate_hz);
    tracing::info!(%address, "waiting for an autopilot that simulates its vehicle");
    context.enter_realtime();
    while !context.stop.is_set() {
        context.health.count_turn();
        socket::wait(&[&autopilot.socket], camera.next())?;
        ports.beat()?;
        let now = Time::now();
        let is_reported = autopilot.read(now)?;
        autopilot.request(now)?;
        if is_reported {
            context.health.count_input();
        }
        let is_captured = camera.next() <= now;
        if is_captured {
            camera.skip_to(now);
        }
        let Some(truth) = autopilot.observer.truth(now).filter(|_| is_reported || is_captured)
        else {
            continue;
        };
        context.health.count_output();
        let capture = if is_captured { camera.index() } else { 0 };
        ports.publish(TruthV1 { capture, ..truth })?;
    }
    Ok(())
}

/// An autopilot with its simulator.
#[derive(Debug)]
struct SimulatedAutopilot {
    socket: PeerSocket,
    decoder: MavlinkDecoder,
    encoder: MavlinkEncoder,
    observer: SimulatorObserver,
    /// Address of the autopilot, once a message has arrived from it.
    address: Option<MavlinkAddress>,
    requested_at: Time,
    reported_at: Time,
}

impl SimulatedAutopilot {
    fn open(address: SocketAddr) -> Result<Self, Failure> {
        Ok(Self {
            socket: PeerSocket::open(&address, "the autopilot's truth")?,
            decoder: MavlinkDecoder::new(),
            encoder: MavlinkEncoder::new(OWN),
            observer: SimulatorObserver::default(),
            address: None,
            requested_at: Time::UNSET,
            reported_at: Time::UNSET,
        })
    }

    /// Reads the datagrams that have arrived; returns whether they contained the motion.
    fn read(&mut self, now: Time) -> Result<bool, Failure> {
        let Self { socket, decoder, observer, address, .. } = self;
        let (mut buffer, mut is_reported) = ([0; MAX_DATAGRAM], false);
        for _ in 0..MOST_READ {
            let Some((length, sender)) = socket.receive(&mut buffer)? else { break };
            for packet in decoder.push(&buffer[..length]) {
                if packet.from.component == MavlinkAddress::AUTOPILOT {
                    *address = Some(packet.from);
                }
                if let MavlinkContent::Truth(sample) = packet.content {
                    is_reported = true;
                    observer.take(now, &sample);
                }
            }
            if address.is_some() && socket.accept(sender) {
                tracing::info!(autopilot = %sender, "the autopilot has started");
                self.requested_at = Time::UNSET;
            }
        }
        if is_reported {
            self.reported_at = now;
        }
        Ok(is_reported)
    }

    /// Requests the truth if it is missing.
    fn request(&mut self, now: Time) -> Result<(), Failure> {
        let Some(target) = self.address else { return Ok(()) };
        let missing_since = match self.requested_at.is_set() {
            true => self.requested_at.max(self.reported_at),
            false => Time::UNSET,
        };
        if now.since(missing_since) < REQUEST_PERIOD {
            return Ok(());
        }
        self.requested_at = now;
        for message in TRUTH_MESSAGES {
            let kind = CommandKind::MessageInterval { message, interval_us: TRUTH_INTERVAL_US };
            let command = VehicleCommandLong { target, kind, confirmation: 0 };
            if let Some(packet) = self.encoder.encode(&MavlinkContent::Command(command)) {
                self.socket.send(packet.as_bytes())?;
            }
        }
        Ok(())
    }
}
