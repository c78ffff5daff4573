//! The real-time thread does not allocate while connected, for any data from the server.

#[path = "../../control/tests/allocation/counter.rs"]
mod counter;

use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::thread::JoinHandle;

use oqtal_bus::time::Time;
use oqtal_config::Config;
use oqtal_receiver::{CameraStream, PoseReceiver, connect_to_all};
use oqtal_wire::ByteOrder;
use oqtal_wire::motion::{BodySample, MotionFrame, RigidPose};
use oqtal_wire::qtm::{QtmBody, QtmEvent, QtmHost, QtmParameters, QtmSession, QtmWriter};
use oqtal_wire::vrpn::{PING_TYPE, VrpnMessage, VrpnSession, write_message};

use counter::allocations;

#[test]
fn the_count_counts() {
    assert_eq!(allocations(|| drop(std::hint::black_box(Box::new(1)))).0, 1);
}

/// Messages of a round \[-\], whose answers are more than a client has memory for.
const FLOOD: usize = 2000;

fn frame(number: u32, bodies: &[BodySample]) -> MotionFrame<'_> {
    let captured_ns = u64::from(number) * 10_000_000;
    MotionFrame { number, captured_ns, sent_ns: captured_ns, bodies, markers: &[] }
}

fn seen() -> BodySample {
    let pose = RigidPose::new([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]);
    BodySample { pose, ..BodySample::LOST }
}

/// Answers in a thread until the client is streaming, then sends `bytes`.
fn serve(
    mut answer: impl FnMut(&[u8], &mut Vec<u8>) -> bool + Send + 'static,
    bytes: Vec<u8>,
) -> (SocketAddr, JoinHandle<TcpStream>) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = listener.local_addr().unwrap();
    let server = std::thread::spawn(move || {
        let (mut stream, mut out, mut buffer) =
            (listener.accept().unwrap().0, Vec::new(), [0; 4096]);
        let (mut count, mut done) = (0, false);
        while !done {
            done = answer(&buffer[..count], &mut out);
            stream.write_all(&std::mem::take(&mut out)).unwrap();
            count = if done { 0 } else { stream.read(&mut buffer).unwrap() };
        }
        stream.write_all(&bytes).unwrap();
        stream
    });
    (address, server)
}

/// Receives until a pose of frame `last` is there, as the turn does; how often that allocates.
fn received(stream: &mut dyn CameraStream, last: u32) -> u64 {
    let mut receiver = PoseReceiver::new(&Config::default().receiver, 1);
    allocations(|| {
        while receiver.counts(0).arrived < u64::from(last) {
            stream.receive(&Time::now, &mut receiver).unwrap();
            stream.maintain(Time::now()).unwrap();
            let _ = (receiver.take(0), stream.take_refused(), stream.sockets());
        }
    })
    .0
}

/// Pings and names of trackers that were not requested.
fn questions() -> Vec<u8> {
    let mut flood = Vec::new();
    // The types as the session numbers them are in its greeting: a number of our own is described for pings.
    let name =
        |text: &str| [&(text.len() as u32 + 1).to_be_bytes()[..], text.as_bytes(), &[0]].concat();
    let described = name(PING_TYPE);
    let ping =
        VrpnMessage { payload: &described, ..VrpnMessage::new(99, VrpnMessage::TYPE_DESCRIPTION) };
    write_message(&mut flood, &ping, 0);
    for k in 0..FLOOD {
        write_message(&mut flood, &VrpnMessage::new(0, 99), 0);
        let text = name(&format!("body{k}"));
        let sender = VrpnMessage {
            payload: &text,
            ..VrpnMessage::new(1000 + k as i32, VrpnMessage::SENDER_DESCRIPTION)
        };
        write_message(&mut flood, &sender, 0);
    }
    flood
}

#[test]
fn endless_requests_and_names_of_a_vrpn_server_cause_no_allocation() {
    let names = ["quad".to_owned()];
    let mut greeting = Vec::new();
    let mut session = VrpnSession::open(&names, &mut greeting);
    let mut answer = {
        let mut first = true;
        move |bytes: &[u8], out: &mut Vec<u8>| {
            if std::mem::take(&mut first) {
                out.append(&mut greeting);
            }
            session.receive(bytes, out).unwrap();
            session.is_greeted()
        }
    };
    let mut flood = questions();
    let bodies = [seen()];
    let mut poses = VrpnSession::open(&names, &mut Vec::new());
    let mut cookie = Vec::new();
    let _ = VrpnSession::open(&names, &mut cookie);
    poses.receive(&cookie, &mut Vec::new()).unwrap();
    (1..=5).for_each(|number| poses.write_frame(&frame(number, &bodies), &mut flood));
    let (address, server) = serve(move |bytes, out| answer(bytes, out), flood);
    let link = format!("vrpn:{address},body=quad");
    let mut stream = connect_to_all(&link.parse().unwrap()).unwrap().stream;
    let _server = server.join().unwrap();
    assert_eq!(received(&mut *stream, 5), 0);
}

#[test]
fn endless_events_and_bodies_of_a_qtm_server_cause_no_allocation() {
    let body = QtmBody { name: "quad".to_owned(), ..QtmBody::default() };
    let parameters = QtmParameters { bodies: Some(vec![body]), ..QtmParameters::default() };
    let (mut host, mut greeting) = (QtmHost::new(parameters), Vec::new());
    let mut session = QtmSession::open(1, String::new(), ByteOrder::Little, &mut greeting);
    let answer = move |bytes: &[u8], out: &mut Vec<u8>| {
        out.append(&mut greeting);
        session.receive(bytes, &mut host, None, out).unwrap();
        session.subscription().is_some()
    };
    let mut flood = Vec::new();
    let mut writer = QtmWriter::new(&mut flood, ByteOrder::Little);
    (0..FLOOD).for_each(|_| writer.event(QtmEvent::CaptureStarted));
    let components =
        oqtal_wire::qtm::ComponentSet::new().with(oqtal_wire::qtm::ComponentKind::BodiesResidual);
    for number in 1..=5_u32 {
        let bodies = vec![seen(); number as usize];
        writer.data(&frame(number, &bodies), &components);
    }
    let (address, server) = serve(answer, flood);
    let link = format!("qtm:{address},body=quad,transport=tcp");
    let mut stream = connect_to_all(&link.parse().unwrap()).unwrap().stream;
    let _server = server.join().unwrap();
    assert_eq!(received(&mut *stream, 5), 0);
}
