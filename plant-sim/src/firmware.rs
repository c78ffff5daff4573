//! The plant as the body of a Crazyflie's firmware that runs as a program: its rotors turn as the firmware commands, its sensors
//! feed the firmware, and CRTP packets of a client are passed on. The state of the vehicle goes over CRTP alone; the truth is
//! published for the cameras.
//!
//! | file | subject |
//! |---|---|
//! | `body.rs` | rotors and inertial sensors, pure |
//! | `relay.rs` | CRTP packets on their way, with the faults of the radio, pure |

mod body;
mod relay;

use std::net::SocketAddr;

use oqtal_bus::bus::Bus;
use oqtal_bus::message::{HealthV1, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::TRUTH;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_runtime::health::Heartbeat;
use oqtal_runtime::process::{Failure, ProcessContext};
use oqtal_wire::crazyflie_sitl::{FirmwarePacket, HELLO, MAX_DATAGRAM, is_from_client};

use crate::disturbance::{DisturbanceClock, SceneDisturbance};
use crate::socket::{self, PeerSocket};
use crate::turn::tell_skipped;
use crate::wire::LinkDirection;

pub use body::{BodyOutput, FirmwareBody, ImuDatagram};
pub use relay::{CrtpRelay, Datagram};

/// Most datagrams that are read in one turn from each socket \[-\].
const MOST_READ: usize = 64;
/// Most samples of the sensors that are sent in one turn \[-\]: the firmware's queue holds five packets.
const MOST_IMU: usize = 3;
/// Time by which the body may be ahead of the firmware's last motor values: a little more than between two of them. A processor
/// that is busy delays the firmware by more than its loops stand; the body then stands still instead.
const LEAD: Span = Span::from_millis(3);
/// Longest time for which the body waits for motor values.
const PATIENCE: Span = Span::from_millis(20);
/// Time without motor values after which the firmware counts as dead.
const FIRMWARE_TIMEOUT: Span = Span::from_millis(250);

/// Addresses of a firmware's body.
#[derive(Clone, Copy, Debug)]
pub struct BodyAddresses {
    /// At which it waits for the firmware.
    pub body: SocketAddr,
    /// At which a client reaches the firmware.
    pub crtp: SocketAddr,
}

/// Flies the body of a firmware until asked to stop.
///
/// # Errors
/// An address cannot be used; the bus refuses or breaks.
pub fn run(context: &ProcessContext, addresses: BodyAddresses) -> Result<(), Failure> {
    let bus = context.bus()?;
    let mut truths = bus.writer(&TRUTH)?;
    let mut heartbeat =
        Heartbeat::new(&bus, context.role, HealthV1::OWN_CONFIG, context.health.clone())?;
    let mut disturbances = DisturbanceClock::open(&bus, &context.config)?;
    let mut link = FirmwareLink::open(context, addresses)?;
    tracing::info!(address = %addresses.body, "the body waits for its firmware");
    context.enter_realtime();
    while !context.stop.is_set() {
        context.health.count_turn();
        socket::wait([&link.firmware, &link.client], link.next_event())?;
        heartbeat.beat(HealthV1::default())?;
        let now = Time::now();
        link.disturb(disturbances.at(now)?);
        tell_skipped(link.body.skip_pause(now - link.slip));
        if link.read(now) {
            context.health.count_input();
        }
        let mut published = Ok(());
        link.advance(now, |truth| {
            if published.is_ok() {
                published = publish(&mut truths, truth);
            }
        });
        published?;
        context.health.count_output();
        link.pass_on(now);
    }
    tracing::info!(
        lost_packets = link.relay.lost(),
        late_samples = link.late_samples,
        waited_s = link.slip.seconds(),
        "the body is at rest"
    );
    Ok(())
}

/// The next datagram at `socket` and its sender; one that is too long counts as empty.
fn read(socket: &PeerSocket) -> Option<(Datagram, SocketAddr)> {
    let mut bytes = [0; MAX_DATAGRAM + 1];
    let (length, sender) = socket.read(&mut bytes)?;
    let datagram = Datagram::new(&bytes[..length]).or_else(|| Datagram::new(&[]));
    datagram.map(|datagram| (datagram, sender))
}

/// Publishes a truth sample, and wakes the cameras at those that they capture.
fn publish(
    truths: &mut <Bus as Transport>::Writer<TruthV1>,
    truth: TruthV1,
) -> Result<(), oqtal_bus::error::BusError> {
    truths.send(truth.capture, Default::default(), truth)?;
    if truth.capture > 0 { truths.notify() } else { Ok(()) }
}

/// Body, firmware, and the client that flies it.
#[derive(Debug)]
struct FirmwareLink {
    body: FirmwareBody,
    relay: CrtpRelay,
    firmware: PeerSocket,
    client: PeerSocket,
    /// When motor values last arrived; `None` while the firmware is not running.
    heard_at: Option<Time>,
    /// The body's time then.
    body_heard_at: Time,
    /// Time for which the body has waited for the firmware: its own time is behind by so much.
    slip: Span,
    /// Samples that were not sent, because the process was late \[-\].
    late_samples: u64,
}

impl FirmwareLink {
    /// Disturbs body and radio from now on.
    fn disturb(&mut self, disturbance: SceneDisturbance) {
        self.relay.disturb(disturbance.radio);
        self.body.disturb(disturbance);
    }

    fn open(context: &ProcessContext, addresses: BodyAddresses) -> Result<Self, Failure> {
        let config = &context.config;
        Ok(Self {
            firmware: PeerSocket::open(addresses.body, "the firmware")?,
            client: PeerSocket::open(addresses.crtp, "its client")?,
            body: FirmwareBody::new(config, Time::now()),
            relay: CrtpRelay::new(config.clock.seed),
            heard_at: None,
            body_heard_at: Time::UNSET,
            slip: Span::ZERO,
            late_samples: 0,
        })
    }

    /// Reads what has arrived at both sockets; returns whether motor values did.
    fn read(&mut self, now: Time) -> bool {
        let mut driven = false;
        for _ in 0..MOST_READ {
            let Some((datagram, sender)) = read(&self.firmware) else { break };
            match FirmwarePacket::decode(datagram.as_bytes()) {
                FirmwarePacket::Hello => self.greet(sender),
                FirmwarePacket::Motors(motors) => {
                    driven = true;
                    self.heard_at = Some(now);
                    self.body_heard_at = self.body.time();
                    self.body.drive(motors);
                }
                FirmwarePacket::Calibrated => tracing::info!("the firmware has calibrated"),
                FirmwarePacket::Client => self.relay.push(LinkDirection::Down, now, datagram),
                FirmwarePacket::Invalid => {}
            }
        }
        for _ in 0..MOST_READ {
            let Some((datagram, sender)) = read(&self.client) else { break };
            if is_from_client(datagram.as_bytes()) {
                self.client.accept(sender);
                self.relay.push(LinkDirection::Up, now, datagram);
            }
        }
        self.watch_firmware(now);
        driven
    }

    /// Answers a firmware that has just started.
    fn greet(&mut self, sender: SocketAddr) {
        if self.firmware.accept(sender) {
            tracing::info!(firmware = %sender, "the firmware has started");
        }
        self.firmware.send(&HELLO);
    }

    /// Tells that the firmware is silent; the plant stops the motors by itself.
    fn watch_firmware(&mut self, now: Time) {
        if self.heard_at.is_some_and(|at| now.since(at) > FIRMWARE_TIMEOUT) {
            self.heard_at = None;
            tracing::warn!("the firmware is silent, its motors are off");
        }
    }

    /// The next instant at which there is something to do without a datagram.
    fn next_event(&self) -> Time {
        let next = self.body.next_event() + self.slip;
        match self.heard_at {
            Some(at) if self.body.next_event() > self.body_heard_at + LEAD => {
                next.max(at + PATIENCE)
            }
            _ => next,
        }
    }

    /// The body's time at `now`; the body waits for a firmware that is late.
    fn body_time(&mut self, now: Time) -> Time {
        let wanted = now - self.slip;
        let is_awaited = self.heard_at.is_some_and(|at| now.since(at) < PATIENCE);
        let until = if is_awaited { wanted.min(self.body_heard_at + LEAD) } else { wanted };
        let until = until.max(self.body.time());
        self.slip = now.since(until);
        until
    }

    /// Integrates to `now`; sends samples of the sensors, and with them at most one packet of the client: the firmware has one short
    /// queue for both.
    fn advance(&mut self, now: Time, mut truth: impl FnMut(TruthV1)) {
        let until = self.body_time(now);
        let Self { body, relay, firmware, late_samples, slip, .. } = self;
        let mut sent = 0;
        body.advance(until, |output| match output {
            BodyOutput::Truth(sample) => truth(TruthV1 { time: sample.time + *slip, ..sample }),
            BodyOutput::Imu(_) if sent >= MOST_IMU => *late_samples += 1,
            BodyOutput::Imu(datagram) => {
                sent += 1;
                firmware.send(&datagram);
            }
        });
        let packet = (sent > 0 && firmware.has_peer()).then(|| relay.pop(LinkDirection::Up, now));
        if let Some(packet) = packet.flatten() {
            firmware.send(packet.as_bytes());
        }
    }

    /// Passes on what the firmware sends to its client.
    fn pass_on(&mut self, now: Time) {
        while let Some(packet) = self.relay.pop(LinkDirection::Down, now) {
            self.client.send(packet.as_bytes());
        }
    }
}
