//! Time from which a flight may be requested.

use crate::common::{START, bridge, flight, header, status, turn};
use oqtal_bridge::Bridge;
use oqtal_bus::time::Span;

/// A daemon may request a flight as soon as the vehicle is reported: it is reported no sooner than a request would be executed.
#[test]
fn a_flight_requested_when_the_vehicle_is_reported_begins() {
    for pause_ms in [1, 5, 16, 17, 40, 60] {
        let mut bridge = bridge();
        let (mut has_link, mut is_starting) = (false, false);
        for frame in 0..100 {
            let now = START + Span::from_millis(pause_ms * frame);
            bridge.receive_bytes(now, &status(0), &mut |_| {});
            if has_link {
                bridge.receive_command(now, &header(1, now), flight(), 0);
            }
            let report = turn(&mut bridge, now).1;
            has_link |= report.is_some_and(|(_, _, vehicle)| vehicle.link == 1);
            is_starting |= report.is_some_and(|(_, _, vehicle)| vehicle.starting == 1);
        }
        assert!(has_link && is_starting, "{pause_ms} ms: {has_link}");
    }
}

/// An earlier request has no effect, and no vehicle is reported until it ends.
#[test]
fn a_flight_that_was_asked_for_before_the_port_opened_does_not_hear_of_the_vehicle() {
    let mut bridge = bridge();
    let has_link = |bridge: &mut Bridge, millis: i64| {
        let now = START + Span::from_millis(millis);
        bridge.receive_bytes(now, &status(0), &mut |_| {});
        turn(bridge, now).1.is_some_and(|(_, _, vehicle)| vehicle.link == 1)
    };
    for frame in 0..200 {
        let now = START + Span::from_millis(16 * frame);
        bridge.receive_command(now, &header(1, now), flight(), 0);
        assert!(!has_link(&mut bridge, 16 * frame));
    }
    assert!((200..210).any(|frame| has_link(&mut bridge, 16 * frame)), "no longer asked for");
}
