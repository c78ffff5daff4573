//! Datagrams on the loopback interface with the kernel's stamps: frames of QTM, and attitude set-points of MAVLink.

use std::io::IoSliceMut;
use std::os::fd::{AsRawFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use nix::errno::Errno;
use nix::sys::socket::{
    AddressFamily, ControlMessageOwned, MsgFlags, SockFlag, SockProtocol, SockType, recvmsg,
    setsockopt, socket, sockopt,
};
use nix::sys::time::{TimeSpec, TimeVal, TimeValLike};
use oqtal_bus::time::Span;
use oqtal_runtime::process::{Exit, Failure};

/// Longest packet that is examined \[bytes\]; the rest of a longer one is cut off.
const EXAMINED: usize = 2048;
/// Length of an Ethernet header, which the loopback interface has, too \[bytes\].
const ETHERNET: usize = 14;
const TCP: u8 = 6;
const UDP: u8 = 17;
/// Type of a data packet in QTM's real-time protocol.
const QTM_DATA: u32 = 3;
/// First byte of a packet of MAVLink 2, and the number of SET_ATTITUDE_TARGET.
const MAVLINK_2: u8 = 0xFD;
const SET_ATTITUDE_TARGET: u32 = 82;

/// What a packet is, with its port of destination.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// A frame of the cameras.
    Frame(u16),
    /// A command to the vehicle.
    Command(u16),
}

/// A packet and the instant at which the kernel passed it on \[ns, CLOCK_REALTIME\].
pub type Record = (i64, Seen);

/// The frames and the commands after them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answers {
    /// Time from each frame to the first command before the next frame.
    pub latencies: Vec<Span>,
    /// Frames without a command before the next one \[-\].
    pub unanswered: u64,
}

impl Answers {
    /// The answers of `records` to the frames from `from_ns` to `to_ns`, in order of time.
    ///
    /// # Errors
    /// The frames or the commands have several destinations (exit code 75).
    pub fn of(records: &[Record], from_ns: i64, to_ns: i64) -> Result<Self, Failure> {
        let (mut ports, mut answers, mut asked) = ([None; 2], Self::default(), None);
        for (at_ns, seen) in records {
            let (port, known) = match seen {
                Seen::Frame(port) => (port, &mut ports[0]),
                Seen::Command(port) => (port, &mut ports[1]),
            };
            if *known.get_or_insert(*port) != *port {
                let reason = "another camera server or vehicle sends over the loopback interface; end it, and measure again";
                return Err(Failure::new(Exit::Peer, reason));
            }
            match (seen, asked) {
                (Seen::Frame(_), unanswered) => {
                    answers.unanswered += u64::from(unanswered.is_some());
                    asked = (from_ns..to_ns).contains(at_ns).then_some(*at_ns);
                }
                (Seen::Command(_), Some(since_ns)) => {
                    answers.latencies.push(Span::from_nanos(at_ns - since_ns));
                    asked = None;
                }
                (Seen::Command(_), None) => {}
            }
        }
        Ok(answers)
    }
}

/// The observation of the loopback interface, by a thread.
#[derive(Debug)]
pub struct Capture {
    ends: Arc<AtomicBool>,
    thread: JoinHandle<Vec<Record>>,
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
    pub fn finish(self) -> Vec<Record> {
        self.ends.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or_default()
    }
}

fn observe(socket: &OwnedFd, ends: &AtomicBool) -> Vec<Record> {
    let (mut records, mut packet) = (Vec::new(), [0; EXAMINED]);
    let mut control = nix::cmsg_space!(TimeSpec);
    while !ends.load(Ordering::Relaxed) {
        let mut parts = [IoSliceMut::new(&mut packet)];
        let received =
            recvmsg::<()>(socket.as_raw_fd(), &mut parts, Some(&mut control), MsgFlags::empty());
        // Without a packet the wait is over: the flag is checked.
        let Ok(message) = received else { continue };
        let stamp = message.cmsgs().ok().and_then(|mut all| {
            all.find_map(|it| match it {
                ControlMessageOwned::ScmTimestampns(stamp) => Some(stamp.num_nanoseconds()),
                _ => None,
            })
        });
        let length = message.bytes;
        if let (Some(at_ns), Some(seen)) = (stamp, recognised(&packet[..length])) {
            records.push((at_ns, seen));
        }
    }
    records
}

/// What `packet`, with its Ethernet header, is; `None` for all others.
fn recognised(packet: &[u8]) -> Option<Seen> {
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
    let is_frame = word(0)? as usize == payload.len() && word(4)? == QTM_DATA;
    let is_command =
        protocol == UDP && payload[0] == MAVLINK_2 && word(7)? & 0xFF_FFFF == SET_ATTITUDE_TARGET;
    match (is_frame, is_command) {
        (true, _) => Some(Seen::Frame(port)),
        (_, true) => Some(Seen::Command(port)),
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
            assert_eq!(recognised(&packet(protocol, 7, &frame)), Some(Seen::Frame(7)));
        }
        let whole = packet(UDP, 9, &command);
        assert_eq!(recognised(&whole), Some(Seen::Command(9)));
        assert_eq!(recognised(&packet(UDP, 9, &[0xFD, 9, 0, 0, 0, 1, 1, 83, 0, 0, 0, 0])), None);
        for length in 0..whole.len() - 1 {
            assert_eq!(recognised(&whole[..length]), None, "{length}");
        }
    }

    #[test]
    fn each_frame_is_answered_by_the_first_command_before_the_next() {
        use Seen::{Command, Frame};
        let records = [
            (5, Frame(1)),
            (10, Frame(1)),
            (13, Command(2)),
            (14, Command(2)),
            (20, Frame(1)),
            (30, Frame(1)),
            (39, Command(2)),
        ];
        let expected = Answers { latencies: [3, 9].map(Span::from_nanos).to_vec(), unanswered: 1 };
        assert_eq!(Answers::of(&records, 10, 40).unwrap(), expected);
        let others = [&records[..], &[(41, Frame(3))]].concat();
        assert_eq!(Answers::of(&others, 10, 40).unwrap_err().exit, Exit::Peer);
    }
}
