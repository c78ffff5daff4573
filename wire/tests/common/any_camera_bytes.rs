//! Properties of the camera systems' decoders for arbitrary bytes, shared by the property tests and the fuzz targets.

use oqtal_wire::ByteOrder;
use oqtal_wire::motion::MotionFrame;
use oqtal_wire::natnet::{
    ModelDefinitions, NatNetClient, NatNetEvent, NatNetFrame, NatNetMessage, NatNetServer,
    NatNetServerOptions, NatNetVersion, ServerInfo,
};
use oqtal_wire::qtm::{
    DiscoveryReply, DiscoveryRequest, QtmClient, QtmClientEvent, QtmClientOptions, QtmHost,
    QtmPacket, QtmParameters, QtmSession,
};
use oqtal_wire::vrpn::{CallbackRequest, VrpnClient, VrpnEvent, VrpnSession, VrpnVersion};

const FRAME: MotionFrame<'static> =
    MotionFrame { number: 1, captured_ns: 0, sent_ns: 0, bodies: &[], markers: &[] };

/// Checks both ends of the RT protocol: no panic, and no more records than bytes.
pub fn any_qtm_bytes(bytes: &[u8]) {
    for order in [ByteOrder::Little, ByteOrder::Big] {
        let mut client = QtmClient::new(QtmClientOptions { order, ..QtmClientOptions::default() });
        client.receive(bytes);
        while let Ok(Some(event)) = client.poll() {
            if let QtmClientEvent::Frame(frame) = event {
                let bodies = frame.components().flat_map(|component| component.bodies());
                let markers = frame.components().flat_map(|component| component.markers());
                let poses = bodies.filter(|body| body.pose().is_ok()).count();
                assert!(poses + markers.count() <= bytes.len());
            }
        }
        client.take_output();
        let (mut host, mut out) = (QtmHost::new(QtmParameters::default()), Vec::new());
        let mut session = QtmSession::open(1, String::new(), order, &mut out);
        let _ = session.receive(bytes, &mut host, Some(&FRAME), &mut out);
        let _ = QtmPacket::parse(bytes, order);
    }
    let _ = (DiscoveryReply::parse(bytes), DiscoveryRequest::parse(bytes));
    if let Ok(text) = std::str::from_utf8(bytes) {
        let _ = QtmParameters::from_xml(text);
        let _ = text.parse::<oqtal_wire::qtm::QtmCommand>();
    }
}

/// Checks both ends of VRPN, with and without the cookie that lets the rest be read.
pub fn any_vrpn_bytes(bytes: &[u8]) {
    let cookie = VrpnVersion::OURS.to_cookie();
    for start in [&[][..], &cookie[..]] {
        let mut client = VrpnClient::new();
        client.receive(start);
        client.receive(bytes);
        while let Ok(Some(event)) = client.poll() {
            if let VrpnEvent::Pose { pose, .. } = event {
                let _ = pose.pose();
            }
        }
        let mut out = Vec::new();
        let mut session = VrpnSession::open(&[], &mut out);
        let _ = session.receive(&[start, bytes].concat(), &mut out);
    }
    let _ = CallbackRequest::parse(bytes);
}

/// Checks both ends of NatNet in every version that is laid out differently.
pub fn any_natnet_bytes(bytes: &[u8]) {
    let (mut server, mut out) = (NatNetServer::new(NatNetServerOptions::default()), Vec::new());
    let from = ([127, 0, 0, 1], 1510).into();
    server.receive(bytes, from, 0, &mut out);
    let mut client = NatNetClient::new(true);
    if let Ok(NatNetEvent::Connected(_)) = client.receive(bytes) {
        let _ = client.receive(bytes);
    }
    let _ = (NatNetMessage::parse(bytes), ServerInfo::parse(bytes));
    for (major, minor) in [(3, 0), (4, 0), (4, 1), (4, 2)] {
        let version = NatNetVersion::new(major, minor);
        let _ = ModelDefinitions::parse(bytes, version);
        if let Ok(frame) = NatNetFrame::parse(bytes, version) {
            let poses = frame.bodies().filter(|body| body.pose().is_some()).count();
            assert!(poses <= bytes.len());
        }
    }
}
