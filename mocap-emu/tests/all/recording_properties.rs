//! Properties of recordings: written poses are read back, and arbitrary bytes give poses or an error.

use std::path::Path;

use oqtal_control::quaternion::Attitude;
use oqtal_mocap_emu::recording::{RecordedPose, Recording, RecordingError};
use proptest::prelude::*;
use proptest::sample::Index;

const EUROC_HEADER: &str = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], \
    q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1]";

fn parse(text: &str) -> Result<Recording, RecordingError> {
    Recording::parse(Path::new("a.csv"), text.as_bytes())
}

/// Poses from time zero on, some of them at equal times.
fn flights() -> impl Strategy<Value = Vec<RecordedPose>> {
    let step = prop_oneof![Just(0), 1..1000u64, 1..500_000_000u64];
    let pose = (step, prop::array::uniform3(-1e3..1e3), prop::array::uniform3(-3.0..3.0));
    prop::collection::vec(pose, 1..40).prop_map(|poses| {
        let mut time_ns = 0;
        let later = poses.into_iter().map(|(step, position, rotation)| {
            time_ns += step;
            let attitude = Attitude::from_rotation_vector(rotation.into());
            RecordedPose { time_ns, position: position.into(), attitude }
        });
        let first =
            RecordedPose { time_ns: 0, position: [0.0; 3].into(), attitude: Attitude::LEVEL };
        let mut flight: Vec<_> = std::iter::once(first).chain(later).collect();
        flight.push(RecordedPose { time_ns: time_ns + 1, ..first });
        flight
    })
}

/// The flight as a file in each format, starting at `start` \[ns\].
fn written(flight: &[RecordedPose], start: u64) -> [String; 3] {
    let mut named = String::from("qz,qw,qx,qy,z,y,x,t\n");
    let mut tum = String::new();
    let mut euroc = format!("{EUROC_HEADER}\n");
    for pose in flight {
        let ns = start + pose.time_ns;
        let t = format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000);
        let [x, y, z] = pose.position.into();
        let [q1, q2, q3, eta] = pose.attitude.xyzw();
        named += &format!("{q3:e},{eta},{q1},{q2},{z},{y},{x},{t}\n");
        tum += &format!("{t} {x} {y} {z} {q1} {q2} {q3} {eta}\n");
        euroc += &format!("{ns},{x},{y},{z},{eta},{q1},{q2},{q3},0.5\n");
    }
    [named, tum, euroc]
}

/// Asserts that arbitrary bytes give poses in order of time, or an error on a line of the file.
fn check_total(bytes: &[u8]) {
    let lines = bytes.iter().filter(|&&byte| byte == b'\n').count() + 1;
    match Recording::parse(Path::new("a.csv"), bytes) {
        Ok(recording) => {
            assert!(recording.poses().is_sorted_by_key(|pose| pose.time_ns));
            assert!(recording.timing().mean_rate_hz.is_finite());
        }
        Err(error) => assert!((1..=lines).contains(&error.line.unwrap()), "{error}"),
    }
}

proptest! {
    #[test]
    fn written_poses_are_read_back(flight in flights(), start in 0..2_000_000_000_000_000_000u64) {
        for text in written(&flight, start) {
            let recording = parse(&text).unwrap();
            prop_assert_eq!(recording.poses().len(), flight.len());
            for (read, written) in recording.poses().iter().zip(&flight) {
                prop_assert_eq!(read.time_ns, written.time_ns);
                prop_assert_eq!(read.position, written.position);
                for (read, written) in read.attitude.xyzw().iter().zip(written.attitude.xyzw()) {
                    prop_assert!((read - written).abs() < 1e-15);
                }
            }
        }
    }

    #[test]
    fn any_decimal_time_is_read_to_the_nanosecond_or_refused(
        time in "[0-9]{0,12}\\.?[0-9]{1,12}([eE][-+]?[0-9]{1,3})?",
    ) {
        let seconds: f64 = time.parse().unwrap();
        match parse(&format!("-1 0 0 0 0 0 0 1\n{time} 0 0 0 0 0 0 1\n")) {
            Ok(recording) => {
                let after_first = seconds * 1e9 + 1e9;
                let error = (recording.poses()[1].time_ns as f64 - after_first).abs();
                prop_assert!(error <= 0.5 + 1e-15 * after_first, "{} ns", error);
            }
            Err(error) => prop_assert!(seconds * 1e9 > 9.2e18, "{}", error),
        }
    }

    #[test]
    fn any_bytes_end_in_poses_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        check_total(&bytes);
    }

    #[test]
    fn any_damage_ends_in_poses_or_an_error(
        flight in flights(),
        format in 0..3usize,
        damage in prop::collection::vec((any::<Index>(), any::<Index>(), "[-+.,eE0-9#\" \n\ra-z\u{e9}]{0,2}"), 1..4),
    ) {
        let mut bytes = written(&flight, 0)[format].clone().into_bytes();
        for (at, end, by) in damage {
            let at = at.index(bytes.len() + 1);
            // Replaces a few bytes; sometimes cuts off the rest.
            let end = if end.index(4) == 0 { bytes.len() } else { bytes.len().min(at + end.index(4)) };
            bytes.splice(at..end, by.bytes());
        }
        check_total(&bytes);
    }
}
