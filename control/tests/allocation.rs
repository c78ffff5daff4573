//! No step of a law or of the autopilot allocates.

#[path = "allocation/counter.rs"]
mod counter;

use nalgebra::{Matrix3, Vector3};
use oqtal_control::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, ControlOptions, Controller, ControllerName,
    InputForm, OqtalDt, OqtalDtOptions, RateInput, TorqueInput,
};
use oqtal_control::position::PositionOptions;
use oqtal_control::predictive::{
    Autopilot, CommandReport, Design, FilterOptions, Integration, MeasuredPose, ModelInput,
    MotionTracker, PredictiveOptions, Rotation, VehicleModel,
};
use oqtal_control::quantity::BodyRate;
use oqtal_control::quaternion::Attitude;
use oqtal_control::rigid_body::Inertia;
use oqtal_control::trajectory::{Phase, Reference};

use counter::allocations;

const DT_S: f64 = 1.0 / 60.0;

/// Flies every law through several cells, so that Riccati equations are solved, and to the limits of the input, so that quadratic
/// programs are solved.
fn check_laws<I: InputForm + Copy>(options: &ControlOptions, input: I) {
    for controller in ControllerName::ALL {
        let mut law = Controller::new(&ControlOptions { controller, ..*options }, input).unwrap();
        let mut saturated = 0;
        let (count, ()) = allocations(|| {
            for tick in 0..60 {
                let turn = Vector3::new(0.03, -0.02, 0.01) * f64::from(tick);
                let state = AttitudeState {
                    attitude: Attitude::from_rotation_vector(turn),
                    rate: BodyRate(Vector3::new(-0.5, 0.9, 1.5) * f64::from(tick % 5)),
                };
                let command = law.update(&state, &AttitudeReference::default(), DT_S);
                let u = I::u_from(command);
                saturated += u32::from((input.saturate(&(2.0 * u)) - u).amax() < 1e-9);
            }
        });
        assert_eq!(count, 0, "{controller:?}");
        assert!(saturated > 0, "{controller:?} is not at its limits");
    }
}

#[test]
fn the_count_counts() {
    assert_eq!(allocations(|| drop(std::hint::black_box(Box::new(1)))).0, 1);
}

#[test]
fn no_law_allocates_in_a_step() {
    let sticks = RateInput::new(Vector3::repeat(2.0)).unwrap();
    check_laws(&ControlOptions::default(), sticks);
    check_laws(&ControlOptions::default(), sticks.with_lag(0.05, DT_S).unwrap());
    // The axes of the second body affect each other, so that the program of `mpc` has all of them.
    for coupling in [0.0, 0.05] {
        let mut inertia = Matrix3::from_diagonal_element(0.5);
        (inertia[(0, 1)], inertia[(1, 0)]) = (coupling, coupling);
        let input = TorqueInput::new(Inertia::new(inertia).unwrap(), 20.0).unwrap();
        check_laws(&ControlOptions::spacecraft(), input);
    }
}

#[test]
fn the_autopilot_does_not_allocate_in_a_step() {
    let model = VehicleModel {
        rotation: Rotation::RateLoop { lag_s: 0.05 },
        mass_kg: 0.5,
        gravity_m_s2: 9.81,
        drag_per_s: 0.25,
        thrust_lag_s: 0.05,
        integration: Integration::Fine,
    };
    let input = RateInput::new(Vector3::repeat(2.0)).unwrap().with_lag(0.05, DT_S).unwrap();
    let design = Design { model, input, period_s: DT_S, turning_jerk_m_s3: f64::INFINITY };
    let (options, loops) = (PredictiveOptions::default(), PositionOptions::default());
    let law = OqtalDt::new(OqtalDtOptions::default(), input, DT_S).unwrap();
    let mut autopilot = Autopilot::new(design, Controller::OqtalDt(law), &options, &loops);
    let reference = Reference::rest(Vector3::new(1.3, 0.0, 1.0), Phase::Trajectory);
    let pose = MeasuredPose { position: Vector3::zeros(), attitude: Attitude::LEVEL };
    let mut tracker =
        MotionTracker::new(model, FilterOptions::default(), 0.02).predictive(&options);
    tracker.begin(-0.015, &pose, -1.0);
    let mut computed = 0;
    let (count, ()) = allocations(|| {
        for tick in 1..=200 {
            let now_s = tick as f64 * DT_S;
            tracker.take(now_s - 0.015, &pose);
            if let Some(output) = autopilot.compute(now_s, &tracker, &reference) {
                computed += 1;
                let (attitude, thrust_n) = (output.attitude, output.setpoint.thrust_n);
                let demand = input.demand_of(&output.u);
                tracker.sent(tick, now_s, ModelInput { demand, attitude, thrust_n });
                tracker.applied(CommandReport {
                    sequence: tick,
                    acts_s: now_s + 0.02,
                    follows: true,
                });
            }
        }
    });
    assert_eq!((count, computed), (0, 200));
}
