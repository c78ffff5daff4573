//! Sockets of the VRPN server: clients that connect, and clients that request a call back.

use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream, UdpSocket};

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::Failure;
use oqtal_wire::motion::MotionFrame;
use oqtal_wire::vrpn::{CallbackRequest, VrpnSession};
use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, connect, socket_with};

use super::address::{for_each_datagram, listen_both};
use super::clients::{ClientSession, ClientTable};
use super::model::BodyModels;
use super::server::{Endpoint, FrameServer};

/// A client that has not sent its cookie after this time is disconnected.
const GREETING_TIMEOUT: Span = Span::from_millis(5000);

#[derive(Debug)]
struct Client {
    session: VrpnSession,
    address: SocketAddr,
    since: Time,
}

impl ClientSession for Client {}

/// The VRPN server.
#[derive(Debug)]
pub struct VrpnServer {
    listener: TcpListener,
    callbacks: UdpSocket,
    clients: ClientTable<Client>,
    bodies: Vec<String>,
}

impl VrpnServer {
    /// Opens the server at `port`, TCP and UDP.
    pub fn open(ip: IpAddr, port: u16, models: &BodyModels) -> Result<Self, Failure> {
        let (listener, callbacks) = listen_both("vrpn", SocketAddr::new(ip, port))?;
        let bodies = models.names().to_vec();
        Ok(Self { listener, callbacks, clients: ClientTable::new(), bodies })
    }

    fn accept(&mut self, since: Time) {
        let Self { listener, callbacks, clients, bodies } = self;
        let open = |address, has_room: bool, queue: &mut Vec<u8>| {
            has_room.then(|| Client { session: VrpnSession::open(bodies, queue), address, since })
        };
        clients.accept(listener, open);
        for_each_datagram(callbacks, &mut [0; 256], |request, from| {
            let Some(request) = CallbackRequest::parse(request) else { return };
            // The server calls back the sender only and never connects to a third machine.
            let to = SocketAddr::new(from.ip(), request.address.port());
            // A client repeats its request until it is called back.
            if clients.sessions().any(|client| client.address == to) {
                return;
            }
            if let Some(stream) = call_back(to) {
                clients.add(stream, |has_room, queue| open(to, has_room, queue));
            }
        });
    }
}

/// Starts a connection without waiting for its result.
fn call_back(to: SocketAddr) -> Option<TcpStream> {
    let family = if to.is_ipv4() { AddressFamily::INET } else { AddressFamily::INET6 };
    let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
    let socket = socket_with(family, SocketType::STREAM, flags, None).ok()?;
    match connect(&socket, &to) {
        Ok(()) | Err(Errno::INPROGRESS) => Some(TcpStream::from(socket)),
        Err(_) => None,
    }
}

impl FrameServer for VrpnServer {
    fn endpoints(&self) -> Vec<Endpoint> {
        let direct = Endpoint::of(("vrpn", "direct"), "tcp", self.listener.local_addr());
        let called_back = Endpoint { service: "called back", transport: "udp", ..direct.clone() };
        vec![direct, called_back]
    }

    fn add_sockets<'a>(&'a self, sockets: &mut Vec<PollFd<'a>>) {
        sockets.push(PollFd::new(&self.listener, PollFlags::IN));
        sockets.push(PollFd::new(&self.callbacks, PollFlags::IN));
        self.clients.add_sockets(sockets);
    }

    fn serve(&mut self, now: Time) {
        self.accept(now);
        self.clients.read(|Client { session, since, .. }, bytes, queue| {
            session.receive(bytes, queue) == Ok(true)
                && (session.is_greeted() || now.since(*since) <= GREETING_TIMEOUT)
        });
        self.clients.send(|_, _| {});
        self.clients.remove_broken(drop);
    }

    fn broadcast(&mut self, frame: &MotionFrame<'_>) {
        self.clients.send(|Client { session, .. }, queue| {
            if session.is_greeted() {
                session.write_frame(frame, queue);
            }
        });
    }

    fn clients(&self) -> usize {
        self.clients.len()
    }
}
