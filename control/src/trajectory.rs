//! References: the desired motion at each time of a flight.
//!
//! A [`Trajectory`] is the part of a flight that is under test; a [`FlightPlan`] puts take-off, settling and landing
//! around it. Both are pure functions of time.

mod attitude;
mod detour;
mod excitation;
mod options;
mod path;
mod plan;
mod reference;
pub mod shape;
mod waypoints;

pub use attitude::{AttitudeChirp, AttitudeDoublet};
pub use detour::{Detour, Leg, LegLimits, ReferenceMotion};
pub use excitation::Excitation;
pub use options::{TrajectoryKind, TrajectoryOptions};
pub use path::Trajectory;
pub use plan::{FlightPlan, StartPoint};
pub use reference::{Phase, Reference};
pub use waypoints::{WaypointCurve, WaypointError, WaypointProblem, Waypoints};
