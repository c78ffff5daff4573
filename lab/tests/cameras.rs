//! Flights on poses computed from simulated markers, and estimation errors in real rooms.

use nalgebra::Vector3;
use oqtal_config::Config;
use oqtal_lab::cameras::{estimation, noise, statistics};
use oqtal_observe::flight::{Flight, Outcome};

use crate::{config, flown};

/// A flight on poses computed from markers.
fn on_markers(settings: &[&str]) -> Flight {
    flown(config(&[&["mocap.model=markers"], settings].concat()))
}

fn position_error(flight: &Flight) -> f64 {
    let scored = flight.samples.iter().filter(|sample| sample.telemetry.scored == 1);
    let errors: Vec<f64> = scored
        .map(|sample| {
            (sample.position() - Vector3::from(sample.telemetry.reference_position)).norm()
        })
        .collect();
    errors.iter().sum::<f64>() / errors.len() as f64
}

#[test]
fn a_covered_camera_and_two_hidden_markers_still_fly_the_square() {
    let whole = on_markers(&[]);
    let partly = on_markers(&["mocap.cameras.covered=[2]", "mocap.markers.hidden=[1,5]"]);
    assert_eq!((whole.outcome, partly.outcome), (Outcome::Landed, Outcome::Landed));
    let ratio = position_error(&partly) / position_error(&whole);
    assert!((0.97..1.03).contains(&ratio), "{ratio}");
}

#[test]
fn a_swap_of_two_markers_is_never_flown_through() {
    let flight =
        on_markers(&["mocap.markers.swap-probability=0.01", "mocap.markers.swap-frames=3.0"]);
    assert_eq!(flight.outcome, Outcome::Landed);
    let last = flight.samples.last().unwrap().telemetry;
    assert!(last.poses_refused > 20, "{}", last.poses_refused);
    let limit_m = flight.config.mocap.markers.max_residual_mm * 1e-3;
    for sample in flight.samples.iter().filter(|sample| sample.telemetry.fresh == 1) {
        assert!(sample.telemetry.pose_residual_m <= limit_m);
        // 15 ms of flight at 1 m/s, and noise; a swap shifts the pose by centimetres and turns it by degrees.
        let moved = sample.position() - Vector3::from(sample.telemetry.pose_position);
        assert!(moved.norm() < 0.025, "{moved} at {:?}", sample.telemetry.time);
    }
}

#[test]
fn pose_noise_follows_the_pixel_noise_and_the_place() {
    let map = noise::map(&Config::default(), 400);
    let double = noise::map(&config(&["mocap.cameras.pixel-noise-px=0.3"]), 400);
    for (one, two) in map.iter().zip(&double) {
        let ratio = two.position_mm[0] / one.position_mm[0];
        assert!((1.9..2.1).contains(&ratio), "{}: {ratio}", one.name);
        assert!((one.reprojection_ratio / 0.15 - 1.0).abs() < 0.03, "{one:?}");
    }
    assert!(noise::to_text(&map).lines().count() == map.len() + 2);
}

#[test]
fn filters_have_the_right_noise_and_white_innovations() {
    for preset in ["qualisys", "measured", "room"] {
        let preset_setting = format!("mocap.preset={preset}");
        let config = config(&[&preset_setting, "mocap.room.stalls-per-1000-s=0.0"]);
        let rows = estimation::study(config).unwrap();
        let exact = &rows[0];
        for (nis, next) in exact.nis_ratio.iter().zip(exact.next_ratio) {
            assert!((0.5..1.5).contains(nis), "{preset}: {exact:?}");
            assert!(next.abs() < 0.3, "{preset}: {exact:?}");
        }
        let (arrival, estimated) = (&rows[1], &rows[2]);
        assert!(estimated.filter_velocity_m_s < arrival.filter_velocity_m_s, "{rows:?}");
        assert!(exact.filter_velocity_m_s <= estimated.filter_velocity_m_s, "{rows:?}");
    }
}

#[test]
fn statistics_without_recordings_are_within_nothing() {
    let study = statistics::CameraStudy::of(&config(&["mocap.preset=room"]), 40.0, &[]).unwrap();
    assert_eq!(study.is_within(0), None);
    assert_eq!(study.to_text().lines().count(), 23);
    assert_eq!(study.to_json()["figures"].as_array().unwrap().len(), 21);
}
