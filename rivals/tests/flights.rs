//! Flights of the laws with the model of the prediction as the vehicle: no noise, no delay.

#[path = "../../control/tests/allocation/counter.rs"]
mod counter;

use std::f64::consts::TAU;

use nalgebra::Vector3;
use oqtal_control::predictive::{Bias, Integration, ModelInput, Motion, Rotation, VehicleModel};
use oqtal_control::quaternion::Attitude;
use oqtal_control::trajectory::{Phase, Reference};
use oqtal_rivals::dfbc::{Dfbc, DfbcOptions};
use oqtal_rivals::flat::FlatPoint;
use oqtal_rivals::l1::{L1Geometric, L1Options};
use oqtal_rivals::law::{RateVehicle, Rival, RivalTick};
use oqtal_rivals::nmpc::{Nmpc, NmpcOptions};

use counter::allocations;

const PERIOD_S: f64 = 1.0 / 60.0;

const MODEL: VehicleModel = VehicleModel {
    rotation: Rotation::RateLoop { lag_s: 0.05 },
    mass_kg: 0.5,
    gravity_m_s2: 9.81,
    drag_per_s: 0.25,
    thrust_lag_s: 0.05,
    integration: Integration::Fine,
};

/// A disturbance of the command and of the acceleration that no law is told.
const UNTOLD: Bias =
    Bias { demand: Vector3::new(0.05, -0.03, 0.02), acceleration: Vector3::new(0.0, 0.0, 0.0) };

fn laws() -> [(&'static str, Box<dyn Rival>); 3] {
    [
        ("nmpc", Box::new(Nmpc::new(NmpcOptions::default()))),
        ("dfbc", Box::new(Dfbc::new(DfbcOptions::default()))),
        ("l1", Box::new(L1Geometric::new(L1Options::default()))),
    ]
}

fn vehicle() -> RateVehicle {
    RateVehicle::new(&MODEL, Vector3::repeat(2.0), 20.0).unwrap()
}

/// A circle of 3 m at 3.8 m/s.
fn circle(t_s: f64) -> Reference {
    let (radius_m, w) = (3.0, 3.8 / 3.0);
    let course = std::array::from_fn(|order| {
        let phase = w * t_s + order as f64 * TAU / 4.0;
        Vector3::new(phase.cos(), phase.sin(), 0.0) * (radius_m * w.powi(order as i32))
    });
    Reference::moving(course, Phase::Trajectory)
}

fn rest(_: f64) -> Reference {
    Reference::rest(Vector3::z(), Phase::Trajectory)
}

/// Flies for `duration_s` from `motion`, and returns the greatest error of the last second \[m\].
fn flown(
    law: &mut dyn Rival,
    (mut motion, bias): (Motion, Bias),
    reference: fn(f64) -> Reference,
    duration_s: f64,
) -> f64 {
    let (vehicle, mut acting, mut worst) = (vehicle(), ModelInput::default(), 0.0_f64);
    let ticks = (duration_s / PERIOD_S) as usize;
    law.reset();
    for tick in 0..ticks {
        let now_s = tick as f64 * PERIOD_S;
        let command = law.command(&RivalTick {
            vehicle: &vehicle,
            motion: &motion,
            bias: Bias::default(),
            measured: &motion,
            acting,
            dt_s: PERIOD_S,
            reference: &|ahead_s| reference(now_s + ahead_s),
        });
        assert_eq!(command, vehicle.limited(&command));
        motion = MODEL.advance(&motion, &command, &bias, PERIOD_S);
        acting = command;
        if tick + 60 >= ticks {
            worst = worst.max((motion.position - reference(now_s + PERIOD_S).position).norm());
        }
    }
    worst
}

/// The motion of a vehicle on `reference`.
fn on(reference: fn(f64) -> Reference) -> Motion {
    FlatPoint::of(&reference(0.0), &vehicle(), &Bias::default()).motion
}

#[test]
fn a_vehicle_on_a_fast_circle_stays_on_it() {
    for (name, mut law) in laws() {
        let error_m = flown(&mut *law, (on(circle), Bias::default()), circle, 6.0);
        assert!(error_m < 0.01, "{name}: {error_m} m");
    }
}

#[test]
fn a_vehicle_far_from_its_reference_returns_within_the_limits_of_its_commands() {
    let away = Motion {
        position: Vector3::new(2.0, -1.0, 0.0),
        velocity: Vector3::new(-1.0, 1.0, 0.5),
        attitude: Attitude::from_rotation_vector(Vector3::new(0.3, -0.2, 0.5)),
        ..on(rest)
    };
    for (name, mut law) in laws() {
        let error_m = flown(&mut *law, (away, Bias::default()), rest, 8.0);
        assert!(error_m < 0.01, "{name}: {error_m} m");
    }
}

/// An error of the rate command of 0.05 rad/s would turn the vehicle by 0.36 deg and move it by centimetres.
#[test]
fn an_error_of_the_rate_command_that_is_not_told_is_cancelled() {
    for (name, mut law) in laws() {
        let error_m = flown(&mut *law, (on(rest), UNTOLD), rest, 8.0);
        assert!(error_m < 2e-3, "{name}: {error_m} m");
    }
}

#[test]
fn l1_adaptation_cancels_a_force_and_geometric_control_without_it_does_not() {
    let force = Bias { acceleration: Vector3::new(0.4, -0.3, 0.2), ..Bias::default() };
    let without = L1Options { bandwidth_rad_s: [0.0; 2], ..L1Options::default() };
    let [adapted_m, fixed_m] = [L1Options::default(), without]
        .map(|options| flown(&mut L1Geometric::new(options), (on(rest), force), rest, 10.0));
    assert!(adapted_m < 2e-3 && fixed_m > 0.05, "{adapted_m} {fixed_m}");
}

#[test]
fn a_law_that_is_told_of_a_force_and_of_an_error_of_the_command_cancels_them() {
    let bias = Bias { acceleration: Vector3::new(0.4, -0.3, 0.2), ..UNTOLD };
    let vehicle = vehicle();
    let reference = rest(0.0);
    let motion = FlatPoint::of(&reference, &vehicle, &bias).motion;
    let nmpc = NmpcOptions { indi_cutoff_hz: 0.0, ..NmpcOptions::default() };
    let dfbc = DfbcOptions { indi_cutoff_hz: 0.0, ..DfbcOptions::default() };
    let laws: [Box<dyn Rival>; 2] = [Box::new(Nmpc::new(nmpc)), Box::new(Dfbc::new(dfbc))];
    for mut law in laws {
        let command = law.command(&RivalTick {
            vehicle: &vehicle,
            motion: &motion,
            bias,
            measured: &motion,
            acting: ModelInput::default(),
            dt_s: PERIOD_S,
            reference: &rest,
        });
        let moved = MODEL.advance(&motion, &command, &bias, 0.1);
        assert!((moved.position - motion.position).norm() < 1e-4, "{moved:?}");
        assert!(moved.rate.norm() < 1e-3, "{moved:?}");
    }
}

#[test]
fn no_step_allocates() {
    let away = Motion { position: Vector3::new(2.0, -1.0, 0.0), ..on(rest) };
    for (name, mut law) in laws() {
        let (count, error_m) = allocations(|| flown(&mut *law, (away, Bias::default()), rest, 8.0));
        assert_eq!(count, 0, "{name}: {error_m} m");
    }
}

/// From far away the rates are at their limits, so that quadratic programs with active limits are solved.
#[test]
fn the_iterations_of_a_program_stay_far_below_their_bound() {
    let mut law = Nmpc::new(NmpcOptions::default());
    let (vehicle, mut most) = (vehicle(), 0);
    let mut motion = Motion { position: Vector3::new(4.0, -3.0, 0.0), ..on(rest) };
    for _ in 0..120 {
        let command = law.command(&RivalTick {
            vehicle: &vehicle,
            motion: &motion,
            bias: Bias::default(),
            measured: &motion,
            acting: ModelInput::default(),
            dt_s: PERIOD_S,
            reference: &rest,
        });
        most = most.max(law.iterations());
        motion = MODEL.advance(&motion, &command, &Bias::default(), PERIOD_S);
    }
    assert!((1..=25).contains(&most), "{most}");
}
