//! The interface of a control stack.

use oqtal_control::estimator::Estimate;
use oqtal_control::position::{OuterLoop, PositionCommand};
use oqtal_control::predictive::{AdaptedModel, CommandReport, FilterInnovation, Motion};
use oqtal_control::scalar_pid::PidGains;
use oqtal_control::trajectory::Reference;

use crate::command::VehicleCommand;

/// A rotation command this close to its limit counts as saturated \[-\], as a fraction of the limit.
pub(super) const SATURATED: f64 = 1.0 - 1e-9;

/// The output of a control stack in one tick.
#[derive(Clone, Copy, Debug)]
pub struct ControlOutput {
    /// The setpoint of the outer loops.
    pub setpoint: PositionCommand,
    /// The command to the vehicle.
    pub command: VehicleCommand,
    /// Whether the rotation command is at its limit.
    pub saturated: bool,
}

/// The instant of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlStep {
    /// The present instant \[s since the clock's origin\].
    pub now_s: f64,
    /// Time since the last tick \[s\].
    pub dt_s: f64,
}

/// A control stack. No method allocates.
pub trait FlightStack {
    /// Takes an accepted pose captured at `captured_s` \[s since the clock's origin\], with the rates estimated from it.
    fn observe(&mut self, captured_s: f64, measured: &Estimate);

    /// The output at `step` for a vehicle at `estimate` that should be at `reference`. `None` if the stack has no pose to work
    /// with.
    fn decide(
        &mut self,
        step: ControlStep,
        estimate: &Estimate,
        reference: &Reference,
    ) -> Option<ControlOutput>;

    /// The motion that a filter of the stack itself estimates at the capture of the last pose, and the innovation of that pose;
    /// `None` if the stack has no filter or no pose.
    fn filtered(&self) -> Option<(&Motion, Option<&FilterInnovation>)> {
        None
    }

    /// Records the command that was sent at `sent_s` \[s since the clock's origin\], for predictions.
    fn sent(&mut self, sequence: u64, sent_s: f64, command: &VehicleCommand);

    /// Records that a command took effect, at a time since the clock's origin.
    fn applied(&mut self, report: CommandReport);

    /// The model that the stack adapted in flight; `None` if it flies with the configured one.
    fn adapted(&self) -> Option<AdaptedModel> {
        None
    }

    /// Replaces the gains of one of the outer loops of Fig. 16; without effect on a stack that has others.
    fn set_loop(&mut self, _: OuterLoop, _: PidGains) {}

    /// Resets integrators and filters for a new flight. Counters are kept.
    fn reset(&mut self);

    /// Number of Riccati equations solved so far \[-\].
    fn riccati_solves(&self) -> u32;

    /// Number of Riccati equations without a solution so far \[-\]; the law then keeps its last gain.
    fn riccati_failures(&self) -> u32;
}
