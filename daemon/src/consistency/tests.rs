use oqtal_control::euler::EulerAngles;
use oqtal_control::quaternion::Attitude;

use super::*;
use crate::command_model::{CommandModel, motion_tracker};

/// Greatest evidence of the response in eight seconds in which the vehicle turns into a tilt and back each second, at poses of
/// 60 Hz and reports of the gyroscope of 10 Hz, one of them at `phase_s` \[s\], and the first one before.
fn evidence(phase_s: f64) -> f64 {
    let config = Config::default();
    let mut tracker = motion_tracker(&config, CommandModel::new(&config).unwrap().model);
    let pose = |pitch| {
        let angles = EulerAngles { roll: 0.0, pitch, yaw: 0.0 };
        let attitude = Attitude::from_xyzw(angles.xyzw()).unwrap();
        MeasuredPose { position: Vector3::z(), attitude }
    };
    tracker.begin(0.0, &pose(0.0), 0.0);
    // 15 deg within 0.13 s, as at a corner of the square, and slight rotations in between.
    let rate = |t_s: f64| match t_s.fract() {
        t_s if t_s < 0.13 => 2.0,
        t_s if (0.33..0.46).contains(&t_s) => -2.0,
        t_s => 0.2 * (40.0 * t_s).sin(),
    };
    let noise = PoseDeviations { position_m: 0.5e-3, attitude_rad: 3.5e-3 };
    let mut tests = PoseConsistency::new(&config);
    let (mut pitch, mut greatest) = (0.0, 0.0_f64);
    tests.receive_rate(phase_s - 0.1, Vector3::zeros());
    for ms in 0..8000 {
        let t_s = 1e-3 * f64::from(ms);
        pitch += 1e-3 * rate(t_s);
        if (t_s - phase_s).rem_euclid(0.1) < 0.5e-3 {
            tests.receive_rate(t_s, Vector3::y() * rate(t_s));
        }
        if ms % 17 == 0 {
            let expected = Expectation { obeys: true, is_away: true, turns: false };
            tests.take(&tracker, (t_s, &pose(pitch)), &noise, &expected);
            greatest = greatest.max(tests.evidence().response);
        }
    }
    greatest
}

#[test]
fn a_turn_between_two_reports_of_the_gyroscope_raises_little_evidence() {
    for phase in 0..20 {
        let phase_s = 5e-3 * f64::from(phase);
        let evidence = evidence(phase_s);
        assert!(evidence < 0.7, "{evidence}, reports from {phase_s} s on");
    }
}
