//! Malicious or broken servers: the connection ends or the data is ignored; nothing blocks, grows or publishes invalid poses.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, UdpSocket};
use std::thread::JoinHandle;

use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_receiver::{CameraStream, ConnectError, PoseReceiver, connect_to_all};
use oqtal_wire::ByteOrder;
use oqtal_wire::motion::{BodySample, MotionFrame, RigidPose};
use oqtal_wire::qtm::{
    ComponentKind, ComponentSet, QtmBody, QtmHost, QtmParameters, QtmSession, QtmWriter,
};

/// A server that names these bodies, agrees to everything and then sends `bytes` and nothing more: its address and its connection.
fn serve(names: &[&str], bytes: Vec<u8>) -> (SocketAddr, JoinHandle<std::net::TcpStream>) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = listener.local_addr().unwrap();
    let body = |name: &&str| QtmBody { name: (*name).to_owned(), ..QtmBody::default() };
    let bodies = names.iter().map(body).collect();
    let server = std::thread::spawn(move || {
        let (mut stream, mut out) = (listener.accept().unwrap().0, Vec::new());
        let parameters = QtmParameters { bodies: Some(bodies), ..QtmParameters::default() };
        let mut host = QtmHost::new(parameters);
        let mut session = QtmSession::open(1, String::new(), ByteOrder::Little, &mut out);
        let mut buffer = [0; 4096];
        while session.subscription().is_none() {
            stream.write_all(&std::mem::take(&mut out)).unwrap();
            let count = stream.read(&mut buffer).unwrap();
            session.receive(&buffer[..count], &mut host, None, &mut out).unwrap();
        }
        stream.write_all(&out).unwrap();
        stream.write_all(&bytes).unwrap();
        stream
    });
    (address, server)
}

/// Connects to a server with one body.
fn connected(rest: &str, bytes: Vec<u8>) -> (Box<dyn CameraStream>, std::net::TcpStream) {
    let (address, server) = serve(&["quad"], bytes);
    let link = format!("qtm:{address},body=quad{rest}");
    let stream = connect_to_all(&link.parse().unwrap()).unwrap().stream;
    (stream, server.join().unwrap())
}

/// Receives until the connection is lost, or `is_done`.
fn receive(
    stream: &mut dyn CameraStream,
    receiver: &mut PoseReceiver,
    mut is_done: impl FnMut(&mut dyn CameraStream, &PoseReceiver) -> bool,
) -> std::io::Result<()> {
    loop {
        stream.receive(&Time::now, receiver)?;
        stream.maintain(Time::now())?;
        if is_done(stream, receiver) {
            return Ok(());
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}

/// Whether definitions have arrived; they are read and applied.
fn applies_definitions(stream: &mut dyn CameraStream) -> bool {
    stream.take_definitions().is_some_and(|mut definitions| {
        let _ = definitions.read();
        stream.apply_definitions(definitions);
        true
    })
}

fn receiver() -> PoseReceiver {
    PoseReceiver::new(&Config::default().receiver, 1)
}

fn xml(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    QtmWriter::new(&mut bytes, ByteOrder::Little).xml(text);
    bytes
}

#[test]
fn garbage_and_lengths_that_no_packet_has_end_the_connection() {
    let sized = |size: u32| [size.to_le_bytes(), 2_u32.to_le_bytes()].concat();
    for bytes in [vec![0xA5; 100_000], sized(u32::MAX), sized(4), sized((1 << 20) + 1)] {
        let (mut stream, _server) = connected("", bytes);
        let lost = receive(&mut *stream, &mut receiver(), |_, _| false);
        assert!(lost.is_err());
    }
}

#[test]
fn a_list_of_bodies_that_is_rubbish_or_never_ends_changes_no_route_for_long() {
    let endless = |name: &str| format!("<Body><Name>{name}</Name></Body>");
    let many: String = (0..25_000).map(|k| endless(&format!("b{k}"))).collect();
    let good = format!("<A><The_6D>{}{}</The_6D></A>", endless("other"), endless("quad"));
    let lists = [
        (format!("<A><The_6D>{many}</The_6D></A>"), false),
        ("<A>".repeat(100_000), true),
        ("<A><The_6D><Body>".to_owned(), true),
        (good, true),
    ];
    for (list, has) in lists {
        let (mut stream, _server) = connected("", xml(&list));
        receive(&mut *stream, &mut receiver(), |stream, _| applies_definitions(stream)).unwrap();
        assert_eq!(stream.has(0), has, "{}", &list[..20]);
    }
}

#[test]
fn a_body_without_a_place_is_not_tracked_and_a_frame_of_another_sender_is_none() {
    let bytes = frame(&[BodySample::LOST]);
    let (mut stream, _server) = connected(",transport=tcp", bytes.clone());
    let mut lost = receiver();
    let arrived = |_: &mut dyn CameraStream, receiver: &PoseReceiver| {
        receiver.seen_at(0).is_set() && !receiver.is_tracked(0)
    };
    receive(&mut *stream, &mut lost, arrived).unwrap();
    // The same frame from an address of this machine that is not the server's, to every port that the receiver may have opened.
    let (mut stream, _server) = connected("", Vec::new());
    let foreign = UdpSocket::bind("127.0.0.2:0").unwrap();
    let mut spoofed = receiver();
    for socket in stream.sockets().into_iter().flatten() {
        let address = rustix::net::getsockname(socket).unwrap();
        let address = std::net::SocketAddr::try_from(address).unwrap();
        let _ = foreign.send_to(&bytes, (Ipv4Addr::LOCALHOST, address.port()));
    }
    let mut calls = 0;
    receive(&mut *stream, &mut spoofed, |_, _| {
        calls += 1;
        calls > 20
    })
    .unwrap();
    assert!(!spoofed.arrived_at().is_set());
}

/// A frame with these bodies.
fn frame(bodies: &[BodySample]) -> Vec<u8> {
    let components = ComponentSet::new().with(ComponentKind::BodiesResidual);
    let frame = MotionFrame { number: 7, captured_ns: 7, sent_ns: 7, bodies, markers: &[] };
    let mut bytes = Vec::new();
    QtmWriter::new(&mut bytes, ByteOrder::Little).data(&frame, &components);
    bytes
}

#[test]
fn f54_a_frame_with_more_or_fewer_bodies_than_defined_is_dropped_and_the_names_are_requested() {
    let pose = RigidPose::new([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]);
    let seen = BodySample { pose, ..BodySample::LOST };
    for (bodies, is_ours) in [(&[seen][..], true), (&[seen, seen], false), (&[], false)] {
        let (mut stream, mut server) = connected(",transport=tcp", frame(bodies));
        let mut receiver = receiver();
        receive(&mut *stream, &mut receiver, |_, receiver| receiver.arrived_at().is_set()).unwrap();
        assert_eq!(receiver.is_tracked(0), is_ours, "{} bodies", bodies.len());
        assert_eq!(stream.has(0), is_ours, "{} bodies", bodies.len());
        // The client's next output: nothing, or a request.
        server.set_nonblocking(is_ours).unwrap();
        let mut request = [0; 1000];
        let count = server.read(&mut request).unwrap_or(0);
        let asks = String::from_utf8_lossy(&request[..count]).contains("GetParameters");
        assert_eq!(asks, !is_ours, "{} bodies", bodies.len());
    }
}

#[test]
fn f54_names_are_asked_for_every_2_s_and_a_renamed_body_is_not_there() {
    let (mut stream, mut server) = connected(",transport=tcp", Vec::new());
    stream.maintain(Time::now() + Span::from_millis(3000)).unwrap();
    let mut request = [0; 1000];
    let count = server.read(&mut request).unwrap();
    assert!(String::from_utf8_lossy(&request[..count]).contains("GetParameters"));
    server.write_all(&xml("<A><The_6D><Body><Name>x</Name></Body></The_6D></A>")).unwrap();
    receive(&mut *stream, &mut receiver(), |stream, _| applies_definitions(stream)).unwrap();
    assert!(!stream.has(0));
}

#[test]
fn two_bodies_of_the_wanted_name_are_refused() {
    let (address, server) = serve(&["quad", "other", "quad"], Vec::new());
    let link = format!("qtm:{address},body=quad");
    let refused = connect_to_all(&link.parse().unwrap()).unwrap_err();
    assert!(matches!(refused, ConnectError::Ambiguous { .. }), "{refused}");
    assert!(refused.to_string().contains("several bodies `quad`"), "{refused}");
    server.join().unwrap();
}

#[test]
fn the_words_of_a_server_reach_a_message_as_one_short_line() {
    let words = "\u{1b}[2J\nroot: all is well\n".repeat(40_000);
    let mut texts = vec![Vec::new(), Vec::new()];
    QtmWriter::new(&mut texts[0], ByteOrder::Little).command("QTM RT Interface connected");
    QtmWriter::new(&mut texts[0], ByteOrder::Little).command("Version set to 1.25");
    QtmWriter::new(&mut texts[0], ByteOrder::Little).error(&words);
    QtmWriter::new(&mut texts[1], ByteOrder::Little).command(&words);
    for text in texts {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let link = format!("qtm:{},body=quad", listener.local_addr().unwrap());
        let server = std::thread::spawn(move || {
            let mut stream = listener.accept().unwrap().0;
            let _ = stream.write_all(&text);
            stream
        });
        let message = connect_to_all(&link.parse().unwrap()).unwrap_err().to_string();
        assert!(message.contains("all is well") && message.len() < 4000, "{}", message.len());
        assert!(!message.contains(char::is_control), "{message:?}");
        server.join().unwrap();
    }
    let (address, server) = serve(&["a\u{202e}b", &"n".repeat(100_000)], Vec::new());
    let link = format!("qtm:{address},body=quad");
    let message = connect_to_all(&link.parse().unwrap()).unwrap_err().to_string();
    assert!(message.contains("`a\\u{202e}b`") && message.len() < 4000, "{:.300}", message);
    server.join().unwrap();
}
