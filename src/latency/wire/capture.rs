//! Datagrams on the loopback interface with the kernel's stamps: frames of QTM, and attitude set-points of MAVLink.

use std::io::IoSliceMut;
use std::os::fd::{AsRawFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use nix::errno::Errno;
use nix::net::if_::if_nametoindex;
use nix::sys::socket::{
    AddressFamily, ControlMessageOwned, LinkAddr, MsgFlags, SockFlag, SockProtocol, SockType,
    recvmsg, setsockopt, socket, sockopt,
};
use nix::sys::time::{TimeSpec, TimeVal, TimeValLike};
use oqtal_bus::time::Span;
use oqtal_runtime::process::{Exit, Failure};

/// Longest packet that is examined \[bytes\]; the rest of a longer one is cut off.
const EXAMINED: usize = 2048;
/// Size of the socket's buffer \[bytes\].
const BUFFER: usize = 8 << 20;
/// Length of an Ethernet header, which the loopback interface has, too \[bytes\].
const ETHERNET: usize = 14;
const TCP: u8 = 6;
const UDP: u8 = 17;
/// Type of a data packet in QTM's real-time protocol.
const QTM_DATA: u32 = 3;
/// First byte of a packet of MAVLink 2, and the number of SET_ATTITUDE_TARGET.
const MAVLINK_2: u8 = 0xFD;
const SET_ATTITUDE_TARGET: u32 = 82;

/// Kind of a packet, with its port of destination.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketKind {
    /// A frame of the cameras.
    Frame(u16),
    /// A command to the vehicle.
    Command(u16),
}

/// The instant at which the kernel passed a packet on \[ns, CLOCK_REALTIME\], and its kind.
pub type StampedPacket = (i64, PacketKind);

/// The frames and the commands after them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answers {
    /// Time from each frame to the first command before the next frame.
    pub latencies: Vec<Span>,
    /// Frames without a command before the next one \[-\].
    pub unanswered: u64,
}

impl Answers {
    /// The answers of `packets` to the frames from `from_ns` to `to_ns`, in order of time.
    ///
    /// # Errors
    /// The frames or the commands have several destinations, or no frame has an answer (exit code 75).
    pub fn of(packets: &[StampedPacket], from_ns: i64, to_ns: i64) -> Result<Self, Failure> {
        let (mut ports, mut answers, mut asked) = ([None; 2], Self::default(), None);
        for (at_ns, kind) in packets {
            let (port, known) = match kind {
                PacketKind::Frame(port) => (port, &mut ports[0]),
                PacketKind::Command(port) => (port, &mut ports[1]),
            };
            if *known.get_or_insert(*port) != *port {
                let reason = "another camera server or vehicle sends over the loopback interface; end it, and measure again";
                return Err(Failure::new(Exit::Peer, reason));
            }
            match (kind, asked) {
                (PacketKind::Frame(_), unanswered) => {
                    answers.unanswered += u64::from(unanswered.is_some());
                    asked = (from_ns..to_ns).contains(at_ns).then_some(*at_ns);
                }
                (PacketKind::Command(_), Some(since_ns)) => {
                    answers.latencies.push(Span::from_nanos(at_ns - since_ns));
                    asked = None;
                }
                (PacketKind::Command(_), None) => {}
            }
        }
        match answers.latencies.is_empty() {
            true => Err(Failure::new(Exit::Peer, "no frame of the cameras was answered")),
            false => Ok(answers),
        }
    }
}

/// The observation of the loopback interface, by a thread.
#[derive(Debug)]
pub struct Capture {
    ends: Arc<AtomicBool>,
    thread: JoinHandle<(Vec<StampedPacket>, u32)>,
}

impl Capture {
    /// Begins to observe.
    ///
    /// # Errors
    /// This process may not (exit code 77), or the kernel refuses (71).
    pub fn start() -> Result<Self, Failure> {
        let opened = || -> Result<OwnedFd, Errno> {
            let (family, kind) = (AddressFamily::Packet, SockType::Raw);
            let socket = socket(family, kind, SockFlag::SOCK_CLOEXEC, SockProtocol::EthIp)?;
            setsockopt(&socket, sockopt::ReceiveTimestampns, &true)?;
            setsockopt(&socket, sockopt::RxqOvfl, &1)?;
            setsockopt(&socket, sockopt::RcvBufForce, &BUFFER)?;
            setsockopt(&socket, sockopt::ReceiveTimeout, &TimeVal::milliseconds(100))?;
            Ok(socket)
        };
        let socket = opened().map_err(|error| match error {
            Errno::EPERM | Errno::EACCES => {
                let reason = "observing the loopback interface needs CAP_NET_RAW: run `oqtal latency --wire` as root";
                Failure::new(Exit::Permission, reason)
            }
            error => Failure::new(Exit::System, format!("observing the loopback interface: {error}")),
        })?;
        let ends = Arc::new(AtomicBool::new(false));
        let observed = ends.clone();
        let thread = std::thread::spawn(move || observe(&socket, &observed));
        Ok(Self { ends, thread })
    }

    /// Ends the observation; returns what was seen, in order.
    ///
    /// # Errors
    /// Packets were lost before they were seen (exit code 71).
    pub fn finish(self) -> Result<Vec<StampedPacket>, Failure> {
        self.ends.store(true, Ordering::Relaxed);
        let lost = |count| {
            let reason = format!(
                "{count} packets on the loopback interface were not observed: this machine is overloaded"
            );
            Failure::new(Exit::System, reason)
        };
        match self.thread.join() {
            Ok((packets, 0)) => Ok(packets),
            Ok((_, count)) => Err(lost(count)),
            Err(panic) => std::panic::resume_unwind(panic),
        }
    }
}

/// The packets until `ends`, and the number of those that were lost.
fn observe(socket: &OwnedFd, ends: &AtomicBool) -> (Vec<StampedPacket>, u32) {
    let (mut packets, mut packet, mut lost) = (Vec::new(), [0; EXAMINED], 0);
    let mut control = nix::cmsg_space!(TimeSpec, u32);
    let loopback = if_nametoindex("lo").ok();
    while !ends.load(Ordering::Relaxed) {
        let mut parts = [IoSliceMut::new(&mut packet)];
        let received = recvmsg::<LinkAddr>(
            socket.as_raw_fd(),
            &mut parts,
            Some(&mut control),
            MsgFlags::empty(),
        );
        // Without a packet the wait is over: the flag is checked.
        let Ok(message) = received else { continue };
        let mut stamp = None;
        for part in message.cmsgs().into_iter().flatten() {
            match part {
                ControlMessageOwned::ScmTimestampns(at) => stamp = Some(at.num_nanoseconds()),
                ControlMessageOwned::RxqOvfl(count) => lost = count,
                _ => {}
            }
        }
        let interface = message.address.and_then(|it| it.ifindex().try_into().ok());
        let (length, is_local) = (message.bytes, interface == loopback);
        if let (Some(at_ns), Some(kind)) = (stamp, recognised(&packet[..length]))
            && is_local
        {
            packets.push((at_ns, kind));
        }
    }
    (packets, lost)
}

/// Kind of `packet`, which begins with its Ethernet header; `None` for all others.
fn recognised(packet: &[u8]) -> Option<PacketKind> {
    let ip = packet.get(ETHERNET..)?;
    let header = usize::from(ip.first()? & 15) * 4;
    let (protocol, length) = (*ip.get(9)?, u16::from_be_bytes([*ip.get(2)?, *ip.get(3)?]));
    let transport = ip.get(header..usize::from(length).min(ip.len()))?;
    let port = u16::from_be_bytes([*transport.get(2)?, *transport.get(3)?]);
    let payload = match protocol {
        UDP => transport.get(8..)?,
        TCP => transport.get(usize::from(transport.get(12)? >> 4) * 4..)?,
        _ => return None,
    };
    let word = |at: usize| Some(u32::from_le_bytes(payload.get(at..at + 4)?.try_into().ok()?));
    // The packet may be cut off here, and TCP may join two frames.
    let sent = usize::from(length).checked_sub(header)?;
    let is_frame = word(0)? > 8 && word(0)? as usize <= sent && word(4)? == QTM_DATA;
    let is_command =
        protocol == UDP && payload[0] == MAVLINK_2 && word(7)? & 0xFF_FFFF == SET_ATTITUDE_TARGET;
    match (is_frame, is_command) {
        (true, _) => Some(PacketKind::Frame(port)),
        (_, true) => Some(PacketKind::Command(port)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(protocol: u8, port: u16, payload: &[u8]) -> Vec<u8> {
        let mut transport = vec![0; if protocol == UDP { 8 } else { 20 }];
        transport[2..4].copy_from_slice(&port.to_be_bytes());
        if protocol == TCP {
            transport[12] = 5 << 4;
        }
        let length = (20 + transport.len() + payload.len()) as u16;
        let mut ip = [0; 20];
        (ip[0], ip[9]) = (0x45, protocol);
        ip[2..4].copy_from_slice(&length.to_be_bytes());
        [&[0; ETHERNET], &ip[..], &transport, payload].concat()
    }

    #[test]
    fn frames_and_commands_are_recognised_and_cut_packets_are_not() {
        let frame = [20, 0, 0, 0, 3, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1];
        let command = [0xFD, 9, 0, 0, 0, 1, 1, 82, 0, 0, 0, 0];
        for protocol in [UDP, TCP] {
            assert_eq!(recognised(&packet(protocol, 7, &frame)), Some(PacketKind::Frame(7)));
        }
        let whole = packet(UDP, 9, &command);
        assert_eq!(recognised(&whole), Some(PacketKind::Command(9)));
        assert_eq!(recognised(&packet(UDP, 9, &[0xFD, 9, 0, 0, 0, 1, 1, 83, 0, 0, 0, 0])), None);
        for length in 0..whole.len() - 1 {
            assert_eq!(recognised(&whole[..length]), None, "{length}");
        }
    }

    #[test]
    fn each_frame_is_answered_by_the_first_command_before_the_next() {
        use PacketKind::{Command, Frame};
        let packets = [
            (5, Frame(1)),
            (10, Frame(1)),
            (13, Command(2)),
            (14, Command(2)),
            (20, Frame(1)),
            (30, Frame(1)),
            (39, Command(2)),
        ];
        let expected = Answers { latencies: [3, 9].map(Span::from_nanos).to_vec(), unanswered: 1 };
        assert_eq!(Answers::of(&packets, 10, 40).unwrap(), expected);
        let others = [&packets[..], &[(41, Frame(3))]].concat();
        assert_eq!(Answers::of(&others, 10, 40).unwrap_err().exit, Exit::Peer);
    }
}
