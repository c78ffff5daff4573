//! Search for camera systems in the network: by the broadcasts of QTM and NatNet, and on hosts that are named.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::natnet::{COMMAND_PORT, NatNetClient};
use oqtal_wire::qtm::{DISCOVERY_PORT, DiscoveryReply, DiscoveryRequest};
use serde::Serialize;

use crate::connect::connect;
use oqtal_wire::link::{CameraLink, InvalidLink};

/// Protocols that are tried on every host.
const PROTOCOLS: [&str; 3] = ["qtm", "vrpn", "natnet"];
/// Period of polling the socket.
const POLL_PERIOD: Span = Span::from_millis(20);
/// Maximum number of servers whose answers to a broadcast are kept; each is queried on its own thread \[-\].
const MAX_ANSWERS: usize = 64;
/// The kernel's table of routes.
const ROUTES: &str = "/proc/net/route";
/// Flag of a route through a gateway in that table, RTF_GATEWAY \[-\].
const GATEWAY: u32 = 2;

/// A camera system that was found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FoundServer {
    /// Link to it, without a body.
    pub link: String,
    /// The server's description of itself.
    pub server: String,
    /// Names of its bodies.
    pub bodies: Vec<String>,
}

impl fmt::Display for FoundServer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { link, server, bodies } = self;
        write!(f, "{link}  {server}")?;
        if bodies.is_empty() {
            write!(f, "\n  no rigid body is defined")?;
        }
        for body in bodies {
            write!(f, "\n  {link},body={body}")?;
        }
        Ok(())
    }
}

/// Result of a search.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Discovery {
    /// The camera systems that were found.
    pub found: Vec<FoundServer>,
    /// For each named host without a camera system: why each protocol does not reach one.
    pub unanswered: Vec<String>,
    /// Whether so many servers answered the broadcast that further ones are left out.
    pub is_truncated: bool,
}

impl Discovery {
    /// Lines about what was not found.
    pub fn notes(&self) -> impl Iterator<Item = String> {
        let cut = self.is_truncated.then(|| {
            format!(
                "{MAX_ANSWERS} servers answered the broadcast, further ones are left out; name the hosts that are missing, as in `oqtal receiver discover HOST`"
            )
        });
        self.unanswered.iter().cloned().chain(cut)
    }
}

/// Searches for `duration`, on this machine, in the networks of its interfaces, and on `hosts`.
///
/// # Errors
/// The operating system refuses to open a socket.
pub fn discover(hosts: &[String], duration: Span) -> Result<Discovery, Failure> {
    let mut links = BTreeSet::new();
    for host in hosts.iter().map(String::as_str).chain(["127.0.0.1"]) {
        links.extend(PROTOCOLS.map(|kind| format!("{kind}:{host}")));
    }
    let answered = broadcast(duration).map_err(|error| {
        Failure::new(Exit::System, format!("searching by broadcast failed: {error}"))
    })?;
    let is_truncated = answered.len() > MAX_ANSWERS;
    for (link, ip) in answered.into_iter().take(MAX_ANSWERS) {
        links.insert(link);
        // VRPN has no broadcast: a host of cameras may serve it beside what answered.
        links.insert(format!("vrpn:{ip}"));
    }
    // Each host is queried on its own thread: a silent host takes until the time-out.
    let asked = links.into_iter().map(|link| {
        let text = link.clone();
        (link, std::thread::spawn(move || ask(&text)))
    });
    let asked: Vec<_> = asked.collect();
    let (mut found, mut failures) = (Vec::new(), BTreeMap::new());
    for (link, thread) in asked {
        match thread.join() {
            Ok(Ok(server)) => found.push(server),
            Ok(Err(reason)) => drop(failures.insert(link, reason)),
            Err(_) => {}
        }
    }
    let unanswered = hosts.iter().filter_map(|host| unanswered(host, &failures)).collect();
    Ok(Discovery { found, unanswered, is_truncated })
}

/// Why no protocol reaches a camera system at `host`, by the `failures` of the links; `None` if one does.
fn unanswered(host: &str, failures: &BTreeMap<String, String>) -> Option<String> {
    let reason = |kind: &str| failures.get(&format!("{kind}:{host}"));
    // A host without an address has one reason for all.
    let reasons: BTreeSet<_> = PROTOCOLS.into_iter().map(reason).collect::<Option<_>>()?;
    let lines = reasons.into_iter().map(|reason| format!("\n  {reason}"));
    Some(format!("no camera system answers at {host}:{}", lines.collect::<String>()))
}

/// Description of the server at a link.
///
/// # Errors
/// Why there is none.
fn ask(text: &str) -> Result<FoundServer, String> {
    let link: CameraLink = text.parse().map_err(|error: InvalidLink| error.to_string())?;
    let connection = connect(&link).map_err(|error| error.to_string())?;
    let bodies = connection.bodies.into_iter().map(|body| body.name).collect();
    Ok(FoundServer { link: link.to_string(), server: connection.server, bodies })
}

/// Broadcasts requests, and collects the links of the servers that answer.
fn broadcast(duration: Span) -> io::Result<BTreeSet<(String, IpAddr)>> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    socket.set_broadcast(true)?;
    socket.set_read_timeout(Some(POLL_PERIOD.to_duration()))?;
    let request = DiscoveryRequest { reply_port: socket.local_addr()?.port() }.to_datagram();
    let mut natnet = NatNetClient::new(false);
    let ping = natnet.poll_output(1).unwrap_or_default();
    // The cameras may be in another network than the default route.
    let routes = std::fs::read_to_string(ROUTES).unwrap_or_default();
    for address in broadcast_addresses(&routes) {
        // Send errors are ignored: a machine without a network finds no servers.
        let _ = socket.send_to(&request, (address, DISCOVERY_PORT));
        let _ = socket.send_to(ping, (address, COMMAND_PORT));
    }
    let mut found = BTreeSet::new();
    let end = Time::now() + duration;
    let mut buffer = [0; 2048];
    while Time::now() < end && found.len() <= MAX_ANSWERS {
        if let Ok((count, from)) = socket.recv_from(&mut buffer) {
            found.extend(answer(&buffer[..count], from).map(|link| (link, from.ip())));
        }
    }
    Ok(found)
}

/// Broadcast address of each network that is reached without a gateway by `routes`, a text in the form of `/proc/net/route`, and
/// the address 255.255.255.255, which is sent by the default route.
fn broadcast_addresses(routes: &str) -> BTreeSet<Ipv4Addr> {
    let own_network = |line: &str| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let [_, destination, _, flags, _, _, _, mask, ..] = fields[..] else { return None };
        // Addresses are printed as numbers whose bytes in memory are in the order of the network.
        let [destination, flags, mask] =
            [destination, flags, mask].map(|field| u32::from_str_radix(field, 16).ok());
        let (destination, mask) = (destination?, mask?);
        // A network of two addresses or one has no broadcast.
        let has_broadcast = mask.count_zeros() > 1;
        (flags? & GATEWAY == 0 && mask != 0 && has_broadcast)
            .then(|| Ipv4Addr::from((destination | !mask).to_ne_bytes()))
    };
    routes.lines().filter_map(own_network).chain([Ipv4Addr::BROADCAST]).collect()
}

/// Link of the server that sent this answer.
fn answer(datagram: &[u8], from: SocketAddr) -> Option<String> {
    if from.port() == COMMAND_PORT {
        return Some(format!("natnet:{}", from.ip()));
    }
    let reply = DiscoveryReply::parse(datagram)?;
    Some(format!("qtm:{}:{}", from.ip(), reply.base_port.checked_add(1)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_distinguished_by_port_and_content() {
        let reply = DiscoveryReply { description: "lab, QTM 2.17".to_owned(), base_port: 22222 };
        let from = |port| SocketAddr::from(([10, 0, 0, 7], port));
        let datagram = reply.to_datagram();
        assert_eq!(answer(&datagram, from(22226)).as_deref(), Some("qtm:10.0.0.7:22223"));
        assert_eq!(answer(&[1, 2, 3], from(1510)).as_deref(), Some("natnet:10.0.0.7"));
        assert_eq!(answer(&[1, 2, 3], from(9)), None);
    }

    #[test]
    #[cfg(target_endian = "little")]
    fn each_network_of_an_interface_has_its_broadcast() {
        let routes = "Iface\tDestination\tGateway \tFlags\tRefCnt\tUse\tMetric\tMask\t\tMTU\tWindow\tIRTT\n\
             eth0\t00000000\t0100A8C0\t0003\t0\t0\t0\t00000000\t0\t0\t0\n\
             eth0\t0000A8C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0\n\
             eth1\t0010000A\t00000000\t0001\t0\t0\t0\t00FCFFFF\t0\t0\t0\n\
             tun0\t0200000A\t00000000\t0005\t0\t0\t0\tFFFFFFFF\t0\t0\t0\n\
             eth1\t0000010A\t0110000A\t0003\t0\t0\t0\t0000FFFF\t0\t0\t0\n";
        let expected = ["10.0.19.255", "192.168.0.255", "255.255.255.255"];
        assert!(broadcast_addresses(routes).iter().map(ToString::to_string).eq(expected));
        assert_eq!(broadcast_addresses("").len(), 1);
    }

    #[test]
    fn servers_beyond_the_greatest_number_are_left_out_with_a_note() {
        let cut = Discovery { is_truncated: true, ..Discovery::default() };
        let notes: Vec<_> = cut.notes().collect();
        assert!(
            notes[0].starts_with("64 servers answered the broadcast, further ones"),
            "{notes:?}"
        );
        assert_eq!(Discovery::default().notes().count(), 0);
    }

    #[test]
    fn a_named_host_that_does_not_answer_is_reported_with_the_reason_of_each_protocol() {
        // Nothing listens there once the listener is dropped.
        let free = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap();
        let Discovery { unanswered, .. } =
            discover(&[free.to_string()], Span::from_millis(1)).unwrap();
        let [text] = &unanswered[..] else { panic!("{unanswered:?}") };
        assert!(text.starts_with(&format!("no camera system answers at {free}:\n")), "{text}");
        assert!(text.contains(&format!("no qtm server at {free}: ")), "{text}");
        assert_eq!(text.lines().count(), 1 + PROTOCOLS.len(), "{text}");
    }

    #[test]
    fn found_servers_are_printed_as_links() {
        let server = FoundServer {
            link: "qtm:10.0.0.7".to_owned(),
            server: "QTM".to_owned(),
            bodies: vec!["quad".to_owned()],
        };
        assert_eq!(server.to_string(), "qtm:10.0.0.7  QTM\n  qtm:10.0.0.7,body=quad");
    }
}
