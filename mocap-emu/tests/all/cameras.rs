//! Emulated cameras: noise, latency, dropouts and outliers are as configured.

use nalgebra::Vector3;
use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::MocapOptions;
use oqtal_control::quaternion::Attitude;
use oqtal_mocap_emu::{Cameras, Delivery};

use crate::{at_rest, mocap};

const FRAMES: u64 = 4000;

fn truth(frame: u64) -> TruthV1 {
    at_rest(frame, [1.0, 2.0, 3.0], [0.2, -0.1, 0.4])
}

/// The poses of many frames, each with its arrival.
fn watch(mocap: &MocapOptions, seed: u64) -> Vec<(Time, Delivery)> {
    let mut cameras = Cameras::new(mocap, seed);
    let mut arrivals = Vec::new();
    for frame in 1..=FRAMES {
        cameras.capture(&truth(frame));
        while let Some(at) = cameras.next_event().filter(|at| *at <= truth(frame + 1).time) {
            arrivals.push((at, cameras.deliver(at).unwrap()));
        }
    }
    arrivals
}

fn deviation(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

fn attitude_noise(delivery: &Delivery) -> Vector3<f64> {
    let actual = Attitude::from_xyzw(truth(1).attitude).unwrap();
    actual.rotation_to(&Attitude::from_xyzw(delivery.pose.attitude).unwrap())
}

#[test]
fn ideal_cameras_publish_the_truth_at_once() {
    for (at, delivery) in watch(&mocap(&[("preset", "ideal".into())]), 1) {
        assert_eq!(delivery.pose.position, [1.0, 2.0, 3.0]);
        assert!(attitude_noise(&delivery).norm() < 1e-15);
        assert_eq!(at, delivery.stamps.captured_at);
    }
}

#[test]
fn noise_has_its_standard_deviation_on_every_axis() {
    let arrivals = watch(&mocap(&[]), 1);
    assert_eq!(arrivals.len() as u64, FRAMES);
    for axis in 0..3 {
        let position = arrivals.iter().map(|(_, d)| d.pose.position[axis] - (axis as f64 + 1.0));
        assert!((deviation(position) / 0.5e-3 - 1.0).abs() < 0.05);
        let attitude = arrivals.iter().map(|(_, d)| attitude_noise(d)[axis].to_degrees());
        assert!((deviation(attitude) / 0.2 - 1.0).abs() < 0.05);
    }
}

#[test]
fn poses_arrive_after_the_latency() {
    for (at, delivery) in watch(&mocap(&[]), 1) {
        assert_eq!(at.since(delivery.stamps.captured_at), Span::from_millis(15));
    }
}

#[test]
fn jitter_spreads_the_latency_and_nothing_overtakes() {
    let arrivals = watch(&mocap(&[("jitter-ms", 30.0.into())]), 1);
    let mean = arrivals.iter().map(|(at, d)| at.since(d.stamps.captured_at).seconds()).sum::<f64>()
        / arrivals.len() as f64;
    assert!((0.029..0.036).contains(&mean), "15 ms, half of 30, and a little for waiting: {mean}");
    assert!(arrivals.windows(2).all(|pair| pair[0].0 <= pair[1].0));
    assert!(arrivals.windows(2).all(|pair| pair[0].1.frame < pair[1].1.frame));
}

#[test]
fn a_polling_receiver_hands_poses_on_at_its_multiples() {
    for (at, _) in watch(&mocap(&[("poll-ms", 10.0.into()), ("jitter-ms", 16.0.into())]), 1) {
        assert_eq!(at.nanos() % 10_000_000, 0);
    }
}

#[test]
fn gaps_come_as_often_and_last_as_long_as_configured() {
    let gaps = [("dropout-probability", 0.02.into()), ("dropout-frames", 4.0.into())];
    let arrivals = watch(&mocap(&gaps), 1);
    let lengths: Vec<f64> = arrivals
        .windows(2)
        .map(|pair| (pair[1].1.frame - pair[0].1.frame - 1) as f64)
        .filter(|length| *length > 0.0)
        .collect();
    let share = lengths.len() as f64 / FRAMES as f64;
    let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
    assert!((0.013..0.025).contains(&share), "{share}");
    assert!((3.0..5.0).contains(&mean), "{mean}");
}

#[test]
fn a_lost_frame_does_not_change_the_noise_of_another() {
    let plain = watch(&mocap(&[]), 9);
    let gappy = watch(&mocap(&[("dropout-probability", 0.3.into())]), 9);
    assert!(gappy.len() < plain.len());
    for (_, delivery) in &gappy {
        assert_eq!(delivery.pose, plain[delivery.frame as usize - 1].1.pose);
    }
}

#[test]
fn outliers_are_as_far_off_and_as_rare_as_configured() {
    let arrivals = watch(&mocap(&[("outlier-probability", 0.05.into())]), 1);
    let distance =
        |d: &Delivery| (Vector3::from(d.pose.position) - Vector3::new(1., 2., 3.)).norm();
    let wrong: Vec<f64> = arrivals.iter().map(|(_, d)| distance(d)).filter(|d| *d > 0.1).collect();
    assert!((wrong.len() as f64 / FRAMES as f64 / 0.05 - 1.0).abs() < 0.2);
    assert!(wrong.iter().all(|distance| (distance - 0.3).abs() < 5e-3));
}

#[test]
fn quantised_poses_are_multiples_of_their_quantum() {
    let quanta = [("position-quantum-mm", 0.1.into()), ("attitude-quantum-deg", 0.05.into())];
    for (_, delivery) in watch(&mocap(&quanta), 1).iter().take(50) {
        for x in delivery.pose.position {
            assert!((x / 1e-4 - (x / 1e-4).round()).abs() < 1e-6);
        }
        let attitude = Attitude::from_xyzw(delivery.pose.attitude).unwrap();
        for angle in &Attitude::LEVEL.rotation_to(&attitude) {
            let quanta = angle.to_degrees() / 0.05;
            assert!((quanta - quanta.round()).abs() < 1e-6);
        }
    }
}

#[test]
fn the_seed_decides_the_noise() {
    let poses = |seed| -> Vec<_> {
        watch(&mocap(&[]), seed).iter().map(|(_, delivery)| delivery.pose).collect()
    };
    assert_eq!(poses(3), poses(3));
    assert_ne!(poses(3), poses(4));
}
