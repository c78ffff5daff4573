//! Relay in the network of a firmware: forwards datagrams, or what a stream brings at once, between bridge and vehicle with delays and
//! losses, records the set-points that reach the vehicle, and injects datagrams of another ground station.

mod ends;

use std::fs::File;
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;

use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::{CrtpPacket, CrtpRequest};
use oqtal_wire::mavlink::{MavlinkContent, MavlinkDecoder};
use oqtal_wire::msp::{MspChannelMap, MspDecoder, MspSticks, command};
use rustix::event::Timespec;
use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};

use crate::common::random::Random;
use ends::RelayEnds;
pub use ends::RelayPorts;

/// Longest wait for a datagram.
const WAIT: Timespec = Timespec { tv_sec: 0, tv_nsec: 500_000 };
const LONGEST: usize = 2048;
/// Ends of the relay.
const NEAR: usize = 0;
const FAR: usize = 1;

/// Set-point forwarded to the vehicle.
#[derive(Clone, Copy, Debug)]
pub struct PassedSetpoint {
    /// Instants at which the bridge sent it, and at which it left the relay.
    pub sent_at: Time,
    pub passed_at: Time,
    /// Whether the set-point has thrust.
    pub flies: bool,
}

/// Handling of datagrams by the relay, and its observations.
pub struct RelayState {
    /// Probability that a datagram is lost \[0..1\].
    pub loss: f64,
    /// Greatest delay of a datagram \[ms\].
    pub jitter_ms: f64,
    pub is_silent: bool,
    /// Injected datagrams of another ground station for the vehicle.
    pub injected: Vec<Vec<u8>>,
    pub setpoints: Vec<PassedSetpoint>,
    pub lost: u64,
    random: Random,
}

pub struct Relay {
    state: Arc<Mutex<RelayState>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Relay {
    /// Starts a relay in the network namespace of this name.
    pub fn start(ports: &'static RelayPorts, network: &str) -> Self {
        let state = Arc::new(Mutex::new(RelayState {
            loss: 0.0,
            jitter_ms: 0.0,
            is_silent: false,
            injected: Vec::new(),
            setpoints: Vec::new(),
            lost: 0,
            random: Random(1),
        }));
        let stop = Arc::new(AtomicBool::new(false));
        let network = File::open(format!("/run/netns/{network}")).unwrap();
        let (shared, ended) = (Arc::clone(&state), Arc::clone(&stop));
        let thread = std::thread::spawn(move || {
            move_into_link_name_space(network.as_fd(), Some(LinkNameSpaceType::Network)).unwrap();
            let mut exchange = Exchange::open(ports);
            while !ended.load(Ordering::Relaxed) {
                exchange.turn(&shared);
            }
        });
        Self { state, stop, thread: Some(thread) }
    }

    pub fn state(&self) -> MutexGuard<'_, RelayState> {
        self.state.lock().unwrap()
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Datagram in transit.
struct Waiting {
    to: usize,
    sent_at: Time,
    due: Time,
    bytes: Vec<u8>,
}

struct Exchange {
    ends: RelayEnds,
    waiting: Vec<Waiting>,
}

impl Exchange {
    fn open(ports: &RelayPorts) -> Self {
        Self { ends: RelayEnds::open(ports), waiting: Vec::new() }
    }

    fn turn(&mut self, state: &Mutex<RelayState>) {
        self.ends.wait(&WAIT);
        let state = &mut *state.lock().unwrap();
        for end in [NEAR, FAR] {
            self.read(end, state);
        }
        for bytes in std::mem::take(&mut state.injected) {
            self.ends.send(FAR, &bytes);
        }
        let now = Time::now();
        let (due, waiting) =
            std::mem::take(&mut self.waiting).into_iter().partition(|w| w.due <= now);
        self.waiting = waiting;
        let due: Vec<Waiting> = due;
        for datagram in due {
            self.ends.send(datagram.to, &datagram.bytes);
            let flies = thrust_of(&datagram.bytes).filter(|_| datagram.to == FAR);
            let Some(flies) = flies else { continue };
            let sent_at = datagram.sent_at;
            state.setpoints.push(PassedSetpoint { sent_at, passed_at: now, flies });
        }
    }

    fn read(&mut self, end: usize, state: &mut RelayState) {
        let mut buffer = [0; LONGEST];
        while let Some(length) = self.ends.receive(end, &mut buffer) {
            let is_lost = state.loss > 0.0 && state.random.between(0.0, 1.0) < state.loss;
            if state.is_silent || is_lost {
                state.lost += 1;
                continue;
            }
            let sent_at = Time::now();
            let delay = match state.jitter_ms > 0.0 {
                true => state.random.between(0.0, state.jitter_ms),
                false => 0.0,
            };
            let mut due = sent_at + Span::from_seconds(delay * 1e-3);
            if self.ends.keep_order() {
                let before = self.waiting.iter().filter(|waiting| waiting.to == 1 - end);
                due = before.map(|waiting| waiting.due).fold(due, Time::max);
            }
            let bytes = buffer[..length].to_vec();
            self.waiting.push(Waiting { to: 1 - end, sent_at, due, bytes });
        }
    }
}

/// Whether a set-point has thrust; `None` for any other datagram.
fn thrust_of(bytes: &[u8]) -> Option<bool> {
    let packet = MavlinkDecoder::new().push(bytes).next();
    if let Some(packet) = packet {
        let MavlinkContent::AttitudeTarget(target) = packet.content else { return None };
        return Some(target.thrust > 0.0);
    }
    if let Some(packet) =
        MspDecoder::new().push(bytes).find(|packet| packet.command == command::CHANNELS)
    {
        let (sticks, _) = MspSticks::read(packet.payload(), MspChannelMap::FACTORY)?;
        return Some(sticks.throttle > 0.0);
    }
    match CrtpRequest::read(&CrtpPacket::parse(bytes).ok()?) {
        Some(CrtpRequest::Setpoint(setpoint)) => Some(setpoint.thrust > 0),
        _ => None,
    }
}
