//! Connection to a VRPN server: one connection for names and poses.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::os::fd::AsFd;

use oqtal_bus::time::{Span, Time};
use oqtal_wire::text::printable;
use oqtal_wire::vrpn::{TrackerPose, VrpnClient, VrpnEvent, VrpnVersion};

use crate::attempt::{Attempt, CameraConnection, ConnectError};
use crate::gate::FrameStamp;
use crate::routes::{CameraBody, RefusedBody, RouteTable};
use crate::socket::{lost, read_some};
use crate::stream::{CameraStream, FrameSink, MeasuredBody, StreamSockets};

/// Size of the read buffer \[bytes\].
const BUFFER: usize = 65_536;
/// Maximum number of reads in one turn \[-\].
const MAX_READS: usize = 16;
/// Time after the greeting within which the server must send a name; a tracker without one counts as missing.
const NAMING_TIME: Span = Span::from_millis(800);
/// Time between two keep-alive messages.
const PING_PERIOD: Span = Span::from_millis(1000);
/// Sender of the server itself, no tracker.
const CONTROL: &str = "VRPN Control";

/// Takes a pose with its sender and time \[us, server clock\].
type PoseHandler<'a> = &'a mut dyn FnMut(&RouteTable, (i32, u64), &TrackerPose);

/// An open connection.
#[derive(Debug)]
pub struct VrpnConnection {
    client: VrpnClient,
    socket: TcpStream,
    routes: RouteTable,
    buffer: Vec<u8>,
    ping_at: Time,
    greeted: Option<String>,
    /// Frames are received: nothing may allocate any more.
    is_open: bool,
}

/// Connects and waits for the names of the trackers.
///
/// # Errors
/// There is no usable server.
pub fn connect(attempt: &Attempt) -> Result<CameraConnection, ConnectError> {
    let mut connection = VrpnConnection {
        client: VrpnClient::new(),
        socket: attempt.tcp()?,
        routes: attempt.routes(),
        buffer: vec![0; BUFFER],
        ping_at: Time::UNSET,
        greeted: None,
        is_open: false,
    };
    connection.shake_hands(attempt)?;
    connection.socket.set_nonblocking(true).map_err(|error| attempt.refused(&error))?;
    connection.is_open = true;
    Ok(CameraConnection {
        server: connection.greeted.clone().unwrap_or_default(),
        bodies: connection.routes.listed(),
        wanted: connection.routes.wanted().iter().map(|name| printable(name)).collect(),
        stream: Box::new(connection),
    })
}

impl VrpnConnection {
    /// Blocks until the server has greeted and named the wanted trackers, or sends no more names.
    fn shake_hands(&mut self, attempt: &Attempt) -> Result<(), ConnectError> {
        let Self { client, socket, .. } = self;
        let sent = client.flush(|output| socket.write_all(output));
        sent.map_err(|error| attempt.refused(&error))?;
        let mut named_by = attempt.deadline;
        let timeout = Some(Span::from_millis(20).to_duration());
        self.socket.set_read_timeout(timeout).map_err(|error| attempt.refused(&error))?;
        loop {
            let wanted = self.routes.wanted().len();
            let complete = wanted > 0 && (0..wanted).all(|route| self.routes.has(route));
            if Time::now() >= named_by || (complete && !attempt.link.bodies.is_empty()) {
                break;
            }
            match self.socket.read(&mut self.buffer) {
                Ok(0) => return Err(attempt.silent("it closes the connection")),
                Ok(count) => self.client.receive(&self.buffer[..count]),
                Err(error)
                    if matches!(
                        error.kind(),
                        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut
                    ) => {}
                Err(error) => return Err(attempt.refused(&error)),
            }
            let before = self.greeted.is_some();
            self.handle(&mut |_, _, _| ()).map_err(|error| attempt.other_protocol(error))?;
            if self.greeted.is_some() && !before {
                named_by = (Time::now() + NAMING_TIME).min(attempt.deadline);
            }
        }
        if self.greeted.is_some() { Ok(()) } else { Err(attempt.silent("it sends nothing")) }
    }

    /// Handles the messages that were received; `pose` takes those of poses, with sender and time \[us, server clock\].
    fn handle(&mut self, pose: PoseHandler) -> io::Result<()> {
        let Self { client, routes, greeted, is_open, .. } = self;
        while let Some(event) = client.poll().map_err(lost)? {
            match event {
                VrpnEvent::Greeted(version) => *greeted = Some(version_name(version)),
                VrpnEvent::Sender { number, name } if name != CONTROL => {
                    let key = i64::from(number);
                    if *is_open {
                        routes.rename(key, name);
                    } else {
                        routes.insert(CameraBody { key, name: name.to_owned() });
                    }
                }
                VrpnEvent::Pose { sender, time_us, pose: measured } => {
                    pose(routes, (sender, time_us), &measured);
                }
                VrpnEvent::Disconnected => return Err(lost("the server ends the connection")),
                VrpnEvent::Sender { .. } | VrpnEvent::Pong | VrpnEvent::Other => {}
            }
        }
        Ok(())
    }
}

fn version_name(version: VrpnVersion) -> String {
    format!("VRPN {:02}.{:02}", version.major, version.minor)
}

/// Passes on the pose of a tracker: its route, number and time \[us, server clock\].
fn pass_on(
    (route, sender, time_us): (usize, i32, u64),
    measured: &TrackerPose,
    (arrival, sink): (Time, &mut dyn FrameSink),
) {
    // Further sensors of a tracker are other bodies of the same name.
    if measured.sensor != 0 {
        return;
    }
    let stamp_ns = (time_us > 0).then(|| time_us.wrapping_mul(1000));
    sink.frame(route, FrameStamp { number: None, stamp_ns }, arrival);
    let number = sender.unsigned_abs().saturating_add(1);
    let body = MeasuredBody { number, pose: measured.pose(), residual_m: f64::NAN };
    sink.body(route, route, body);
}

impl CameraStream for VrpnConnection {
    fn sockets(&self) -> StreamSockets<'_> {
        [Some(self.socket.as_fd()), None]
    }

    fn receive(&mut self, now: &dyn Fn() -> Time, sink: &mut dyn FrameSink) -> io::Result<()> {
        for _ in 0..MAX_READS {
            let count = read_some(&mut self.socket, &mut self.buffer)?;
            if count == 0 {
                break;
            }
            self.client.receive(&self.buffer[..count]);
            let arrival = now();
            self.handle(&mut |routes, (sender, time_us), measured| {
                let Some(route) = routes.route(i64::from(sender)) else { return };
                pass_on((route, sender, time_us), measured, (arrival, &mut *sink));
            })?;
        }
        Ok(())
    }

    fn maintain(&mut self, now: Time) -> io::Result<()> {
        if now >= self.ping_at {
            self.ping_at = now + PING_PERIOD;
            // A server makes a tracker of any name that it is asked for.
            let wanted = self.routes.wanted();
            if let Some(route) = (0..wanted.len()).find(|route| self.routes.has(*route)) {
                self.client.ping(&wanted[route]);
            }
        }
        let Self { client, socket, .. } = self;
        // An error, too, if the connection takes nothing: a server that reads no requests is of no use.
        client.flush(|output| socket.write_all(output))
    }

    fn has(&self, route: usize) -> bool {
        self.routes.has(route)
    }

    fn take_refused(&mut self) -> Option<RefusedBody> {
        self.routes.take_refused()
    }

    fn gate_per_body(&self) -> bool {
        true
    }
}
