//! Estimation and prediction of the vehicle's motion, and the autopilot that uses them with the law `OqtalDt`, or with another one
//! for comparison. Not in the paper.
//!
//! ```text
//!  reference ─▶ reference model ─▶ position law ─▶ flatness ─▶ OqtalDt ─▶ command ─▶ vehicle
//!                                      ▲                         ▲           │
//!                     predicted motion ┴─────────────────────────┘           │ time of effect
//!                            ▲                                               ▼
//!  poses ─────────▶ MotionTracker ──────────◀─────────────── commands already sent
//! ```
//!
//! | file | subject |
//! |---|---|
//! | `tracker.rs` | the estimate of the motion, with the commands in transit |
//! | `track.rs` | the motion expected at an instant, with its uncertainty |
//! | `model.rs` | model of the vehicle |
//! | `history.rs` | sent commands, measured delay |
//! | `kalman.rs`, `attitude_filter.rs`, `position_filter.rs` | the filters |
//! | `rotation_estimator.rs`, `thrust_estimator.rs`, `parameter_estimate.rs` | estimates of response and thrust |
//! | `estimator_pair.rs`, `adaptation.rs` | the model adapted in flight |
//! | `reference_model.rs` | a reference with limited speed, acceleration and jerk |
//! | `position_law.rs`, `command_filter.rs` | desired acceleration |
//! | `flatness.rs`, `demand.rs` | attitude, rate and angular acceleration for a force; the demand of a reference on the vehicle |
//! | `look_ahead.rs` | a prescribed attitude at the time of effect |
//! | `setpoint_buffer.rs` | set-points by the time for which they are valid |
//! | `ring.rs` | ring buffer |
//!
//! State and reference of the law refer to the same instant: the time at which a command sent now takes effect. Motion and
//! reference are predicted to that time. The set-point reported for now was therefore computed one delay ago.

mod adaptation;
mod attitude_filter;
mod command_filter;
mod demand;
mod estimator_pair;
mod flatness;
mod history;
mod kalman;
mod look_ahead;
mod model;
mod options;
mod parameter_estimate;
mod position_filter;
mod position_law;
mod reference_model;
mod ring;
mod rotation_estimator;
mod setpoint_buffer;
mod thrust_estimator;
mod track;
mod tracker;

use nalgebra::Vector3;

use crate::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, Controller, InputForm, LawTerms,
};
use crate::position::{PositionCommand, PositionOptions};
use crate::quantity::BodyRate;
use crate::quaternion::Attitude;
use crate::tracking_error::AttitudeError;
use crate::trajectory::Reference;
pub use adaptation::{Adaptation, AdaptedModel};
pub use attitude_filter::AttitudeFilter;
pub use command_filter::{CommandFilter, Smooth};
pub use demand::MotionDemand;
pub use estimator_pair::{AdaptiveEstimator, NormalisedSquare};
pub use flatness::Force;
pub use history::{CommandEffect, CommandHistory, CommandReport};
pub use kalman::{AxisFilter, Covariance, StateTransition};
pub use look_ahead::LookAhead;
pub use model::{Bias, Integration, ModelInput, Motion, Rotation, VehicleModel};
pub use options::{AdaptationOptions, FilterOptions, PredictiveOptions};
pub use position_filter::PositionFilter;
pub use position_law::{PositionLaw, Setpoint};
pub use reference_model::{Course, MotionLimits, ReferenceModel, ReferenceModelOptions};
pub use rotation_estimator::{RateResponse, ResponseBounds, RotationEstimator, TurnInterval};
use setpoint_buffer::SetpointBuffer;
pub use thrust_estimator::{ClimbInterval, ThrustEstimator};
pub use track::{
    Deviation, FilterInnovation, Innovation, MeasuredPose, Propagation, Track, TrackNoise,
};
pub use tracker::MotionTracker;

/// Longest step of the reference model \[s\]; after a longer pause the reference model waits.
const LONGEST_STEP_S: f64 = 0.1;

/// Least cosine of the tilt by which the thrust is divided \[-\]: that of 60 degrees.
const LEAST_COSINE: f64 = 0.5;

/// Vehicle and loop that an autopilot is designed for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Design<I> {
    /// Model of the vehicle.
    pub model: VehicleModel,
    /// Input form of the vehicle.
    pub input: I,
    /// Period of the loop \[s\].
    pub period_s: f64,
    /// Greatest jerk of a horizontal reference that the vehicle can follow by turning its thrust \[m/s^3\]; infinite without a limit.
    pub turning_jerk_m_s3: f64,
}

/// Output of the autopilot in one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictiveOutput {
    /// Set-point for now, computed one delay ago, with the thrust commanded now.
    pub setpoint: PositionCommand,
    /// Input of the rotation, within the vehicle's range \[N m, body axes, in rate form -1..1\].
    pub u: Vector3<f64>,
    /// Terms of that input, before the adapted gain and the vehicle's limits.
    pub terms: LawTerms,
    /// Command to a vehicle with its own attitude loop, body to world.
    pub attitude: Attitude,
    /// Motion predicted for the time at which the command takes effect.
    pub motion: Motion,
}

/// Position law and attitude law on the tracked motion. No step allocates.
#[derive(Clone, Debug, PartialEq)]
pub struct Autopilot<I> {
    design: Design<I>,
    position: PositionLaw,
    attitude: Controller<I>,
    setpoint_buffer: SetpointBuffer,
    look_ahead: LookAhead,
    /// Greatest tilt of an attitude command, unless the reference needs more \[rad\].
    tilt_limit_rad: f64,
    /// Time of the last step \[s\].
    last_s: Option<f64>,
}

impl<I: InputForm + Copy> Autopilot<I> {
    /// The autopilot of a vehicle with the attitude law `attitude`, within the limits of `loops`.
    pub fn new(
        design: Design<I>,
        attitude: Controller<I>,
        options: &PredictiveOptions,
        loops: &PositionOptions,
    ) -> Self {
        Self {
            position: PositionLaw::new(options, loops, (&design.model, design.turning_jerk_m_s3)),
            attitude,
            setpoint_buffer: SetpointBuffer::new(),
            look_ahead: LookAhead::default(),
            tilt_limit_rad: loops.tilt_limit_deg.to_radians(),
            last_s: None,
            design,
        }
    }

    /// Continues a flight that `old` controlled, with the attitude law of `old` if `keeps_law`.
    pub fn adopt(&mut self, old: &Self, keeps_law: bool) {
        match keeps_law {
            true => self.attitude = old.attitude,
            false => self.attitude.adopt(&old.attitude),
        }
        self.position.adopt(&old.position);
        self.setpoint_buffer = old.setpoint_buffer;
        (self.look_ahead, self.last_s) = (old.look_ahead, old.last_s);
    }

    /// Records that the input `u` of another law was sent in place of that of the last step \[N m, body axes, in rate form -1..1\].
    pub fn yield_to(&mut self, u: &Vector3<f64>, tracker: &MotionTracker) {
        let disturbance = -self.design.input.input_for(&tracker.bias().demand);
        self.attitude.yield_to(&(u.component_mul(&tracker.effect().gain) - disturbance));
    }

    /// Like [`PositionLaw::begin_stop`]: a hold begins.
    pub fn begin_stop(&mut self) {
        self.position.begin_stop();
    }

    /// Restarts with a vehicle on the floor.
    pub fn reset(&mut self) {
        self.attitude.reset();
        self.position.reset();
        self.setpoint_buffer = SetpointBuffer::new();
        self.look_ahead.reset();
        self.last_s = None;
    }

    /// Returns the command at `now_s` \[s\] for a vehicle with the motion predicted by `tracker` that should be at `reference`.
    /// `None` before the first pose, if no time has passed, and if a number is not finite or overflows; such a step leaves the
    /// state unchanged.
    pub fn compute(
        &mut self,
        now_s: f64,
        tracker: &MotionTracker,
        reference: &Reference,
    ) -> Option<PredictiveOutput> {
        let since_s = self.last_s.map_or(self.design.period_s, |last| now_s - last);
        // One prediction serves rotation and height. The thrust takes effect earlier, by the correction of the delay; its lag and
        // the lower gain of the vertical axis tolerate this.
        let (dt_s, delay_s) = (since_s.min(LONGEST_STEP_S), tracker.effect_delay_s());
        let motion = tracker.motion_at(now_s + delay_s)?;
        let is_sound = motion.is_finite() && reference.is_finite() && now_s.is_finite();
        if !is_sound || dt_s <= 0.0 {
            return None;
        }
        if let Some(adapted) = tracker.adapted() {
            self.attitude.set_rate_lag(adapted.rate_lag_s, self.design.period_s);
        }
        let ahead = Ahead { motion, bias: tracker.bias(), dt_s, delay_s };
        let setpoint = self.setpoint(&ahead, tracker.model(), reference)?;
        let disturbance = -self.design.input.input_for(&ahead.bias.demand);
        let u = self.rotate(&ahead, &setpoint.attitude, &disturbance, &tracker.effect().gain);
        let attitude = self.attitude_command(&setpoint.attitude, &ahead.bias.demand);
        self.setpoint_buffer.push(now_s + delay_s, setpoint);
        self.last_s = Some(now_s);
        let mut now = self.setpoint_buffer.at(now_s)?;
        now.attitude = reference.attitude.unwrap_or(now.attitude);
        Some(PredictiveOutput {
            setpoint: PositionCommand { thrust_n: setpoint.thrust_n, ..now },
            u,
            terms: LawTerms { disturbance, ..self.attitude.terms() },
            attitude,
            motion,
        })
    }

    /// The set-point for a vehicle with this `model` in the predicted motion.
    fn setpoint(
        &mut self,
        ahead: &Ahead,
        model: &VehicleModel,
        reference: &Reference,
    ) -> Option<PositionCommand> {
        let Ahead { motion, bias, dt_s, delay_s } = ahead;
        let Setpoint { velocity, force } =
            self.position.update((motion, bias), reference, (*dt_s, *delay_s));
        let attitude = match &reference.attitude {
            Some(prescribed) => self.look_ahead.lead(prescribed, *dt_s, *delay_s),
            None => {
                self.look_ahead.reset();
                force.attitude(reference.yaw_after(*delay_s))
            }
        };
        let cosine = motion.attitude.to_world(&Vector3::z()).z.max(LEAST_COSINE);
        // A thrust that changes is ahead of its lag, and of half the time for which the command is held.
        let lead_s = model.thrust_lag_s + dt_s / 2.0;
        let growth = force.value.dot(&force.slope) / force.value.norm();
        let thrust_n = model.mass_kg * (force.value.z / cosine + growth * lead_s);
        let numbers = velocity.iter().chain(&force.value).chain([&thrust_n]);
        if attitude.is_finite() && numbers.copied().all(f64::is_finite) {
            return Some(PositionCommand { attitude, thrust_n, velocity });
        }
        self.position.reset();
        self.look_ahead.reset();
        None
    }

    /// Number of Riccati equations solved so far \[-\].
    pub fn riccati_solves(&self) -> u32 {
        self.attitude.riccati_solves()
    }

    /// Number of Riccati equations without a usable solution so far \[-\].
    pub fn riccati_failures(&self) -> u32 {
        self.attitude.failed_solves()
    }

    /// Attitude command for a vehicle with its own attitude loop, so that the vehicle is at `wanted` when the command takes
    /// effect: ahead of it by the angle at which the on-board loop produces the rate of the reference, minus the estimated bias
    /// of the demand `bias`, but tilted by at most the limit, or by as much as `wanted`.
    fn attitude_command(&self, wanted: &AttitudeReference, bias: &Vector3<f64>) -> Attitude {
        let Rotation::AttitudeLoop { gain_per_s, .. } = self.design.model.rotation else {
            return wanted.attitude;
        };
        let input = &self.design.input;
        let on_reference = AttitudeError::between(&wanted.attitude, &wanted.attitude);
        let u = input.feed_forward(&on_reference, &Vector3::zeros(), wanted);
        let rate = input.demand_of(&u) - bias;
        let limit_rad = self.tilt_limit_rad.max(wanted.attitude.tilt_rad());
        wanted.attitude.turned_by(rate / gain_per_s).within_tilt(limit_rad)
    }

    /// The law's input with the compensation of the estimated bias, `disturbance`, for a vehicle whose rate is `gain` times the
    /// commanded one \[-\].
    fn rotate(
        &mut self,
        ahead: &Ahead,
        wanted: &AttitudeReference,
        disturbance: &Vector3<f64>,
        gain: &Vector3<f64>,
    ) -> Vector3<f64> {
        let Ahead { motion, dt_s, .. } = ahead;
        let state = AttitudeState { attitude: motion.attitude, rate: BodyRate(motion.rate) };
        let u = match &mut self.attitude {
            // Not limited before the estimated bias is compensated.
            Controller::OqtalDt(law) => law.input(&state, wanted),
            law => I::u_from(law.update(&state, wanted, *dt_s)),
        };
        self.design.input.saturate(&(u + disturbance).component_div(gain))
    }
}

/// The motion at the time at which a command sent now takes effect.
struct Ahead {
    motion: Motion,
    bias: Bias,
    /// Time since the last step \[s\].
    dt_s: f64,
    /// Time until the command takes effect \[s\].
    delay_s: f64,
}
