//! The trajectory that is flown: one of the shapes, at the hover point.

use nalgebra::Vector3;

use super::attitude::{AttitudeChirp, AttitudeDoublet};
use super::excitation::ExcitationCourse;
use super::reference::{Phase, Reference};
use super::shape::{Circle, Hover, Lemniscate, Square, Step};
use super::waypoints::{WaypointCurve, Waypoints};

/// The part of a flight under test, in a frame with its origin on the floor below the hover point and the axes of the world. Made
/// by [`TrajectoryOptions::trajectory`](super::TrajectoryOptions::trajectory).
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    pub(super) shape: TrajectoryShape,
    /// Hover point above the start \[m, world\].
    pub(super) hover_point: Vector3<f64>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum TrajectoryShape {
    Hover(Hover),
    Step(Step),
    Square(Square),
    Circle(Circle),
    Lemniscate(Lemniscate),
    AttitudeChirp(AttitudeChirp),
    AttitudeDoublet(AttitudeDoublet),
    Excitation(ExcitationCourse),
    Waypoints(Waypoints),
}

impl Trajectory {
    /// The reference at `t_s` \[s\] after the start of the trajectory. Times before the start count as the start,
    /// times after the end as the end.
    pub fn sample(&self, t_s: f64) -> Reference {
        let duration_s = self.duration_s();
        let mut reference = self.course(t_s.min(duration_s).max(0.0));
        if t_s >= duration_s {
            // At rest from here on, whatever the derivatives at the end of the curve.
            [reference.velocity, reference.acceleration] = [Vector3::zeros(); 2];
            [reference.jerk, reference.snap] = [Vector3::zeros(); 2];
            (reference.yaw_rate_rad_s, reference.yaw_acceleration_rad_s2) = (0.0, 0.0);
        }
        reference
    }

    /// The same trajectory with its waypoints, if it has some, joined by `curve`.
    pub fn along(self, curve: WaypointCurve) -> Self {
        let shape = match self.shape {
            TrajectoryShape::Waypoints(points) => TrajectoryShape::Waypoints(points.along(curve)),
            other => other,
        };
        Self { shape, ..self }
    }

    /// The reference at `t_s` \[s\] in 0..duration.
    fn course(&self, t_s: f64) -> Reference {
        let mut reference = match &self.shape {
            TrajectoryShape::Hover(_) => Reference::rest(Vector3::zeros(), Phase::Trajectory),
            TrajectoryShape::Step(step) => step.sample(t_s),
            TrajectoryShape::Square(square) => square.sample(t_s),
            TrajectoryShape::Circle(circle) => circle.sample(t_s),
            TrajectoryShape::Lemniscate(lemniscate) => lemniscate.sample(t_s),
            TrajectoryShape::AttitudeChirp(chirp) => chirp.sample(t_s),
            TrajectoryShape::AttitudeDoublet(doublet) => doublet.sample(t_s),
            TrajectoryShape::Excitation(excitation) => excitation.sample(t_s),
            // Waypoints are not relative to the hover point.
            TrajectoryShape::Waypoints(waypoints) => return waypoints.sample(t_s),
        };
        reference.position += self.hover_point;
        reference
    }

    /// Duration of the trajectory \[s\].
    pub fn duration_s(&self) -> f64 {
        match &self.shape {
            TrajectoryShape::Hover(hover) => hover.duration_s,
            TrajectoryShape::Step(step) => step.duration_s,
            TrajectoryShape::Square(square) => square.duration_s,
            TrajectoryShape::Circle(circle) => circle.sweep().duration_s(),
            TrajectoryShape::Lemniscate(lemniscate) => lemniscate.sweep().duration_s(),
            TrajectoryShape::AttitudeChirp(chirp) => chirp.duration_s(),
            TrajectoryShape::AttitudeDoublet(doublet) => doublet.duration_s(),
            TrajectoryShape::Excitation(excitation) => excitation.duration_s(),
            TrajectoryShape::Waypoints(waypoints) => waypoints.duration_s(),
        }
    }

    /// Times at which the acceleration may jump \[s\]: those of the waypoints.
    pub fn corners_s(&self) -> impl Iterator<Item = f64> {
        let waypoints = match &self.shape {
            TrajectoryShape::Waypoints(waypoints) => Some(waypoints.times_s()),
            _ => None,
        };
        waypoints.into_iter().flatten()
    }

    /// Whether the trajectory prescribes attitudes. Only the times with a prescribed attitude are then scored.
    pub(super) fn is_of_attitude(&self) -> bool {
        matches!(
            self.shape,
            TrajectoryShape::AttitudeChirp(_) | TrajectoryShape::AttitudeDoublet(_)
        )
    }
}
