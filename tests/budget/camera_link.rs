//! Camera systems for one client, whose lists of bodies change while frames are sent.

use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::time::{Duration, Instant};

use oqtal_wire::ByteOrder;
use oqtal_wire::motion::{BodySample, MotionFrame, RigidPose};
use oqtal_wire::natnet::{
    BodyDefinition, ModelDefinitions, NatNetServer, NatNetServerOptions, ServerInfo,
};
use oqtal_wire::qtm::{
    QtmBody, QtmEvent, QtmHost, QtmParameters, QtmSession, QtmWriter, StreamTarget,
};
use oqtal_wire::vrpn::{VrpnMessage, VrpnSession, write_message};

/// Time between two frames.
const INTERVAL: Duration = Duration::from_millis(1);
/// Number of frames after which the list of bodies changes \[-\].
const CHANGE: u32 = 20;

/// Starts a server of `kind` in a thread that ends with its client; returns the address.
pub fn serve(kind: &'static str) -> SocketAddr {
    let any = (Ipv4Addr::LOCALHOST, 0);
    if kind == "natnet" {
        let socket = UdpSocket::bind(any).unwrap();
        let address = socket.local_addr().unwrap();
        std::thread::spawn(move || serve_natnet(&socket));
        return address;
    }
    let listener = TcpListener::bind(any).unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        let stream = listener.accept().unwrap().0;
        stream.set_read_timeout(Some(INTERVAL)).unwrap();
        if kind == "qtm" { serve_qtm(stream) } else { serve_vrpn(stream) }
    });
    address
}

fn names(number: u32) -> Option<[&'static str; 2]> {
    match number % (2 * CHANGE) {
        0 => Some(["other", "quad"]),
        CHANGE => Some(["quad", "other"]),
        _ => None,
    }
}

/// Calls `step` with each frame, and with the new list of bodies when it changes.
fn play(mut step: impl FnMut(&MotionFrame<'_>, Option<[&str; 2]>) -> Option<()>) {
    let pose = RigidPose::new([0.1, 0.2, 1.0], [0.0, 0.0, 0.0, 1.0]);
    let bodies = [BodySample { pose, residual_m: 0.0 }; 2];
    let began = Instant::now();
    for number in 1..=u32::MAX {
        let captured_ns = began.elapsed().as_nanos() as u64;
        let frame = MotionFrame {
            number,
            captured_ns,
            sent_ns: captured_ns,
            bodies: &bodies,
            markers: &[],
        };
        if step(&frame, names(number)).is_none() {
            return;
        }
    }
}

/// Reads from the client for one interval; `None` after it has disconnected.
fn read(stream: &mut TcpStream, buffer: &mut [u8]) -> Option<usize> {
    match stream.read(buffer) {
        Ok(0) => None,
        Ok(count) => Some(count),
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
            Some(0)
        }
        Err(_) => None,
    }
}

fn parameters(names: [&str; 2]) -> QtmParameters {
    let body = |name: &str| QtmBody { name: name.to_owned(), ..QtmBody::default() };
    QtmParameters { bodies: Some(names.map(body).to_vec()), ..QtmParameters::default() }
}

fn serve_qtm(mut stream: TcpStream) {
    let (mut out, mut buffer) = (Vec::new(), [0; 4096]);
    let mut host = QtmHost::new(parameters(["quad", "other"]));
    let mut session = QtmSession::open(1, String::new(), ByteOrder::Little, &mut out);
    let (datagrams, client) =
        (UdpSocket::bind("127.0.0.1:0").unwrap(), stream.peer_addr().unwrap());
    play(|frame, changed| {
        let count = read(&mut stream, &mut buffer)?;
        if let Some(names) = changed {
            host = QtmHost::new(parameters(names));
            // The client requests the parameters.
            QtmWriter::new(&mut out, ByteOrder::Little).event(QtmEvent::CaptureStarted);
        }
        session.receive(&buffer[..count], &mut host, Some(frame), &mut out).unwrap();
        if let Some(request) = session.subscription() {
            match request.target {
                StreamTarget::Tcp => session.write_frame(frame, &request.components, &mut out),
                StreamTarget::Udp { port, .. } => {
                    let mut datagram = Vec::new();
                    session.write_frame(frame, &request.components, &mut datagram);
                    let _ = datagrams.send_to(&datagram, (client.ip(), port));
                }
            }
        }
        let sent = stream.write_all(&out).ok();
        out.clear();
        sent
    });
}

fn serve_vrpn(mut stream: TcpStream) {
    let (mut out, mut buffer) = (Vec::new(), [0; 4096]);
    let mut session = VrpnSession::open(&["quad".to_owned(), "other".to_owned()], &mut out);
    play(|frame, changed| {
        let count = read(&mut stream, &mut buffer)?;
        session.receive(&buffer[..count], &mut out).ok()?;
        if session.is_greeted() {
            for (number, name) in (1..).zip(changed.into_iter().flatten()) {
                let length = u32::try_from(name.len() + 1).unwrap().to_be_bytes();
                let payload = [&length[..], name.as_bytes(), b"\0"].concat();
                let described = VrpnMessage {
                    payload: &payload,
                    ..VrpnMessage::new(number, VrpnMessage::SENDER_DESCRIPTION)
                };
                write_message(&mut out, &described, 0);
            }
            session.write_frame(frame, &mut out);
        }
        let sent = stream.write_all(&out).ok();
        out.clear();
        sent
    });
}

fn serve_natnet(socket: &UdpSocket) {
    socket.set_read_timeout(Some(INTERVAL)).unwrap();
    let body = |(id, name): (i32, &str)| BodyDefinition {
        name: name.to_owned(),
        id,
        markers_m: vec![[0.0; 3]; 4],
    };
    let bodies = |names: [&str; 2]| (1..).zip(names).map(body).collect::<Vec<_>>();
    let options = NatNetServerOptions { bodies: bodies(["quad", "other"]), ..Default::default() };
    let (version, mut client, mut buffer) = (options.version, None, [0; 4096]);
    let mut server = NatNetServer::new(options);
    let mut info = None;
    play(|frame, changed| {
        let mut out = Vec::new();
        match socket.recv_from(&mut buffer) {
            Ok((count, from)) => {
                server.receive(&buffer[..count], from, 0, &mut out);
                client = Some(from);
                if ServerInfo::parse(out.get(4..).unwrap_or_default()).is_ok() {
                    info.get_or_insert_with(|| out.clone());
                }
            }
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => return None,
            Err(_) => {}
        }
        let Some(to) = client else { return Some(()) };
        let mut datagrams = vec![out, Vec::new()];
        server.write_frame(frame, Some(to), &mut datagrams[1]);
        if let Some(names) = changed {
            // Sent again, as the answer to a repeated request.
            datagrams.extend(info.clone());
            let mut definitions = Vec::new();
            let models = ModelDefinitions { bodies: bodies(names) };
            models.write(version, &mut definitions);
            datagrams.push(definitions);
        }
        let sent = datagrams.iter().filter(|datagram| !datagram.is_empty());
        sent.map(|datagram| socket.send_to(datagram, to).ok().map(drop)).collect()
    });
}
