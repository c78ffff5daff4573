//! One Crazyradio for several bridges: each vehicle has a UDP address of this machine, which its bridge names as
//! `crtp:udp:HOST:PORT`.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::str::FromStr;

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure, stop_on_signals};
use oqtal_wire::crtp::{CrtpPacket, MAX_CRTP_PACKET};
use oqtal_wire::link::RadioSpec;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use super::dongle::RadioDongle;
use super::usb::UsbDongle;
use super::worker::RadioWorker;
use crate::link::PortOpenError;

/// Longest wait for packets of bridges.
const LONGEST_WAIT: Span = Span::from_millis(20);
/// Most packets read from one bridge in one turn, including those of other senders \[-\].
const MAX_READS: usize = 8;
/// Time without a packet of a vehicle's bridge after which another bridge can take over the vehicle. A bridge that works sends a set-point
/// in every period.
const BRIDGE_SILENCE: Span = Span::from_millis(1000);

/// Vehicle on a shared radio, as `80/2M/E7E7E7E701@127.0.0.1:19851`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SharedVehicle {
    /// Radio of the vehicle.
    pub radio: RadioSpec,
    /// Address for the bridge of the vehicle.
    pub address: SocketAddr,
}

/// Options of a radio that several vehicles share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadioShareOptions {
    /// Greatest rate of packets other than set-points to each vehicle \[1/s\].
    pub packets_per_s: f64,
    /// Whether poses of two vehicles on one channel share a packet.
    pub packs_poses: bool,
}

impl FromStr for SharedVehicle {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = "write CHANNEL/RATE/ADDRESS@IP:PORT, as 80/2M/E7E7E7E701@127.0.0.1:19851";
        let (radio, address) = text.split_once('@').ok_or_else(|| form.to_owned())?;
        let address = address.parse().map_err(|error| format!("{error}; {form}"))?;
        Ok(Self { radio: radio.parse()?, address })
    }
}

/// Shares the first Crazyradio among `vehicles` until a stop is requested.
///
/// # Errors
/// There is no radio, or it is lost; an address is in use, or named twice.
pub fn share_radio(vehicles: &[SharedVehicle], options: RadioShareOptions) -> Result<(), Failure> {
    let stop = stop_on_signals()?;
    let mut bridges = vehicles.iter().map(BridgeSocket::bind).collect::<Result<Vec<_>, _>>()?;
    let radios = vehicles.iter().map(|vehicle| vehicle.radio).collect();
    let mut worker = RadioWorker::new(UsbDongle::open()?, radios, options.packets_per_s);
    if options.packs_poses {
        worker.pack_poses();
    }
    for SharedVehicle { radio, address } in vehicles {
        tracing::info!("{radio} is at crtp:udp:{address}");
    }
    while !stop.is_set() {
        let now = Time::now();
        wait(&bridges, worker.next_event().unwrap_or(now + LONGEST_WAIT).since(now))?;
        turn(&mut worker, &mut bridges, &mut Time::now).map_err(|error| {
            Failure::new(Exit::System, format!("the Crazyradio is lost: {error}; plug it in again"))
        })?;
        worker.give_account(Time::now());
    }
    Ok(())
}

/// Takes what bridges sent, exchanges one packet with a vehicle, and passes its reply on.
fn turn<D: RadioDongle>(
    worker: &mut RadioWorker<D>,
    bridges: &mut [BridgeSocket],
    clock: &mut dyn FnMut() -> Time,
) -> io::Result<()> {
    for (index, bridge) in bridges.iter_mut().enumerate() {
        for _ in 0..MAX_READS {
            let now = clock();
            match bridge.read(now) {
                Received::Packet(packet) => worker.push(now, index, packet),
                Received::OfAnother => {}
                Received::Nothing => break,
            }
        }
    }
    if let Some((vehicle, Some(reply))) = worker.exchange(clock)? {
        bridges[vehicle].write(&reply);
    }
    Ok(())
}

/// Sleeps for at most `left`, or until a bridge sends.
fn wait(bridges: &[BridgeSocket], left: Span) -> Result<(), Failure> {
    let left = left.clamp(Span::ZERO, LONGEST_WAIT).to_duration();
    let timeout = Timespec::try_from(left).unwrap_or_default();
    let mut fds: Vec<PollFd> =
        bridges.iter().map(|bridge| PollFd::new(&bridge.socket, PollFlags::IN)).collect();
    match poll(&mut fds, Some(&timeout)) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => {
            Err(Failure::new(Exit::System, format!("waiting for bridges failed: {error}")))
        }
    }
}

/// Result of a read from a socket.
#[derive(Debug, PartialEq)]
enum Received {
    /// A packet of the vehicle's bridge.
    Packet(CrtpPacket),
    /// A packet of another sender, which is discarded.
    OfAnother,
    /// None.
    Nothing,
}

/// Socket for the bridge of one vehicle: the first sender keeps the vehicle until it has been silent for [`BRIDGE_SILENCE`].
#[derive(Debug)]
struct BridgeSocket {
    vehicle: RadioSpec,
    socket: UdpSocket,
    /// The bridge, and the arrival of its last packet.
    bridge: Option<(SocketAddr, Time)>,
}

impl BridgeSocket {
    fn bind(vehicle: &SharedVehicle) -> Result<Self, PortOpenError> {
        let address = vehicle.address.to_string();
        let refused = |error: io::Error| match error.kind() {
            ErrorKind::AddrInUse => PortOpenError::AddressInUse { address: address.clone() },
            ErrorKind::AddrNotAvailable => PortOpenError::NotLocal { address: address.clone() },
            _ => PortOpenError::System { port: address.clone(), reason: error.to_string() },
        };
        let socket = UdpSocket::bind(vehicle.address).map_err(refused)?;
        socket.set_nonblocking(true).map_err(refused)?;
        Ok(Self { vehicle: vehicle.radio, socket, bridge: None })
    }

    fn read(&mut self, now: Time) -> Received {
        let mut buffer = [0; MAX_CRTP_PACKET + 1];
        let Ok((length, sender)) = self.socket.recv_from(&mut buffer) else {
            return Received::Nothing;
        };
        let is_held = |(bridge, heartbeat_at): (SocketAddr, Time)| {
            bridge != sender && now.since(heartbeat_at) <= BRIDGE_SILENCE
        };
        if self.bridge.is_some_and(is_held) {
            return Received::OfAnother;
        }
        if self.bridge.is_none_or(|(bridge, _)| bridge != sender) {
            tracing::info!(vehicle = %self.vehicle, bridge = %sender, "a bridge has the vehicle");
        }
        self.bridge = Some((sender, now));
        Received::Packet(CrtpPacket::parse(&buffer[..length]).unwrap_or(CrtpPacket::NULL))
    }

    fn write(&self, packet: &CrtpPacket) {
        if let Some((bridge, _)) = self.bridge {
            // Send errors of a bridge that has ended are ignored.
            let _ = self.socket.send_to(packet.as_bytes(), bridge);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::RadioAck;
    use oqtal_wire::crtp::{CrtpRequest, LegacySetpoint};

    /// Radio whose vehicles answer every packet with it.
    #[derive(Debug)]
    struct Mirror;

    impl RadioDongle for Mirror {
        fn exchange(&mut self, _: &RadioSpec, packet: &CrtpPacket) -> io::Result<RadioAck> {
            Ok(RadioAck { is_acknowledged: true, repeated: 0, reply: Some(*packet) })
        }

        fn broadcast(&mut self, _: &RadioSpec, _: &CrtpPacket) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn each_bridge_is_answered_by_its_own_vehicle() {
        let vehicle = |id: u8| SharedVehicle {
            radio: format!("80/2M/E7E7E7E7{id:02X}").parse().unwrap(),
            address: "127.0.0.1:0".parse().unwrap(),
        };
        let vehicles = [vehicle(1), vehicle(2)];
        let mut sockets: Vec<BridgeSocket> =
            vehicles.iter().map(|vehicle| BridgeSocket::bind(vehicle).unwrap()).collect();
        let bridges: Vec<UdpSocket> = sockets
            .iter()
            .map(|socket| {
                let bridge = UdpSocket::bind("127.0.0.1:0").unwrap();
                bridge.connect(socket.socket.local_addr().unwrap()).unwrap();
                bridge
            })
            .collect();
        let sent = [1, 2].map(|thrust| {
            CrtpRequest::Setpoint(LegacySetpoint { thrust, ..LegacySetpoint::ZERO }).packet()
        });
        for (bridge, packet) in bridges.iter().zip(&sent) {
            bridge.send(packet.as_bytes()).unwrap();
        }
        let radios = vehicles.iter().map(|vehicle| vehicle.radio).collect();
        let mut worker = RadioWorker::new(Mirror, radios, 250.0);
        wait(&sockets, LONGEST_WAIT).unwrap();
        let mut now = Time::VIRTUAL_START;
        let mut clock = || {
            now = now + Span::from_millis(1);
            now
        };
        for _ in 0..4 {
            turn(&mut worker, &mut sockets, &mut clock).unwrap();
        }
        let mut buffer = [0; MAX_CRTP_PACKET];
        for (bridge, packet) in bridges.iter().zip(&sent) {
            let length = bridge.recv(&mut buffer).unwrap();
            assert_eq!(buffer[..length], *packet.as_bytes());
        }
    }

    #[test]
    fn a_vehicle_stays_with_the_bridge_that_sends_until_that_is_silent() {
        let address = "127.0.0.1:0".parse().unwrap();
        let radio = "80/2M/E7E7E7E701".parse().unwrap();
        let mut socket = BridgeSocket::bind(&SharedVehicle { radio, address }).unwrap();
        let [bridge, other] = [(); 2].map(|()| {
            let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
            sender.connect(socket.socket.local_addr().unwrap()).unwrap();
            sender
        });
        let packet = CrtpRequest::Setpoint(LegacySetpoint::ZERO).packet();
        let at = |millis| Time::VIRTUAL_START + Span::from_millis(millis);
        let mut receive_from = |sender: &UdpSocket, millis| {
            sender.send(packet.as_bytes()).unwrap();
            (socket.read(at(millis)), socket.bridge.unwrap().0 == sender.local_addr().unwrap())
        };
        assert_eq!(receive_from(&bridge, 0), (Received::Packet(packet), true));
        assert_eq!(receive_from(&other, 900), (Received::OfAnother, false), "nor is it answered");
        assert_eq!(receive_from(&bridge, 1000), (Received::Packet(packet), true));
        assert_eq!(receive_from(&other, 2000), (Received::OfAnother, false));
        assert_eq!(
            receive_from(&other, 2001),
            (Received::Packet(packet), true),
            "a bridge restarted"
        );
        assert_eq!(receive_from(&bridge, 2002), (Received::OfAnother, false));
        assert_eq!(socket.read(at(2003)), Received::Nothing);
    }

    #[test]
    fn a_vehicle_is_a_radio_and_an_address() {
        let vehicle: SharedVehicle = "80/2M/E7E7E7E701@127.0.0.1:19851".parse().unwrap();
        assert_eq!((vehicle.radio.vehicle_id(), vehicle.address.port()), (1, 19_851));
        for wrong in ["80/2M/E7E7E7E701", "80/2M/E7E7E7E701@localhost", "80@127.0.0.1:1"] {
            assert!(wrong.parse::<SharedVehicle>().is_err());
        }
    }
}
