//! Both ends of Qualisys's RT protocol against each other.

use crate::common::scene::{agree, frame};
use oqtal_wire::ByteOrder;
use oqtal_wire::motion::MotionFrame;
use oqtal_wire::qtm::{
    BodyOrientation, ComponentKind, ComponentSet, DiscoveryReply, DiscoveryRequest, NoPose,
    ParameterSelection, QtmBody, QtmClient, QtmClientError, QtmClientEvent, QtmClientOptions,
    QtmCommand, QtmEvent, QtmHost, QtmPacket, QtmParameters, QtmPoint, QtmSession, QtmStream,
    QtmVersion, QtmWriter, StreamRate, StreamRequest, StreamTarget,
};
use proptest::prelude::*;

fn parameters() -> QtmParameters {
    let points = (1..=4)
        .map(|n| QtmPoint { name: format!("cf1 - {n}"), position_mm: [f64::from(n), -0.5, 0.25] });
    let body = |name: &str, points| QtmBody { name: name.to_owned(), color: 0x00FF_8001, points };
    QtmParameters {
        frequency_hz: Some(100),
        markers: Some(vec!["a".to_owned(), "b <&> \"c\"".to_owned()]),
        bodies: Some(vec![body("cf1", points.collect()), body("quad & <two>", Vec::new())]),
    }
}

/// A server and a connection, as a client sees them.
struct Server {
    host: QtmHost,
    session: QtmSession,
    order: ByteOrder,
    sent: Vec<u8>,
}

impl Server {
    fn new(order: ByteOrder) -> Self {
        let mut sent = Vec::new();
        let session = QtmSession::open(7, "10.0.0.2 (4711)".to_owned(), order, &mut sent);
        Self { host: QtmHost::new(parameters()), session, order, sent }
    }

    fn receive(&mut self, bytes: &[u8], frame: Option<&MotionFrame<'_>>) {
        self.session.receive(bytes, &mut self.host, frame, &mut self.sent).unwrap();
    }

    /// The answers to a command, each as text.
    fn answers(&mut self, command: &str) -> Vec<String> {
        let order = self.order;
        self.sent.clear();
        let mut bytes = Vec::new();
        QtmWriter::new(&mut bytes, order).command(command);
        self.receive(&bytes, None);
        let mut stream = QtmStream::new(order, 1 << 20);
        stream.push(&self.sent);
        let mut answers = Vec::new();
        while let Some(packet) = stream.take().unwrap() {
            answers.push(match packet {
                QtmPacket::Command(text) | QtmPacket::Xml(text) => text.to_owned(),
                QtmPacket::Error(text) => format!("error: {text}"),
                other => format!("{other:?}"),
            });
        }
        answers
    }
}

/// Events of a client until no more bytes are exchanged, as text without the frames.
fn converse(client: &mut QtmClient, server: &mut Server) -> Result<Vec<String>, QtmClientError> {
    let mut events = Vec::new();
    loop {
        client.receive(&std::mem::take(&mut server.sent));
        while let Some(event) = client.poll()? {
            events.push(match event {
                QtmClientEvent::Parameters(text) => {
                    format!("{:?}", QtmParameters::from_xml(text).unwrap())
                }
                other => format!("{other:?}"),
            });
        }
        let output = client.take_output();
        if output.is_empty() {
            return Ok(events);
        }
        server.receive(&output, None);
    }
}

#[test]
fn a_client_names_the_bodies_and_asks_for_the_stream() {
    for order in [ByteOrder::Little, ByteOrder::Big] {
        let mut server = Server::new(order);
        let mut client = QtmClient::new(QtmClientOptions { order, ..QtmClientOptions::default() });
        let events = converse(&mut client, &mut server).unwrap();
        assert!(events.iter().any(|event| event.contains("quad & <two>")), "{events:?}");
        assert_eq!(client.version(), Some(QtmVersion::new(1, 25)));
        let request = server.session.subscription().unwrap();
        assert_eq!(request.components.iter().collect::<Vec<_>>(), [ComponentKind::BodiesResidual]);
    }
}

#[test]
fn names_are_asked_for_again_without_a_new_stream() {
    let mut server = Server::new(ByteOrder::Little);
    let mut client = QtmClient::new(QtmClientOptions::default());
    converse(&mut client, &mut server).unwrap();
    client.request_parameters();
    server.receive(&client.take_output(), None);
    client.receive(&std::mem::take(&mut server.sent));
    assert!(matches!(client.poll(), Ok(Some(QtmClientEvent::Parameters(_)))));
    assert!(client.take_output().is_empty(), "the stream was requested again");
}

#[test]
fn a_client_asks_for_older_versions_until_one_is_spoken() {
    let mut server = Server::new(ByteOrder::Little);
    let newest = QtmVersion::new(1, 31);
    let mut client = QtmClient::new(QtmClientOptions { newest, ..QtmClientOptions::default() });
    converse(&mut client, &mut server).unwrap();
    assert_eq!(client.version(), Some(QtmVersion::NEWEST));
    let mut client = QtmClient::new(QtmClientOptions {
        newest,
        oldest: QtmVersion::new(1, 30),
        ..QtmClientOptions::default()
    });
    let error = converse(&mut client, &mut Server::new(ByteOrder::Little)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the server supports no version of the RT protocol from 1.30 to 1.31"
    );
}

#[test]
fn another_server_is_distinguished_from_qtm() {
    let mut client = QtmClient::new(QtmClientOptions::default());
    let mut bytes = Vec::new();
    QtmWriter::new(&mut bytes, ByteOrder::Little).command("SMTP ready");
    client.receive(&bytes);
    assert_eq!(client.poll(), Err(QtmClientError::NotQtm("SMTP ready".to_owned())));
}

#[test]
fn answers_are_those_that_clients_compare_with() {
    let mut server = Server::new(ByteOrder::Big);
    for (command, answer) in [
        ("Version", "Version is 1.1"),
        ("version 1.19", "Version set to 1.19"),
        ("Version 1.7", "error: Version NOT supported"),
        ("QTMVersion", "QTM Version is 2.17 (build 4000)"),
        ("byteorder", "Byte order is big endian"),
        ("GetState", "Event(Connected)"),
        ("GetParameters Analog", "error: Parameters not available"),
        ("GetParameters 7D", "error: Parse error"),
        ("GetCurrentFrame 6D", "NoMoreData"),
        ("Start", "error: You must be master to issue this command"),
        ("TakeControl password", "You are now master"),
        ("TakeControl", "You are already master"),
        ("New", "Already connected"),
        ("Start", "Starting measurement"),
        ("Start", "error: Measurement is already running"),
        ("Trig", "Trig ok"),
        ("SetQTMEvent \"here\"", "Event set"),
        ("Stop", "Stopping measurement"),
        ("Start rtfromfile", "Starting RT from file"),
        ("Start RTFromFile", "error: RT from file already running"),
        ("Close", "Closing connection"),
        ("GetState", "Event(ConnectionClosed)"),
        ("New", "Creating new connection"),
        ("ReleaseControl", "You are now a regular client"),
        ("Nonsense", "error: Parse error"),
    ] {
        assert_eq!(server.answers(command), [answer], "{command}");
    }
    let announced = server.host.take_events();
    assert_eq!(announced.len(), 6, "{announced:?}");
    assert_eq!(announced.last(), Some(&QtmEvent::Connected));
    server.host = QtmHost::new(parameters());
    let mut other = QtmSession::open(8, "10.0.0.3 (5)".to_owned(), ByteOrder::Big, &mut Vec::new());
    let mut bytes = Vec::new();
    QtmWriter::new(&mut bytes, ByteOrder::Big).command("TakeControl");
    other.receive(&bytes, &mut server.host, None, &mut Vec::new()).unwrap();
    assert_eq!(server.answers("TakeControl"), ["error: 10.0.0.3 (5) is already master"]);
}

#[test]
fn parameters_are_read_as_written_in_both_generations() {
    for version in [QtmVersion::new(1, 19), QtmVersion::new(1, 25)] {
        let text = parameters().to_xml(version, ParameterSelection::ALL);
        assert!(text.starts_with(&format!("<QTM_Parameters_Ver_{version}>")), "{text}");
        assert_eq!(text.contains("<RGBColor>16744449"), version < QtmVersion::NEW_PARAMETERS);
        let mut expected = parameters();
        if version < QtmVersion::NEW_PARAMETERS {
            let points = expected.bodies.iter_mut().flatten().flat_map(|body| &mut body.points);
            points.for_each(|point| point.name.clear());
        }
        assert_eq!(QtmParameters::from_xml(&text), Ok(expected));
    }
}

#[test]
fn discovery_is_read_as_written() {
    let request = DiscoveryRequest { reply_port: 0x1234 };
    assert_eq!(request.to_datagram(), [10, 0, 0, 0, 7, 0, 0, 0, 0x12, 0x34]);
    assert_eq!(DiscoveryRequest::parse(&request.to_datagram()), Some(request));
    let description = "lab, QTM 2.17 (build 4000), 6 cameras".to_owned();
    let reply = DiscoveryReply { description, base_port: 22222 };
    assert_eq!(DiscoveryReply::parse(&reply.to_datagram()), Some(reply));
}

#[test]
fn commands_are_read_as_written() {
    let components =
        ComponentSet::new().with(ComponentKind::Unlabelled).with(ComponentKind::BodiesEuler);
    let udp = StreamRequest {
        rate: StreamRate::AllFrames,
        target: StreamTarget::Udp { address: None, port: 6734 },
        components,
    };
    let parsed = "StreamFrames AllFrames UDP:6734 3DNoLabels 6DEuler ".parse();
    assert_eq!(parsed, Ok(QtmCommand::Stream(udp)));
    let other = "streamframes frequency:100 6d".parse::<QtmCommand>().unwrap();
    for command in [QtmCommand::Stream(udp), other, QtmCommand::Load("a b.qtm".to_owned())] {
        assert_eq!(command.to_string().parse(), Ok(command));
    }
    assert!("StreamFrames AllFrames UDP:80 6D".parse::<QtmCommand>().is_err());
}

#[test]
fn a_flood_of_commands_is_answered_in_portions() {
    const COMMANDS: usize = 2000;
    let mut server = Server::new(ByteOrder::Little);
    let mut flood = Vec::new();
    let mut writer = QtmWriter::new(&mut flood, ByteOrder::Little);
    (0..COMMANDS).for_each(|_| writer.command("GetParameters All"));
    let (mut stream, mut answers, mut rest) =
        (QtmStream::new(ByteOrder::Little, 1 << 20), 0, &flood[..]);
    while answers < COMMANDS {
        let taken = if server.session.is_ready() { rest.len().min(1 << 14) } else { 0 };
        let (bytes, after) = rest.split_at(taken);
        rest = after;
        server.receive(bytes, None);
        // At most one answer beyond the limit.
        assert!(server.sent.len() < (1 << 17) + (1 << 14), "{} bytes", server.sent.len());
        stream.push(&std::mem::take(&mut server.sent));
        while let Some(packet) = stream.take().unwrap() {
            answers += usize::from(matches!(packet, QtmPacket::Xml(_)));
        }
    }
}

proptest! {
    #[test]
    fn a_frame_is_read_as_written(frame in frame(), big in any::<bool>()) {
        let order = if big { ByteOrder::Big } else { ByteOrder::Little };
        let all = ComponentKind::ALL.into_iter().fold(ComponentSet::new(), ComponentSet::with);
        let mut bytes = Vec::new();
        QtmWriter::new(&mut bytes, order).data(&frame.as_frame(), &all);
        let QtmPacket::Data(data) = QtmPacket::parse(&bytes, order).unwrap() else {
            panic!("not a frame")
        };
        prop_assert_eq!(data.frame(), frame.number);
        prop_assert_eq!(data.timestamp_us(), frame.captured_ns / 1000);
        prop_assert_eq!(data.components().count(), ComponentKind::ALL.len());
        for component in data.components() {
            let seen = frame.markers.iter().filter(|marker| marker.position_m.is_some()).count();
            match component.kind() {
                ComponentKind::Markers | ComponentKind::MarkersResidual => {
                    prop_assert_eq!(component.markers().count(), frame.markers.len());
                }
                ComponentKind::Unlabelled | ComponentKind::UnlabelledResidual => {
                    prop_assert_eq!(component.markers().count(), seen);
                }
                _ => prop_assert_eq!(component.bodies().count(), frame.bodies.len()),
            }
            for (record, body) in component.bodies().zip(&frame.bodies) {
                match (record.pose(), &body.pose) {
                    (Ok(read), Some(pose)) => prop_assert!(agree(&read, pose, (1e-6, 1e-7))),
                    (Err(NoPose::Euler), _) => {
                        prop_assert!(matches!(record.orientation, BodyOrientation::Euler(_)));
                    }
                    (read, pose) => prop_assert_eq!((read, pose), (Err(NoPose::Lost), &None)),
                }
            }
        }
    }
}
