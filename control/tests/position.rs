//! The outer loops alone, and around a point mass whose acceleration lags behind its command.

use std::collections::VecDeque;

use nalgebra::Vector3;
use oqtal_control::estimator::{Estimate, Estimator, EstimatorOptions};
use oqtal_control::metrics::Statistics;
use oqtal_control::position::{PositionCommand, PositionLoops, PositionOptions, attitude_along};
use oqtal_control::quaternion::Attitude;
use oqtal_control::tracking_error::AttitudeReference;
use oqtal_control::trajectory::{FlightPlan, Phase, Reference, StartPoint, TrajectoryOptions};
use proptest::prelude::*;

const MASS_KG: f64 = 0.5;
const GRAVITY_M_S2: f64 = 9.81;
const DT_S: f64 = 1.0 / 60.0;

fn loops() -> PositionLoops {
    PositionLoops::new(&PositionOptions::default(), MASS_KG, GRAVITY_M_S2)
}

fn rest_at(position: Vector3<f64>) -> Reference {
    Reference::rest(position, Phase::Trajectory)
}

/// 3-2-1 yaw, from the direction of body x.
fn yaw_of(attitude: &Attitude) -> f64 {
    let forward = attitude.to_world(&Vector3::x());
    forward.y.atan2(forward.x)
}

fn tilt_of(attitude: &Attitude) -> f64 {
    attitude.to_world(&Vector3::z()).angle(&Vector3::z())
}

/// The acceleration that the command gives a vehicle which follows it at once.
fn acceleration_of(command: &PositionCommand) -> Vector3<f64> {
    command.attitude.attitude.to_world(&Vector3::z()) * (command.thrust_n / MASS_KG)
        - Vector3::z() * GRAVITY_M_S2
}

fn vector3(bound: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-bound..bound).prop_map(Vector3::from)
}

#[test]
fn at_rest_on_the_reference_the_command_is_level_with_the_weight_as_thrust() {
    let command = loops().update(&Estimate::default(), &rest_at(Vector3::zeros()), DT_S);
    assert_eq!(command.attitude.attitude, Attitude::LEVEL);
    assert_eq!(command.velocity, Vector3::zeros());
    assert!((command.thrust_n - MASS_KG * GRAVITY_M_S2).abs() < 1e-12);
}

#[test]
fn default_options_pass_and_bad_ones_name_their_key() {
    assert_eq!(PositionOptions::default().check(), Ok(()));
    let steep = PositionOptions { tilt_limit_deg: 61.0, ..PositionOptions::default() };
    assert_eq!(steep.check().unwrap_err().key, "tilt-limit-deg");
    let falling =
        PositionOptions { vertical_acceleration_limit_m_s2: 9.81, ..PositionOptions::default() };
    assert_eq!(falling.check().unwrap_err().key, "vertical-acceleration-limit-m-s2");
}

#[test]
fn integrals_remove_a_constant_push() {
    let push = Vector3::new(0.3, -0.2, -0.4);
    let mut loops = loops();
    let mut estimate = Estimate::default();
    for _ in 0..180 * 60 {
        let acceleration =
            acceleration_of(&loops.update(&estimate, &rest_at(Vector3::zeros()), DT_S)) + push;
        estimate.velocity += acceleration * DT_S;
        estimate.position += estimate.velocity * DT_S;
    }
    assert!(estimate.position.norm() < 1e-3, "{}", estimate.position);
}

#[test]
fn velocity_of_the_reference_is_fed_forward() {
    let velocity = Vector3::new(0.3, -0.2, 0.1);
    let reference = Reference { velocity, ..rest_at(Vector3::zeros()) };
    let command = loops().update(&Estimate::default(), &reference, DT_S);
    assert_eq!(command.velocity, velocity);
}

#[test]
fn integral_stands_still_while_the_velocity_is_capped() {
    let far = rest_at(Vector3::x() * 10.0);
    let mut loops = loops();
    let mut estimate = Estimate::default();
    for _ in 0..600 {
        estimate.velocity = loops.update(&estimate, &far, DT_S).velocity;
    }
    let arrived = loops.update(&estimate, &rest_at(Vector3::zeros()), DT_S);
    // Remainder of the one sample before the cap was known, of a limit of 0.05 m/s.
    assert!(arrived.velocity.x < 0.005, "{}", arrived.velocity.x);
}

#[test]
fn reset_loops_are_as_new() {
    let mut used = loops();
    let estimate = Estimate { position: Vector3::new(3.0, -0.2, 0.05), ..Estimate::default() };
    for _ in 0..100 {
        used.update(&estimate, &rest_at(Vector3::zeros()), DT_S);
    }
    used.reset();
    let near = rest_at(Vector3::new(3.0, 0.0, 0.0));
    assert_eq!(used.update(&estimate, &near, DT_S), loops().update(&estimate, &near, DT_S));
}

#[test]
fn attitude_reference_is_passed_on_and_height_is_kept() {
    let attitude = Attitude::from_rotation_vector(Vector3::new(10.0_f64.to_radians(), 0.0, 0.0));
    let reference = Reference {
        attitude: Some(AttitudeReference::at_rest(attitude)),
        ..rest_at(Vector3::zeros())
    };
    let away = Estimate { position: Vector3::new(0.7, -0.4, 0.0), ..Estimate::default() };
    let command = loops().update(&away, &reference, DT_S);
    assert_eq!(command.attitude.attitude, attitude);
    assert!(acceleration_of(&command).z.abs() < 1e-12);
}

#[test]
fn open_horizontal_loops_do_not_wind_up() {
    let attitude = Attitude::from_rotation_vector(Vector3::new(0.1, 0.0, 0.0));
    let away = Estimate { position: Vector3::new(0.1, -0.2, 0.0), ..Estimate::default() };
    let mut loops = loops();
    let first = loops.update(&away, &rest_at(Vector3::zeros()), DT_S);
    loops.reset();
    for _ in 0..600 {
        loops.update(
            &away,
            &Reference {
                attitude: Some(AttitudeReference::at_rest(attitude)),
                ..rest_at(Vector3::zeros())
            },
            DT_S,
        );
    }
    assert_eq!(loops.update(&away, &rest_at(Vector3::zeros()), DT_S), first);
}

#[test]
fn without_a_force_or_with_one_to_the_side_the_attitude_is_level() {
    let level = Attitude::from_rotation_vector(Vector3::z() * 0.4);
    for force in [Vector3::zeros(), Vector3::new(-0.4_f64.sin(), 0.4_f64.cos(), 0.0)] {
        assert!(attitude_along(&force, 0.4).angle_to(&level) < 1e-9);
    }
}

proptest! {
    #[test]
    fn attitude_along_a_force_has_its_direction_and_the_yaw(
        tilt in 0.0..60.0_f64, azimuth in -3.2..3.2_f64, size in 0.01..100.0_f64, yaw in -3.1..3.1_f64,
    ) {
        let tilt = tilt.to_radians();
        let up = Vector3::new(tilt.sin() * azimuth.cos(), tilt.sin() * azimuth.sin(), tilt.cos());
        let attitude = attitude_along(&(up * size), yaw);
        prop_assert!((attitude.to_world(&Vector3::z()) - up).norm() < 1e-9);
        prop_assert!((yaw_of(&attitude) - yaw).abs() < 1e-9);
        prop_assert!((attitude.unit_quaternion().norm() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn commands_never_exceed_their_limits(
        samples in prop::collection::vec((vector3(50.0), vector3(20.0), vector3(5.0)), 1..60),
        yaw_rad in -3.1..3.1,
    ) {
        let options = PositionOptions::default();
        let mut loops = loops();
        for (position, velocity, reference_velocity) in samples {
            let estimate = Estimate { position, velocity, ..Estimate::default() };
            let reference = Reference { velocity: reference_velocity, yaw_rad, ..rest_at(Vector3::zeros()) };
            let command = loops.update(&estimate, &reference, DT_S);
            prop_assert!(command.velocity.xy().norm() <= options.horizontal_velocity_limit_m_s + 1e-9);
            prop_assert!(command.velocity.z.abs() <= options.vertical_velocity_limit_m_s);
            prop_assert!(tilt_of(&command.attitude.attitude) <= options.tilt_limit_deg.to_radians() + 1e-9);
            let vertical = acceleration_of(&command).z;
            prop_assert!(vertical.abs() <= options.vertical_acceleration_limit_m_s2 + 1e-9);
            prop_assert!((yaw_of(&command.attitude.attitude) - yaw_rad).abs() < 1e-9);
        }
    }

    #[test]
    fn capped_velocity_points_at_the_reference(direction in -3.1..3.1_f64, distance in 1.0..50.0_f64) {
        let goal = Vector3::new(direction.cos(), direction.sin(), 0.0) * distance;
        let velocity = loops().update(&Estimate::default(), &rest_at(goal), DT_S).velocity;
        prop_assert!((velocity.normalize() - goal.normalize()).norm() < 1e-9);
    }

    #[test]
    fn a_bad_estimate_does_not_reach_the_command(
        which in 0..3_usize, bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY)],
    ) {
        let mut loops = loops();
        loops.update(&Estimate::default(), &rest_at(Vector3::zeros()), DT_S);
        let mut estimate = Estimate::default();
        estimate.position[which] = bad;
        estimate.velocity[2 - which] = bad;
        let command = loops.update(&estimate, &rest_at(Vector3::zeros()), DT_S);
        prop_assert!(command.thrust_n.is_finite());
        prop_assert!(command.attitude.attitude.xyzw().iter().all(|value| value.is_finite()));
        prop_assert!(command.velocity.iter().all(|value| value.is_finite()));
    }
}

/// A point mass whose acceleration follows the commanded one through a delay of 35 ms and a lag of 50 ms, on a floor.
struct PointMass {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
    /// Commanded accelerations within the delay.
    queue: VecDeque<Vector3<f64>>,
}

impl PointMass {
    const STEP_S: f64 = 1e-3;
    const LAG_S: f64 = 0.05;
    const DELAY_STEPS: usize = 35;

    fn on_the_floor_at(position: Vector3<f64>) -> Self {
        let still = Vector3::zeros();
        Self {
            position,
            velocity: still,
            acceleration: still,
            queue: VecDeque::from(vec![still; Self::DELAY_STEPS]),
        }
    }

    fn step(&mut self, command: Vector3<f64>, floor_m: f64) {
        self.queue.push_back(command);
        let delayed = self.queue.pop_front().unwrap_or(command);
        self.acceleration += (delayed - self.acceleration) * (Self::STEP_S / Self::LAG_S);
        self.velocity += self.acceleration * Self::STEP_S;
        self.position += self.velocity * Self::STEP_S;
        if self.position.z < floor_m {
            self.position.z = floor_m;
            self.velocity = Vector3::zeros();
        }
    }
}

#[test]
fn point_mass_flies_the_square_as_well_as_table_5_and_lands() {
    let start = StartPoint { position: Vector3::new(0.4, -0.3, 0.1), yaw_rad: 0.5 };
    let options = TrajectoryOptions::default();
    let plan = FlightPlan::new(&options, options.trajectory(None).unwrap(), start);
    let mut estimator = Estimator::new(EstimatorOptions::default());
    let mut loops = loops();
    let mut vehicle = PointMass::on_the_floor_at(start.position);
    let mut command = Vector3::zeros();
    let mut error = Statistics::default();
    // Control at every 17th step: 58.8 Hz.
    for step in 0..((plan.end_s() + 2.0) / PointMass::STEP_S) as u32 {
        let t_s = f64::from(step) * PointMass::STEP_S;
        if step % 17 == 0 {
            let reference = plan.sample(t_s);
            let estimate = estimator.update(t_s, vehicle.position, Attitude::LEVEL);
            command =
                acceleration_of(&loops.update(&estimate, &reference, 17.0 * PointMass::STEP_S));
            if plan.scored(t_s) {
                error.add((reference.position - vehicle.position).norm());
            }
        }
        vehicle.step(command, start.position.z);
    }
    assert!(error.mean() <= 0.33, "mean error {} m", error.mean());
    assert!(vehicle.position.z - start.position.z < 0.05, "ended at {}", vehicle.position);
    assert!(
        (vehicle.position - start.position).xy().norm() < 0.05,
        "ended at {}",
        vehicle.position
    );
}
