//! Arbitrary bytes into the decoders of camera systems.

use crate::common::any_camera_bytes::{any_natnet_bytes, any_qtm_bytes, any_vrpn_bytes};
use crate::common::scene;
use oqtal_wire::ByteOrder;
use oqtal_wire::natnet::{NatNetServer, NatNetServerOptions, NatNetVersion};
use oqtal_wire::qtm::{ComponentKind, ComponentSet, QtmEvent, QtmWriter};
use oqtal_wire::vrpn::VrpnSession;
use proptest::prelude::*;

/// Good bytes of each protocol with a few of them changed, and the rest cut off.
fn damaged(bytes: Vec<u8>) -> impl Strategy<Value = Vec<u8>> {
    let changes = prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6);
    (Just(bytes), changes, any::<prop::sample::Index>(), any::<bool>()).prop_map(
        |(mut bytes, changes, cut, whole)| {
            for (place, value) in changes {
                let length = bytes.len();
                bytes[place.index(length)] = value;
            }
            bytes.truncate(if whole { bytes.len() } else { cut.index(bytes.len()) });
            bytes
        },
    )
}

fn qtm() -> impl Strategy<Value = Vec<u8>> {
    let good = (scene::frame(), any::<bool>()).prop_map(|(frame, big)| {
        let order = if big { ByteOrder::Big } else { ByteOrder::Little };
        let mut out = Vec::new();
        let mut writer = QtmWriter::new(&mut out, order);
        writer.command("QTM RT Interface connected");
        writer.command("Version set to 1.25");
        writer.event(QtmEvent::Connected);
        writer.xml("<P><The_6D><Bodies>1</Bodies><Body><Name>a&amp;b</Name></Body></The_6D></P>");
        let all = ComponentKind::ALL.into_iter().fold(ComponentSet::new(), ComponentSet::with);
        writer.data(&frame.as_frame(), &all);
        out
    });
    good.prop_flat_map(damaged)
}

fn vrpn() -> impl Strategy<Value = Vec<u8>> {
    let good = scene::frame().prop_map(|frame| {
        let mut out = Vec::new();
        let mut session = VrpnSession::open(&["cf1".to_owned()], &mut out);
        let cookie = out.split_off(0);
        session.receive(&cookie, &mut out).unwrap();
        session.write_frame(&frame.as_frame(), &mut out);
        out
    });
    good.prop_flat_map(damaged)
}

fn natnet() -> impl Strategy<Value = Vec<u8>> {
    let good = (scene::frame(), any::<bool>()).prop_map(|(frame, old)| {
        let version = if old { NatNetVersion::new(3, 1) } else { NatNetVersion::SIZED };
        let options = NatNetServerOptions { version, ..NatNetServerOptions::default() };
        let mut out = Vec::new();
        NatNetServer::new(options).write_frame(&frame.as_frame(), None, &mut out);
        out
    });
    good.prop_flat_map(damaged)
}

fn noise() -> impl Strategy<Value = Vec<u8>> {
    prop::collection::vec(any::<u8>(), 0..400)
}

proptest! {
    #[test]
    fn both_ends_of_qtm_stay_sound(bytes in prop_oneof![qtm(), noise()]) {
        any_qtm_bytes(&bytes);
    }

    #[test]
    fn both_ends_of_vrpn_stay_sound(bytes in prop_oneof![vrpn(), noise()]) {
        any_vrpn_bytes(&bytes);
    }

    #[test]
    fn both_ends_of_natnet_stay_sound(bytes in prop_oneof![natnet(), noise()]) {
        // Without the header, the content of a frame.
        any_natnet_bytes(bytes.get(4..).unwrap_or_default());
        any_natnet_bytes(&bytes);
    }

    #[test]
    fn parameters_stay_sound(text in "[<>/&;a-zA-Z0-9_ \"=#]{0,200}") {
        any_qtm_bytes(format!("<P><The_6D><Body>{text}</Body></The_6D></P>").as_bytes());
    }
}

#[test]
fn elements_nested_without_end_are_refused() {
    let deep = "<a>".repeat(100_000);
    assert!(oqtal_wire::qtm::QtmParameters::from_xml(&deep).is_err());
}
