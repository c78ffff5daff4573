//! The simulator within an autopilot that runs as a program, in place of the plant: its truth, which it reports over MAVLink, is
//! published for the cameras. The autopilot is commanded by a bridge over a link of its own.

mod observer;

use std::net::SocketAddr;

use oqtal_bus::message::HealthV1;
use oqtal_bus::time::{Grid, Span, Time};
use oqtal_bus::topic::TRUTH;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_runtime::health::Heartbeat;
use oqtal_runtime::process::{Failure, ProcessContext};
use oqtal_wire::simulator::{SimulatorDecoder, truth_requests};

use crate::socket::{self, PeerSocket};

pub use observer::MotionObserver;

/// Most datagrams that are read in one turn \[-\].
const MOST_READ: usize = 64;
/// Longest datagram that is read \[bytes\].
const MAX_DATAGRAM: usize = 2048;
/// Time between two requests for the truth: an autopilot that was rebooted has forgotten the last one.
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
        truths.send(
            capture,
            Default::default(),
            oqtal_bus::message::TruthV1 { capture, ..truth },
        )?;
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
    decoder: SimulatorDecoder,
    observer: MotionObserver,
    /// System and component ids, once it was heard \[-\].
    ids: Option<(u8, u8)>,
    requested_at: Time,
    /// Number of the next packet \[-\].
    sequence: u8,
}

impl SimulatedAutopilot {
    fn open(address: SocketAddr) -> Result<Self, Failure> {
        Ok(Self {
            socket: PeerSocket::open(address, "the autopilot's truth")?,
            decoder: SimulatorDecoder::default(),
            observer: MotionObserver::default(),
            ids: None,
            requested_at: Time::UNSET,
            sequence: 0,
        })
    }

    /// Reads what has arrived; returns whether the motion was reported.
    fn read(&mut self, now: Time) -> bool {
        let Self { socket, decoder, observer, ids, .. } = self;
        let (mut buffer, mut has_news) = ([0; MAX_DATAGRAM], false);
        for _ in 0..MOST_READ {
            let Some((length, sender)) = socket.read(&mut buffer) else { break };
            let mut heard = *ids;
            decoder.push(
                &buffer[..length],
                |system, component| heard = Some((system, component)),
                |report| {
                    has_news = true;
                    observer.take(now, &report);
                },
            );
            if heard.is_some() && socket.accept(sender) {
                tracing::info!(autopilot = %sender, "the autopilot has started");
                self.requested_at = Time::UNSET;
            }
            *ids = heard;
        }
        has_news
    }

    /// Asks for the truth, once a second.
    fn request(&mut self, now: Time) {
        let Some((system, component)) = self.ids else { return };
        if now.since(self.requested_at) < REQUEST_PERIOD {
            return;
        }
        self.requested_at = now;
        for packet in truth_requests(system, component, self.sequence) {
            self.socket.send(&packet);
            self.sequence = self.sequence.wrapping_add(1);
        }
    }
}
