//! The flight at a tick in which an external law is asked.

use oqtal_bus::time::Time;
use oqtal_control::predictive::{Motion, MotionTracker};
use oqtal_control::trajectory::Reference;

use crate::stack::ControlOutput;

/// The flight at a tick in which an external law is asked.
#[derive(Clone, Copy)]
pub struct QuestionView<'a> {
    /// The present instant.
    pub now: Time,
    /// The motion predicted for the command's effect.
    pub ahead: &'a Motion,
    /// Bias and delay of the prediction.
    pub tracker: &'a MotionTracker,
    /// The reference for the command's effect.
    pub reference: &'a Reference,
    /// The reference at an instant; `None` while it is not that of the plan or of a planner.
    pub course: &'a dyn Fn(Time) -> Option<Reference>,
    /// The output of the fallback law.
    pub fallback: &'a ControlOutput,
}
