//! The server's end: answers to requests, and the clients that get frames by unicast.

use std::net::{Ipv4Addr, SocketAddr};

use super::DATA_PORT;
use super::frame_writing::{CLOCK_HZ, write_frame};
use super::message::{MessageId, NatNetMessage, NatNetVersion, write_content};
use super::model::{BodyDefinition, ModelDefinitions};
use super::server_info::ServerInfo;
use crate::motion::MotionFrame;

/// Greatest number of unicast clients \[-\].
const MAX_CLIENTS: usize = 10;
/// Silence after which a unicast client is removed \[ns\].
const SILENCE_NS: u64 = 10_000_000_000;

/// Options of a server.
#[derive(Clone, Debug, PartialEq)]
pub struct NatNetServerOptions {
    /// Version of the protocol.
    pub version: NatNetVersion,
    /// Group of the frames; `None` serves unicast clients only.
    pub multicast: Option<Ipv4Addr>,
    /// Port of the frames by multicast \[-\].
    pub data_port: u16,
    /// Rate of the cameras \[Hz\].
    pub rate_hz: f32,
    /// The bodies.
    pub bodies: Vec<BodyDefinition>,
}

impl Default for NatNetServerOptions {
    fn default() -> Self {
        Self {
            version: NatNetVersion::SIZED,
            multicast: Some(super::MULTICAST_GROUP),
            data_port: DATA_PORT,
            rate_hz: 100.0,
            bodies: Vec::new(),
        }
    }
}

/// A client that gets its frames by unicast.
#[derive(Clone, Copy, Debug)]
struct UnicastClient {
    address: SocketAddr,
    received_ns: u64,
    version: NatNetVersion,
}

/// The server's end: datagrams in, datagrams out.
#[derive(Clone, Debug)]
pub struct NatNetServer {
    info: ServerInfo,
    rate_hz: f32,
    models: ModelDefinitions,
    clients: Vec<UnicastClient>,
}

impl NatNetServer {
    /// A server without clients.
    pub fn new(options: NatNetServerOptions) -> Self {
        let info = ServerInfo {
            name: "Motive".to_owned(),
            app_version: [3, 1, 0, 0],
            version: options.version,
            clock_hz: CLOCK_HZ,
            data_port: options.data_port,
            multicast: options.multicast,
        };
        let models = ModelDefinitions { bodies: options.bodies };
        Self { info, rate_hz: options.rate_hz, models, clients: Vec::new() }
    }

    /// Takes a datagram of a client and appends the answer for its sender to `out`; no answer to invalid requests.
    pub fn receive(&mut self, datagram: &[u8], from: SocketAddr, now_ns: u64, out: &mut Vec<u8>) {
        let Ok(message) = NatNetMessage::parse(datagram) else { return };
        let version = self.version_of(from);
        match message.id {
            MessageId::Connect => self.info.write(out),
            MessageId::RequestModels => self.models.write(version, out),
            MessageId::KeepAlive => self.keep(from, now_ns),
            MessageId::Disconnect => self.clients.retain(|client| client.address != from),
            MessageId::Request => self.request(message.content, from, out),
            // The time of the client comes back as it was sent; that of the server is in ticks of its clock, as in the frames.
            MessageId::EchoRequest if message.content.len() == 8 => {
                write_content(out, MessageId::EchoResponse, |writer| {
                    writer.bytes(message.content).u64(now_ns / (1_000_000_000 / CLOCK_HZ));
                });
            }
            _ => {}
        }
    }

    /// Addresses of the unicast clients. Removes silent clients.
    pub fn unicast_clients(&mut self, now_ns: u64) -> impl Iterator<Item = SocketAddr> + '_ {
        self.clients.retain(|client| now_ns.saturating_sub(client.received_ns) < SILENCE_NS);
        self.clients.iter().map(|client| client.address)
    }

    /// Appends a frame to `out`: for the unicast client at `to`, or else for the group.
    pub fn write_frame(&self, frame: &MotionFrame<'_>, to: Option<SocketAddr>, out: &mut Vec<u8>) {
        let version = to.map_or(self.info.version, |to| self.version_of(to));
        write_frame(frame, &self.models.bodies, version, out);
    }

    /// Version in which a client is answered.
    fn version_of(&self, address: SocketAddr) -> NatNetVersion {
        let client = self.clients.iter().find(|client| client.address == address);
        client.map_or(self.info.version, |client| client.version)
    }

    /// Keeps a unicast client, if there is a place for it.
    fn keep(&mut self, address: SocketAddr, now_ns: u64) {
        let version = self.info.version;
        if let Some(client) = self.clients.iter_mut().find(|client| client.address == address) {
            client.received_ns = now_ns;
        } else if self.clients.len() < MAX_CLIENTS {
            self.clients.push(UnicastClient { address, received_ns: now_ns, version });
        }
    }

    /// Answers a text request.
    fn request(&mut self, content: &[u8], from: SocketAddr, out: &mut Vec<u8>) {
        let end = content.iter().position(|byte| *byte == 0).unwrap_or(content.len());
        let text = std::str::from_utf8(&content[..end]).unwrap_or_default();
        let (name, argument) = text.split_once(',').unwrap_or((text, ""));
        let bitstream =
            || argument.trim().parse().ok().filter(|v: &NatNetVersion| v.is_supported());
        match name {
            "FrameRate" => write_content(out, MessageId::Response, |w| {
                w.f32(self.rate_hz);
            }),
            "UnitsToMillimeters" => write_content(out, MessageId::Response, |w| {
                w.f32(1000.0);
            }),
            "Bitstream" if bitstream().is_some() => {
                let client = self.clients.iter_mut().find(|client| client.address == from);
                if let (Some(client), Some(version)) = (client, bitstream()) {
                    client.version = version;
                }
                write_content(out, MessageId::Response, |w| {
                    w.i32(0);
                });
            }
            _ => write_content(out, MessageId::Unrecognized, |_| ()),
        }
    }
}
