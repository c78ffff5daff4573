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
use oqtal_control::controller::{OqtalDtOptions, RateInput};
use oqtal_control::position::PositionOptions;
use oqtal_control::predictive::{
    Autopilot, Design, Integration, PredictiveOptions, Rotation, VehicleModel,
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
    autopilot_with(&PredictiveOptions::default())
}

fn autopilot_with(options: &PredictiveOptions) -> Autopilot<RateInput> {
    let design =
        Design { model: quadrotor(), input: sticks(), delay_s: DELAY_S, period_s: PERIOD_S };
    Autopilot::new(design, OqtalDtOptions::default(), options, &PositionOptions::default()).unwrap()
}

fn vector(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-limit..limit).prop_map(Vector3::from)
}
