//! Both ends of NatNet against each other.

use std::net::SocketAddr;

use crate::common::scene::{agree, frame};
use oqtal_wire::natnet::{
    BodyDefinition, ModelDefinitions, NatNetClient, NatNetClientError, NatNetEvent, NatNetServer,
    NatNetServerOptions, NatNetStage, NatNetVersion, ServerInfo,
};
use proptest::prelude::*;

const VERSIONS: [NatNetVersion; 4] = [
    NatNetVersion::new(3, 0),
    NatNetVersion::new(3, 1),
    NatNetVersion::new(4, 1),
    NatNetVersion::new(4, 2),
];

fn bodies(count: usize) -> Vec<BodyDefinition> {
    let markers_m = vec![[0.125, 0.0, 0.5]; 4];
    let body = |id| BodyDefinition { name: format!("body {id}"), id, markers_m: markers_m.clone() };
    (1..).map(body).take(count).collect()
}

fn address() -> SocketAddr {
    "10.0.0.2:50000".parse().unwrap()
}

/// A client and a server that have exchanged the definitions, and those.
fn connected(
    options: NatNetServerOptions,
    unicast: bool,
) -> (NatNetClient, NatNetServer, ModelDefinitions) {
    let (mut client, mut server) = (NatNetClient::new(unicast), NatNetServer::new(options));
    let mut models = None;
    for now in 0..4 {
        let Some(request) = client.poll_output(now) else { break };
        let mut answer = Vec::new();
        server.receive(request, address(), now, &mut answer);
        if !answer.is_empty() {
            match client.receive(&answer).unwrap() {
                NatNetEvent::Models(content, version) => {
                    models = Some(ModelDefinitions::parse(content, version).unwrap());
                }
                event => assert!(matches!(event, NatNetEvent::Connected(_)), "{event:?}"),
            }
        }
    }
    assert_eq!(client.stage(), NatNetStage::Streaming);
    (client, server, models.unwrap())
}

#[test]
fn an_echo_has_the_time_of_the_client_and_that_of_the_server() {
    let mut server = NatNetServer::new(NatNetServerOptions::default());
    let mut answer = Vec::new();
    let request = [&[12, 0, 8, 0][..], &0x0102_0304_u64.to_le_bytes()].concat();
    server.receive(&request, address(), 5_000, &mut answer);
    let stamps = [0x0102_0304_u64, 50].map(u64::to_le_bytes).concat();
    assert_eq!(answer, [&[13, 0, 16, 0][..], &stamps].concat());
    answer.clear();
    server.receive(&[12, 0, 1, 0, 7], address(), 5_000, &mut answer);
    assert!(answer.is_empty());
}

#[test]
fn a_client_learns_the_bodies_in_every_version() {
    for version in VERSIONS {
        let options =
            NatNetServerOptions { version, bodies: bodies(3), ..NatNetServerOptions::default() };
        let (client, _, models) = connected(options, false);
        assert_eq!(models, ModelDefinitions { bodies: bodies(3) }, "{version}");
        assert_eq!(client.info().map(|info| info.version), Some(version));
        assert_eq!(client.info().and_then(|info| info.multicast), Some([239, 255, 42, 99].into()));
    }
}

#[test]
fn a_unicast_client_is_served_while_it_keeps_alive() {
    let (mut client, mut server, _) = connected(NatNetServerOptions::default(), true);
    let second = 1_000_000_000;
    assert_eq!(server.unicast_clients(second).collect::<Vec<_>>(), [address()]);
    let alive = client.poll_output(5 * second).unwrap();
    server.receive(alive, address(), 5 * second, &mut Vec::new());
    assert_eq!(server.unicast_clients(14 * second).count(), 1);
    assert_eq!(server.unicast_clients(15 * second).count(), 0);
    let (_, mut server, _) = connected(NatNetServerOptions::default(), false);
    assert_eq!(server.unicast_clients(0).count(), 0);
}

#[test]
fn requests_are_repeated_until_they_are_answered() {
    let mut client = NatNetClient::new(false);
    let sent = (0..40).filter(|step| client.poll_output(step * 100_000_000).is_some()).count();
    assert_eq!(sent, 8);
}

#[test]
fn a_version_that_is_not_spoken_is_named() {
    for version in [NatNetVersion::new(2, 10), NatNetVersion::new(4, 5)] {
        let info = ServerInfo {
            name: "other".to_owned(),
            app_version: [1, 0, 0, 0],
            version,
            clock_hz: 1,
            data_port: 1511,
            multicast: None,
        };
        let mut datagram = Vec::new();
        info.write(&mut datagram);
        let error = NatNetClient::new(false).receive(&datagram).unwrap_err();
        assert_eq!(error, NatNetClientError::Version(version));
    }
}

#[test]
fn a_server_reports_what_it_does_not_support() {
    let mut server = NatNetServer::new(NatNetServerOptions::default());
    let mut answer = |text: &[u8]| {
        let mut out = Vec::new();
        let head = [2, 0, text.len() as u8, 0];
        server.receive(&[&head[..], text].concat(), address(), 0, &mut out);
        out
    };
    assert_eq!(answer(b"FrameRate\0"), [&[3, 0, 4, 0][..], &100.0_f32.to_le_bytes()].concat());
    assert_eq!(answer(b"SetLicence\0"), [100, 0, 0, 0]);
}

proptest! {
    #[test]
    fn frames_arrive_as_sent_in_every_version(frame in frame(), version in prop::sample::select(&VERSIONS)) {
        let bodies = bodies(frame.bodies.len());
        let options = NatNetServerOptions { version, bodies, ..NatNetServerOptions::default() };
        let (mut client, server, _) = connected(options, false);
        let mut datagram = Vec::new();
        server.write_frame(&frame.as_frame(), None, &mut datagram);
        let NatNetEvent::Frame(read) = client.receive(&datagram).unwrap() else {
            panic!("not a frame")
        };
        prop_assert_eq!(read.number() as u32, frame.number);
        // 10 MHz.
        prop_assert_eq!(read.times().mid_exposure, frame.captured_ns / 100);
        prop_assert_eq!(read.times().transmitted, (frame.captured_ns + 1_000_000) / 100);
        prop_assert_eq!(read.bodies().count(), frame.bodies.len());
        for ((id, body), exact) in (1..).zip(read.bodies()).zip(&frame.bodies) {
            prop_assert_eq!(body.id, id);
            prop_assert_eq!(body.tracked, exact.pose.is_some());
            if let Some(pose) = &exact.pose {
                prop_assert!(agree(&body.pose().unwrap(), pose, (1e-6, 1e-7)));
            }
        }
    }
}

/// Motive 3.1 was seen to ignore requests for the definitions that do not name their types.
#[test]
fn a_request_for_the_bodies_that_is_not_answered_names_their_type() {
    let server = NatNetServerOptions { bodies: bodies(1), ..NatNetServerOptions::default() };
    let (mut client, mut server) = (NatNetClient::new(true), NatNetServer::new(server));
    let mut exchange = |client: &mut NatNetClient, now_ns: u64| {
        let request = client.poll_output(now_ns).unwrap().to_vec();
        let mut answer = Vec::new();
        server.receive(&request, address(), now_ns, &mut answer);
        (request[4..].to_vec(), answer)
    };
    let (_, info) = exchange(&mut client, 0);
    client.receive(&info).unwrap();
    assert_eq!(exchange(&mut client, 1).0, [0_u8; 0]);
    let (types, models) = exchange(&mut client, 1_000_000_000);
    assert_eq!(types, [2, 0, 0, 0]);
    client.receive(&models).unwrap();
    client.request_models();
    assert_eq!(exchange(&mut client, 2_000_000_000).0, [2, 0, 0, 0], "what was answered is kept");
}
