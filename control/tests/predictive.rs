//! Tests of the predictive autopilot: model, filters, prediction, reference model, and the whole.

#[path = "predictive/adaptation.rs"]
mod adaptation;
#[path = "predictive/autopilot.rs"]
mod autopilot;
#[path = "predictive/filters.rs"]
mod filters;
#[path = "predictive/history.rs"]
mod history;
#[path = "predictive/noise.rs"]
mod noise;
#[path = "predictive/reference.rs"]
mod reference;

use nalgebra::Vector3;
use oqtal_control::controller::{Controller, OqtalDt, OqtalDtOptions, RateInput};
use oqtal_control::position::PositionOptions;
use oqtal_control::predictive::{
    Autopilot, Design, FilterOptions, Integration, MeasuredPose, MotionTracker, PredictiveOptions,
    Rotation, VehicleModel,
};
use proptest::prelude::*;

const PERIOD_S: f64 = 1.0 / 60.0;
const LAG_S: f64 = 0.05;
const DELAY_S: f64 = 0.02;
const AUTHORITY: f64 = 2.0;

/// A quadrotor whose rate follows with a lag, Eq. (61).
fn quadrotor() -> VehicleModel {
    VehicleModel {
        rotation: Rotation::RateLoop { lag_s: LAG_S },
        mass_kg: 0.5,
        gravity_m_s2: 9.81,
        drag_per_s: 0.25,
        thrust_lag_s: 0.05,
        integration: Integration::Fine,
    }
}

fn sticks() -> RateInput {
    RateInput::new(Vector3::repeat(AUTHORITY)).unwrap().with_lag(LAG_S, PERIOD_S).unwrap()
}

fn autopilot() -> Autopilot<RateInput> {
    let design = Design {
        model: quadrotor(),
        input: sticks(),
        period_s: PERIOD_S,
        turning_jerk_m_s3: f64::INFINITY,
    };
    let law = OqtalDt::new(OqtalDtOptions::default(), sticks(), PERIOD_S).unwrap();
    let (options, loops) = (PredictiveOptions::default(), PositionOptions::default());
    Autopilot::new(design, Controller::OqtalDt(law), &options, &loops)
}

/// Noise by which the daemon admits poses, as shipped.
const ADMISSION: FilterOptions = FilterOptions {
    attitude_noise_deg: 0.5,
    position_noise_mm: 1.0,
    rate_walk_rad_s: 2.0,
    demand_bias_walk: 0.5,
    velocity_walk_m_s: 2.0,
    acceleration_walk_m_s2: 3.0,
};

/// The tracker of a vehicle that was at rest in `pose` at `t_s`, high above the floor.
fn tracker(options: &PredictiveOptions, t_s: f64, pose: &MeasuredPose) -> MotionTracker {
    let mut tracker = MotionTracker::new(quadrotor(), ADMISSION, DELAY_S).predictive(options);
    tracker.begin(t_s, pose, -100.0);
    tracker
}

fn vector(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-limit..limit).prop_map(Vector3::from)
}
