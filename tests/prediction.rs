//! The predictor's model of the vehicle agrees with the simulator if both have the same parameters and biases.

use nalgebra::{Quaternion, Vector3, Vector4};
use oqtal_config::{Config, Interface, Setting};
use oqtal_control::predictive::{Bias, ModelInput, Motion, Rotation, VehicleModel};
use oqtal_control::quaternion::Attitude;
use oqtal_daemon::CommandModel;
use oqtal_plant_sim::{Disturbance, Dynamics, State};
use proptest::prelude::*;

const STEP_S: f64 = 1e-4;

fn vector(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-limit..limit).prop_map(Vector3::from)
}

fn config(vehicle: &str) -> Config {
    Config::from_settings(&[Setting::flag("test", "vehicle.preset", vehicle)]).unwrap()
}

fn model(config: &Config, rotation: Rotation) -> VehicleModel {
    VehicleModel { rotation, ..CommandModel::new(config).unwrap().model }
}

fn state(motion: &Motion) -> State {
    let [x, y, z, w] = motion.attitude.xyzw();
    State {
        position: motion.position,
        velocity: motion.velocity,
        attitude: Quaternion::new(w, x, y, z),
        rate: motion.rate,
        actuators: Vector4::x() * motion.thrust_n,
    }
}

/// Integrates the simulator's equations over 35 ms, in steps of a tenth of the simulator's.
fn integrate(
    config: &Config,
    motion: &Motion,
    input: &oqtal_plant_sim::PlantInput,
    disturbance: &Disturbance,
) -> State {
    let dynamics = Dynamics::new(&config.plant);
    let mut state = state(motion);
    (0..350).for_each(|_| dynamics.advance(&mut state, STEP_S, input, disturbance));
    state
}

fn assert_same(predicted: &Motion, state: &State) {
    assert!((predicted.position - state.position).norm() < 1e-8);
    assert!((predicted.velocity - state.velocity).norm() < 1e-6);
    assert!((predicted.rate - state.rate).norm() < 1e-5);
    let q = state.attitude;
    let attitude = Attitude::from_xyzw([q.i, q.j, q.k, q.w]).unwrap();
    assert!(predicted.attitude.angle_to(&attitude) < 1e-6);
    assert!((predicted.thrust_n - state.actuators.x).abs() < 1e-6);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn the_prediction_agrees_with_the_quadrotor(
        (velocity, turn, rate) in (vector(2.0), vector(1.0), vector(2.0)),
        (sticks, thrust, thrust_n) in (vector(1.0), 0.0..1.0_f64, 0.0..20.0_f64),
        (drift, push) in (vector(0.1), vector(0.5)),
    ) {
        let config = config("hummingbird");
        let lag_s = config.vehicle.rate_lag_ms * 1e-3;
        let model = model(&config, Rotation::RateLoop { lag_s });
        let attitude = Attitude::from_rotation_vector(turn);
        let motion = Motion { position: Vector3::z(), velocity, attitude, rate, thrust_n };
        let authority = Vector3::from(config.vehicle.rate_authority_rad_s);
        let input = ModelInput {
            demand: sticks.component_mul(&authority),
            thrust_n: thrust * config.vehicle.max_thrust_n,
            ..ModelInput::default()
        };
        let bias = Bias { demand: drift, acceleration: push };
        let disturbance = Disturbance { acceleration: push, rate_drift: drift, ..Disturbance::NONE };
        let told = oqtal_plant_sim::PlantInput { sticks, thrust, ..Default::default() };
        let predicted = model.advance(&motion, &input, &bias, 0.035);
        assert_same(&predicted, &integrate(&config, &motion, &told, &disturbance));
    }

    #[test]
    fn the_prediction_agrees_with_a_vehicle_that_holds_an_attitude(
        (velocity, turn, rate) in (vector(2.0), vector(1.0), vector(1.0)),
        // Within the rate authority; the demand has a kink at its limit.
        (left, thrust, thrust_n) in (vector(0.25), 0.0..1.0_f64, 0.0..20.0_f64),
        (drift, push) in (vector(0.1), vector(0.5)),
    ) {
        let mut config = config("hummingbird");
        config.plant.interface = Interface::Attitude;
        let vehicle = &config.vehicle;
        let rotation = Rotation::AttitudeLoop {
            gain_per_s: vehicle.attitude_gain_per_s,
            greatest_rate: Vector3::from(vehicle.rate_authority_rad_s),
            lag_s: vehicle.rate_lag_ms * 1e-3,
        };
        let model = model(&config, rotation);
        let attitude = Attitude::from_rotation_vector(turn);
        let commanded = attitude.turned_by(left);
        let motion = Motion { position: Vector3::z(), velocity, attitude, rate, thrust_n };
        let thrust_n = thrust * vehicle.max_thrust_n;
        let input = ModelInput { attitude: commanded, thrust_n, ..ModelInput::default() };
        let bias = Bias { demand: drift, acceleration: push };
        let disturbance = Disturbance { acceleration: push, rate_drift: drift, ..Disturbance::NONE };
        let attitude = **commanded.unit_quaternion();
        let told = oqtal_plant_sim::PlantInput { attitude, thrust, ..Default::default() };
        let predicted = model.advance(&motion, &input, &bias, 0.035);
        assert_same(&predicted, &integrate(&config, &motion, &told, &disturbance));
    }

    #[test]
    fn the_prediction_agrees_with_the_spacecraft(
        (velocity, turn, rate) in (vector(2.0), vector(1.0), vector(2.0)),
        (torque, push) in (vector(1.0), vector(0.5)),
    ) {
        let config = config("spacecraft");
        let inertia = config.vehicle.inertia().unwrap();
        let model = model(&config, Rotation::RigidBody { inertia });
        let attitude = Attitude::from_rotation_vector(turn);
        let motion = Motion { position: Vector3::z(), velocity, attitude, rate, thrust_n: 1.6 };
        let demand = inertia.inverse() * torque;
        let input = ModelInput { demand, thrust_n: 1.6, ..ModelInput::default() };
        let bias = Bias { demand: Vector3::zeros(), acceleration: push };
        let disturbance =
            Disturbance { acceleration: push, ..Disturbance::NONE };
        let thrust = 1.6 / config.vehicle.max_thrust_n;
        let told = oqtal_plant_sim::PlantInput { torque, thrust, ..Default::default() };
        let predicted = model.advance(&motion, &input, &bias, 0.035);
        assert_same(&predicted, &integrate(&config, &motion, &told, &disturbance));
    }
}
