//! The bridge's own rules, over a list of protocols, for all commands, poses, manual overrides and failures of the port. No old
//! command is ever sent; the first set-point is a zero set-point; nothing is sent while another has control. The vehicle gets
//! zero set-points soon after the last command, and a flight is not resumed after a loss.

mod asctec;
mod crtp;
mod exchange;
mod mavlink;
mod msp;
mod protocol;

use exchange::{Exchange, Happening};
use proptest::prelude::*;
use protocol::{Protocol, Understood};

/// All protocols. A further one is a row.
const PROTOCOLS: [Protocol; 6] = [
    asctec::PROTOCOL,
    crtp::PROTOCOL,
    mavlink::ARDUPILOT,
    mavlink::PX4,
    msp::RX_MSP,
    msp::OVERRIDE,
];

/// Events, each with the number of periods that follow \[-\].
type Happenings = Vec<(Happening, usize)>;

fn happening() -> impl Strategy<Value = Happening> {
    let age = || prop_oneof![8 => 0..2000_i64, 1 => 0..200_000_i64, 1 => -50_000..0_i64];
    let command = |flies| age().prop_map(move |age_us| Happening::Command { flies, age_us });
    prop_oneof![
        24 => command(true),
        3 => command(false),
        3 => age().prop_map(|age_us| Happening::Pose { age_us }),
        4 => Just(Happening::Nothing),
        1 => (any::<bool>(), any::<bool>())
            .prop_map(|(motors_on, is_piloted)| Happening::Somebody { motors_on, is_piloted }),
        1 => prop::collection::vec(any::<u8>(), 0..80).prop_map(Happening::Noise),
        1 => Just(Happening::PortLost),
    ]
}

fn happenings(count: std::ops::Range<usize>) -> impl Strategy<Value = Happenings> {
    let periods = prop_oneof![12 => 0..2_usize, 1 => 2..24_usize];
    prop::collection::vec((happening(), periods), count)
}

/// The exchange of `protocol`, airborne, after everything that happened.
fn flown(protocol: &Protocol, happenings: &Happenings) -> Result<Exchange, TestCaseError> {
    let mut exchange = Exchange::new(protocol);
    exchange.until_airborne()?;
    happenings.iter().try_for_each(|(what, periods)| exchange.happen(what, *periods))?;
    Ok(exchange)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn the_rules_hold_for_every_frame(happenings in happenings(100..300)) {
        for protocol in &PROTOCOLS {
            flown(protocol, &happenings)?;
        }
    }

    #[test]
    fn the_rules_hold_from_the_first_byte_on(happenings in happenings(1..200)) {
        for protocol in &PROTOCOLS {
            let mut exchange = Exchange::new(protocol);
            happenings.iter().try_for_each(|(what, periods)| exchange.happen(what, *periods))?;
        }
    }

    #[test]
    fn after_the_last_command_at_most_four_frames_are_not_zero(happenings in happenings(0..60)) {
        for protocol in &PROTOCOLS {
            let mut exchange = flown(protocol, &happenings)?;
            exchange.vehicle.manual_override(exchange.vehicle.motors_on(), false);
            let before = exchange.flights();
            exchange.happen(&Happening::Nothing, 120)?;
            let after = exchange.flights() - before;
            prop_assert!(after <= 4, "{}: {} frames", protocol.name, after);
            let last = exchange.understood.iter().rev().take(30);
            prop_assert!(last.clone().count() == 30);
            prop_assert!(last.clone().all(|frame| !matches!(frame, Understood::Flight(_))));
        }
    }

    #[test]
    fn a_flight_is_not_resumed_after_a_loss_until_there_was_no_request(lost_after in 1..200_usize) {
        for protocol in &PROTOCOLS {
            let mut exchange = Exchange::new(protocol);
            exchange.until_airborne()?;
            for _ in 0..lost_after {
                exchange.happen(&Happening::FLIGHT, 1)?;
            }
            exchange.happen(&Happening::PortLost, 1)?;
            let before = exchange.flights();
            for _ in 0..300 {
                exchange.happen(&Happening::FLIGHT, 1)?;
            }
            prop_assert_eq!(exchange.flights(), before, "{}", protocol.name);
            exchange.until_airborne()?;
        }
    }
}

/// A flight in every protocol: rest, start, flight, end, stop.
#[test]
fn every_protocol_starts_flies_and_stops() {
    for protocol in &PROTOCOLS {
        let mut exchange = Exchange::new(protocol);
        exchange.until_airborne().unwrap();
        for _ in 0..300 {
            exchange.happen(&Happening::FLIGHT, 1).unwrap();
        }
        let (flown, name) = (exchange.flights(), protocol.name);
        assert!(flown > 290 && exchange.vehicle.motors_on(), "{name}: {flown} frames");
        for _ in 0..300 {
            exchange.happen(&Happening::DISARMED, 1).unwrap();
        }
        assert!(!exchange.vehicle.motors_on(), "{name}: motors run after the flight");
    }
}

/// An autopilot counts as armed from the command on, but its motors follow set-points some seconds later.
#[test]
fn a_start_that_is_withdrawn_leaves_no_vehicle_armed() {
    for protocol in &PROTOCOLS {
        for after in [0, 1, 6, 30, 60, 90, 140] {
            let mut exchange = Exchange::new(protocol);
            for _ in 0..600 {
                exchange.happen(&Happening::DISARMED, 1).unwrap();
            }
            for _ in 0..600 {
                if exchange.vehicle.motors_on() {
                    break;
                }
                exchange.happen(&Happening::FLIGHT, 1).unwrap();
            }
            assert!(exchange.vehicle.motors_on(), "{}", protocol.name);
            for _ in 0..after {
                exchange.happen(&Happening::FLIGHT, 1).unwrap();
            }
            for _ in 0..300 {
                exchange.happen(&Happening::DISARMED, 1).unwrap();
            }
            assert!(!exchange.vehicle.motors_on(), "{}, {after} periods", protocol.name);
        }
    }
}

/// The stop sequence is not left half-sent: an AscTec vehicle would neither stop nor fly.
#[test]
fn a_flight_requested_while_the_motors_are_being_stopped_begins_after_the_stop() {
    for protocol in &PROTOCOLS {
        for after in (84..150).step_by(3) {
            let mut exchange = Exchange::new(protocol);
            exchange.until_airborne().unwrap();
            for _ in 0..after {
                exchange.happen(&Happening::DISARMED, 1).unwrap();
            }
            let before = exchange.flights();
            for _ in 0..300 {
                exchange.happen(&Happening::FLIGHT, 1).unwrap();
            }
            let (flown, name) = (exchange.flights() - before, protocol.name);
            assert!(flown > 60 && exchange.vehicle.motors_on(), "{name}, {after} periods: {flown}");
        }
    }
}

/// Until a vehicle reports its motors, the bridge receives the same from one that flies and from one at rest: it reports neither as at
/// rest.
#[test]
fn f18_a_vehicle_that_flies_when_a_bridge_comes_is_not_reported_as_off() {
    for protocol in PROTOCOLS.iter().chain([&crtp::FLOWN]) {
        for is_stopped in [false, true] {
            let mut exchange = Exchange::new(protocol);
            exchange.vehicle.manual_override(true, false);
            if is_stopped {
                exchange.raise_stop();
            }
            stays_unreported(&mut exchange, protocol.name);
        }
    }
}

/// Another host may have started the motors meanwhile.
#[test]
fn f18_a_vehicle_that_was_silent_is_not_reported_as_off_by_an_earlier_report() {
    for protocol in &PROTOCOLS {
        let mut exchange = Exchange::new(protocol);
        (0..300).for_each(|_| exchange.happen(&Happening::DISARMED, 1).unwrap());
        assert!(exchange.reports_motors_off(), "{}", protocol.name);
        exchange.is_silent = true;
        (0..100).for_each(|_| exchange.happen(&Happening::DISARMED, 1).unwrap());
        exchange.is_silent = false;
        exchange.vehicle.manual_override(true, false);
        stays_unreported(&mut exchange, protocol.name);
    }
}

/// Lets five seconds pass; the motors are not reported as off while they run.
fn stays_unreported(exchange: &mut Exchange, name: &str) {
    for period in 0..300 {
        exchange.happen(&Happening::DISARMED, 1).unwrap();
        let is_wrong = exchange.vehicle.motors_on() && exchange.reports_motors_off();
        assert!(!is_wrong, "{name}: motors off after {period} periods");
    }
}

/// No silence reveals the restart: the new vehicle answers the next frame.
#[test]
fn f72_a_vehicle_that_was_restarted_is_not_flown_by_what_was_read_before() {
    for (protocol, restarted, flies) in [
        (msp::RX_MSP, msp::with_failsafe(20), false),
        (msp::RX_MSP, msp::with_failsafe(5), true),
        (crtp::PROTOCOL, crtp::vehicle(), true),
    ] {
        let mut exchange = Exchange::new(&protocol);
        (0..300).for_each(|_| exchange.happen(&Happening::DISARMED, 1).unwrap());
        exchange.vehicle = restarted;
        (0..300).for_each(|_| exchange.happen(&Happening::FLIGHT, 1).unwrap());
        assert_eq!(exchange.flights() > 0, flies, "{}", protocol.name);
    }
}

/// Its failsafe watches the receiver of the pilot: it flies on without set-points.
#[test]
fn f72_a_vehicle_with_msp_override_is_flown_only_if_a_time_out_is_not_needed() {
    for (protocol, flies) in [(msp::LIMITED_OVERRIDE, false), (msp::OVERRIDE, true)] {
        let mut exchange = Exchange::new(&protocol);
        (0..300).for_each(|_| exchange.happen(&Happening::DISARMED, 1).unwrap());
        assert_eq!(exchange.time_out_s(), 0.0, "no time-out is reported");
        (0..300).for_each(|_| exchange.happen(&Happening::FLIGHT, 1).unwrap());
        assert_eq!(exchange.flights() > 0, flies);
    }
}

#[test]
fn f72_a_restart_that_lengthens_the_time_out_is_reported_within_two_seconds() {
    let mut exchange = Exchange::new(&msp::RX_MSP);
    (0..300).for_each(|_| exchange.happen(&Happening::DISARMED, 1).unwrap());
    let tenths = |exchange: &mut Exchange| (exchange.time_out_s() * 10.0).round();
    assert_eq!(tenths(&mut exchange), 3.0);
    exchange.vehicle = msp::with_failsafe(10);
    (0..120).for_each(|_| exchange.happen(&Happening::DISARMED, 1).unwrap());
    assert_eq!(tenths(&mut exchange), 10.0);
}

/// Also a vehicle that obeys only several frames in a row.
#[test]
fn f33_the_motors_are_off_after_the_last_frames_of_a_bridge() {
    for protocol in [mavlink::ARDUPILOT, mavlink::PX4, msp::RX_MSP] {
        let mut exchange = Exchange::new(&protocol);
        exchange.until_airborne().unwrap();
        exchange.end().unwrap();
        assert!(!exchange.vehicle.motors_on(), "{}", protocol.name);
    }
}
