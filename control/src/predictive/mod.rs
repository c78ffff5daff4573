//! The predictive autopilot: estimation, prediction over the loop's delay and a reference model, around the law
//! [`OqtalDt`]. Not in the paper.
//!
//! ```text
//!  reference ─▶ reference model ─▶ position law ─▶ flatness ─▶ OqtalDt ─▶ command ─▶ vehicle
//!                                      ▲                         ▲           │
//!                     predicted motion ┴─────────────────────────┘           │ time of effect
//!                            ▲                                               ▼
//!  poses ──▶ Kalman filters ─┴──────────────◀─────────────── commands already sent
//! ```
//!
//! | file | subject |
//! |---|---|
//! | `model.rs` | model of the vehicle |
//! | `history.rs` | commands sent, measured delay |
//! | `kalman.rs`, `attitude_filter.rs`, `position_filter.rs` | the filters |
//! | `rotation_estimator.rs`, `adaptation.rs` | the model adapted in flight |
//! | `observer.rs` | estimate of the motion from both filters; differences on the floor |
//! | `reference_model.rs` | a reference with limited speed, acceleration and jerk |
//! | `position_law.rs`, `command_filter.rs` | desired acceleration |
//! | `flatness.rs` | attitude, rate and angular acceleration for a force |
//! | `look_ahead.rs` | a prescribed attitude at the time of effect |
//! | `inner_law.rs` | the attitude law: [`OqtalDt`], or another one for comparison |
//! | `setpoint_buffer.rs` | set-points by the time they are for |
//! | `ring.rs` | ring buffer |
//! | `track.rs` | the motion expected of a vehicle, by which poses are judged |
//!
//! State and reference of the law are those of one instant: the time at which a command sent now takes effect. The
//! motion is predicted to that time, and the reference is that of that time. The set-point reported for now was
//! therefore decided one delay ago.

mod adaptation;
mod attitude_filter;
mod command_filter;
mod flatness;
mod history;
mod inner_law;
mod kalman;
mod look_ahead;
mod model;
mod observer;
mod options;
mod position_filter;
mod position_law;
mod reference_model;
mod ring;
mod rotation_estimator;
mod setpoint_buffer;
mod track;

use nalgebra::Vector3;

use crate::controller::{
    AttitudeReference, AttitudeState, Controller, InputForm, OqtalDt, OqtalDtOptions,
};
use crate::estimator::Estimate;
use crate::options::OptionError;
use crate::position::{PositionCommand, PositionOptions};
use crate::quantity::BodyRate;
use crate::quaternion::Attitude;
use crate::tracking_error::AttitudeError;
use crate::trajectory::Reference;
pub use adaptation::{Adaptation, AdaptedModel};
pub use attitude_filter::AttitudeFilter;
pub use command_filter::{CommandFilter, Smooth};
pub use flatness::Force;
pub use history::{CommandEffect, CommandHistory, CommandReport};
use inner_law::InnerLaw;
pub use kalman::{Covariance, StateTransition};
pub use look_ahead::LookAhead;
pub use model::{Bias, Integration, ModelInput, Motion, Rotation, VehicleModel};
pub use observer::{FilterInnovation, MotionObserver};
pub use options::{AdaptationOptions, FilterOptions, PredictiveOptions};
pub use position_filter::PositionFilter;
pub use position_law::{PositionLaw, Setpoint};
pub use reference_model::{Course, MotionLimits, ReferenceModel, ReferenceModelOptions};
pub use rotation_estimator::{RateResponse, ResponseBounds, RotationEstimator};
use setpoint_buffer::SetpointBuffer;
pub use track::{Deviation, Innovation, MeasuredPose, Surroundings, Track};

/// Longest step of the reference model \[s\]; after a longer pause the reference model waits.
const LONGEST_STEP_S: f64 = 0.1;

/// Least cosine of the tilt that the thrust is divided by \[-\]: that of 60 degrees.
const LEAST_COSINE: f64 = 0.5;

/// Vehicle and loop that an autopilot is designed for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Design<I> {
    /// Model of the vehicle.
    pub model: VehicleModel,
    /// Input form of the vehicle.
    pub input: I,
    /// Delay from sending a command to its effect, until one is measured \[s\].
    pub delay_s: f64,
    /// Period of the loop \[s\].
    pub period_s: f64,
}

/// Output of the autopilot in one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictiveOutput {
    /// Set-point for now, decided one delay ago, with the thrust commanded now.
    pub setpoint: PositionCommand,
    /// Input of the rotation, within the vehicle's range \[N m, body axes, in rate form -1..1\].
    pub u: Vector3<f64>,
    /// Command to a vehicle that holds an attitude, body to world.
    pub attitude: Attitude,
}

impl PredictiveOutput {
    /// The command, as [`Autopilot::sent`] takes it.
    #[must_use]
    pub fn command(&self) -> PredictiveCommand {
        let Self { setpoint, u, attitude } = *self;
        PredictiveCommand { u, attitude, thrust_n: setpoint.thrust_n }
    }
}

/// A command to the vehicle. The default is that of motors that are off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PredictiveCommand {
    /// Input of the rotation \[N m, body axes, in rate form -1..1\].
    pub u: Vector3<f64>,
    /// Attitude, where the vehicle holds one, body to world.
    pub attitude: Attitude,
    /// Thrust along body z \[N\]; a negative one counts as 0.
    pub thrust_n: f64,
}

/// Estimation, prediction, position law and attitude law in one. No step allocates.
#[derive(Clone, Debug, PartialEq)]
pub struct Autopilot<I> {
    design: Design<I>,
    /// The model that is flown: that of the design, adapted.
    model: VehicleModel,
    observer: MotionObserver,
    /// `None` for a fixed model.
    adaptation: Option<Adaptation>,
    history: CommandHistory,
    position: PositionLaw,
    attitude: InnerLaw<I>,
    setpoint_buffer: SetpointBuffer,
    lead: LookAhead,
    /// Time of the last step \[s\].
    last_s: Option<f64>,
}

impl<I: InputForm + Copy> Autopilot<I> {
    /// The autopilot of a vehicle, within the limits of `loops`.
    ///
    /// # Errors
    /// An option of the attitude law whose value is not allowed.
    pub fn new(
        design: Design<I>,
        law: OqtalDtOptions,
        options: &PredictiveOptions,
        loops: &PositionOptions,
    ) -> Result<Self, OptionError> {
        Ok(Self {
            model: design.model,
            observer: MotionObserver::new(design.model, options.filter),
            adaptation: options
                .adaptation
                .adapt
                .then(|| Adaptation::new(&options.adaptation, &options.filter, &design.model)),
            history: CommandHistory::new(design.delay_s),
            position: PositionLaw::new(options, loops, design.model.gravity_m_s2),
            attitude: InnerLaw::Own(OqtalDt::new(law, design.input, design.period_s)?),
            setpoint_buffer: SetpointBuffer::new(),
            lead: LookAhead::default(),
            last_s: None,
            design,
        })
    }

    /// The same with `law` in place of [`OqtalDt`]: for the question what is owed to the law and what to its surroundings.
    #[must_use]
    pub fn with_law(self, law: Controller<I>) -> Self {
        Self { attitude: InnerLaw::Other(law), ..self }
    }

    /// Restarts with a vehicle on the floor; commands sent and the measured delay are kept.
    pub fn reset(&mut self) {
        self.observer.reset();
        self.attitude.reset();
        self.position.reset();
        self.setpoint_buffer = SetpointBuffer::new();
        self.lead.reset();
        self.last_s = None;
    }

    /// Takes the pose captured at `t_s` \[s\], with velocity and body rate from differences.
    pub fn observe(&mut self, t_s: f64, measured: &Estimate) {
        self.observer.take(t_s, measured, &self.history);
        if let Some(adaptation) = &mut self.adaptation {
            match self.observer.latest().filter(|_| self.observer.is_airborne()) {
                Some((last_s, motion)) if last_s == t_s => {
                    let vertical = self.observer.bias().acceleration.z;
                    let seen = (&measured.attitude, motion, vertical);
                    adaptation.take(t_s, seen, &self.history);
                }
                Some(_) => {}
                None => adaptation.land(),
            }
            let adapted = adaptation.model();
            self.fly_with(&adapted);
        }
    }

    /// Predicts and commands with this model from now on.
    fn fly_with(&mut self, adapted: &AdaptedModel) {
        self.model = adapted.of(&self.design.model);
        self.observer.set_model(self.model);
        self.history.set_effect(adapted.effect());
        self.attitude.set_rate_lag(adapted.rate_lag_s, self.design.period_s);
    }

    /// The model that is flown, relative to the configured one; `None` if that is flown itself.
    #[must_use]
    pub fn adapted(&self) -> Option<AdaptedModel> {
        self.adaptation.as_ref().map(Adaptation::model)
    }

    /// Records a command sent at `t_s` \[s\].
    pub fn sent(&mut self, sequence: u64, t_s: f64, command: &PredictiveCommand) {
        let PredictiveCommand { u, attitude, thrust_n } = *command;
        let demand = self.design.input.demand_of(&self.design.input.saturate(&u));
        let attitude = if attitude.is_finite() { attitude } else { Attitude::LEVEL };
        let thrust_n = if thrust_n.is_finite() { thrust_n.max(0.0) } else { 0.0 };
        self.history.push(sequence, t_s, ModelInput { demand, attitude, thrust_n });
    }

    /// Records that a command took effect.
    pub fn applied(&mut self, report: CommandReport) {
        self.history.applied(report);
    }

    /// Measured delay from sending a command to its effect \[s\].
    #[must_use]
    pub fn delay_s(&self) -> f64 {
        self.history.delay_s()
    }

    /// The motion that the filters estimate at the capture of the last pose, and the innovation of that pose; `None` before the
    /// first pose.
    #[must_use]
    pub fn filtered(&self) -> Option<(&Motion, Option<&FilterInnovation>)> {
        self.observer.latest().map(|(_, motion)| (motion, self.observer.innovation()))
    }

    /// Returns the command at `now_s` \[s\] for a vehicle that should be at `reference`. `None` before the first
    /// pose, if no time has passed, and if a number is not finite or overflows; no part of such a step is stored.
    pub fn decide(&mut self, now_s: f64, reference: &Reference) -> Option<PredictiveOutput> {
        let since_s = self.last_s.map_or(self.design.period_s, |last| now_s - last);
        self.history.expect_reports();
        // One prediction serves rotation and height. The thrust acts earlier by the correction of the delay; its lag and the lower
        // gain of the vertical axis bear that.
        let (dt_s, delay_s) = (since_s.min(LONGEST_STEP_S), self.history.effect_delay_s());
        let motion = self.observer.predict(now_s + delay_s, &self.history)?;
        let sound = motion.is_finite() && reference.is_finite() && now_s.is_finite();
        if !sound || dt_s <= 0.0 {
            return None;
        }
        let setpoint = self.setpoint(&motion, reference, (dt_s, delay_s))?;
        let u = self.rotate(&motion, &setpoint.attitude, dt_s);
        let attitude = self.attitude_command(&setpoint.attitude);
        self.setpoint_buffer.push(now_s + delay_s, setpoint);
        self.last_s = Some(now_s);
        let mut now = self.setpoint_buffer.at(now_s)?;
        now.attitude = reference.attitude.unwrap_or(now.attitude);
        Some(PredictiveOutput {
            setpoint: PositionCommand { thrust_n: setpoint.thrust_n, ..now },
            u,
            attitude,
        })
    }

    /// The set-point for the predicted `motion`.
    fn setpoint(
        &mut self,
        motion: &Motion,
        reference: &Reference,
        (dt_s, delay_s): (f64, f64),
    ) -> Option<PositionCommand> {
        let bias = self.observer.bias();
        let Setpoint { velocity, force } =
            self.position.update((motion, &bias), reference, (dt_s, delay_s));
        let attitude = match &reference.attitude {
            Some(prescribed) => self.lead.lead(prescribed, dt_s, delay_s),
            None => {
                self.lead.reset();
                force.attitude(reference.yaw_rad)
            }
        };
        let cosine = motion.attitude.to_world(&Vector3::z()).z.max(LEAST_COSINE);
        let thrust_n = self.model.mass_kg * force.value.z / cosine;
        let numbers = velocity.iter().chain(&force.value).chain([&thrust_n]);
        if attitude.is_finite() && numbers.copied().all(f64::is_finite) {
            return Some(PositionCommand { attitude, thrust_n, velocity });
        }
        self.position.reset();
        self.lead.reset();
        None
    }

    /// Number of Riccati equations solved so far \[-\].
    #[must_use]
    pub fn riccati_solves(&self) -> u32 {
        self.attitude.riccati_solves()
    }

    /// Number of Riccati equations without a usable solution so far \[-\].
    #[must_use]
    pub fn riccati_failures(&self) -> u32 {
        self.attitude.riccati_failures()
    }

    /// The attitude to command to a vehicle that holds it, so that the vehicle is at `wanted` when the command acts: ahead of it
    /// by the angle from which the on-board loop makes the rate of the reference, less the estimated bias.
    fn attitude_command(&self, wanted: &AttitudeReference) -> Attitude {
        let Rotation::AttitudeLoop { gain_per_s, .. } = self.design.model.rotation else {
            return wanted.attitude;
        };
        let input = &self.design.input;
        let on_reference = AttitudeError::between(&wanted.attitude, &wanted.attitude);
        let u = input.feed_forward(&on_reference, &Vector3::zeros(), wanted);
        let rate = input.demand_of(&u) - self.observer.bias().demand;
        wanted.attitude.turned_by(rate / gain_per_s)
    }

    /// The law's input minus the estimated bias.
    fn rotate(&mut self, motion: &Motion, wanted: &AttitudeReference, dt_s: f64) -> Vector3<f64> {
        let bias = self.observer.bias();
        let state = AttitudeState { attitude: motion.attitude, rate: BodyRate(motion.rate) };
        let Design { input, .. } = &self.design;
        let demanded = self.attitude.input(&state, wanted, dt_s);
        let u = demanded - input.input_for(&bias.demand);
        input.saturate(&u.component_div(&self.history.effect().gain))
    }
}
