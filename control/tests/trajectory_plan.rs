//! Whole flights: phases, landing, what is scored.

use nalgebra::Vector3;
use oqtal_control::quaternion::Attitude;
use oqtal_control::trajectory::{FlightPlan, Phase, StartPoint, TrajectoryKind, TrajectoryOptions};
use proptest::prelude::*;

const KINDS: [TrajectoryKind; 9] = [
    TrajectoryKind::Hover,
    TrajectoryKind::Step,
    TrajectoryKind::Square,
    TrajectoryKind::Circle,
    TrajectoryKind::Lemniscate,
    TrajectoryKind::AttitudeChirp,
    TrajectoryKind::AttitudeDoublet,
    TrajectoryKind::Excitation,
    TrajectoryKind::BriefExcitation,
];

const START: StartPoint = StartPoint { position: Vector3::new(2.0, -1.0, 0.2), yaw_rad: 0.3 };

fn options(kind: TrajectoryKind) -> TrajectoryOptions {
    TrajectoryOptions { kind, ..TrajectoryOptions::default() }
}

fn plan(options: &TrajectoryOptions) -> FlightPlan {
    FlightPlan::new(options, options.trajectory(None).unwrap(), START)
}

#[test]
fn phases_follow_each_other_at_their_times() {
    // Take-off 2.5 s, settling 4 s, square 22 s.
    let plan = plan(&options(TrajectoryKind::Square));
    let phases = [
        (0.0, Phase::TakeOff),
        (2.49, Phase::TakeOff),
        (2.5, Phase::Settle),
        (6.49, Phase::Settle),
        (6.5, Phase::Trajectory),
        (28.5, Phase::Trajectory),
        (28.51, Phase::Landing),
        (99.0, Phase::Landing),
    ];
    for (t_s, phase) in phases {
        assert_eq!(plan.sample(t_s).phase, phase, "at {t_s} s");
    }
}

#[test]
fn phase_numbers_and_names_are_stable() {
    let known = [
        (1, Phase::TakeOff, "take-off"),
        (2, Phase::Settle, "settle"),
        (3, Phase::Trajectory, "trajectory"),
        (4, Phase::Landing, "landing"),
    ];
    for (number, phase, name) in known {
        assert_eq!(phase as u8, number);
        assert_eq!(Phase::from_number(number), Some(phase));
        assert_eq!(phase.to_string(), name);
    }
    assert_eq!(Phase::from_number(0), None);
    assert_eq!(Phase::from_number(5), None);
}

#[test]
fn flight_is_relative_to_where_the_vehicle_stands() {
    let plan = plan(&options(TrajectoryKind::Square));
    assert_eq!(plan.sample(0.0).position, START.position);
    assert_eq!(plan.sample(4.0).position, START.position + Vector3::z());
    let corner = START.position + Vector3::new(1.3, 0.0, 1.0);
    assert!((plan.sample(7.0).position - corner).norm() < 1e-12);
    assert_eq!(plan.sample(7.0).yaw_rad, START.yaw_rad);
}

#[test]
fn attitude_step_is_about_the_heading_at_the_start() {
    let attitude = plan(&options(TrajectoryKind::Step)).sample(6.5).attitude.unwrap().attitude;
    let expected = Attitude::from_rotation_vector(Vector3::z() * START.yaw_rad)
        .turned_by(Vector3::x() * 10.0_f64.to_radians());
    assert!(attitude.angle_to(&expected) < 1e-9);
}

#[test]
fn duration_replaces_that_of_the_trajectory() {
    let short =
        plan(&TrajectoryOptions { duration_s: Some(3.0), ..options(TrajectoryKind::Square) });
    assert_eq!(short.sample(9.5).phase, Phase::Trajectory);
    assert_eq!(short.sample(9.51).phase, Phase::Landing);
    let long =
        plan(&TrajectoryOptions { duration_s: Some(60.0), ..options(TrajectoryKind::Circle) });
    let held = long.sample(6.5 + 50.0);
    assert_eq!(held.phase, Phase::Trajectory);
    assert!((held.position - START.position - Vector3::z()).norm() < 1e-9);
    assert!(held.velocity.norm() < 1e-9);
}

#[test]
fn square_is_scored_for_22_s_from_the_first_corner() {
    let plan =
        plan(&TrajectoryOptions { duration_s: Some(40.0), ..options(TrajectoryKind::Square) });
    let scored = [(6.49, false), (6.5, true), (28.5, true), (28.51, false)];
    for (t_s, expected) in scored {
        assert_eq!(plan.scored(t_s), expected, "at {t_s} s");
    }
}

#[test]
fn hover_is_scored_from_10_s_after_its_height_is_reached_until_its_end() {
    let plan =
        plan(&TrajectoryOptions { duration_s: Some(60.0), ..options(TrajectoryKind::Hover) });
    let scored = [(6.5, false), (12.49, false), (12.5, true), (66.5, true), (66.51, false)];
    for (t_s, expected) in scored {
        assert_eq!(plan.scored(t_s), expected, "at {t_s} s");
    }
}

#[test]
fn nothing_is_scored_after_an_early_landing() {
    let mut plan = plan(&options(TrajectoryKind::Square));
    plan.land_from(8.0, plan.sample(8.0).into());
    assert!(plan.scored(7.9));
    assert!(!plan.scored(8.1));
}

#[test]
fn a_landing_is_not_begun_again() {
    let mut plan = plan(&options(TrajectoryKind::Square));
    plan.land_from(8.0, plan.sample(8.0).into());
    let before = plan.clone();
    plan.land_from(9.0, START);
    assert_eq!(plan, before);
}

#[test]
fn landing_from_below_its_end_stays_there() {
    let mut plan = plan(&options(TrajectoryKind::Hover));
    let low = StartPoint { position: START.position - Vector3::z(), yaw_rad: 1.0 };
    plan.land_from(1.0, low);
    assert_eq!(StartPoint::from(plan.sample(1.5)), low);
    assert_eq!(plan.sample(1.5).velocity, Vector3::zeros());
}

proptest! {
    #[test]
    fn take_off_and_landing_are_smooth_and_slow_and_end_just_below_the_floor(
        kind in prop::sample::select(&KINDS), early in prop::option::of(0.0..40.0),
    ) {
        let mut plan = plan(&options(kind));
        if let Some(t_s) = early {
            let from = StartPoint::from(plan.sample(t_s));
            plan.land_from(t_s, from);
            prop_assert!((plan.sample(t_s + 1e-6).position - from.position).norm() < 1e-6);
        }
        let h = 1e-3;
        for k in 0..(plan.end_s() / h) as u32 {
            let (now, next) = (plan.sample(f64::from(k) * h), plan.sample(f64::from(k + 1) * h));
            if now.phase == next.phase && matches!(now.phase, Phase::TakeOff | Phase::Landing) {
                let step = next.position - now.position;
                prop_assert!((step - 0.5 * (now.velocity + next.velocity) * h).norm() < 1e-6);
            }
            if now.phase == Phase::Landing {
                prop_assert!(now.velocity.norm() <= 0.4 + 1e-9);
                prop_assert_eq!(now.attitude, None);
            }
        }
        let end = plan.sample(plan.end_s() + 1e-6);
        prop_assert!((end.position.z - (START.position.z - 0.1)).abs() < 1e-12);
        prop_assert_eq!(end.velocity.norm(), 0.0);
        prop_assert_eq!(plan.sample(plan.end_s() + 100.0), end);
    }
}
