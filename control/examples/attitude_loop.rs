//! A spacecraft 60 degrees off turns to level under the paper's law, Eq. (56), at 60 Hz.

use std::error::Error;

use nalgebra::{Matrix3, Vector3};
use oqtal_control::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, ControlOptions, Controller, ControllerName,
    TorqueInput,
};
use oqtal_control::quaternion::Attitude;
use oqtal_control::rigid_body::Inertia;

const PERIOD_S: f64 = 1.0 / 60.0;
const STEPS: u32 = 100;

fn main() -> Result<(), Box<dyn Error>> {
    let inertia = Inertia::new(Matrix3::from_diagonal_element(0.5))?;
    let options =
        ControlOptions { controller: ControllerName::Oqtal, ..ControlOptions::spacecraft() };
    let mut law = Controller::new(&options, TorqueInput::new(inertia, 20.0)?)?;

    let start = Attitude::from_rotation_vector(Vector3::new(0.6, -0.5, 0.7));
    let mut state = AttitudeState { attitude: start, ..AttitudeState::default() };
    let reference = AttitudeReference::at_rest(Attitude::LEVEL);
    for tick in 0..=900 {
        if tick % 150 == 0 {
            let error_deg = state.attitude.angle_to(&Attitude::LEVEL).to_degrees();
            println!("{:5.2} s: {error_deg:8.4} deg off", f64::from(tick) * PERIOD_S);
        }
        let torque = law.update(&state, &reference, PERIOD_S);
        // The torque is held for a period; the body is integrated in short steps.
        for _ in 0..STEPS {
            let step_s = PERIOD_S / f64::from(STEPS);
            state.rate.0 += inertia.acceleration(state.rate, torque).0 * step_s;
            state.attitude = state.attitude.turned_by(state.rate.0 * step_s);
        }
    }
    let left_deg = state.attitude.angle_to(&Attitude::LEVEL).to_degrees();
    println!("{} Riccati equations solved", law.riccati_solves());
    if left_deg < 0.1 { Ok(()) } else { Err(format!("still {left_deg} deg off").into()) }
}
