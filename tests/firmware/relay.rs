//! Relay in the network of a firmware: forwards datagrams between bridge and vehicle with delays and losses, records the
//! set-points that reach the vehicle, and injects datagrams of another ground station.

use std::fs::File;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;

use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::{CrtpPacket, CrtpRequest};
use oqtal_wire::mavlink::{MavlinkContent, MavlinkDecoder};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};

use crate::common::random::Random;

/// Longest wait for a datagram.
const WAIT: Timespec = Timespec { tv_sec: 0, tv_nsec: 500_000 };
const LONGEST: usize = 2048;
/// Ends of the relay.
const NEAR: usize = 0;
const FAR: usize = 1;

/// Addresses of a relay: its own, and those of bridge and vehicle unless they are learned from received datagrams.
pub struct RelayPorts {
    pub near: &'static str,
    pub near_peer: Option<&'static str>,
    pub far: &'static str,
    pub far_peer: Option<&'static str>,
}

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
    sockets: [UdpSocket; 2],
    peers: [Option<SocketAddr>; 2],
    waiting: Vec<Waiting>,
}

impl Exchange {
    fn open(ports: &RelayPorts) -> Self {
        let bind = |address: &str| {
            let socket = UdpSocket::bind(address).unwrap();
            socket.set_nonblocking(true).unwrap();
            socket
        };
        let peer = |peer: Option<&str>| peer.map(|address| address.parse().unwrap());
        Self {
            sockets: [bind(ports.near), bind(ports.far)],
            peers: [peer(ports.near_peer), peer(ports.far_peer)],
            waiting: Vec::new(),
        }
    }

    fn turn(&mut self, state: &Mutex<RelayState>) {
        let mut fds = self.sockets.each_ref().map(|socket| PollFd::new(socket, PollFlags::IN));
        let _ = poll(&mut fds, Some(&WAIT));
        let state = &mut *state.lock().unwrap();
        for end in [NEAR, FAR] {
            self.read(end, state);
        }
        for bytes in std::mem::take(&mut state.injected) {
            self.send(FAR, &bytes);
        }
        let now = Time::now();
        let (due, waiting) =
            std::mem::take(&mut self.waiting).into_iter().partition(|w| w.due <= now);
        self.waiting = waiting;
        let due: Vec<Waiting> = due;
        for datagram in due {
            self.send(datagram.to, &datagram.bytes);
            let flies = thrust_of(&datagram.bytes).filter(|_| datagram.to == FAR);
            let Some(flies) = flies else { continue };
            let sent_at = datagram.sent_at;
            state.setpoints.push(PassedSetpoint { sent_at, passed_at: now, flies });
        }
    }

    fn read(&mut self, end: usize, state: &mut RelayState) {
        let mut buffer = [0; LONGEST];
        while let Ok((length, sender)) = self.sockets[end].recv_from(&mut buffer) {
            self.peers[end] = Some(sender);
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
            let due = sent_at + Span::from_seconds(delay * 1e-3);
            let bytes = buffer[..length].to_vec();
            self.waiting.push(Waiting { to: 1 - end, sent_at, due, bytes });
        }
    }

    fn send(&self, to: usize, bytes: &[u8]) {
        if let Some(peer) = self.peers[to] {
            // A firmware that has ended does not receive.
            let _ = self.sockets[to].send_to(bytes, peer);
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
    match CrtpRequest::read(&CrtpPacket::parse(bytes).ok()?) {
        Some(CrtpRequest::Setpoint(setpoint)) => Some(setpoint.thrust > 0),
        _ => None,
    }
}
