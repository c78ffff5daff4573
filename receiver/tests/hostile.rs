//! Servers that mean harm, or are broken: the connection ends, or nothing happens; nothing hangs, grows or publishes nonsense.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpListener, UdpSocket};

use oqtal_bus::time::Time;
use oqtal_config::Config;
use oqtal_receiver::{CameraStream, PoseReceiver, connect_to_all};
use oqtal_wire::ByteOrder;
use oqtal_wire::motion::{BodySample, MotionFrame};
use oqtal_wire::qtm::{
    ComponentKind, ComponentSet, QtmBody, QtmHost, QtmParameters, QtmSession, QtmWriter,
};

/// Connects to a server that agrees to everything and then sends `bytes` and nothing more.
fn connected(rest: &str, bytes: Vec<u8>) -> (Box<dyn CameraStream>, std::net::TcpStream) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let link = format!("qtm:{},body=quad{rest}", listener.local_addr().unwrap());
    let server = std::thread::spawn(move || {
        let (mut stream, mut out) = (listener.accept().unwrap().0, Vec::new());
        let body = QtmBody { name: "quad".to_owned(), ..QtmBody::default() };
        let parameters = QtmParameters { bodies: Some(vec![body]), ..QtmParameters::default() };
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
        let taken = |stream: &mut dyn CameraStream, _: &PoseReceiver| {
            stream.take_definitions().is_some_and(|mut definitions| {
                let _ = definitions.read();
                stream.give_back(definitions);
                true
            })
        };
        receive(&mut *stream, &mut receiver(), taken).unwrap();
        assert_eq!(stream.has(0), has, "{}", &list[..20]);
    }
}

#[test]
fn a_body_without_a_place_is_not_tracked_and_a_frame_of_another_sender_is_none() {
    let components = ComponentSet::new().with(ComponentKind::BodiesResidual);
    let bodies = [BodySample::LOST];
    let frame =
        MotionFrame { number: 7, captured_ns: 7, sent_ns: 7, bodies: &bodies, markers: &[] };
    let mut bytes = Vec::new();
    QtmWriter::new(&mut bytes, ByteOrder::Little).data(&frame, &components);
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
    for socket in stream.sockets() {
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
