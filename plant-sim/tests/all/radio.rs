//! Model of the radio: rate, latency, losses, wrong bits.

use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, PlantWireOptions};
use oqtal_plant_sim::wire::{LinkDirection, LinkModel, RadioModel};
use oqtal_runtime::faults::RadioDisturbance;
use proptest::prelude::*;

const BAUD: u32 = 57_600;
const LATENCY: Span = Span::from_millis(17);

fn radio(change: impl Fn(&mut PlantWireOptions)) -> RadioModel {
    let mut options = PlantWireOptions { latency_ms: 17.0, ..Config::default().plant.wire };
    change(&mut options);
    RadioModel::new(&options, 7, BAUD)
}

fn at(micros: i64) -> Time {
    Time::VIRTUAL_START + Span::from_nanos(1000 * micros)
}

/// All bytes that have arrived by `now`.
fn received(radio: &mut RadioModel, way: LinkDirection, now: Time) -> Vec<u8> {
    let mut bytes = Vec::new();
    radio.receive(way, now, &mut bytes);
    bytes
}

const LATE: i64 = 1_000_000_000;

#[test]
fn a_command_arrives_whole_after_its_bytes_and_the_latency() {
    let mut radio = radio(|_| {});
    radio.send(LinkDirection::Up, at(0), &[1; 17]);
    let arrival = radio.next_arrival(LinkDirection::Up).unwrap();
    let bytes = Span::from_seconds(170.0 / f64::from(BAUD));
    assert!((arrival.since(at(0)) - bytes - LATENCY).nanos().abs() < 17);
    assert_eq!(received(&mut radio, LinkDirection::Up, arrival - Span::from_nanos(1)).len(), 16);
    assert_eq!(received(&mut radio, LinkDirection::Up, arrival).len(), 1);
    assert_eq!(radio.next_arrival(LinkDirection::Up), None);
}

#[test]
fn a_delay_that_grows_within_a_frame_postpones_the_rest_of_it() {
    let mut radio = radio(|_| {});
    radio.send(LinkDirection::Up, at(0), &[1; 17]);
    let half = at(17_000 + 1_500);
    assert_eq!(received(&mut radio, LinkDirection::Up, half).len(), 8);
    let delay = Span::from_millis(10);
    radio.disturb(RadioDisturbance { delay, ..RadioDisturbance::default() });
    assert_eq!(received(&mut radio, LinkDirection::Up, half).len(), 0);
    assert_eq!(received(&mut radio, LinkDirection::Up, half + delay).len(), 0);
    assert_eq!(received(&mut radio, LinkDirection::Up, at(LATE)).len(), 9);
}

#[test]
fn replies_that_would_wait_for_more_than_a_second_are_lost() {
    let mut radio = radio(|options| options.half_duplex = false);
    for _ in 0..1000 {
        radio.send(LinkDirection::Down, at(0), &[1; 100]);
    }
    let traffic = radio.traffic(LinkDirection::Down);
    assert_eq!((traffic.frames, traffic.frames - traffic.lost), (1000, 58));
    assert_eq!(received(&mut radio, LinkDirection::Down, at(LATE)).len(), 5800);
}

#[test]
fn half_duplex_the_two_ends_take_turns() {
    for (half_duplex, wait_ms) in [(true, 17.36), (false, 0.0)] {
        let mut radio = radio(|options| options.half_duplex = half_duplex);
        radio.send(LinkDirection::Down, at(0), &[0; 100]);
        radio.send(LinkDirection::Up, at(0), &[1; 1]);
        let arrival = radio.next_arrival(LinkDirection::Up).unwrap().since(at(0)) - LATENCY;
        assert!((arrival.seconds() * 1e3 - wait_ms - 0.174).abs() < 0.01, "{arrival:?}");
    }
}

#[test]
fn frames_are_lost_and_bits_are_wrong_as_often_as_configured() {
    let mut radio = radio(|options| {
        (options.loss_probability, options.bit_error_rate) = (0.1, 0.01);
    });
    for frame in 0..10_000 {
        radio.send(LinkDirection::Up, at(20_000 * frame), &[0; 20]);
    }
    let traffic = radio.traffic(LinkDirection::Up);
    // Five standard deviations of the binomial distributions.
    assert!((traffic.lost as f64 - 1000.0).abs() < 150.0, "{traffic:?}");
    assert!((traffic.wrong_bits as f64 - 16_000.0).abs() < 630.0, "{traffic:?}");
    let arrived = received(&mut radio, LinkDirection::Up, at(LATE));
    assert_eq!(arrived.len() as u64, 20 * (traffic.frames - traffic.lost));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// In any interval, no more bytes arrive than the rate of the wire allows.
    #[test]
    fn occupancy_never_exceeds_the_baud_rate(
        frames in prop::collection::vec((0..50_000_i64, 1..200_usize, any::<bool>()), 1..40),
        step_us in 1..5000_i64,
    ) {
        let mut radio = radio(|_| {});
        let mut now = 0;
        let mut sent = 0;
        for (wait, bytes, up) in frames {
            now += wait;
            sent += bytes;
            radio.send(if up { LinkDirection::Up } else { LinkDirection::Down }, at(now), &vec![0; bytes]);
        }
        let mut arrived = 0;
        let mut looked_at = 0;
        while arrived < sent {
            looked_at += step_us;
            let fresh = received(&mut radio, LinkDirection::Up, at(looked_at)).len()
                + received(&mut radio, LinkDirection::Down, at(looked_at)).len();
            let fits = step_us as f64 * 1e-6 * f64::from(BAUD) / 10.0;
            prop_assert!(fresh as f64 <= fits.floor() + 1.0, "{fresh} bytes in {step_us} us");
            arrived += fresh;
        }
    }

    #[test]
    fn without_losses_every_byte_arrives_in_order(
        frames in prop::collection::vec((0..50_000_i64, prop::collection::vec(any::<u8>(), 0..200)), 0..40),
        steps in prop::collection::vec(1..20_000_i64, 0..200),
    ) {
        let mut radio = radio(|_| {});
        let (mut now, mut sent) = (0, Vec::new());
        for (wait, bytes) in frames {
            now += wait;
            radio.send(LinkDirection::Up, at(now), &bytes);
            sent.extend(bytes);
        }
        let (mut looked_at, mut arrived) = (0, Vec::new());
        for step in steps {
            looked_at += step;
            arrived.extend(received(&mut radio, LinkDirection::Up, at(looked_at)));
        }
        arrived.extend(received(&mut radio, LinkDirection::Up, at(LATE)));
        prop_assert_eq!(arrived, sent);
        prop_assert!(received(&mut radio, LinkDirection::Down, at(LATE)).is_empty());
    }

    /// The same bits are wrong regardless of the division of bytes into frames.
    #[test]
    fn wrong_bits_depend_on_their_place_alone(cuts in prop::collection::vec(1..90_usize, 1..30)) {
        let noisy = || radio(|options| options.bit_error_rate = 0.02);
        let (mut whole, mut cut) = (noisy(), noisy());
        for bytes in &cuts {
            cut.send(LinkDirection::Down, at(0), &vec![0; *bytes]);
        }
        whole.send(LinkDirection::Down, at(0), &vec![0; cuts.iter().sum()]);
        let (whole, cut) = [&mut whole, &mut cut].map(|r| received(r, LinkDirection::Down, at(LATE))).into();
        prop_assert_eq!(whole, cut);
    }
}
