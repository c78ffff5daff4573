//! The section `[trajectory]` of a configuration.

use std::path::PathBuf;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::attitude::{AttitudeChirp, AttitudeDoublet};
use super::excitation::Excitation;
use super::path::{Trajectory, TrajectoryShape};
use super::shape::{Circle, Hover, Lemniscate, MAX_DURATION_S, Square, Step};
use super::waypoints::{WaypointCurve, Waypoints};
use crate::options::{OptionError, Rule, check_options};

/// Kind of trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrajectoryKind {
    /// [`Hover`]
    Hover,
    /// [`Step`]
    Step,
    /// [`Square`]
    Square,
    /// [`Circle`]
    Circle,
    /// [`Lemniscate`]
    Lemniscate,
    /// [`AttitudeChirp`]
    AttitudeChirp,
    /// [`AttitudeDoublet`]
    AttitudeDoublet,
    /// [`Excitation`]
    Excitation,
    /// The motions of [`Excitation`] that show delays, lags, rate gains and thrust, in 20 s
    BriefExcitation,
    /// [`Waypoints`]
    Waypoints,
}

/// Options of a flight: the kind of trajectory, the parameters of each kind, take-off and landing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct TrajectoryOptions {
    /// The trajectory to fly.
    pub kind: TrajectoryKind,
    /// Duration of the trajectory in place of its own \[s\]: the trajectory is truncated, or held at its end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub duration_s: Option<f64>,
    /// File of the waypoints, for [`TrajectoryKind::Waypoints`]. The caller reads the file: see [`Waypoints::parse`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub waypoints_file: Option<PathBuf>,
    /// Curve between the waypoints.
    pub waypoints_curve: WaypointCurve,
    /// Height of the hover point over the floor \[m\].
    pub height_m: f64,
    /// Time of the take-off \[s\].
    pub take_off_s: f64,
    /// Time at rest between take-off and trajectory \[s\].
    pub settle_s: f64,
    /// Greatest speed of the descent \[m/s\].
    pub descent_m_s: f64,
    /// Parameters of the hover.
    pub hover: Hover,
    /// Parameters of the step.
    pub step: Step,
    /// Parameters of the square.
    pub square: Square,
    /// Parameters of the circle.
    pub circle: Circle,
    /// Parameters of the lemniscate.
    pub lemniscate: Lemniscate,
    /// Parameters of the attitude chirp.
    pub attitude_chirp: AttitudeChirp,
    /// Parameters of the attitude doublet.
    pub attitude_doublet: AttitudeDoublet,
    /// Parameters of the excitation.
    pub excitation: Excitation,
}

impl Default for TrajectoryOptions {
    fn default() -> Self {
        Self {
            kind: TrajectoryKind::Square,
            duration_s: None,
            waypoints_file: None,
            waypoints_curve: WaypointCurve::default(),
            height_m: 1.0,
            take_off_s: 2.5,
            settle_s: 4.0,
            descent_m_s: 0.4,
            hover: Hover::default(),
            step: Step::default(),
            square: Square::default(),
            circle: Circle::default(),
            lemniscate: Lemniscate::default(),
            attitude_chirp: AttitudeChirp::default(),
            attitude_doublet: AttitudeDoublet::default(),
            excitation: Excitation::default(),
        }
    }
}

impl TrajectoryOptions {
    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("duration-s", self.duration_s.unwrap_or(0.0), Rule::Between(0.0, MAX_DURATION_S)),
            ("height-m", self.height_m, Rule::Between(0.1, 100.0)),
            ("take-off-s", self.take_off_s, Rule::Between(0.5, 60.0)),
            ("settle-s", self.settle_s, Rule::Between(0.0, 3600.0)),
            ("descent-m-s", self.descent_m_s, Rule::Between(0.05, 2.0)),
        ])?;
        self.hover.check().map_err(|error| error.within("hover"))?;
        self.step.check().map_err(|error| error.within("step"))?;
        self.square.check().map_err(|error| error.within("square"))?;
        self.circle.check().map_err(|error| error.within("circle"))?;
        self.lemniscate.check().map_err(|error| error.within("lemniscate"))?;
        self.attitude_chirp.check().map_err(|error| error.within("attitude-chirp"))?;
        self.attitude_doublet.check().map_err(|error| error.within("attitude-doublet"))?;
        self.excitation.check().map_err(|error| error.within("excitation"))
    }

    /// Time from the take-off to the beginning of the trajectory \[s\].
    pub fn start_s(&self) -> f64 {
        self.take_off_s + self.settle_s
    }

    /// The trajectory that these options name. `waypoints` is the content of the file, used by
    /// [`TrajectoryKind::Waypoints`] only; that kind without waypoints gives `None`.
    pub fn trajectory(&self, waypoints: Option<Waypoints>) -> Option<Trajectory> {
        let shape = match self.kind {
            TrajectoryKind::Hover => TrajectoryShape::Hover(self.hover),
            TrajectoryKind::Step => TrajectoryShape::Step(self.step),
            TrajectoryKind::Square => TrajectoryShape::Square(self.square),
            TrajectoryKind::Circle => TrajectoryShape::Circle(self.circle),
            TrajectoryKind::Lemniscate => TrajectoryShape::Lemniscate(self.lemniscate),
            TrajectoryKind::AttitudeChirp => TrajectoryShape::AttitudeChirp(self.attitude_chirp),
            TrajectoryKind::AttitudeDoublet => {
                TrajectoryShape::AttitudeDoublet(self.attitude_doublet)
            }
            TrajectoryKind::Excitation => TrajectoryShape::Excitation(self.excitation.whole()),
            TrajectoryKind::BriefExcitation => TrajectoryShape::Excitation(self.excitation.brief()),
            TrajectoryKind::Waypoints => {
                TrajectoryShape::Waypoints(waypoints?.along(self.waypoints_curve))
            }
        };
        Some(Trajectory { shape, hover_point: Vector3::new(0.0, 0.0, self.height_m) })
    }
}
