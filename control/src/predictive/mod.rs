//! Flying with what is known: estimation, prediction over the loop's delay and a reference that can
//! be followed, around the law [`OqtalDt`]. Not in the paper.
//!
//! ```text
//!  reference ─▶ reference model ─▶ position law ─▶ flatness ─▶ OqtalDt ─▶ command ─▶ vehicle
//!                                      ▲                         ▲           │
//!                     predicted motion ┴─────────────────────────┘           │ and when it acts
//!                            ▲                                               ▼
//!  poses ──▶ Kalman filters ─┴──────────────◀─────────────── commands already sent
//! ```
//!
//! | file | subject |
//! |---|---|
//! | `model.rs` | the vehicle as it is known |
//! | `history.rs` | commands sent, and the delay as measured |
//! | `kalman.rs`, `attitude_filter.rs`, `position_filter.rs` | the filters |
//! | `observer.rs` | both about one motion; on the floor, differences |
//! | `reference_model.rs` | a reference within speed, acceleration and jerk |
//! | `position_law.rs`, `command_filter.rs` | the acceleration to have |
//! | `flatness.rs` | the attitude, rate and angular acceleration for it |
//! | `lead.rs` | a prescribed attitude at the instant of effect |
//! | `setpoint_buffer.rs` | what was decided for which instant |
//! | `ring.rs` | the newest of something |
//!
//! Everything a law sees is for one instant, that at which a command sent now will act: the motion
//! is predicted to it, and the reference is the one for it. What is reported as the setpoint for now was
//! decided a delay ago.

mod attitude_filter;
mod command_filter;
mod flatness;
mod history;
mod kalman;
mod look_ahead;
mod model;
mod observer;
mod options;
mod position_filter;
mod position_law;
mod reference_model;
mod ring;
mod setpoint_buffer;

use nalgebra::Vector3;

use crate::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, InputForm, OqtalDt, OqtalDtOptions,
};
use crate::estimator::Estimate;
use crate::options::OptionError;
use crate::position::{PositionCommand, PositionOptions};
use crate::quantity::BodyRate;
use crate::trajectory::Reference;
pub use attitude_filter::AttitudeFilter;
pub use command_filter::{CommandFilter, Smooth};
pub use flatness::Force;
pub use history::CommandHistory;
pub use kalman::{Covariance, StateTransition};
pub use look_ahead::LookAhead;
pub use model::{Bias, ModelInput, Motion, Rotation, VehicleModel};
pub use observer::MotionObserver;
pub use options::{FilterOptions, PredictiveOptions};
pub use position_filter::PositionFilter;
pub use position_law::{PositionLaw, Setpoint};
pub use reference_model::{Course, MotionLimits, ReferenceModel, ReferenceModelOptions};
use setpoint_buffer::SetpointBuffer;

/// Time without a decision beyond this does not count \[s\]: the reference waits.
const LONGEST_STEP_S: f64 = 0.1;

/// The cosine of the tilt by which the thrust is divided is at least this: that of 60 degrees.
const LEAST_COSINE: f64 = 0.5;

/// What the autopilot is made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Design<I> {
    /// The vehicle.
    pub model: VehicleModel,
    /// How it is commanded.
    pub input: I,
    /// From a command sent to its effect, until measured \[s\].
    pub delay_s: f64,
    /// From step to step \[s\].
    pub period_s: f64,
}

/// What the autopilot decides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictiveOutput {
    /// What the vehicle should do now, as decided a delay ago, and the thrust that it is told.
    pub setpoint: PositionCommand,
    /// The input to the rotation, within the vehicle's range.
    pub u: Vector3<f64>,
}

/// Estimation, prediction, position law and attitude law in one. No step allocates.
#[derive(Clone, Debug, PartialEq)]
pub struct Autopilot<I> {
    design: Design<I>,
    observer: MotionObserver,
    history: CommandHistory,
    position: PositionLaw,
    attitude: OqtalDt<I>,
    setpoint_buffer: SetpointBuffer,
    lead: LookAhead,
    /// When it last decided \[s\].
    last_s: Option<f64>,
}

impl<I: InputForm + Copy> Autopilot<I> {
    /// The autopilot of a vehicle, within the limits of `loops`.
    ///
    /// # Errors
    /// An option of the attitude law whose value has no meaning.
    pub fn new(
        design: Design<I>,
        law: OqtalDtOptions,
        options: &PredictiveOptions,
        loops: &PositionOptions,
    ) -> Result<Self, OptionError> {
        Ok(Self {
            observer: MotionObserver::new(design.model, options.filter),
            history: CommandHistory::new(design.delay_s),
            position: PositionLaw::new(options, loops, design.model.gravity_m_s2),
            attitude: OqtalDt::new(law, design.input, design.period_s)?,
            setpoint_buffer: SetpointBuffer::new(),
            lead: LookAhead::default(),
            last_s: None,
            design,
        })
    }

    /// Starts anew with a vehicle that stands; what was sent, and the delay measured, is kept.
    pub fn reset(&mut self) {
        self.observer.reset();
        self.position.reset();
        self.setpoint_buffer = SetpointBuffer::new();
        self.lead.reset();
        self.last_s = None;
    }

    /// Takes the pose captured at `t_s` \[s\], with rates from differences.
    pub fn observe(&mut self, t_s: f64, measured: &Estimate) {
        self.observer.take(t_s, measured, &self.history);
    }

    /// Remembers a command as it was sent at `t_s` \[s\]: `u`, and the thrust \[N\] of a vehicle that
    /// only pushes.
    pub fn sent(&mut self, sequence: u64, t_s: f64, (u, thrust_n): (&Vector3<f64>, f64)) {
        let demand = self.design.input.demand_of(&self.design.input.saturate(u));
        let thrust_n = if thrust_n.is_finite() { thrust_n.max(0.0) } else { 0.0 };
        self.history.push(sequence, t_s, ModelInput { demand, thrust_n });
    }

    /// Learns that a command began to act at `t_s` \[s\].
    pub fn applied(&mut self, sequence: u64, t_s: f64) {
        self.history.applied(sequence, t_s);
    }

    /// From a command sent to its effect \[s\], as measured.
    #[must_use]
    pub fn delay_s(&self) -> f64 {
        self.history.delay_s()
    }

    /// The command at `now_s` \[s\] for a vehicle that should be at `reference`. `None` before the
    /// first pose, if no time has passed, and if a number is not finite or so great that one becomes
    /// it; nothing of that is remembered.
    pub fn decide(&mut self, now_s: f64, reference: &Reference) -> Option<PredictiveOutput> {
        let since_s = self.last_s.map_or(self.design.period_s, |last| now_s - last);
        let (dt_s, delay_s) = (since_s.min(LONGEST_STEP_S), self.history.delay_s());
        let motion = self.observer.predict(now_s + delay_s, &self.history)?;
        let sound = motion.is_finite() && reference.is_finite() && now_s.is_finite();
        if !sound || dt_s <= 0.0 {
            return None;
        }
        let setpoint = self.setpoint(&motion, reference, (dt_s, delay_s))?;
        let u = self.rotate(&motion, &setpoint.attitude);
        self.setpoint_buffer.push(now_s + delay_s, setpoint);
        self.last_s = Some(now_s);
        let mut now = self.setpoint_buffer.at(now_s)?;
        now.attitude = reference.attitude.unwrap_or(now.attitude);
        Some(PredictiveOutput {
            setpoint: PositionCommand { thrust_n: setpoint.thrust_n, ..now },
            u,
        })
    }

    /// What the vehicle should do when it will be at `motion`.
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
        let thrust_n = self.design.model.mass_kg * force.value.z / cosine;
        let numbers = velocity.iter().chain(&force.value).chain([&thrust_n]);
        if attitude.is_finite() && numbers.copied().all(f64::is_finite) {
            return Some(PositionCommand { attitude, thrust_n, velocity });
        }
        self.position.reset();
        self.lead.reset();
        None
    }

    /// Riccati equations solved so far.
    #[must_use]
    pub fn riccati_solves(&self) -> u32 {
        self.attitude.riccati_solves()
    }

    /// The law's input, less the bias that the filters know of.
    fn rotate(&self, motion: &Motion, wanted: &AttitudeReference) -> Vector3<f64> {
        let bias = self.observer.bias();
        let state = AttitudeState { attitude: motion.attitude, rate: BodyRate(motion.rate) };
        let Design { input, .. } = &self.design;
        input.saturate(&(self.attitude.input(&state, wanted) - input.input_for(&bias.demand)))
    }
}
