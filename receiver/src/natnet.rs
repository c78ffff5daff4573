//! Connection to OptiTrack Motive by NatNet: a socket for commands, and frames on it or from a multicast group.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::AsFd;

use oqtal_bus::time::{Span, Time};
use oqtal_wire::natnet::{
    NatNetClient, NatNetClientError, NatNetEvent, NatNetFrame, NatNetStage, NatNetVersion,
    ServerInfo,
};
use oqtal_wire::text::printable;

use crate::attempt::{Attempt, CameraConnection, ConnectError};
use crate::definitions::{BodyDefinitions, DefinitionFormat, DefinitionSlot, read};
use crate::gate::FrameStamp;
use crate::routes::{RefusedBody, RouteTable};
use crate::socket::{bind_group, lost, receive_some};
use crate::stream::{CameraStream, FrameSink, MeasuredBody, StreamSockets};
use oqtal_wire::link::{CameraProtocol, NatnetDelivery};

/// Size of the read buffer \[bytes\]: the longest datagram.
const BUFFER: usize = 65_536;
/// Frames in a row with a restarted count, after which the server counts as restarted \[-\]: fewer than the gate needs.
const RESTART_FRAMES: u32 = 4;
/// Time between two requests for the names of the bodies.
const MODELS_PERIOD: Span = Span::from_millis(1000);
/// Most datagrams of one turn and socket \[-\].
const MAX_READS: usize = 64;

/// An open connection.
#[derive(Debug)]
pub struct NatnetConnection {
    client: NatNetClient,
    commands: UdpSocket,
    /// Frames of a multicast group; those of a unicast server come to `commands`, from another port than its answers.
    frames: Option<UdpSocket>,
    server: SocketAddr,
    clock_hz: u64,
    routes: RouteTable,
    definitions: DefinitionSlot,
    count: FrameCount,
    /// Instant of the next request for the names of the bodies; the server does not announce their changes.
    next_models: Time,
    buffer: Vec<u8>,
}

/// Detects a restarted count of frames: the server was restarted, and its bodies may have changed.
#[derive(Clone, Copy, Debug, Default)]
struct FrameCount {
    last: Option<i32>,
    /// Run of increasing numbers below `last`: its length \[-\] and its latest number.
    restart_run: (u32, i32),
}

impl FrameCount {
    /// Takes the number of a frame. Returns whether the count has restarted.
    fn has_restarted(&mut self, number: i32) -> bool {
        let Some(last) = self.last.filter(|last| number.wrapping_sub(*last) <= 0) else {
            *self = Self { last: Some(number), restart_run: (0, number) };
            return false;
        };
        let (count, before) = self.restart_run;
        // A repeated frame does not belong to a new count.
        if number != last {
            self.restart_run = (if count > 0 && number > before { count + 1 } else { 1 }, number);
        }
        self.restart_run.0 >= RESTART_FRAMES
    }
}

/// Connects, reads the definitions of the bodies, and joins the group of the frames.
///
/// # Errors
/// There is no usable server, or the port of the frames is in use.
pub fn connect(attempt: &Attempt) -> Result<CameraConnection, ConnectError> {
    let CameraProtocol::Natnet { delivery } = attempt.link.protocol else {
        return Err(attempt.other_protocol("the link is of another kind"));
    };
    let mut connection = NatnetConnection::open(attempt, delivery == NatnetDelivery::Unicast)?;
    let mut info = connection.shake_hands(attempt)?;
    let group = match delivery {
        NatnetDelivery::Announced => info.multicast,
        NatnetDelivery::Multicast(group) => Some(group),
        NatnetDelivery::Unicast => None,
    };
    match group {
        Some(group) => {
            let frames = connection.join(attempt, (group, info.data_port))?;
            connection.frames = Some(frames);
        }
        None if delivery == NatnetDelivery::Announced => {
            // A unicast server: its frames must be requested.
            connection = NatnetConnection::open(attempt, true)?;
            info = connection.shake_hands(attempt)?;
        }
        None => {}
    }
    let refused = |error: io::Error| attempt.refused(&error);
    connection.commands.set_nonblocking(true).map_err(refused)?;
    connection.clock_hz = info.clock_hz.max(1);
    let format = DefinitionFormat::Natnet(info.version);
    connection.definitions = DefinitionSlot::new(format, &connection.routes);
    let [major, minor, ..] = info.app_version;
    Ok(CameraConnection {
        server: format!("{} {major}.{minor}, NatNet {}", printable(&info.name), info.version),
        bodies: connection.routes.listed(),
        wanted: connection.routes.wanted().iter().map(|name| printable(name)).collect(),
        stream: Box::new(connection),
    })
}

impl NatnetConnection {
    fn open(attempt: &Attempt, unicast: bool) -> Result<Self, ConnectError> {
        let any = if attempt.address.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
        let open = || {
            let socket = UdpSocket::bind(any)?;
            if !unicast {
                // The address of the socket is then that of the interface for the group.
                socket.connect(attempt.address)?;
            }
            socket.set_read_timeout(Some(Span::from_millis(20).to_duration()))?;
            Ok(socket)
        };
        let routes = attempt.routes().with_numbers();
        let format = DefinitionFormat::Natnet(NatNetVersion::OLDEST);
        Ok(Self {
            client: NatNetClient::new(unicast),
            commands: open().map_err(|error: io::Error| attempt.refused(&error))?,
            frames: None,
            server: attempt.address,
            clock_hz: 1,
            definitions: DefinitionSlot::new(format, &routes),
            routes,
            count: FrameCount::default(),
            next_models: Time::UNSET,
            buffer: vec![0; BUFFER],
        })
    }

    /// Joins the group of the frames, at the interface that leads to the server.
    fn join(
        &self,
        attempt: &Attempt,
        (group, port): (Ipv4Addr, u16),
    ) -> Result<UdpSocket, ConnectError> {
        let opened = self.commands.local_addr().and_then(|address| {
            let IpAddr::V4(interface) = address.ip() else {
                return Err(io::Error::other("the multicast group needs an IPv4 server"));
            };
            let socket = bind_group(group, port, interface)?;
            socket.set_nonblocking(true)?;
            Ok(socket)
        });
        opened.map_err(|error| match error.kind() {
            io::ErrorKind::AddrInUse => ConnectError::PortInUse { port, reason: error.to_string() },
            io::ErrorKind::PermissionDenied => {
                ConnectError::Permission { what: format!("port {port}"), reason: error.to_string() }
            }
            _ => attempt.refused(&error),
        })
    }

    /// Blocks until the definitions have come.
    fn shake_hands(&mut self, attempt: &Attempt) -> Result<ServerInfo, ConnectError> {
        while !attempt.is_over() {
            if let Some(datagram) = self.client.poll_output(Time::now().nanos()) {
                // Send errors are ignored; the request is repeated.
                let _ = self.commands.send_to(datagram, self.server);
            }
            let count = match self.commands.recv_from(&mut self.buffer) {
                Ok((count, from)) if from.ip() == self.server.ip() => count,
                Ok(_) => continue,
                Err(error) if is_final(&error) => return Err(attempt.refused(&error)),
                Err(_) => continue,
            };
            match self.client.receive(&self.buffer[..count]) {
                Ok(NatNetEvent::Models(content, version)) => {
                    let Ok(bodies) = read(content, DefinitionFormat::Natnet(version)) else {
                        self.client.request_models();
                        continue;
                    };
                    self.routes.replace(bodies);
                    if let Some(info) = self.client.info() {
                        return Ok(info.clone());
                    }
                }
                Ok(_) | Err(NatNetClientError::Datagram(_)) => {}
                Err(error @ NatNetClientError::Version(_)) => {
                    let address = attempt.address.to_string();
                    return Err(ConnectError::Version { address, reason: error.to_string() });
                }
            }
        }
        let silent = if self.client.stage() == NatNetStage::Connecting {
            io::Error::from(io::ErrorKind::TimedOut)
        } else {
            io::Error::other("it names no bodies")
        };
        Err(attempt.refused(&silent))
    }

    /// Reads one of the two sockets.
    fn receive_from(
        &mut self,
        commands: bool,
        now: &dyn Fn() -> Time,
        sink: &mut dyn FrameSink,
    ) -> io::Result<()> {
        let Self { client, frames, routes, clock_hz, buffer, server, definitions, count, .. } =
            self;
        let socket = if commands { Some(&self.commands) } else { frames.as_ref() };
        let Some(socket) = socket else { return Ok(()) };
        let mut changed = false;
        for _ in 0..MAX_READS {
            let bytes = receive_some(socket, server.ip(), buffer)?;
            if bytes == 0 {
                break;
            }
            match client.receive(&buffer[..bytes]) {
                Ok(NatNetEvent::Frame(frame)) if count.has_restarted(frame.number()) => {
                    return Err(lost("the server was restarted"));
                }
                Ok(NatNetEvent::Frame(frame)) => {
                    changed |= frame.models_changed();
                    pass_on(&frame, (routes, *clock_hz), (now(), &mut *sink));
                }
                Ok(NatNetEvent::Models(content, _)) => definitions.receive(content),
                // Rate of the clock, version and group may be others now.
                Ok(NatNetEvent::Connected(_)) => return Err(lost("the server was restarted")),
                Ok(NatNetEvent::Other) => {}
                Err(_) => sink.damaged(),
            }
        }
        if changed {
            client.request_models();
        }
        Ok(())
    }
}

/// Whether another try would also fail.
fn is_final(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::ConnectionRefused)
}

impl CameraStream for NatnetConnection {
    fn sockets(&self) -> StreamSockets<'_> {
        [Some(self.commands.as_fd()), self.frames.as_ref().map(AsFd::as_fd)]
    }

    fn receive(&mut self, now: &dyn Fn() -> Time, sink: &mut dyn FrameSink) -> io::Result<()> {
        self.receive_from(false, now, sink)?;
        self.receive_from(true, now, sink)
    }

    fn maintain(&mut self, now: Time) -> io::Result<()> {
        if now >= self.next_models {
            self.next_models = now + MODELS_PERIOD;
            self.client.request_models();
        }
        if let Some(datagram) = self.client.poll_output(now.nanos()) {
            // Send errors are ignored; silence ends the connection.
            let _ = self.commands.send_to(datagram, self.server);
        }
        Ok(())
    }

    fn take_definitions(&mut self) -> Option<Box<BodyDefinitions>> {
        self.definitions.take()
    }

    fn apply_definitions(&mut self, definitions: Box<BodyDefinitions>) {
        if self.definitions.apply_definitions(definitions, &mut self.routes) {
            self.client.request_models();
        }
    }

    fn has(&self, route: usize) -> bool {
        self.routes.has(route)
    }

    fn take_refused(&mut self) -> Option<RefusedBody> {
        self.routes.take_refused()
    }
}

/// Passes the requested bodies of a frame on.
fn pass_on(
    frame: &NatNetFrame<'_>,
    (routes, clock_hz): (&RouteTable, u64),
    (arrival, sink): (Time, &mut dyn FrameSink),
) {
    let stamp = FrameStamp {
        number: Some(frame.number().cast_unsigned()),
        stamp_ns: stamp_ns(frame, clock_hz),
    };
    sink.frame(0, stamp, arrival);
    for body in frame.bodies() {
        let Some(route) = routes.route(i64::from(body.id)) else { continue };
        let measured = MeasuredBody {
            number: body.id.unsigned_abs(),
            pose: body.pose(),
            residual_m: f64::from(body.mean_error_m),
        };
        sink.body(0, route, measured);
    }
}

/// The middle of the exposure \[ns, server clock\]. Cameras without this value send zero: the arrival of their data at the server, or the
/// time since the server's start, is used instead, and its constant delay is part of the latency of the cameras.
fn stamp_ns(frame: &NatNetFrame<'_>, clock_hz: u64) -> Option<u64> {
    let times = frame.times();
    let ticks = [times.mid_exposure, times.received].into_iter().find(|ticks| *ticks > 0);
    let since_start_ns = (times.timestamp_s > 0.0).then_some((times.timestamp_s * 1e9) as u64);
    let in_ns = |ticks: u64| {
        let nanos = u128::from(ticks) * 1_000_000_000 / u128::from(clock_hz);
        nanos as u64
    };
    ticks.map(in_ns).or(since_start_ns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_restarted_count_differs_from_lost_repeated_and_late_frames() {
        let mut count = FrameCount::default();
        let numbers = [100, 101, 103, 103, 102, 104, 102, 103, 105, 110, 109, 109, 109, 109, 111];
        assert!(!numbers.into_iter().any(|number| count.has_restarted(number)));
        let restarted: Vec<bool> = (1..=5).map(|number| count.has_restarted(number)).collect();
        assert_eq!(restarted, [false, false, false, true, true]);
        let mut young = FrameCount::default();
        assert!(![i32::MAX, i32::MIN, i32::MIN + 1].into_iter().any(|n| young.has_restarted(n)));
    }
}
