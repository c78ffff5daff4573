//! Sockets of the QTM server: both byte orders, discovery, frames over TCP and UDP.

use std::net::{IpAddr, SocketAddr, TcpListener, UdpSocket};

use oqtal_bus::time::Time;
use oqtal_runtime::process::Failure;
use oqtal_wire::ByteOrder;
use oqtal_wire::motion::{BodySample, MarkerSample, MotionFrame};
use oqtal_wire::qtm::{
    DiscoveryReply, DiscoveryRequest, QtmHost, QtmSession, StreamRequest, StreamTarget,
};
use rustix::event::{PollFd, PollFlags};

use super::address::{datagrams, listen, port_after, port_of};
use super::connection::Connection;
use super::model::BodyModels;
use super::server::{Endpoint, FrameServer};

/// Greatest number of clients, as of QTM \[-\].
const MAX_CLIENTS: usize = 10;
/// Discovery requests answered at a time.
const MAX_REQUESTS: usize = 16;
/// Cameras that are reported.
const CAMERAS: u32 = 6;

#[derive(Debug)]
struct Client {
    connection: Connection,
    session: QtmSession,
    address: IpAddr,
}

/// The newest frame, for clients that ask for one at a time.
#[derive(Debug, Default)]
struct Newest {
    number: u32,
    captured_ns: u64,
    bodies: Vec<BodySample>,
    markers: Vec<MarkerSample>,
}

/// The QTM server.
#[derive(Debug)]
pub struct QtmServer {
    listeners: [(TcpListener, ByteOrder); 2],
    discovery: UdpSocket,
    /// Source of frames over UDP.
    sender: UdpSocket,
    host: QtmHost,
    clients: Vec<Client>,
    next_client: u64,
    newest: Newest,
    rate_hz: u32,
    scratch: Vec<u8>,
    input: Vec<u8>,
}

impl QtmServer {
    /// Opens the server: little endian at `port`, big endian at the next, discovery at the third after it.
    pub fn open(ip: IpAddr, port: u16, models: &BodyModels) -> Result<Self, Failure> {
        let at = |distance| SocketAddr::new(ip, port_after(port, distance));
        Ok(Self {
            listeners: [
                (listen("qtm", at(0))?, ByteOrder::Little),
                (listen("qtm", at(1))?, ByteOrder::Big),
            ],
            discovery: datagrams("qtm", at(3))?,
            sender: datagrams("qtm", SocketAddr::new(ip, 0))?,
            host: QtmHost::new(models.to_qtm()),
            clients: Vec::new(),
            next_client: 0,
            newest: Newest::default(),
            rate_hz: models.rate_hz().round().max(1.0) as u32,
            scratch: Vec::new(),
            input: vec![0; 1 << 14],
        })
    }

    fn accept(&mut self) {
        for (listener, order) in &self.listeners {
            while let Ok((stream, from)) = listener.accept() {
                let Some(mut connection) = Connection::new(stream) else { continue };
                let queue = connection.queue();
                if self.clients.len() >= MAX_CLIENTS {
                    QtmSession::refuse(*order, queue);
                    connection.flush();
                    continue;
                }
                let name = format!("{} ({})", from.ip(), from.port());
                let session = QtmSession::open(self.next_client, name, *order, queue);
                self.next_client += 1;
                self.clients.push(Client { connection, session, address: from.ip() });
            }
        }
    }

    fn read(&mut self) {
        let Newest { number, captured_ns, bodies, markers } = &self.newest;
        let frame = MotionFrame {
            number: *number,
            captured_ns: *captured_ns,
            sent_ns: *captured_ns,
            bodies,
            markers,
        };
        let frame = Some(&frame).filter(|frame| frame.number > 0);
        for client in &mut self.clients {
            let ready = client.session.is_ready();
            let bytes = if ready { client.connection.read(&mut self.input) } else { &[] };
            let queue = client.connection.queue();
            if client.session.receive(bytes, &mut self.host, frame, queue).is_err() {
                client.connection.close();
            }
        }
        for event in self.host.take_events() {
            for client in &mut self.clients {
                client.session.write_event(event, client.connection.queue());
            }
        }
    }

    fn answer_discovery(&mut self) {
        let mut buffer = [0; 64];
        for _ in 0..MAX_REQUESTS {
            let Ok((length, from)) = self.discovery.recv_from(&mut buffer) else { break };
            let Some(request) = DiscoveryRequest::parse(&buffer[..length]) else { continue };
            let host = rustix::system::uname();
            let reply = DiscoveryReply {
                description: format!(
                    "{}, QTM 2.17 (build 4000), {CAMERAS} cameras",
                    host.nodename().to_string_lossy()
                ),
                base_port: port_of(&self.listeners[0].0).saturating_sub(1),
            };
            let to = SocketAddr::new(from.ip(), request.reply_port);
            let _ = self.discovery.send_to(&reply.to_datagram(), to);
        }
    }
}

impl FrameServer for QtmServer {
    fn endpoints(&self) -> Vec<Endpoint> {
        let tcp = |listener: &TcpListener, what| Endpoint {
            protocol: "qtm",
            what,
            transport: "tcp",
            address: listener.local_addr().map_or(String::new(), |at| at.to_string()),
        };
        let address = self.discovery.local_addr().map_or(String::new(), |at| at.to_string());
        vec![
            tcp(&self.listeners[0].0, "little endian"),
            tcp(&self.listeners[1].0, "big endian"),
            Endpoint { protocol: "qtm", what: "discovery", transport: "udp", address },
        ]
    }

    fn add_sockets<'a>(&'a self, sockets: &mut Vec<PollFd<'a>>) {
        sockets.extend(self.listeners.iter().map(|(socket, _)| PollFd::new(socket, PollFlags::IN)));
        sockets.push(PollFd::new(&self.discovery, PollFlags::IN));
        let clients = self.clients.iter();
        sockets.extend(
            clients
                .map(|Client { connection, session, .. }| connection.poll_fd(session.is_ready())),
        );
    }

    fn serve(&mut self, _now: Time) {
        self.accept();
        self.read();
        self.answer_discovery();
        for client in &mut self.clients {
            client.connection.flush();
            if client.connection.is_broken() {
                self.host.disconnected(client.session.client());
            }
        }
        self.clients.retain(|client| !client.connection.is_broken());
    }

    fn broadcast(&mut self, frame: &MotionFrame<'_>) {
        let Newest { number, captured_ns, bodies, markers } = &mut self.newest;
        (*number, *captured_ns) = (frame.number, frame.captured_ns);
        bodies.clear();
        bodies.extend_from_slice(frame.bodies);
        markers.clear();
        markers.extend_from_slice(frame.markers);
        if !self.host.has_data() {
            return;
        }
        for Client { connection, session, address } in &mut self.clients {
            let Some(StreamRequest { rate, target, components }) = session.subscription().copied()
            else {
                continue;
            };
            if !rate.includes(frame.number, self.rate_hz) {
                continue;
            }
            match target {
                StreamTarget::Tcp => {
                    session.write_frame(frame, &components, connection.queue());
                    connection.flush();
                }
                StreamTarget::Udp { address: other, port } => {
                    self.scratch.clear();
                    session.write_frame(frame, &components, &mut self.scratch);
                    // A datagram that finds no place is lost, as on any network.
                    let to = SocketAddr::new(other.unwrap_or(*address), port);
                    let _ = self.sender.send_to(&self.scratch, to);
                }
            }
        }
    }

    fn clients(&self) -> usize {
        self.clients.len()
    }
}
