//! Socket of the NatNet server: requests, and frames by multicast and unicast.

use std::net::{IpAddr, SocketAddr, UdpSocket};

use oqtal_bus::time::Time;
use oqtal_runtime::process::Failure;
use oqtal_wire::motion::MotionFrame;
use oqtal_wire::natnet::{NatNetServer, NatNetServerOptions};
use rustix::event::{PollFd, PollFlags};

use super::address::{datagrams, for_each_datagram};
use super::server::{Endpoint, FrameServer};

/// The NatNet server.
#[derive(Debug)]
pub struct NatNetSocket {
    /// Requests and their answers.
    socket: UdpSocket,
    /// Frames: as from Motive, from another port than the answers.
    frames: UdpSocket,
    server: NatNetServer,
    group: Option<SocketAddr>,
    clients: Vec<SocketAddr>,
    answer: Vec<u8>,
    input: Vec<u8>,
}

impl NatNetSocket {
    /// Opens the server of `options`: requests at `port`, frames by multicast to the next port, whatever `options.data_port` is.
    pub fn open(ip: IpAddr, port: u16, mut options: NatNetServerOptions) -> Result<Self, Failure> {
        let socket = datagrams("natnet", SocketAddr::new(ip, port))?;
        let port = socket.local_addr().map_or(port, |address| address.port());
        options.data_port = port.saturating_add(1);
        let frames = datagrams("natnet", SocketAddr::new(ip, 0))?;
        // Both sockets are bound to the served address, so frames leave by its interface.
        let group = options.multicast.map(|group| SocketAddr::from((group, options.data_port)));
        Ok(Self {
            socket,
            frames,
            server: NatNetServer::new(options),
            group,
            clients: Vec::new(),
            answer: Vec::new(),
            input: vec![0; 1 << 16],
        })
    }
}

impl FrameServer for NatNetSocket {
    fn endpoints(&self) -> Vec<Endpoint> {
        let requests = Endpoint::of(("natnet", "requests"), "udp", self.socket.local_addr());
        let frames = self.group.map(|group| Endpoint {
            service: "frames",
            address: group.to_string(),
            ..requests.clone()
        });
        std::iter::once(requests).chain(frames).collect()
    }

    fn add_sockets<'a>(&'a self, sockets: &mut Vec<PollFd<'a>>) {
        sockets.push(PollFd::new(&self.socket, PollFlags::IN));
    }

    fn serve(&mut self, now: Time) {
        let Self { socket, server, answer, input, .. } = self;
        for_each_datagram(socket, input, |request, from| {
            answer.clear();
            server.receive(request, from, now.nanos(), answer);
            if !answer.is_empty() {
                let _ = socket.send_to(answer, from);
            }
        });
        self.clients.clear();
        self.clients.extend(self.server.unicast_clients(now.nanos()));
    }

    fn broadcast(&mut self, frame: &MotionFrame<'_>) {
        let unicast = self.clients.iter().copied().map(|client| (client, Some(client)));
        let multicast = self.group.map(|group| (group, None));
        for (to, client) in multicast.into_iter().chain(unicast) {
            self.answer.clear();
            self.server.write_frame(frame, client, &mut self.answer);
            // A datagram that does not fit into the send buffer is lost, as on any network.
            let _ = self.frames.send_to(&self.answer, to);
        }
    }

    fn clients(&self) -> usize {
        self.clients.len()
    }
}
