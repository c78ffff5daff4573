//! Aerodynamic forces on the rotors, and losses and jitter of the simulated radio.

use nalgebra::{Vector3, Vector4};
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, PlantOptions};
use oqtal_plant_sim::{
    CommandLoss, Disturbance, Dynamics, Plant, PlantInput, PlantOutput, RotorAir, State,
};
use proptest::prelude::*;

use crate::configured;

/// Coefficients of the Hummingbird, RotorPy.
const DRAG: f64 = 1.19e-4;
const INFLOW: f64 = 2.32e-4;

const WEIGHT_N: f64 = 0.5 * 9.81;

fn plant(fidelity: &str, coefficients: (f64, f64)) -> PlantOptions {
    configured(&[
        ("plant.fidelity", fidelity.into()),
        ("plant.drag-per-s", 0.0.into()),
        ("plant.rotors.drag-coefficient", coefficients.0.into()),
        ("plant.rotors.inflow-coefficient", coefficients.1.into()),
    ])
    .plant
}

/// Speed of a rotor in hover \[rad/s\].
fn hover_speed(plant: &PlantOptions) -> f64 {
    (WEIGHT_N / 4.0 / plant.rotors.thrust_coefficient).sqrt()
}

/// A hovering vehicle with this velocity and rate.
fn state(plant: &PlantOptions, velocity: Vector3<f64>, rate: Vector3<f64>) -> State {
    let actuators = match plant.fidelity {
        oqtal_config::Fidelity::Eq61 => Vector4::x() * WEIGHT_N,
        oqtal_config::Fidelity::Rotors => Vector4::repeat(hover_speed(plant)),
    };
    State { position: Vector3::z(), velocity, rate, actuators, ..State::on_floor() }
}

/// Acceleration \[m/s^2\] and angular acceleration \[rad/s^2\] with rotors at hover speed.
fn accelerations(
    plant: &PlantOptions,
    state: &State,
    wind: Vector3<f64>,
) -> (Vector3<f64>, Vector3<f64>) {
    let power = hover_speed(plant) / plant.rotors.max_speed_rad_s;
    let motors = Some(Vector4::repeat(power));
    let input =
        PlantInput { thrust: WEIGHT_N / plant.max_thrust_n, motors, ..PlantInput::default() };
    let h = 1e-6;
    let mut after = *state;
    let disturbance = Disturbance { wind, ..Disturbance::NONE };
    Dynamics::new(plant).advance(&mut after, h, &input, &disturbance);
    ((after.velocity - state.velocity) / h, (after.rate - state.rate) / h)
}

#[test]
fn rotor_drag_agrees_with_the_literature_and_depends_on_airspeed_alone() {
    for fidelity in ["eq61", "rotors"] {
        let plant = plant(fidelity, (DRAG, INFLOW));
        let velocity = Vector3::new(0.8, -0.5, 0.3);
        let moving = state(&plant, velocity, Vector3::zeros());
        let (acceleration, _) = accelerations(&plant, &moving, Vector3::zeros());
        let per_s = -acceleration.component_div(&velocity);
        assert!((per_s.xy() - nalgebra::Vector2::repeat(0.4466)).amax() < 2e-3, "{per_s}");
        assert!((per_s.z - 0.8707).abs() < 2e-3, "{per_s}");
        let (drifting, _) = accelerations(&plant, &moving, velocity);
        assert!(drifting.amax() < 1e-3, "{fidelity}: {drifting}");
    }
}

#[test]
fn inflow_damps_roll_and_pitch_but_not_yaw() {
    let (with, without) = (plant("rotors", (0.0, INFLOW)), plant("rotors", (0.0, 0.0)));
    let turning = state(&with, Vector3::zeros(), Vector3::new(1.0, 1.0, 1.0));
    let of = |plant| accelerations(plant, &turning, Vector3::zeros()).1;
    let damping = of(&with) - of(&without);
    // Two rotors are at a distance of one arm from each axis.
    let torque = 2.0 * INFLOW * hover_speed(&with) * with.rotors.arm_m.powi(2);
    let roll = -torque / with.inertia_kg_m2[0][0];
    assert!((damping.x / roll - 1.0).abs() < 1e-3, "{damping}");
    assert!(damping.y < 0.0 && damping.z.abs() < 1e-6, "{damping}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Drag removes energy from any motion, translation and rotation.
    #[test]
    fn the_air_never_drives_the_rotors(
        velocity in prop::array::uniform3(-3.0..3.0_f64),
        rate in prop::array::uniform3(-5.0..5.0_f64),
        speeds in prop::array::uniform4(0.0..900.0_f64),
        layout in prop::sample::select(vec!["plus", "cross"]),
    ) {
        let config = configured(&[
            ("plant.rotors.layout", layout.into()),
            ("plant.rotors.drag-coefficient", DRAG.into()),
            ("plant.rotors.inflow-coefficient", INFLOW.into()),
        ]);
        let (velocity, rate) = (Vector3::from(velocity), Vector3::from(rate));
        let air = RotorAir::new(&config.plant.rotors).unwrap();
        let (force, torque) = air.wrench(&Vector4::from(speeds), &velocity, &rate);
        prop_assert!(force.dot(&velocity) + torque.dot(&rate) <= 1e-12);
    }

    /// Thrust grows towards the floor by up to a third; the increase is 1 % at a height of two and a half radii.
    #[test]
    fn the_ground_effect_is_bounded_and_vanishes_with_height(height in 0.0..2.0_f64, more in 0.0..1.0_f64) {
        let config = configured(&[("plant.rotors.ground-effect", true.into())]);
        let air = RotorAir::new(&config.plant.rotors).unwrap();
        let ratio = air.ground_ratio(height);
        prop_assert!((1.0..=4.0 / 3.0 + 1e-12).contains(&ratio));
        prop_assert!(air.ground_ratio(height + more) <= ratio);
        prop_assert!((air.ground_ratio(0.25) - 1.0 / 0.99).abs() < 1e-12);
        prop_assert!(RotorAir::new(&Config::default().plant.rotors).is_none());
    }

    /// Losses have the configured share and the configured mean burst length.
    #[test]
    fn losses_have_their_share_and_their_length(
        share in 0.02..0.3_f64,
        burst in 1.0..8.0_f64,
        seed in 0..1000_u64,
    ) {
        let plant = configured(&[
            ("plant.command-loss-probability", share.into()),
            ("plant.command-loss-burst", burst.into()),
        ])
        .plant;
        let mut loss = CommandLoss::new(&plant, seed);
        let lost: Vec<bool> = (0..100_000).map(|_| loss.next_is_lost()).collect();
        let count = lost.iter().filter(|lost| **lost).count() as f64;
        let bursts = lost.windows(2).filter(|pair| !pair[0] && pair[1]).count() as f64;
        // Five standard deviations: bursts are geometric, and independent of each other.
        let tolerance = 5.0 * (2.0 * burst / (share * 1e5)).sqrt();
        prop_assert!((count / (share * 1e5) - 1.0).abs() < tolerance, "{count}");
        prop_assert!((count / bursts / burst - 1.0).abs() < tolerance, "{count} in {bursts}");
    }
}

#[test]
fn jitter_delays_each_command_by_up_to_its_bound_and_keeps_their_order() {
    let config = configured(&[("plant.command-jitter-ms", 30.0.into())]);
    let mut plant = Plant::new(&config, Time::VIRTUAL_START);
    let command = CommandV1 { actuation: Actuation::Sticks.code(), ..CommandV1::default() };
    let mut applied = Vec::new();
    for sequence in 1..=600 {
        let now = Time::VIRTUAL_START + Span::from_millis(17 * sequence as i64);
        plant.advance(now, |output| {
            if let PlantOutput::Applied(_, stamps, vehicle) = output {
                let delay = stamps.applied_at.since(stamps.received_at).seconds();
                applied.push((vehicle.command_sequence, delay));
            }
        });
        plant.receive(now, Header { sequence, ..Header::default() }, command, 0);
    }
    assert!(applied.is_sorted_by_key(|(sequence, _)| *sequence));
    let delays = applied.iter().map(|(_, delay)| *delay);
    assert!(delays.clone().all(|delay| (0.02 - 1e-9..0.05 + 1e-9).contains(&delay)));
    let mean = delays.clone().sum::<f64>() / applied.len() as f64;
    assert!(applied.len() > 590 && (0.035..0.038).contains(&mean), "{mean}");
}
