//! Tests of the gate, with a hovering vehicle that moves only along x.

use nalgebra::Vector3;
use oqtal_control::predictive::{ModelInput, Rotation, Track};
use oqtal_control::quaternion::Attitude;

use super::*;
use crate::command_model::{CommandModel, motion_tracker};

/// Time between two poses \[s\].
const FRAME_S: f64 = 1.0 / 60.0;
/// Offset of a body that is not the vehicle \[m\].
const ELSEWHERE_M: f64 = 0.5;
/// Gap after which poses off by [`OFF_M`] are admitted \[s\].
const GAP_S: f64 = 0.12;
/// Offset that a gap admits, and that is compared with later ones \[m\].
const OFF_M: f64 = 0.04;

struct Hover {
    gate: MotionGate,
    tracker: MotionTracker,
    t_s: f64,
    poses: u32,
}

impl Hover {
    /// A vehicle at rest 1 m above the floor.
    fn begun() -> Self {
        let config = Config::default();
        let model = CommandModel::new(&config).unwrap().model;
        let mut tracker = motion_tracker(&config, model);
        let thrust_n = model.mass_kg * model.gravity_m_s2;
        tracker.sent(1, 0.0, ModelInput { thrust_n, ..ModelInput::default() });
        tracker.begin(0.0, &pose_at(0.0), 0.0);
        let mut gate = MotionGate::new(&config);
        gate.restart(&tracker);
        Self { gate, tracker, t_s: 0.0, poses: 0 }
    }

    /// A vehicle that has flown on ten poses at x = 0.
    fn settled() -> Self {
        let mut hover = Self::begun();
        (0..10).for_each(|_| assert_eq!(hover.show(FRAME_S, 0.0), Ok(())));
        hover
    }

    /// Shows a pose at `x` \[m\], `after_s` \[s\] after the last one, with noise of some micrometres, so that it does not count as frozen.
    fn show(&mut self, after_s: f64, x: f64) -> Result<(), Cause> {
        self.poses += 1;
        self.show_still(after_s, x + 1e-6 * f64::from(self.poses % 7))
    }

    /// Shows a pose at exactly `x` \[m\].
    fn show_still(&mut self, after_s: f64, x: f64) -> Result<(), Cause> {
        self.t_s += after_s;
        self.gate.check(&mut self.tracker, self.t_s, &pose_at(x))
    }

    fn track(&self) -> &Track {
        self.tracker.track().unwrap()
    }

    /// Shows poses of another body until they are recognized as such.
    fn see_another_body(&mut self) {
        let mut causes = (0..RELABEL_POSES).map(|_| self.show(FRAME_S, ELSEWHERE_M).unwrap_err());
        assert_eq!(causes.next(), Some(Cause::Jump));
        assert_eq!(causes.last(), Some(Cause::Relabel));
    }

    /// Shows poses for 0.15 s at `x` \[m\] of the time since now \[s\]; returns why the first one is refused that is, if one is.
    fn refusal_at(&mut self, x: impl Fn(f64) -> f64) -> Option<Cause> {
        (1..10).find_map(|k: u32| self.show(FRAME_S, x(f64::from(k) * FRAME_S)).err())
    }
}

fn pose_at(x: f64) -> MeasuredPose {
    MeasuredPose { position: Vector3::new(x, 0.0, 1.0), attitude: Attitude::default() }
}

#[test]
fn after_another_body_only_the_predicted_position_is_admitted_within_the_measured_noise() {
    let mut hover = Hover::settled();
    hover.see_another_body();
    assert_eq!(hover.show(FRAME_S, 0.02), Err(Cause::Relabel));
    hover.gate.set_noise(&PoseDeviations { position_m: 0.01, attitude_rad: 0.0 });
    assert_eq!(hover.show(FRAME_S, 0.02), Ok(()));
}

#[test]
fn another_flight_begins_without_the_poses_of_another_body() {
    let mut hover = Hover::settled();
    hover.see_another_body();
    hover.gate.restart(&hover.tracker);
    assert_eq!(hover.show(FRAME_S, 0.02), Ok(()));
}

#[test]
fn a_body_that_stays_elsewhere_after_a_gap_is_another_one() {
    let mut hover = Hover::settled();
    assert_eq!(hover.show(GAP_S, OFF_M), Ok(()));
    assert_eq!(
        hover.refusal_at(|t_s| OFF_M + 0.003 * (60.0 * t_s).round().cos()),
        Some(Cause::Relabel)
    );
    // An offset by a force grows.
    let mut hover = Hover::settled();
    assert_eq!(hover.show(GAP_S, OFF_M), Ok(()));
    assert_eq!(hover.refusal_at(|t_s| OFF_M + 0.15 * t_s), None);
    // After a motion that nobody saw, its beginning is not known.
    let mut hover = Hover::settled();
    assert_eq!(hover.show(GAP_S, OFF_M), Ok(()));
    hover.gate.discard_hypothesis();
    assert_eq!(hover.refusal_at(|_| OFF_M), None);
    // Without a gap, an offset is that of the vehicle, however wide the gate is.
    let mut hover = Hover::settled();
    hover.gate.sigma = 1e3;
    assert_eq!(hover.show(FRAME_S, OFF_M), Ok(()));
    assert_eq!(hover.refusal_at(|_| OFF_M), None);
}

#[test]
fn poses_that_return_from_an_outlier_leave_nothing_of_it() {
    // The pose that returns from the smaller outlier lies on the motion with it, too.
    for outlier in [0.02, OFF_M] {
        let mut hover = Hover::settled();
        assert_eq!(hover.show(GAP_S, outlier), Ok(()));
        let speed = |hover: &Hover| hover.track().motion.velocity.x.abs();
        assert!(speed(&hover) > 0.05, "{:?}", hover.track().motion);
        assert_eq!(hover.show(FRAME_S, 0.0), Ok(()));
        assert!(speed(&hover) < 1e-3, "{outlier} m: {:?}", hover.track().motion);
    }
}

#[test]
fn poses_that_follow_the_motion_since_a_gap_do_not_return_from_an_outlier() {
    // The second pose is within the tolerance of the motion before the gap, but nearer to that since then.
    for (first, second) in [(0.02, 0.0145), (OFF_M, 0.048)] {
        let mut hover = Hover::settled();
        assert_eq!(hover.show(GAP_S, first), Ok(()));
        assert_eq!(hover.show(FRAME_S, second), Ok(()));
        assert!(hover.gate.hypothesis.is_some(), "{first} m, then {second} m");
    }
}

#[test]
fn a_pose_that_stays_the_same_is_compared_with_a_short_prediction() {
    let mut hover = Hover::begun();
    let mut x = 0.0;
    for _ in 0..60 {
        x += 0.1 * FRAME_S;
        assert_eq!(hover.show_still(FRAME_S, x), Ok(()));
    }
    // 0.1 m/s are 1.5 cm in the longest prediction, and 10 cm in a second.
    for k in 0..60 {
        assert_eq!(hover.show_still(FRAME_S, x), Ok(()), "{k}");
    }
}

#[test]
fn a_vehicle_at_the_floor_may_stand_under_a_thrust_that_need_not_lift_it() {
    let hover = Hover::begun();
    let mut track = *hover.track();
    let weight_n = hover.tracker.model().mass_kg * hover.tracker.model().gravity_m_s2;
    track.motion.position.z = 0.0;
    for (share, may) in [(0.0, true), (1.3, true), (1.4, false)] {
        track.motion.thrust_n = share * weight_n;
        assert_eq!(may_stand(&hover.tracker, &track), may, "{share}");
    }
}

/// A rate command of `demand` \[rad/s\] about x, which the vehicle follows `late_s` \[s\] later than predicted. From the fifth pose on
/// they are of a body turned by `other_rad` \[rad\]. Returns why a pose is refused.
fn refusal_of_a_turn(demand: f64, late_s: f64, other_rad: f64) -> Option<Cause> {
    let mut hover = Hover::settled();
    let (begin_s, model) = (hover.t_s, *hover.tracker.model());
    let thrust_n = model.mass_kg * model.gravity_m_s2;
    let input = ModelInput { demand: Vector3::x() * demand, thrust_n, ..ModelInput::default() };
    hover.tracker.sent(2, begin_s - hover.tracker.effect_delay_s(), input);
    let Rotation::RateLoop { lag_s } = model.rotation else { panic!("{:?}", model.rotation) };
    let angle = |t_s: f64| {
        let t_s = (t_s - late_s).max(0.0);
        demand * (t_s - lag_s * (1.0 - (-t_s / lag_s).exp()))
    };
    (1..=12).find_map(|k: u32| {
        let t_s = f64::from(k) * FRAME_S;
        hover.t_s = begin_s + t_s;
        let other = if k < 5 { 0.0 } else { other_rad };
        let turn = Vector3::new(angle(t_s) + other, 1e-5 * f64::from(k % 7), 0.0);
        let attitude = Attitude::from_rotation_vector(turn);
        let position = hover.tracker.predict(hover.t_s).unwrap().motion.position;
        hover.gate.check(&mut hover.tracker, hover.t_s, &MeasuredPose { position, attitude }).err()
    })
}

#[test]
fn f09_a_rate_that_changes_a_tenth_of_a_second_later_than_predicted_is_not_a_jump() {
    for demand in [0.0, 2.0, 4.0] {
        for late_s in [0.0, 0.05, 0.1] {
            assert_eq!(refusal_of_a_turn(demand, late_s, 0.0), None, "{demand} rad/s, {late_s} s");
        }
        assert_eq!(refusal_of_a_turn(demand, 0.0, 0.3), Some(Cause::Jump), "{demand} rad/s");
    }
}

#[test]
fn a_vehicle_that_the_floor_stops_is_admitted_and_another_body_beside_it_is_not() {
    let mut hover = Hover::begun();
    let sinks_m_s = 0.5;
    let pose = |t_s: f64, x: f64| {
        let z = (0.04 - sinks_m_s * t_s).max(0.0);
        let (position, attitude) =
            (Vector3::new(x, 1e-5 * (40.0 * t_s).sin(), z), Attitude::default());
        MeasuredPose { position, attitude }
    };
    hover.tracker.begin(0.0, &pose(0.0, 0.0), 0.0);
    hover.gate.restart(&hover.tracker);
    let mut track = hover.track().lifted();
    track.motion.velocity.z = -sinks_m_s;
    hover.tracker.restore(track);
    let mut check = |x: f64| {
        hover.t_s += FRAME_S;
        hover.gate.check(&mut hover.tracker, hover.t_s, &pose(hover.t_s, x))
    };
    for _ in 0..60 {
        assert_eq!(check(0.0), Ok(()));
    }
    let refusals = (0..RELABEL_POSES).map(|_| check(ELSEWHERE_M).unwrap_err());
    assert_eq!(refusals.last(), Some(Cause::Relabel));
}
