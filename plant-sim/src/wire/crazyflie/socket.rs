//! The emulated Crazyflie as a process: one packet a datagram over UDP, as its firmware has it in the loop. Answers go to the host
//! that sent last.

use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};

use oqtal_bus::message::HealthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::TRUTH;
use oqtal_bus::transport::Transport;
use oqtal_runtime::faults::RadioFaults;
use oqtal_runtime::process::{Exit, Failure, ProcessContext};
use oqtal_wire::crtp::{CrtpPacket, MAX_CRTP_PACKET};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use super::super::{heartbeat, publish_truth};
use super::vehicle::CrtpVehicle;
use crate::turn::tell_skipped;

/// Longest wait for a packet.
const LONGEST_WAIT: Span = Span::from_millis(20);
/// Most packets read in one turn \[-\].
const MAX_READS: usize = 32;

/// Flies the emulated Crazyflie at the UDP address `address` until asked to stop. Its state goes through its packets alone; the
/// truth is published for the cameras.
///
/// # Errors
/// The address cannot be bound; the bus refuses or breaks.
pub fn run_crazyflie(context: &ProcessContext, address: &str) -> Result<(), Failure> {
    let bus = context.bus()?;
    let mut socket = HostSocket::bind(address)?;
    let mut truths = bus.writer(&TRUTH)?;
    let mut heartbeat = heartbeat(context, &bus)?;
    let mut vehicle = CrtpVehicle::new(&context.config, Time::now())
        .map_err(|error| context.config.locate(&error))?;
    let mut outputs = Vec::with_capacity(64);
    let mut radio = RadioFaults::open(&bus, &context.config)?;
    tracing::info!(address, "the emulated Crazyflie waits for a host");
    context.enter_realtime();
    while !context.stop.is_set() {
        context.health.count_turn();
        socket.wait(vehicle.next_event())?;
        heartbeat.beat(HealthV1::default())?;
        let now = Time::now();
        vehicle.disturb_radio(radio.at(now)?);
        tell_skipped(vehicle.skip_pause(now));
        for packet in (0..MAX_READS).map_while(|_| socket.read()) {
            context.health.count_input();
            vehicle.host_sends(now, packet);
        }
        vehicle.advance(now, |output| outputs.push(output));
        if !outputs.is_empty() {
            context.health.count_output();
        }
        publish_truth(&mut truths, outputs.drain(..))?;
        while let Some(packet) = vehicle.host_receives(now) {
            socket.write(&packet);
        }
    }
    let [(sent_up, lost_up), (sent_down, lost_down)] = vehicle.traffic();
    tracing::info!(sent_up, lost_up, sent_down, lost_down, "the wire is closed");
    Ok(())
}

/// UDP socket, and the host that sent last.
#[derive(Debug)]
struct HostSocket {
    socket: UdpSocket,
    host: Option<SocketAddr>,
}

impl HostSocket {
    fn bind(address: &str) -> Result<Self, Failure> {
        let failed = |error: std::io::Error| {
            let (exit, remedy) = match error.kind() {
                ErrorKind::AddrInUse => {
                    (Exit::Peer, "; stop the process that uses it, or name another port")
                }
                ErrorKind::AddrNotAvailable => {
                    (Exit::Config, "; name an address of this machine, as 127.0.0.1")
                }
                ErrorKind::PermissionDenied => (Exit::Permission, "; name a port above 1023"),
                _ => (Exit::System, ""),
            };
            Failure::new(exit, format!("opening {address} failed: {error}{remedy}"))
        };
        let socket = UdpSocket::bind(address).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        Ok(Self { socket, host: None })
    }

    /// Sleeps until `until`, or until a packet arrives, at most [`LONGEST_WAIT`].
    fn wait(&self, until: Time) -> Result<(), Failure> {
        let left = until.since(Time::now()).clamp(Span::ZERO, LONGEST_WAIT).to_duration();
        let timeout = Timespec::try_from(left).unwrap_or_default();
        match poll(&mut [PollFd::new(&self.socket, PollFlags::IN)], Some(&timeout)) {
            Ok(_) | Err(Errno::INTR) => Ok(()),
            Err(error) => {
                Err(Failure::new(Exit::System, format!("waiting for packets failed: {error}")))
            }
        }
    }

    /// The next packet; datagrams that are none are discarded.
    fn read(&mut self) -> Option<CrtpPacket> {
        let mut buffer = [0; MAX_CRTP_PACKET + 1];
        for _ in 0..MAX_READS {
            let (length, host) = match self.socket.recv_from(&mut buffer) {
                Ok(received) => received,
                // The host that was answered last has gone.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => continue,
                Err(_) => return None,
            };
            if let Ok(packet) = CrtpPacket::parse(&buffer[..length]) {
                self.host = Some(host);
                return Some(packet);
            }
        }
        None
    }

    /// Sends a packet to the host; without one, or where the network takes none, it is lost.
    fn write(&self, packet: &CrtpPacket) {
        if let Some(host) = self.host {
            let _ = self.socket.send_to(packet.as_bytes(), host);
        }
    }
}
