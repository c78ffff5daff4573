//! Both ends of VRPN against each other.

use crate::common::scene::{agree, frame};
use oqtal_wire::vrpn::{
    CallbackRequest, CookieError, PING_TYPE, VrpnClient, VrpnClientError, VrpnEvent, VrpnMessage,
    VrpnSession, VrpnVersion, write_message,
};
use proptest::prelude::*;

/// A connection after the exchange of names.
fn connected(bodies: &[&str]) -> (VrpnClient, VrpnSession) {
    let (client, session, _) = introduced(bodies);
    (client, session)
}

/// A connection after the exchange of names, and the senders.
fn introduced(bodies: &[&str]) -> (VrpnClient, VrpnSession, Vec<(i32, String)>) {
    let bodies: Vec<String> = bodies.iter().map(|name| (*name).to_owned()).collect();
    let (mut client, mut sent) = (VrpnClient::new(), Vec::new());
    let mut session = VrpnSession::open(&bodies, &mut sent);
    let mut senders = Vec::new();
    for _ in 0..3 {
        session.receive(&client.take_output(), &mut sent).unwrap();
        client.receive(&std::mem::take(&mut sent));
        while let Some(event) = client.poll().unwrap() {
            if let VrpnEvent::Sender { number, name } = event {
                senders.push((number, name.to_owned()));
            }
        }
    }
    (client, session, senders)
}

#[test]
fn a_client_learns_the_names_of_the_trackers() {
    let (_, session, senders) = introduced(&["cf1", "quad two"]);
    assert!(session.is_greeted());
    let expected = [(0, "VRPN Control"), (1, "cf1"), (2, "quad two")];
    assert_eq!(senders, expected.map(|(number, name)| (number, name.to_owned())));
}

#[test]
fn a_ping_is_answered() {
    let (mut client, mut session) = connected(&["cf1"]);
    let mut sent = Vec::new();
    client.ping("cf1");
    assert!(session.receive(&client.take_output(), &mut sent).unwrap());
    client.receive(&sent);
    assert_eq!(client.poll(), Ok(Some(VrpnEvent::Pong)));
    assert_eq!(client.poll(), Ok(None));
}

#[test]
fn the_bytes_are_those_of_vrpn() {
    assert_eq!(&VrpnVersion::OURS.to_cookie(), b"vrpn: ver. 07.38  0\0\0\0\0\0");
    let mut out = Vec::new();
    let message = VrpnMessage { seconds: 1, micros: 2, sender: 3, kind: 4, payload: b"hello" };
    write_message(&mut out, &message, 5);
    let head = [29, 1, 2, 3, 4, 5].map(u32::to_be_bytes).concat();
    assert_eq!(out, [&head[..], b"hello\0\0\0"].concat());
    let request = CallbackRequest { address: "192.168.1.5:40000".parse().unwrap() };
    assert_eq!(request.to_datagram(), b"192.168.1.5 40000\0");
    assert_eq!(CallbackRequest::parse(b"192.168.1.5 40000\0"), Some(request));
    assert_eq!(CallbackRequest::parse(b"lab.example 40000\0"), None);
    assert_eq!(PING_TYPE, "vrpn_Base ping_message");
}

#[test]
fn another_version_and_another_protocol_are_refused() {
    let mut client = VrpnClient::new();
    client.receive(&VrpnVersion { major: 6, minor: 1 }.to_cookie());
    assert_eq!(client.poll(), Err(VrpnClientError::Cookie(CookieError::Version(6))));
    let mut client = VrpnClient::new();
    client.receive(b"HTTP/1.1 400 Bad Request\r\n");
    assert_eq!(client.poll(), Err(VrpnClientError::Cookie(CookieError::Magic)));
    let mut session = VrpnSession::open(&[], &mut Vec::new());
    assert!(session.receive(b"GET / HTTP/1.1\r\nHost: lab\r\n", &mut Vec::new()).is_err());
}

proptest! {
    #[test]
    fn poses_arrive_as_sent_in_any_pieces(frame in frame(), piece in 1..100_usize) {
        let names: Vec<String> = (0..frame.bodies.len()).map(|n| format!("body {n}")).collect();
        let (mut client, mut session) = connected(&names.iter().map(String::as_str).collect::<Vec<_>>());
        let mut sent = Vec::new();
        session.write_frame(&frame.as_frame(), &mut sent);
        let mut poses = Vec::new();
        for piece in sent.chunks(piece) {
            client.receive(piece);
            while let Some(event) = client.poll().unwrap() {
                if let VrpnEvent::Pose { sender, time_us, pose } = event {
                    prop_assert_eq!(time_us, frame.captured_ns / 1000);
                    poses.push((sender, pose.pose().unwrap()));
                }
            }
        }
        let seen = (1..).zip(&frame.bodies).filter_map(|(sender, body)| Some((sender, body.pose?)));
        for ((sender, pose), (expected, exact)) in poses.iter().zip(seen.clone()) {
            prop_assert_eq!(*sender, expected);
            prop_assert!(agree(pose, &exact, (0.0, 1e-12)));
        }
        prop_assert_eq!(poses.len(), seen.count());
    }
}
