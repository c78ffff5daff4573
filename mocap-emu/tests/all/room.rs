//! The preset `room`, compared with a real room: captures, arrivals, stalls, noise, stamps; and captures estimated from arrivals.

use nalgebra::Vector3;
use oqtal_bus::message::TruthV1;
use oqtal_config::MocapOptions;
use oqtal_control::quaternion::Attitude;
use oqtal_mocap_emu::capture::Captures;
use oqtal_mocap_emu::emulation::{EmulatedRecording, record};
use oqtal_mocap_emu::recording::{RecordedPose, Recording};
use oqtal_mocap_emu::statistics::{RoomStatistics, allan_deviation};

use crate::mocap;

/// `[mocap]` with the preset `room` and these values.
fn room(settings: &[(&str, toml::Value)]) -> MocapOptions {
    mocap(&[&[("preset", "room".into())], settings].concat())
}

fn at_rest(_: f64) -> TruthV1 {
    TruthV1 { position: [0.3, 0.1, 0.5], attitude: Attitude::LEVEL.xyzw(), ..TruthV1::default() }
}

/// Lemniscate with speeds up to 1 m/s.
fn lemniscate(t_s: f64) -> TruthV1 {
    let angle = t_s * 1.1;
    let position = [0.65 * angle.sin(), 0.65 * (2.0 * angle).sin() / 2.0, 1.0];
    TruthV1 { position, attitude: Attitude::LEVEL.xyzw(), ..TruthV1::default() }
}

fn watch(mocap: &MocapOptions, seconds: f64, motion: fn(f64) -> TruthV1) -> EmulatedRecording {
    record((mocap, 7), seconds, motion).unwrap()
}

#[test]
fn captures_are_on_the_cameras_grid_and_arrivals_follow_them() {
    let watched = watch(&room(&[]), 120.0, lemniscate);
    for pair in watched.stamped_s.windows(2) {
        let frames = (pair[1] - pair[0]) * 240.0;
        assert!((frames - frames.round()).abs() < 1e-5, "{frames}");
    }
    assert!(watched.frames.windows(2).all(|pair| pair[0] < pair[1]));
    let statistics = RoomStatistics::of(&watched.recording);
    assert!((54.0..62.0).contains(&statistics.rate_hz), "{statistics:?}");
    let grid = statistics.grid.unwrap();
    assert_eq!(grid.rate_hz, 240.0, "{grid:?}");
    assert!((5.5..8.5).contains(&grid.interval_ms), "{grid:?}");
    assert!((0.7..0.9).contains(&grid.correlation_ratio), "{grid:?}");
    assert!((2.5..4.0).contains(&grid.latency_ms), "{grid:?}");
}

#[test]
fn connections_stall_as_often_as_configured_and_poses_come_after_it_or_never() {
    let stalls = |loss: f64| {
        let settings = [
            ("room.stalls-per-1000-s", 200.0.into()),
            ("room.stall-from-ms", 150.0.into()),
            ("room.stall-loss-probability", loss.into()),
        ];
        watch(&room(&settings), 300.0, at_rest)
    };
    for (loss, is_complete) in [(0.0, true), (1.0, false)] {
        let watched = stalls(loss);
        let gaps = RoomStatistics::of(&watched.recording).gaps;
        assert!((120.0..260.0).contains(&gaps[1]), "{gaps:?}");
        let lost = watched.frames.windows(2).any(|pair| pair[1] != pair[0] + 1);
        assert_eq!(!lost, is_complete, "loss {loss}");
    }
}

#[test]
fn noise_is_correlated_in_time_and_between_position_and_attitude() {
    let rest = RoomStatistics::of(&watch(&room(&[]), 60.0, at_rest).recording).rest.unwrap();
    assert!((-0.42..-0.1).contains(&rest.position_slope_ratio), "{rest:?}");
    assert!((-0.42..-0.1).contains(&rest.attitude_slope_ratio), "{rest:?}");
    assert!((0.7..0.98).contains(&rest.coupling_ratio), "{rest:?}");
    assert!(rest.kurtosis_ratio > 4.0, "{rest:?}");
    let white = [
        ("room.position-drift-mm", 0.0.into()),
        ("room.attitude-drift-deg", 0.0.into()),
        ("room.pose-coupling-ratio", 0.0.into()),
        ("room.heavy-tail-probability", 0.0.into()),
    ];
    let white = RoomStatistics::of(&watch(&room(&white), 60.0, at_rest).recording).rest.unwrap();
    assert!((white.position_slope_ratio + 0.5).abs() < 0.06, "{white:?}");
    assert!(white.coupling_ratio < 0.1 && (white.kurtosis_ratio - 3.0).abs() < 0.5, "{white:?}");
}

#[test]
fn stamps_are_the_capture_the_arrival_or_a_foreign_clock() {
    let exact = watch(&room(&[]), 20.0, at_rest);
    let with = |stamp: &str| {
        let clock = [
            ("stamp", stamp.into()),
            ("room.clock-offset-ms", (-3.0).into()),
            ("room.clock-drift-ppm", 100.0.into()),
        ];
        watch(&room(&clock), 20.0, at_rest)
    };
    let arrival = with("arrival");
    assert_eq!(arrival.recording, exact.recording);
    let first_s = exact.stamped_s[0];
    for (k, pose) in exact.recording.poses().iter().enumerate() {
        assert!((arrival.stamped_s[k] - pose.time_ns as f64 * 1e-9).abs() < 1e-9);
    }
    let clock = with("clock");
    for k in 0..clock.stamped_s.len() {
        let gained = clock.stamped_s[k] - exact.stamped_s[k] + 3e-3;
        assert!((gained - 100e-6 * (exact.stamped_s[k] - first_s)).abs() < 1e-6, "{gained}");
    }
}

/// Deviation of the captures from the truth without the constant part, which cannot be observed \[s\].
fn scatter(estimated: &[f64], actual: &[f64]) -> f64 {
    let errors: Vec<f64> = estimated.iter().zip(actual).map(|(a, b)| a - b).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn captures_are_estimated_better_than_arrivals_say() {
    let calm = room(&[("room.stalls-per-1000-s", 0.0.into())]);
    let watched = watch(&calm, 60.0, lemniscate);
    let arrivals: Vec<f64> =
        watched.recording.poses().iter().map(|pose| pose.time_ns as f64 * 1e-9).collect();
    let estimated = Captures::of(&watched.recording).captured_s;
    assert!(estimated.windows(2).all(|pair| pair[0] < pair[1]));
    assert!(estimated.iter().zip(&arrivals).all(|(capture, arrival)| capture <= arrival));
    let (by_arrival, by_estimate) =
        (scatter(&arrivals, &watched.stamped_s), scatter(&estimated, &watched.stamped_s));
    assert!(by_arrival > 2.5e-3, "{by_arrival}");
    assert!(by_estimate < 0.4 * by_arrival, "{by_estimate} of {by_arrival}");
}

#[test]
fn a_stall_does_not_make_a_slow_body_fast() {
    // Motion at 0.17 m/s, captured regularly and delivered at once, except for a stall of 0.4 s whose poses arrive 3 ms apart.
    let poses = (0..600_u64).map(|k| {
        let captured_ms = k * 50 / 3;
        let queued_ms = 4500 + k * 3;
        let is_stalled = (300..330).contains(&k) && queued_ms > captured_ms;
        let arrival_ms = if is_stalled { queued_ms } else { captured_ms };
        let position = Vector3::new(0.17e-3 * captured_ms as f64, 0.0, 1.0);
        RecordedPose { time_ns: arrival_ms * 1_000_000, position, attitude: Attitude::LEVEL }
    });
    let recording = Recording::from_poses(poses.collect()).unwrap();
    let fastest = |times: &[f64]| {
        let poses = recording.poses().windows(10).zip(times.windows(10));
        let speeds = poses.map(|(poses, times)| {
            (poses[9].position - poses[0].position).norm() / (times[9] - times[0])
        });
        speeds.fold(0.0, f64::max)
    };
    let arrivals: Vec<f64> = recording.poses().iter().map(|p| p.time_ns as f64 * 1e-9).collect();
    assert!(fastest(&arrivals) > 0.6);
    let estimated = Captures::of(&recording).captured_s;
    assert!(fastest(&estimated) < 0.22, "{}", fastest(&estimated));
}

#[test]
fn allan_deviation_of_a_ramp_is_known() {
    let ramp: Vec<f64> = (0..100).map(f64::from).collect();
    // Means of m values differ by m.
    for m in [1, 2, 5] {
        let expected = m as f64 / f64::sqrt(2.0);
        assert!((allan_deviation(&ramp, m).unwrap() - expected).abs() < 1e-9);
    }
    assert_eq!(allan_deviation(&ramp, 50), None);
}

/// Recordings given in `OQTAL_RECORDINGS`, files separated by colons, lie on the grid of the preset.
#[test]
fn real_recordings_lie_on_the_grid_of_the_preset() {
    let Ok(files) = std::env::var("OQTAL_RECORDINGS") else { return };
    for file in files.split(':') {
        let recording = Recording::read(std::path::Path::new(file)).unwrap();
        let statistics = RoomStatistics::of(&recording);
        eprintln!("{file}: {statistics:#?}");
        if let Some(grid) = statistics.grid {
            assert!((grid.rate_hz - 240.0).abs() <= 2.0, "{file}: {grid:?}");
        }
    }
}
