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

use super::address::{datagrams, for_each_datagram, listen, port_after, port_of};
use super::clients::{ClientSession, ClientTable};
use super::model::BodyModels;
use super::server::{Endpoint, FrameServer};

/// Number of cameras in the reply to a discovery request \[-\].
const CAMERAS: u32 = 6;

#[derive(Debug)]
struct Client {
    session: QtmSession,
    address: IpAddr,
}

impl ClientSession for Client {
    fn is_ready(&self) -> bool {
        self.session.is_ready()
    }
}

/// Copy of the newest frame, for clients that request one at a time.
#[derive(Debug, Default)]
struct Newest {
    number: u32,
    captured_ns: u64,
    bodies: Vec<BodySample>,
    markers: Vec<MarkerSample>,
}

impl Newest {
    fn copy_from(&mut self, frame: &MotionFrame<'_>) {
        (self.number, self.captured_ns) = (frame.number, frame.captured_ns);
        self.bodies.clear();
        self.bodies.extend_from_slice(frame.bodies);
        self.markers.clear();
        self.markers.extend_from_slice(frame.markers);
    }

    /// The frame; `None` before the first.
    fn frame(&self) -> Option<MotionFrame<'_>> {
        let Self { number, captured_ns, bodies, markers } = self;
        (*number > 0).then_some(MotionFrame {
            number: *number,
            captured_ns: *captured_ns,
            sent_ns: *captured_ns,
            bodies,
            markers,
        })
    }
}

/// The QTM server.
#[derive(Debug)]
pub struct QtmServer {
    listeners: [(TcpListener, ByteOrder); 2],
    discovery: UdpSocket,
    /// Source of frames over UDP.
    sender: UdpSocket,
    host: QtmHost,
    clients: ClientTable<Client>,
    next_client: u64,
    newest: Newest,
    rate_hz: u32,
    scratch: Vec<u8>,
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
            clients: ClientTable::new(),
            next_client: 0,
            newest: Newest::default(),
            rate_hz: models.rate_hz().round().max(1.0) as u32,
            scratch: Vec::new(),
        })
    }

    fn accept(&mut self) {
        let Self { listeners, clients, next_client, .. } = self;
        for (listener, order) in listeners {
            clients.accept(listener, |from, has_room, queue| {
                if !has_room {
                    QtmSession::refuse(*order, queue);
                    return None;
                }
                let name = format!("{} ({})", from.ip(), from.port());
                let session = QtmSession::open(*next_client, name, *order, queue);
                *next_client += 1;
                Some(Client { session, address: from.ip() })
            });
        }
    }

    fn answer_discovery(&self) {
        let base_port = port_of(&self.listeners[0].0).saturating_sub(1);
        for_each_datagram(&self.discovery, &mut [0; 64], |request, from| {
            let Some(request) = DiscoveryRequest::parse(request) else { return };
            let host = rustix::system::uname();
            let host = host.nodename().to_string_lossy();
            let description = format!("{host}, QTM 2.17 (build 4000), {CAMERAS} cameras");
            let reply = DiscoveryReply { description, base_port };
            let to = SocketAddr::new(from.ip(), request.reply_port);
            let _ = self.discovery.send_to(&reply.to_datagram(), to);
        });
    }
}

impl FrameServer for QtmServer {
    fn endpoints(&self) -> Vec<Endpoint> {
        let [little, big] = &self.listeners;
        vec![
            Endpoint::of(("qtm", "little endian"), "tcp", little.0.local_addr()),
            Endpoint::of(("qtm", "big endian"), "tcp", big.0.local_addr()),
            Endpoint::of(("qtm", "discovery"), "udp", self.discovery.local_addr()),
        ]
    }

    fn add_sockets<'a>(&'a self, sockets: &mut Vec<PollFd<'a>>) {
        sockets.extend(self.listeners.iter().map(|(socket, _)| PollFd::new(socket, PollFlags::IN)));
        sockets.push(PollFd::new(&self.discovery, PollFlags::IN));
        self.clients.add_sockets(sockets);
    }

    fn serve(&mut self, _now: Time) {
        self.accept();
        let Self { clients, host, newest, .. } = self;
        let frame = newest.frame();
        clients.read(|client, bytes, queue| {
            client.session.receive(bytes, host, frame.as_ref(), queue).is_ok()
        });
        let events = host.take_events();
        clients.send(|client, queue| {
            events.iter().for_each(|event| client.session.write_event(*event, queue));
        });
        clients.remove_broken(|client| host.disconnected(client.session.client()));
        self.answer_discovery();
    }

    fn broadcast(&mut self, frame: &MotionFrame<'_>) {
        self.newest.copy_from(frame);
        if !self.host.has_data() {
            return;
        }
        let Self { clients, sender, rate_hz, scratch, .. } = self;
        clients.send(|Client { session, address }, queue| {
            let Some(StreamRequest { rate, target, components }) = session.subscription().copied()
            else {
                return;
            };
            if !rate.includes(frame.number, *rate_hz) {
                return;
            }
            match target {
                StreamTarget::Tcp => session.write_frame(frame, &components, queue),
                StreamTarget::Udp { address: other, port } => {
                    scratch.clear();
                    session.write_frame(frame, &components, scratch);
                    // A datagram that does not fit into the send buffer is lost, as on any network.
                    let to = SocketAddr::new(other.unwrap_or(*address), port);
                    let _ = sender.send_to(scratch, to);
                }
            }
        });
    }

    fn clients(&self) -> usize {
        self.clients.len()
    }
}
