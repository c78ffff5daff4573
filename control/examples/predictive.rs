//! A quadrotor with 20 ms from command to effect flies one metre sideways under the predictive autopilot.

use std::error::Error;

use nalgebra::Vector3;
use oqtal_control::controller::{Controller, InputForm, OqtalDt, OqtalDtOptions, RateInput};
use oqtal_control::position::PositionOptions;
use oqtal_control::predictive::{
    Autopilot, Bias, CommandHistory, Design, FilterOptions, Integration, MeasuredPose, ModelInput,
    Motion, MotionTracker, PredictiveOptions, Rotation, VehicleModel,
};
use oqtal_control::trajectory::{Phase, Reference};

const PERIOD_S: f64 = 1.0 / 60.0;
const DELAY_S: f64 = 0.02;

fn main() -> Result<(), Box<dyn Error>> {
    let model = VehicleModel {
        rotation: Rotation::RateLoop { lag_s: 0.05 },
        mass_kg: 0.5,
        gravity_m_s2: 9.81,
        drag_per_s: 0.25,
        thrust_lag_s: 0.05,
        integration: Integration::Fine,
    };
    let input = RateInput::new(Vector3::repeat(2.0))?.with_lag(0.05, PERIOD_S)?;
    let design = Design { model, input, period_s: PERIOD_S, turning_jerk_m_s3: f64::INFINITY };
    let (options, limits) = (PredictiveOptions::default(), PositionOptions::default());
    let law = Controller::OqtalDt(OqtalDt::new(OqtalDtOptions::default(), input, PERIOD_S)?);
    let mut autopilot = Autopilot::new(design, law, &options, &limits);

    let pose =
        |motion: &Motion| MeasuredPose { position: motion.position, attitude: motion.attitude };

    // The vehicle, with a wind unknown to the model.
    let wind = Bias { acceleration: Vector3::new(0.1, 0.0, 0.0), ..Bias::default() };
    let mut motion = Motion { thrust_n: 0.5 * 9.81, ..Motion::default() };
    let mut tracker =
        MotionTracker::new(model, FilterOptions::default(), DELAY_S).predictive(&options);
    // The floor is a metre below.
    tracker.begin(1.0 - PERIOD_S, &pose(&motion), -1.0);
    let mut on_the_way = CommandHistory::new(DELAY_S);
    let reference = Reference::rest(Vector3::new(1.0, 0.0, 0.0), Phase::Trajectory);
    for tick in 0..=600 {
        let now_s = 1.0 + tick as f64 * PERIOD_S;
        if tick % 100 == 0 {
            println!("{:5.2} s: x = {:.4} m", now_s - 1.0, motion.position.x);
        }
        tracker.take(now_s, &pose(&motion));
        let output = autopilot.compute(now_s, &tracker, &reference).ok_or("no command")?;
        let command = ModelInput {
            demand: input.demand_of(&output.u),
            attitude: output.attitude,
            thrust_n: output.setpoint.thrust_n,
        };
        tracker.sent(tick, now_s, command);
        on_the_way.push(tick, now_s, command);
        motion = on_the_way.propagate(&model, (&motion, &wind), (now_s, now_s + PERIOD_S));
    }
    let left_m = (motion.position - reference.position).norm();
    if left_m < 0.01 { Ok(()) } else { Err(format!("still {left_m} m away").into()) }
}
