//! The simulator within an autopilot that runs as a program, in place of the plant: its truth, which it reports over MAVLink, is
//! published for the cameras. The autopilot is commanded by a bridge over a link of its own.

mod observer;

use std::net::SocketAddr;

use oqtal_bus::message::{HealthV1, TruthV1};
use oqtal_bus::time::{Grid, Span, Time};
use oqtal_bus::topic::TRUTH;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_runtime::health::Heartbeat;
use oqtal_runtime::process::{Failure, ProcessContext};
use oqtal_wire::mavlink::{
    CommandKind, MavlinkAddress, MavlinkContent, MavlinkDecoder, MavlinkEncoder, VehicleCommandLong,
};

use crate::socket::{self, PeerSocket};

pub use observer::SimulatorObserver;

/// Most datagrams that are read in one turn \[-\].
const MOST_READ: usize = 64;
/// Longest datagram that is read \[bytes\].
const MAX_DATAGRAM: usize = 2048;
/// Address of this process among MAVLink's systems: a program on the ground that controls nothing.
const OWN: MavlinkAddress = MavlinkAddress { system: 254, component: 191 };
/// Messages with the truth: SIM_STATE of ArduPilot, HIL_STATE_QUATERNION of PX4.
const TRUTH_MESSAGES: [u32; 2] = [108, 115];
/// Time between two of them that is asked for \[us\]; an autopilot sends as often as it can.
const TRUTH_INTERVAL_US: u32 = 4000;
/// Time without the truth after which it is asked for again: an autopilot that was rebooted has forgotten the last request.
const REQUEST_PERIOD: Span = Span::from_millis(1000);

/// Publishes the truth of the autopilot that sends to `address`, until asked to stop.
///
/// # Errors
/// The address cannot be used; the bus refuses or breaks.
pub fn run(context: &ProcessContext, address: SocketAddr) -> Result<(), Failure> {
    let bus = context.bus()?;
    let mut truths = bus.writer(&TRUTH)?;
    let mut heartbeat =
        Heartbeat::new(&bus, context.role, HealthV1::OWN_CONFIG, context.health.clone())?;
    let mut autopilot = SimulatedAutopilot::open(address)?;
    let mut camera = Grid::new(Time::now(), context.config.plant.frame_rate_hz);
    tracing::info!(%address, "waiting for an autopilot that simulates its vehicle");
    context.enter_realtime();
    while !context.stop.is_set() {
        context.health.count_turn();
        socket::wait([&autopilot.socket], camera.next())?;
        heartbeat.beat(HealthV1::default())?;
        let now = Time::now();
        let has_news = autopilot.read(now);
        autopilot.request(now);
        if has_news {
            context.health.count_input();
        }
        let is_captured = camera.next() <= now;
        if is_captured {
            camera.skip_to(now);
        }
        let Some(truth) = autopilot.observer.truth(now).filter(|_| has_news || is_captured) else {
            continue;
        };
        context.health.count_output();
        let capture = if is_captured { camera.index() } else { 0 };
        truths.send(capture, Default::default(), TruthV1 { capture, ..truth })?;
        if is_captured {
            truths.notify()?;
        }
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
    /// Its address, once it was heard.
    address: Option<MavlinkAddress>,
    requested_at: Time,
    reported_at: Time,
}

impl SimulatedAutopilot {
    fn open(address: SocketAddr) -> Result<Self, Failure> {
        Ok(Self {
            socket: PeerSocket::open(address, "the autopilot's truth")?,
            decoder: MavlinkDecoder::new(),
            encoder: MavlinkEncoder::new(OWN),
            observer: SimulatorObserver::default(),
            address: None,
            requested_at: Time::UNSET,
            reported_at: Time::UNSET,
        })
    }

    /// Reads what has arrived; returns whether the motion was reported.
    fn read(&mut self, now: Time) -> bool {
        let Self { socket, decoder, observer, address, .. } = self;
        let (mut buffer, mut has_news) = ([0; MAX_DATAGRAM], false);
        for _ in 0..MOST_READ {
            let Some((length, sender)) = socket.read(&mut buffer) else { break };
            for packet in decoder.push(&buffer[..length]) {
                if packet.from.component == MavlinkAddress::AUTOPILOT {
                    *address = Some(packet.from);
                }
                if let MavlinkContent::Truth(sample) = packet.content {
                    has_news = true;
                    observer.take(now, &sample);
                }
            }
            if address.is_some() && socket.accept(sender) {
                tracing::info!(autopilot = %sender, "the autopilot has started");
                self.requested_at = Time::UNSET;
            }
        }
        if has_news {
            self.reported_at = now;
        }
        has_news
    }

    /// Asks for the truth where it is missing.
    fn request(&mut self, now: Time) {
        let Some(target) = self.address else { return };
        let missing_since = match self.requested_at.is_set() {
            true => self.requested_at.max(self.reported_at),
            false => Time::UNSET,
        };
        if now.since(missing_since) < REQUEST_PERIOD {
            return;
        }
        self.requested_at = now;
        for message in TRUTH_MESSAGES {
            let kind = CommandKind::MessageInterval { message, interval_us: TRUTH_INTERVAL_US };
            let command = VehicleCommandLong { target, kind, confirmation: 0 };
            if let Some(packet) = self.encoder.encode(&MavlinkContent::Command(command)) {
                self.socket.send(packet.as_bytes());
            }
        }
    }
}
