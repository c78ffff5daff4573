//! Poses from the markers up: triangulation, the fitted body, visibility, swapped markers.

use nalgebra::Vector3;
use oqtal_bus::message::TruthV1;
use oqtal_config::MocapOptions;
use oqtal_control::quaternion::Attitude;
use oqtal_mocap_emu::markers::{
    MarkerCameras, MarkerFrame, PinholeCamera, Sighting, fit, triangulate,
};
use proptest::prelude::*;

use crate::{at_rest, mocap};

fn places(mocap: &MocapOptions) -> Vec<Vector3<f64>> {
    mocap.markers.positions_m.iter().map(|place| Vector3::from(*place)).collect()
}

fn truth(frame: u64) -> TruthV1 {
    at_rest(frame, [0.2, -0.1, 0.9], [0.1, -0.1, 0.4])
}

fn frames(mocap: &MocapOptions, count: u64) -> Vec<MarkerFrame> {
    let mut cameras = MarkerCameras::new(mocap, 7);
    (1..=count).map(|frame| cameras.observe(&truth(frame))).collect()
}

fn error(frame: &MarkerFrame) -> (Vector3<f64>, Vector3<f64>) {
    let fit = frame.body.unwrap();
    let actual = Attitude::from_xyzw(truth(1).attitude).unwrap();
    (fit.position - Vector3::from(truth(1).position), actual.rotation_to(&fit.attitude))
}

fn vector3(bound: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-bound..bound).prop_map(Vector3::from)
}

#[test]
fn without_noise_the_pose_is_the_true_one() {
    for frame in frames(&mocap(&[("cameras.pixel-noise-px", 0.0.into())]), 3) {
        let (position, attitude) = error(&frame);
        assert!(position.norm() < 1e-9 && attitude.norm() < 1e-8, "{position} {attitude}");
        assert!(frame.body.unwrap().residual_m < 1e-9);
    }
}

#[test]
fn reprojection_error_equals_the_pixel_noise_asked_for() {
    for noise_px in [0.05, 0.15, 0.6] {
        let mocap = mocap(&[
            ("cameras.pixel-noise-px", noise_px.into()),
            ("markers.max-reprojection-px", 50.0.into()),
        ]);
        let (mut squares, mut freedom) = (0.0, 0.0);
        for point in frames(&mocap, 400).iter().flat_map(|frame| frame.markers).flatten() {
            squares += point.squared_px;
            freedom += 2.0 * point.cameras as f64 - 3.0;
        }
        // Chi-square with some 25000 degrees of freedom: 1 % is two standard deviations.
        assert!(freedom > 10_000.0, "{freedom}");
        let measured_px = f64::sqrt(squares / freedom);
        assert!((measured_px / noise_px - 1.0).abs() < 0.02, "{measured_px} for {noise_px}");
    }
}

#[test]
fn a_moving_body_is_seen_in_the_middle_of_the_exposure() {
    let mocap =
        mocap(&[("cameras.exposure-ms", 4.0.into()), ("cameras.pixel-noise-px", 0.0.into())]);
    let moving = TruthV1 { velocity: [1.0, 0.0, 0.0], rate: [0.0, 0.0, 0.5], ..truth(1) };
    let body = MarkerCameras::new(&mocap, 1).observe(&moving).body.unwrap();
    assert!((body.position.x - truth(1).position[0] - 2e-3).abs() < 1e-9);
    let still = Attitude::from_xyzw(truth(1).attitude).unwrap();
    assert!((still.rotation_to(&body.attitude) - Vector3::new(0.0, 0.0, 1e-3)).norm() < 1e-8);
}

#[test]
fn markers_that_are_covered_hidden_or_behind_the_hull_are_not_seen() {
    let seen = |settings: &[(&str, toml::Value)]| {
        let frame = frames(&mocap(settings), 1)[0];
        frame.markers.map(|point| point.map_or(0, |point| point.cameras))
    };
    let (open, all) = (seen(&[]), [6; 8]);
    assert_eq!(open[..8], all);
    let behind = seen(&[("markers.hull-m", vec![0.12, 0.12, 0.12].into())]);
    assert!(behind[..8].iter().any(|count| *count < 6), "{behind:?}");
    let covered = seen(&[("cameras.covered", vec![2].into())]);
    assert!(covered.iter().zip(&open).all(|(covered, open)| covered <= open));
    assert!(covered[..8].iter().all(|count| *count <= 5));
    let hidden = seen(&[("markers.hidden", vec![1, 5].into())]);
    assert_eq!((hidden[0], hidden[4]), (0, 0));
    assert!((0..8).filter(|k| ![0, 4].contains(k)).all(|k| hidden[k] == open[k]));
}

#[test]
fn hidden_markers_do_not_change_the_noise_of_the_rest() {
    let all = frames(&mocap(&[]), 20);
    let some = frames(&mocap(&[("markers.hidden", vec![3].into())]), 20);
    for (all, some) in all.iter().zip(&some) {
        assert!((0..8).filter(|k| *k != 2).all(|k| all.markers[k] == some.markers[k]));
    }
}

#[test]
fn a_body_with_too_few_markers_is_lost() {
    let hidden = mocap(&[("markers.hidden", vec![1, 2, 3, 4, 5].into())]);
    assert!(frames(&hidden, 5).iter().all(|frame| frame.body.is_none()));
    let pose = MarkerCameras::new(&hidden, 1).pose(&truth(1));
    assert_eq!(pose.tracked, 0);
    let away = TruthV1 { position: [40.0, 0.0, 1.0], ..truth(1) };
    assert!(MarkerCameras::new(&mocap(&[]), 1).observe(&away).body.is_none());
}

#[test]
fn a_swap_of_two_markers_is_lost_in_every_subset_that_is_tracked() {
    let mocap = mocap(&[]);
    let places = places(&mocap);
    let limit_m = mocap.markers.max_residual_mm * 1e-3;
    let mut least = f64::INFINITY;
    for subset in 0_u32..256 {
        let seen: Vec<usize> = (0..8).filter(|k| subset >> k & 1 == 1).collect();
        if seen.len() < mocap.markers.least_visible {
            continue;
        }
        for (a, b) in seen.iter().flat_map(|a| seen.iter().map(move |b| (*a, *b))) {
            let taken = |k: usize| match k {
                _ if k == a => b,
                _ if k == b => a,
                _ => k,
            };
            let pairs = seen.iter().map(|k| (places[*k], places[taken(*k)]));
            if a < b {
                least = least.min(fit(pairs).unwrap().residual_m);
            }
        }
    }
    // Five times the noise of a marker of half a millimetre away from the limit.
    assert!(least > limit_m + 2.5e-3, "the least residual of a swap is {least} m");
}

#[test]
fn swaps_and_vanished_markers_come_as_often_and_last_as_long_as_configured() {
    let swapped =
        mocap(&[("markers.swap-probability", 0.01.into()), ("markers.swap-frames", 5.0.into())]);
    let lost = frames(&swapped, 4000).iter().filter(|frame| frame.body.is_none()).count();
    // Expected share: 5 in 104.
    assert!((130..260).contains(&lost), "{lost} of 4000");
    for frame in frames(&swapped, 4000).iter().filter(|frame| frame.body.is_some()) {
        let (position, attitude) = error(frame);
        assert!(position.norm() < 2e-3 && attitude.norm() < 0.02, "{position} {attitude}");
    }
    let vanished = mocap(&[("markers.vanish-probability", 0.01.into())]);
    let seen = frames(&vanished, 4000).iter().flat_map(|frame| frame.markers).flatten().count();
    let share = 1.0 - seen as f64 / (4000.0 * 8.0);
    assert!((0.07..0.12).contains(&share), "{share}: about 10 in 110");
}

#[test]
fn frames_repeat_and_the_seed_decides() {
    let poses = |seed| -> Vec<_> {
        let mut cameras = MarkerCameras::new(&mocap(&[]), seed);
        (1..50).map(|frame| cameras.pose(&truth(frame))).collect()
    };
    assert_eq!(poses(3), poses(3));
    assert_ne!(poses(3), poses(4));
}

#[test]
fn markers_on_a_line_fit_no_body() {
    let line = (0..5).map(|k| Vector3::new(0.1 * f64::from(k), 0.0, 0.0));
    assert_eq!(fit(line.map(|place| (place, place))), None);
    assert_eq!(fit(std::iter::repeat_n((Vector3::zeros(), Vector3::zeros()), 2)), None);
}

#[test]
fn parallel_rays_and_single_cameras_find_no_point() {
    let cameras = PinholeCamera::all(&mocap(&[]).cameras);
    let point = Vector3::new(0.1, 0.2, 0.7);
    let sighting =
        |k: usize| Sighting { camera: &cameras[k], pixel: cameras[k].image(&point).unwrap() };
    assert!(triangulate([sighting(0)].into_iter()).is_none());
    assert!(triangulate([sighting(0), sighting(0)].into_iter()).is_none());
    let two = triangulate([sighting(0), sighting(3)].into_iter()).unwrap();
    assert!((two.position - point).norm() < 1e-9 && two.reprojection_px() < 1e-6);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_turn_and_shift_of_any_markers_is_found(
        places in prop::collection::vec(vector3(0.3), 3..12),
        turn in vector3(3.0),
        shift in vector3(5.0),
        flat in any::<bool>(),
    ) {
        let places: Vec<_> = places
            .iter()
            .map(|place| if flat { Vector3::new(place.x, place.y, 0.02) } else { *place })
            .collect();
        let attitude = Attitude::from_rotation_vector(turn);
        let pairs = places.iter().map(|place| (*place, attitude.to_world(place) + shift));
        if let Some(body) = fit(pairs) {
            prop_assert!(body.residual_m < 1e-7, "{}", body.residual_m);
            // Markers near a line determine the rotation about it only weakly.
            prop_assert!(body.attitude.rotation_to(&attitude).norm() < 1e-3);
        }
    }

    #[test]
    fn any_frame_ends_in_a_pose_or_none(
        position in vector3(1e3),
        attitude in prop::array::uniform4(-2.0..2.0_f64),
        velocity in vector3(1e3),
    ) {
        let truth = TruthV1 {
            position: position.into(), velocity: velocity.into(), attitude, ..truth(5)
        };
        if let Some(fit) = MarkerCameras::new(&mocap(&[]), 1).observe(&truth).body {
            prop_assert!(fit.attitude.is_finite() && fit.position.iter().all(|x| x.is_finite()));
        }
    }
}
