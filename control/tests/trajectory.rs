//! Trajectories and flight plans as functions of time.

use nalgebra::Vector3;
use oqtal_control::quaternion::Attitude;
use oqtal_control::trajectory::shape::{Circle, Hover, Step, StepAxis};
use oqtal_control::trajectory::{Phase, Reference, Trajectory, TrajectoryKind, TrajectoryOptions};
use proptest::prelude::*;

const HOVER_POINT: Vector3<f64> = Vector3::new(0.0, 0.0, 1.0);

fn options(kind: TrajectoryKind) -> TrajectoryOptions {
    TrajectoryOptions { kind, ..TrajectoryOptions::default() }
}

fn trajectory(kind: TrajectoryKind) -> Trajectory {
    options(kind).trajectory(None).unwrap()
}

/// Every stated derivative is that of the one before it, and position, velocity and acceleration have no jumps.
fn assert_smooth(sample: impl Fn(f64) -> Reference, duration_s: f64) {
    let h = 1e-4;
    for k in 1..(duration_s / 0.01) as u32 {
        let t_s = f64::from(k) * 0.01;
        let [before, now, after] = [-h, 0.0, h].map(|off_s| sample(t_s + off_s));
        let courses = [before, after].map(|it| [it.position, it.velocity, it.acceleration]);
        for (order, derivative) in [now.velocity, now.acceleration].iter().enumerate() {
            let slope = (courses[1][order] - courses[0][order]) / (2.0 * h);
            assert!((slope - derivative).norm() < 2e-3, "derivative {order} at {t_s} s");
        }
        assert!((courses[1][2] - courses[0][2]).norm() < 2e-2, "acceleration at {t_s} s");
        // Jerk and snap jump where a ramp begins or ends.
        let slope = (courses[1][2] - courses[0][2]) / (2.0 * h);
        let jumps = (after.jerk - before.jerk).norm() > 2e-3 + 4.0 * h * now.snap.norm();
        assert!(jumps || (slope - now.jerk).norm() < 2e-3, "jerk at {t_s} s");
        let slope = (after.jerk - before.jerk) / (2.0 * h);
        assert!(jumps || (slope - now.snap).norm() < 1e-2, "snap at {t_s} s");
    }
}

#[test]
fn defaults_pass_the_check_and_bad_options_name_their_key() {
    assert_eq!(TrajectoryOptions::default().check(), Ok(()));
    let mut options = TrajectoryOptions::default();
    options.circle.ramp_s = options.circle.period_s + 1.0;
    assert_eq!(options.check().unwrap_err().key, "circle.ramp-s");
    let mut options = TrajectoryOptions::default();
    options.step.angle_deg = 45.0;
    assert_eq!(options.check().unwrap_err().key, "step.angle-deg");
    options.step.axis = StepAxis::Yaw;
    assert_eq!(options.check(), Ok(()));
}

#[test]
fn keys_are_kebab_case_and_unknown_ones_are_errors() {
    let text = r#"{"kind": "circle", "height-m": 1.5, "circle": {"radius-m": 0.4}}"#;
    let options: TrajectoryOptions = serde_json::from_str(text).unwrap();
    assert_eq!(options.circle, Circle { radius_m: 0.4, ..Circle::default() });
    assert_eq!(options.trajectory(None).unwrap().sample(0.0).position.z, 1.5);
    assert!(serde_json::from_str::<TrajectoryOptions>(r#"{"circle": {"radius": 0.4}}"#).is_err());
}

#[test]
fn waypoints_are_needed_by_their_kind_alone() {
    assert!(options(TrajectoryKind::Waypoints).trajectory(None).is_none());
    assert!(options(TrajectoryKind::Hover).trajectory(None).is_some());
}

#[test]
fn hover_rests_at_the_hover_point() {
    let hover = trajectory(TrajectoryKind::Hover);
    assert_eq!(hover.sample(17.0), Reference::rest(HOVER_POINT, Phase::Trajectory));
    assert_eq!(hover.duration_s(), Hover::default().duration_s);
}

#[test]
fn step_prescribes_the_attitude_while_it_holds() {
    for (axis, direction) in [(StepAxis::Roll, Vector3::x()), (StepAxis::Pitch, Vector3::y())] {
        let mut options = options(TrajectoryKind::Step);
        options.step.axis = axis;
        let step = options.trajectory(None).unwrap();
        let expected = Attitude::from_rotation_vector(direction * 10.0_f64.to_radians());
        assert!(step.sample(0.0).attitude.unwrap().attitude.angle_to(&expected) < 1e-9);
        assert!(step.sample(0.99).attitude.is_some());
        assert_eq!(step.sample(1.0), Reference::rest(HOVER_POINT, Phase::Trajectory));
    }
}

#[test]
fn yaw_step_leaves_the_position_loops_closed() {
    let mut options = options(TrajectoryKind::Step);
    options.step = Step { axis: StepAxis::Yaw, angle_deg: -90.0, ..Step::default() };
    let reference = options.trajectory(None).unwrap().sample(0.5);
    assert_eq!(reference.attitude, None);
    assert!((reference.yaw_rad + std::f64::consts::FRAC_PI_2).abs() < 1e-12);
}

#[test]
fn square_jumps_to_the_next_corner_every_five_seconds() {
    let square = trajectory(TrajectoryKind::Square);
    let corners = [(0.0, 1.3, 0.0), (5.0, 1.3, 1.3), (10.0, 0.0, 1.3), (15.0, 0.0, 0.0)];
    for (t_s, x, y) in corners {
        let at_corner = Reference::rest(Vector3::new(x, y, 1.0), Phase::Trajectory);
        assert_eq!(square.sample(t_s), at_corner);
        assert_eq!(square.sample(t_s + 4.99), at_corner);
    }
    assert_eq!(square.duration_s(), 22.0);
    assert_eq!(square.sample(22.0), square.sample(15.0));
}

#[test]
fn circle_keeps_its_radius_and_returns() {
    let circle = trajectory(TrajectoryKind::Circle);
    let centre = Vector3::new(-0.65, 0.0, 1.0);
    for k in 0..=260 {
        let position = circle.sample(f64::from(k) * 0.1).position;
        assert!(((position - centre).norm() - 0.65).abs() < 1e-9);
    }
    assert_eq!(circle.duration_s(), 26.0);
    let cruise = circle.sample(13.0).velocity.norm();
    assert!((cruise - std::f64::consts::TAU * 0.65 / 8.0).abs() < 1e-9);
}

#[test]
fn lemniscate_satisfies_its_equation() {
    let lemniscate = trajectory(TrajectoryKind::Lemniscate);
    let a: f64 = 0.65;
    for k in 0..=260 {
        let p = lemniscate.sample(f64::from(k) * 0.1).position;
        // Gerono: x^4 = a^2 (x^2 - y^2).
        assert!((p.x.powi(4) - a * a * (p.x * p.x - p.y * p.y)).abs() < 1e-9);
    }
}

#[test]
fn closed_curves_are_smooth_and_start_and_end_at_rest_at_the_hover_point() {
    for kind in [TrajectoryKind::Circle, TrajectoryKind::Lemniscate] {
        let curve = trajectory(kind);
        assert_smooth(|t_s| curve.sample(t_s), curve.duration_s());
        for t_s in [-1.0, 0.0, curve.duration_s(), curve.duration_s() + 1.0] {
            let reference = curve.sample(t_s);
            assert!((reference.position - HOVER_POINT).norm() < 1e-9);
            assert!(reference.velocity.norm() < 1e-9);
        }
    }
}

proptest! {
    #[test]
    fn curves_are_smooth_for_any_speed_and_ramp(
        period_s in 4.0..20.0_f64, laps in 1..4_u32, ramp_share in 0.2..1.0_f64,
    ) {
        let mut options = options(TrajectoryKind::Circle);
        options.circle = Circle { radius_m: 0.5, period_s, laps, ramp_s: period_s * ramp_share };
        prop_assert_eq!(options.check(), Ok(()));
        let circle = options.trajectory(None).unwrap();
        assert_smooth(|t_s| circle.sample(t_s), circle.duration_s());
    }
}
