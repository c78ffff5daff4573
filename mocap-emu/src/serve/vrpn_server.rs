//! Sockets of the VRPN server: clients that connect, and clients that want to be called back.

use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream, UdpSocket};

use oqtal_bus::time::{Span, Time};
use oqtal_runtime::process::Failure;
use oqtal_wire::motion::MotionFrame;
use oqtal_wire::vrpn::{CallbackRequest, VrpnSession};
use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, connect, socket_with};

use super::address::listen_both;
use super::connection::Connection;
use super::model::BodyModels;
use super::server::{Endpoint, FrameServer};

/// Greatest number of clients \[-\].
const MAX_CLIENTS: usize = 10;
/// Requests for a call back that are answered at a time.
const MAX_REQUESTS: usize = 16;
/// A client that has not sent its cookie after this time is cut off.
const GREETING_TIMEOUT: Span = Span::from_millis(5000);

#[derive(Debug)]
struct Client {
    connection: Connection,
    session: VrpnSession,
    address: SocketAddr,
    since: Time,
}

/// The VRPN server.
#[derive(Debug)]
pub struct VrpnServer {
    listener: TcpListener,
    callbacks: UdpSocket,
    clients: Vec<Client>,
    bodies: Vec<String>,
    input: Vec<u8>,
}

impl VrpnServer {
    /// Opens the server at `port`, TCP and UDP.
    pub fn open(ip: IpAddr, port: u16, models: &BodyModels) -> Result<Self, Failure> {
        let (listener, callbacks) = listen_both("vrpn", SocketAddr::new(ip, port))?;
        let (bodies, input) = (models.names().to_vec(), vec![0; 1 << 14]);
        Ok(Self { listener, callbacks, clients: Vec::new(), bodies, input })
    }

    fn accept(&mut self, now: Time) {
        while let Ok((stream, from)) = self.listener.accept() {
            self.add(stream, from, now);
        }
        let mut buffer = [0; 256];
        for _ in 0..MAX_REQUESTS {
            let Ok((length, from)) = self.callbacks.recv_from(&mut buffer) else { break };
            let Some(request) = CallbackRequest::parse(&buffer[..length]) else { continue };
            // Only the sender is called back: nobody is made to connect to another machine.
            let to = SocketAddr::new(from.ip(), request.address.port());
            // A client repeats its request until it is called.
            if self.clients.iter().any(|client| client.address == to) {
                continue;
            }
            if let Some(stream) = call_back(to) {
                self.add(stream, to, now);
            }
        }
    }

    fn add(&mut self, stream: TcpStream, address: SocketAddr, since: Time) {
        let connection = Connection::new(stream).filter(|_| self.clients.len() < MAX_CLIENTS);
        let Some(mut connection) = connection else { return };
        let session = VrpnSession::open(&self.bodies, connection.queue());
        self.clients.push(Client { connection, session, address, since });
    }
}

/// Begins a connection without waiting for it.
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
        let address = self.listener.local_addr().map_or(String::new(), |at| at.to_string());
        let endpoint = |what, transport| Endpoint {
            protocol: "vrpn",
            what,
            transport,
            address: address.clone(),
        };
        vec![endpoint("direct", "tcp"), endpoint("called back", "udp")]
    }

    fn add_sockets<'a>(&'a self, sockets: &mut Vec<PollFd<'a>>) {
        sockets.push(PollFd::new(&self.listener, PollFlags::IN));
        sockets.push(PollFd::new(&self.callbacks, PollFlags::IN));
        sockets.extend(self.clients.iter().map(|client| client.connection.poll_fd(true)));
    }

    fn serve(&mut self, now: Time) {
        self.accept(now);
        for Client { connection, session, since, .. } in &mut self.clients {
            let bytes = connection.read(&mut self.input);
            if session.receive(bytes, connection.queue()) != Ok(true) {
                connection.close();
            }
            if !session.is_greeted() && now.since(*since) > GREETING_TIMEOUT {
                connection.close();
            }
            connection.flush();
        }
        self.clients.retain(|client| !client.connection.is_broken());
    }

    fn broadcast(&mut self, frame: &MotionFrame<'_>) {
        for Client { connection, session, .. } in &mut self.clients {
            if session.is_greeted() {
                session.write_frame(frame, connection.queue());
                connection.flush();
            }
        }
    }

    fn clients(&self) -> usize {
        self.clients.len()
    }
}
