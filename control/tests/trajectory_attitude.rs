//! Prescribed attitudes.

use nalgebra::Vector3;
use oqtal_control::quaternion::Attitude;
use oqtal_control::tracking_error::AttitudeReference;
use oqtal_control::trajectory::{
    AttitudeChirp, AttitudeDoublet, FlightPlan, Phase, Trajectory, TrajectoryKind,
    TrajectoryOptions,
};

/// About which half of the trajectory turns, by the time at which it starts \[s\].
const CHIRP_AXES: [(f64, Vector3<f64>); 2] =
    [(0.0, Vector3::new(1.0, 0.0, 0.0)), (14.0, Vector3::new(0.0, 1.0, 0.0))];

fn options(kind: TrajectoryKind) -> TrajectoryOptions {
    TrajectoryOptions { kind, ..TrajectoryOptions::default() }
}

fn trajectory(kind: TrajectoryKind) -> Trajectory {
    options(kind).trajectory(None).unwrap()
}

fn prescribed(trajectory: &Trajectory, t_s: f64) -> AttitudeReference {
    trajectory.sample(t_s).attitude.unwrap()
}

#[test]
fn a_chirp_sweeps_about_roll_and_then_about_pitch() {
    let chirp = trajectory(TrajectoryKind::AttitudeChirp);
    for (start_s, axis) in CHIRP_AXES {
        let angle = |t_s: f64| {
            let turn = Attitude::LEVEL.rotation_to(&prescribed(&chirp, start_s + t_s).attitude);
            assert!((turn - axis * turn.dot(&axis)).norm() < 1e-12, "turns about {turn}");
            turn.dot(&axis)
        };
        let samples: Vec<f64> = (0..8000).map(|ms| angle((f64::from(ms) + 0.5) * 1e-3)).collect();
        let greatest = samples.iter().fold(0.0_f64, |greatest, angle| greatest.max(angle.abs()));
        assert!((greatest.to_degrees() - 4.0).abs() < 1e-3);
        // 0.5 Hz at the start, 3 Hz at the end: a sign is kept for less than a second, then a sixth.
        let crossings: Vec<usize> =
            (1..samples.len()).filter(|k| samples[k - 1] * samples[*k] < 0.0).collect();
        assert!((700..1000).contains(&crossings[0]), "first at {} ms", crossings[0]);
        let last = crossings.len() - 1;
        assert!((160..185).contains(&(crossings[last] - crossings[last - 1])));
    }
}

#[test]
fn the_rates_of_a_chirp_are_the_derivatives_of_its_attitude() {
    let chirp = trajectory(TrajectoryKind::AttitudeChirp);
    let h = 1e-4;
    for (start_s, _) in CHIRP_AXES {
        for k in 1..799 {
            let t_s = start_s + f64::from(k) * 0.01;
            let (before, now, after) =
                (prescribed(&chirp, t_s - h), prescribed(&chirp, t_s), prescribed(&chirp, t_s + h));
            let rate = before.attitude.rotation_to(&after.attitude) / (2.0 * h);
            assert!((rate - now.rate.0).norm() < 1e-4, "at {t_s} s");
            let acceleration = (after.rate.0 - before.rate.0) / (2.0 * h);
            assert!((acceleration - now.acceleration.0).norm() < 1e-3, "at {t_s} s");
        }
    }
}

#[test]
fn a_doublet_steps_to_either_side_and_back_and_rests() {
    let doublet = trajectory(TrajectoryKind::AttitudeDoublet);
    for (start_s, axis) in [(0.0, Vector3::x()), (9.0, Vector3::y())] {
        for (t_s, degrees) in [(0.0, 10.0), (0.99, 10.0), (1.01, -10.0), (2.01, 0.0), (2.99, 0.0)] {
            let expected = Attitude::from_rotation_vector(axis * f64::to_radians(degrees));
            let reference = prescribed(&doublet, start_s + t_s);
            assert!(reference.attitude.angle_to(&expected) < 1e-9, "at {t_s} s");
            assert_eq!(reference, AttitudeReference::at_rest(reference.attitude));
        }
        assert_eq!(doublet.sample(start_s + 3.01).attitude, None);
    }
    assert_eq!(doublet.duration_s(), 18.0);
}

#[test]
fn only_what_is_prescribed_is_scored() {
    for (kind, turning_s) in
        [(TrajectoryKind::AttitudeChirp, 8.0), (TrajectoryKind::AttitudeDoublet, 3.0)]
    {
        let options = options(kind);
        let trajectory = trajectory(kind);
        let start_s = options.take_off_s + options.settle_s;
        let duration_s = trajectory.duration_s();
        let plan = FlightPlan::from_origin(&options, &trajectory);
        let scored = (0..(duration_s * 100.0) as u32)
            .map(|k| start_s + (f64::from(k) + 0.5) * 0.01)
            .filter(|t_s| plan.scored(*t_s))
            .inspect(|t_s| assert_eq!(plan.sample(*t_s).phase, Phase::Trajectory))
            .count();
        assert_eq!(scored as f64 * 0.01, 2.0 * turning_s);
    }
}

#[test]
fn options_out_of_range_name_their_key() {
    let with = |chirp, doublet| TrajectoryOptions {
        attitude_chirp: chirp,
        attitude_doublet: doublet,
        ..TrajectoryOptions::default()
    };
    let (chirp, doublet) = (AttitudeChirp::default(), AttitudeDoublet::default());
    assert_eq!(with(chirp, doublet).check(), Ok(()));
    let key = |options: TrajectoryOptions| options.check().unwrap_err().key;
    let steep = AttitudeChirp { amplitude_deg: 60.0, ..chirp };
    assert_eq!(key(with(steep, doublet)), "attitude-chirp.amplitude-deg");
    let brief = AttitudeDoublet { hold_s: 0.0, ..doublet };
    assert_eq!(key(with(chirp, brief)), "attitude-doublet.hold-s");
}
