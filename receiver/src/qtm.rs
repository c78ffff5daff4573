//! Connection to Qualisys Track Manager: the control connection, and frames over it or as datagrams.

use std::io::{self, Read, Write};
use std::net::{IpAddr, TcpStream, UdpSocket};
use std::os::fd::AsFd;

use oqtal_bus::time::{Span, Time};
use oqtal_wire::ByteOrder;
use oqtal_wire::qtm::{
    BIG_ENDIAN_PORT, DataPacket, QtmClient, QtmClientError, QtmClientEvent, QtmClientOptions,
    QtmEvent, QtmPacket, QtmVersion, StreamTarget,
};
use oqtal_wire::text::printable;

use crate::attempt::{Attempt, CameraConnection, ConnectError};
use crate::definitions::{BodyDefinitions, DefinitionFormat, DefinitionSlot, read};
use crate::gate::FrameStamp;
use crate::routes::{CameraBody, RefusedBody, RouteTable};
use crate::socket::{lost, read_some, receive_some};
use crate::stream::{CameraStream, FrameSink, MeasuredBody, StreamSockets};
use oqtal_wire::link::CameraProtocol;

/// Size of the read buffer \[bytes\]: the longest datagram.
const BUFFER: usize = 65_536;
/// Time between two requests for parameters while they and the frames differ in the number of bodies.
const REQUEST_PERIOD: Span = Span::from_millis(500);
/// Time between two requests for parameters while they agree: a body can be renamed, or take the place of another.
const CHECK_PERIOD: Span = Span::from_millis(2000);
/// Most reads of one turn \[-\].
const MAX_READS: usize = 64;

/// An open connection.
#[derive(Debug)]
pub struct QtmConnection {
    client: QtmClient,
    control: TcpStream,
    frames: Option<UdpSocket>,
    order: ByteOrder,
    routes: RouteTable,
    definitions: DefinitionSlot,
    agreement: BodyAgreement,
    server: IpAddr,
    buffer: Vec<u8>,
}

/// Agreement of frames and definitions on the number of bodies. Frames identify bodies only by their place: if the numbers differ, a place
/// does not identify a body.
#[derive(Clone, Copy, Debug)]
struct BodyAgreement {
    holds: bool,
    /// Instant of the last request for parameters.
    requested_at: Time,
}

/// Connects, agrees on a version, reads the names of the bodies and asks for frames.
///
/// # Errors
/// There is no usable server.
pub fn connect(attempt: &Attempt) -> Result<CameraConnection, ConnectError> {
    let mut connection = QtmConnection::open(attempt)?;
    let bodies = connection.shake_hands(attempt)?;
    let refused = |error: io::Error| attempt.refused(&error);
    connection.control.set_nonblocking(true).map_err(refused)?;
    connection.routes.replace(bodies);
    connection.definitions = DefinitionSlot::new(DefinitionFormat::Qtm, &connection.routes);
    let version = connection.client.version();
    let server = version.map_or_else(String::new, |version| format!("QTM RT protocol {version}"));
    Ok(CameraConnection {
        server,
        bodies: connection.routes.listed(),
        wanted: connection.routes.wanted().iter().map(|name| printable(name)).collect(),
        stream: Box::new(connection),
    })
}

impl QtmConnection {
    fn open(attempt: &Attempt) -> Result<Self, ConnectError> {
        let CameraProtocol::Qtm { udp, minor } = attempt.link.protocol else {
            return Err(attempt.other_protocol("the link is of another kind"));
        };
        let control = attempt.tcp()?;
        let frames = if udp { Some(open_datagrams(attempt)?) } else { None };
        let port = frames.as_ref().and_then(|socket| socket.local_addr().ok());
        let target = port.map_or(StreamTarget::Tcp, |address| StreamTarget::Udp {
            address: None,
            port: address.port(),
        });
        let order = if attempt.address.port() == BIG_ENDIAN_PORT {
            ByteOrder::Big
        } else {
            ByteOrder::Little
        };
        let mut options = QtmClientOptions { order, ..QtmClientOptions::default() };
        options.newest = QtmVersion::new(1, minor);
        options.stream.target = target;
        let client = QtmClient::new(options);
        let routes = attempt.routes();
        let definitions = DefinitionSlot::new(DefinitionFormat::Qtm, &routes);
        let (server, buffer) = (attempt.address.ip(), vec![0; BUFFER]);
        // If the first frame does not agree, they are requested at once.
        let agreement = BodyAgreement { holds: true, requested_at: Time::now() - REQUEST_PERIOD };
        Ok(Self { client, control, frames, order, routes, definitions, agreement, server, buffer })
    }

    /// Blocks until the bodies are named and the stream is requested.
    fn shake_hands(&mut self, attempt: &Attempt) -> Result<Vec<CameraBody>, ConnectError> {
        loop {
            if attempt.is_over() {
                return Err(attempt.silent("it sends nothing"));
            }
            let refused = |error: io::Error| attempt.refused(&error);
            self.control.set_read_timeout(Some(attempt.left())).map_err(refused)?;
            let count =
                self.control.read(&mut self.buffer).map_err(|error| match error.kind() {
                    io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock => {
                        attempt.silent("it sends nothing")
                    }
                    _ => attempt.refused(&error),
                })?;
            if count == 0 {
                return Err(attempt.silent("it closes the connection"));
            }
            self.client.receive(&self.buffer[..count]);
            let bodies = self.next_bodies(attempt)?;
            let Self { client, control, .. } = self;
            let sent = client.flush(|output| control.write_all(output));
            sent.map_err(|error| attempt.refused(&error))?;
            if let Some(bodies) = bodies {
                return Ok(bodies);
            }
        }
    }

    fn next_bodies(&mut self, attempt: &Attempt) -> Result<Option<Vec<CameraBody>>, ConnectError> {
        let address = attempt.address.to_string();
        loop {
            let event = self.client.poll().map_err(|error| match error {
                QtmClientError::Version { .. } => {
                    ConnectError::Version { address: address.clone(), reason: error.to_string() }
                }
                QtmClientError::Refused(reason) => {
                    ConnectError::Refused { address: address.clone(), reason }
                }
                other => attempt.other_protocol(other),
            })?;
            match event {
                Some(QtmClientEvent::Parameters(text)) => {
                    let bodies = read(text.as_bytes(), DefinitionFormat::Qtm);
                    return bodies.map(Some).map_err(|reason| attempt.other_protocol(reason));
                }
                Some(QtmClientEvent::NoData) => return Err(ConnectError::Idle { address }),
                Some(_) => {}
                None => return Ok(None),
            }
        }
    }

    /// Reads the control connection.
    fn receive_control(
        &mut self,
        now: &dyn Fn() -> Time,
        sink: &mut dyn FrameSink,
    ) -> io::Result<()> {
        for _ in 0..MAX_READS {
            let count = read_some(&mut self.control, &mut self.buffer)?;
            if count == 0 {
                break;
            }
            self.client.receive(&self.buffer[..count]);
            self.handle_control(now(), &mut *sink)?;
        }
        Ok(())
    }

    /// Handles what has arrived on the control connection.
    fn handle_control(&mut self, arrival: Time, sink: &mut dyn FrameSink) -> io::Result<()> {
        let Self { client, routes, definitions, agreement, .. } = self;
        while let Some(event) = client.poll().map_err(lost)? {
            match event {
                QtmClientEvent::Frame(data) => {
                    agreement.holds = pass_on(&data, routes, (arrival, &mut *sink));
                }
                QtmClientEvent::Parameters(text) => definitions.receive(text.as_bytes()),
                QtmClientEvent::Event(QtmEvent::ShuttingDown) => {
                    return Err(lost("QTM is shutting down"));
                }
                QtmClientEvent::Handshake | QtmClientEvent::NoData | QtmClientEvent::Event(_) => {}
            }
        }
        Ok(())
    }

    fn receive_datagrams(
        &mut self,
        now: &dyn Fn() -> Time,
        sink: &mut dyn FrameSink,
    ) -> io::Result<()> {
        let Some(socket) = &self.frames else { return Ok(()) };
        for _ in 0..MAX_READS {
            let count = receive_some(socket, self.server, &mut self.buffer)?;
            if count == 0 {
                break;
            }
            match QtmPacket::parse(&self.buffer[..count], self.order) {
                Ok(QtmPacket::Data(data)) => {
                    self.agreement.holds = pass_on(&data, &self.routes, (now(), &mut *sink));
                }
                Ok(_) => {}
                Err(_) => sink.damaged(),
            }
        }
        Ok(())
    }
}

impl CameraStream for QtmConnection {
    fn sockets(&self) -> StreamSockets<'_> {
        [Some(self.control.as_fd()), self.frames.as_ref().map(AsFd::as_fd)]
    }

    fn receive(&mut self, now: &dyn Fn() -> Time, sink: &mut dyn FrameSink) -> io::Result<()> {
        self.receive_datagrams(now, sink)?;
        self.receive_control(now, sink)
    }

    fn maintain(&mut self, now: Time) -> io::Result<()> {
        let Self { client, control, agreement, .. } = self;
        let period = if agreement.holds { CHECK_PERIOD } else { REQUEST_PERIOD };
        if now.since(agreement.requested_at) >= period {
            agreement.requested_at = now;
            client.request_parameters();
        }
        // An error, too, if the connection takes nothing: a server that reads no requests is of no use.
        client.flush(|output| control.write_all(output))
    }

    fn take_definitions(&mut self) -> Option<Box<BodyDefinitions>> {
        self.definitions.take()
    }

    fn apply_definitions(&mut self, definitions: Box<BodyDefinitions>) {
        if self.definitions.apply_definitions(definitions, &mut self.routes) {
            self.client.request_parameters();
        }
    }

    fn has(&self, route: usize) -> bool {
        self.agreement.holds && self.routes.has(route)
    }

    fn take_refused(&mut self) -> Option<RefusedBody> {
        self.routes.take_refused()
    }
}

/// Opens the socket that datagrams come to, for datagrams of the server alone.
fn open_datagrams(attempt: &Attempt) -> Result<UdpSocket, ConnectError> {
    let any = if attempt.address.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
    let open = || {
        let socket = UdpSocket::bind(any)?;
        socket.set_nonblocking(true)?;
        Ok(socket)
    };
    open().map_err(|error: io::Error| attempt.refused(&error))
}

/// Passes the requested bodies of a frame on. Returns whether it has as many bodies as are defined; otherwise none is tracked.
fn pass_on(
    data: &DataPacket<'_>,
    routes: &RouteTable,
    (arrival, sink): (Time, &mut dyn FrameSink),
) -> bool {
    let stamp = FrameStamp {
        number: Some(data.frame()),
        stamp_ns: Some(data.timestamp_us().wrapping_mul(1000)),
    };
    sink.frame(0, stamp, arrival);
    if data.bodies().count() != routes.bodies().count() {
        let untracked = MeasuredBody { number: 0, pose: None, residual_m: f64::NAN };
        (0..routes.wanted().len()).for_each(|route| sink.body(0, route, untracked));
        return false;
    }
    for (record, key) in data.bodies().zip(0_u32..) {
        let Some(route) = routes.route(i64::from(key)) else { continue };
        let residual_m = record.residual_mm.map_or(f64::NAN, |mm| f64::from(mm) * 1e-3);
        let body = MeasuredBody { number: key + 1, pose: record.pose().ok(), residual_m };
        sink.body(0, route, body);
    }
    true
}
