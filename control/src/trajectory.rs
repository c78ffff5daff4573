//! References: where the vehicle should be at each time of a flight.
//!
//! A [`Trajectory`] is the part of a flight that is under test; a [`FlightPlan`] puts take-off, settling and landing
//! around it. Both are pure functions of time.

use std::fmt;

use nalgebra::Vector3;

use crate::tracking_error::AttitudeReference;
pub use attitude::{AttitudeChirp, AttitudeDoublet};
pub use options::{TrajectoryKind, TrajectoryOptions};
pub use plan::{FlightPlan, StartPoint};
pub use waypoints::{WaypointError, WaypointProblem, Waypoints};

mod attitude;
mod options;
mod plan;
pub mod shape;
mod waypoints;

/// The desired motion at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reference {
    /// Desired position \[m, world\].
    pub position: Vector3<f64>,
    /// Desired velocity \[m/s, world\]; zero where the position jumps.
    pub velocity: Vector3<f64>,
    /// Desired 3-2-1 yaw \[rad\].
    pub yaw_rad: f64,
    /// An attitude to fly instead of the horizontal position, with its rate and acceleration for
    /// the laws that feed them forward.
    pub attitude: Option<AttitudeReference>,
    /// The part of the flight.
    pub phase: Phase,
}

impl Reference {
    /// Rest at `position` \[m, world\], body axes along the world's.
    #[must_use]
    pub fn rest(position: Vector3<f64>, phase: Phase) -> Self {
        Self { position, velocity: Vector3::zeros(), yaw_rad: 0.0, attitude: None, phase }
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.position.iter().chain(&self.velocity).all(|number| number.is_finite())
            && self.yaw_rad.is_finite()
            && self.attitude.is_none_or(|attitude| attitude.is_finite())
    }
}

/// The parts of a flight, in their order. The numbers are for messages and recordings and never change; 0 is not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Phase {
    /// From the floor to the hover point.
    TakeOff = 1,
    /// At rest at the hover point.
    Settle = 2,
    /// The trajectory under test.
    Trajectory = 3,
    /// Down to the floor.
    Landing = 4,
}

impl Phase {
    /// The phase of that number.
    #[must_use]
    pub fn from_number(number: u8) -> Option<Self> {
        [Self::TakeOff, Self::Settle, Self::Trajectory, Self::Landing]
            .into_iter()
            .find(|phase| *phase as u8 == number)
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::TakeOff => "take-off",
            Self::Settle => "settle",
            Self::Trajectory => "trajectory",
            Self::Landing => "landing",
        })
    }
}

/// The part of a flight that is under test, in a frame with its origin on the floor below the hover point and the axes
/// of the world. Made by [`TrajectoryOptions::trajectory`].
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    shape: Shape,
    hover_point: Vector3<f64>,
}

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    Hover(shape::Hover),
    Step(shape::Step),
    Square(shape::Square),
    Circle(shape::Circle),
    Lemniscate(shape::Lemniscate),
    AttitudeChirp(AttitudeChirp),
    AttitudeDoublet(AttitudeDoublet),
    Waypoints(Waypoints),
}

impl Trajectory {
    /// The reference at `t_s` \[s\] after the start of the trajectory. Before the start it is that of the start, after the
    /// end that of the end.
    #[must_use]
    pub fn sample(&self, t_s: f64) -> Reference {
        let t_s = t_s.min(self.duration_s()).max(0.0);
        let mut reference = match &self.shape {
            Shape::Hover(_) => Reference::rest(Vector3::zeros(), Phase::Trajectory),
            Shape::Step(step) => step.sample(t_s),
            Shape::Square(square) => square.sample(t_s),
            Shape::Circle(circle) => circle.sample(t_s),
            Shape::Lemniscate(lemniscate) => lemniscate.sample(t_s),
            Shape::AttitudeChirp(chirp) => chirp.sample(t_s),
            Shape::AttitudeDoublet(doublet) => doublet.sample(t_s),
            // Waypoints are not relative to the hover point.
            Shape::Waypoints(waypoints) => return waypoints.sample(t_s),
        };
        reference.position += self.hover_point;
        reference
    }

    /// How long the trajectory lasts \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        match &self.shape {
            Shape::Hover(hover) => hover.duration_s,
            Shape::Step(step) => step.duration_s,
            Shape::Square(square) => square.duration_s,
            Shape::Circle(circle) => circle.sweep().duration_s(),
            Shape::Lemniscate(lemniscate) => lemniscate.sweep().duration_s(),
            Shape::AttitudeChirp(chirp) => chirp.duration_s(),
            Shape::AttitudeDoublet(doublet) => doublet.duration_s(),
            Shape::Waypoints(waypoints) => waypoints.duration_s(),
        }
    }

    /// Whether this is about the attitude alone: then only what prescribes one counts.
    fn is_of_attitude(&self) -> bool {
        matches!(self.shape, Shape::AttitudeChirp(_) | Shape::AttitudeDoublet(_))
    }
}
