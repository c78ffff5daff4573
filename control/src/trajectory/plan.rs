//! A whole flight: take-off, settling, trajectory, landing.

use nalgebra::{Vector3, Vector4};

use super::detour::{Detour, placed};
use super::options::TrajectoryOptions;
use super::path::{Trajectory, TrajectoryShape};
use super::reference::{Phase, Reference};
use crate::euler::shorter_turn;

/// Depth below the floor at which the landing ends \[m\], so that the vehicle reaches the floor even if the floor is
/// slightly lower.
const LANDING_DEPTH_M: f64 = 0.1;

/// Least duration of a descent \[s\].
const LEAST_DESCENT_S: f64 = 1.0;

/// Time at height before a hover is scored \[s\].
const HOVER_TRANSIENT_S: f64 = 10.0;

/// Greatest slope of [`minimum_jerk`], half-way.
const MINIMUM_JERK_PEAK: f64 = 1.875;

/// A position and a heading.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StartPoint {
    /// Position \[m, world\].
    pub position: Vector3<f64>,
    /// 3-2-1 yaw \[rad\].
    pub yaw_rad: f64,
}

impl From<Reference> for StartPoint {
    fn from(reference: Reference) -> Self {
        Self { position: reference.position, yaw_rad: reference.yaw_rad }
    }
}

/// The references of a whole flight as a function of the time since its start.
///
/// The flight is relative to the pose of the vehicle at the start: its position is the origin of the path, whose axes
/// are those of the world, and its yaw is the zero of the yaw. While it settles the vehicle turns to the heading in which a path
/// through waypoints begins.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightPlan {
    trajectory: Trajectory,
    /// Yaw of the first waypoint \[rad\]; zero for other trajectories.
    first_yaw_rad: f64,
    start: StartPoint,
    take_off_s: f64,
    /// Time from the start of the flight to that of the trajectory \[s\].
    trajectory_start_s: f64,
    descent_m_s: f64,
    planned_landing_s: f64,
    landing: Landing,
    /// The change of the flight, and its start from that of the flight \[s\].
    detour: Option<(f64, Detour)>,
    /// Time of the first detour, which is not scored \[s\]; infinite without one.
    scored_until_s: f64,
}

impl FlightPlan {
    /// The flight of `trajectory` from `start`; `options` must pass their check.
    pub fn new(options: &TrajectoryOptions, trajectory: Trajectory, start: StartPoint) -> Self {
        let trajectory_start_s = options.start_s();
        let end_s = trajectory_start_s + options.duration_s.unwrap_or(trajectory.duration_s());
        let first_yaw_rad = match &trajectory.shape {
            TrajectoryShape::Waypoints(waypoints) => waypoints.sample(0.0).yaw_rad,
            _ => 0.0,
        };
        let mut plan = Self {
            trajectory,
            first_yaw_rad,
            start,
            take_off_s: options.take_off_s,
            trajectory_start_s,
            descent_m_s: options.descent_m_s,
            planned_landing_s: end_s,
            landing: Landing::NEVER,
            detour: None,
            scored_until_s: f64::INFINITY,
        };
        plan.land_from(end_s, plan.sample(end_s).into());
        plan
    }

    /// The flight of `trajectory` from the origin; `options` must pass their check.
    pub fn from_origin(options: &TrajectoryOptions, trajectory: &Trajectory) -> Self {
        Self::new(options, trajectory.clone(), StartPoint::default())
    }

    /// The reference at `t_s` \[s\] after the start of the flight.
    pub fn sample(&self, t_s: f64) -> Reference {
        if t_s > self.landing.start_s {
            return self.landing.sample(t_s);
        }
        match &self.detour {
            Some((start_s, detour)) if t_s >= *start_s => detour.sample(t_s - start_s),
            _ => placed(self.relative(t_s), &self.origin()),
        }
    }

    /// Start of the flight, the origin of its path, with the zero of its yaw \[m, world; rad\].
    pub fn origin(&self) -> Vector4<f64> {
        self.start.position.push(self.start.yaw_rad)
    }

    /// Flies `detour` from `t_s` \[s\] after the start of the flight on, in place of the rest of the plan. No landing is planned any
    /// more.
    pub fn redirect(&mut self, t_s: f64, detour: Detour) {
        self.detour = Some((t_s, detour));
        self.scored_until_s = self.scored_until_s.min(t_s);
        (self.landing, self.planned_landing_s) = (Landing::NEVER, f64::INFINITY);
    }

    /// Whether the reference rests, `t_s` \[s\] after the start of the flight, at the end of a detour.
    pub fn has_arrived(&self, t_s: f64) -> bool {
        self.detour.as_ref().is_some_and(|(start_s, detour)| t_s > start_s + detour.duration_s())
    }

    /// Time from the start of the flight at which the landing is planned, even if another landing has begun earlier \[s\].
    pub fn planned_landing_s(&self) -> f64 {
        self.planned_landing_s
    }

    /// Discards a landing in progress whose path the vehicle has left.
    pub fn forget_landing(&mut self) {
        self.landing = Landing::NEVER;
    }

    /// Begins a landing from `from` at `t_s` \[s\] after the start of the flight. A landing in progress is not restarted.
    pub fn land_from(&mut self, t_s: f64, from: StartPoint) {
        if t_s <= self.landing.start_s {
            let depth_m = (from.position.z - self.start.position.z + LANDING_DEPTH_M).max(0.0);
            self.landing = Landing {
                start_s: t_s,
                duration_s: (MINIMUM_JERK_PEAK * depth_m / self.descent_m_s).max(LEAST_DESCENT_S),
                from,
                depth_m,
            };
        }
    }

    /// Whether the errors at `t_s` \[s\] are scored: during the trajectory's own duration; of a hover, from 10 s
    /// after the hover point is reached; of a trajectory that prescribes attitudes, while one is prescribed.
    pub fn scored(&self, t_s: f64) -> bool {
        let (from_s, to_s) = match self.trajectory.shape {
            TrajectoryShape::Hover(_) => {
                (self.trajectory_start_s.max(self.take_off_s + HOVER_TRANSIENT_S), f64::INFINITY)
            }
            _ => (self.trajectory_start_s, self.trajectory_start_s + self.trajectory.duration_s()),
        };
        (from_s..=to_s.min(self.landing.start_s).min(self.scored_until_s)).contains(&t_s)
            && (!self.trajectory.is_of_attitude() || self.sample(t_s).attitude.is_some())
    }

    /// Time in which the vehicle turns to the heading of the first waypoint at no more than `rate_rad_s` \[rad/s\] \[s\].
    pub fn first_turn_s(&self, rate_rad_s: f64) -> f64 {
        MINIMUM_JERK_PEAK * self.first_turn_rad().abs() / rate_rad_s
    }

    /// Time from the start of the flight at which the reference reaches the end of the landing \[s\].
    pub fn end_s(&self) -> f64 {
        self.landing.start_s + self.landing.duration_s
    }

    /// The reference before the landing, relative to the start.
    fn relative(&self, t_s: f64) -> Reference {
        if t_s >= self.trajectory_start_s {
            return self.trajectory.sample(t_s - self.trajectory_start_s);
        }
        let turn_rad = self.first_turn_rad();
        let hover_point = self.trajectory.hover_point;
        if t_s >= self.take_off_s {
            let settle_s = self.trajectory_start_s - self.take_off_s;
            let turn = minimum_jerk((t_s - self.take_off_s) / settle_s, settle_s);
            return Reference {
                yaw_rad: self.first_yaw_rad + turn_rad * (turn[0] - 1.0),
                yaw_rate_rad_s: turn_rad * turn[1],
                yaw_acceleration_rad_s2: turn_rad * turn[2],
                ..Reference::rest(hover_point, Phase::Settle)
            };
        }
        let course = minimum_jerk(t_s / self.take_off_s, self.take_off_s);
        // Whole turns of the first yaw are there from the beginning: the yaw is continuous.
        let yaw_rad = self.first_yaw_rad - turn_rad;
        Reference {
            yaw_rad,
            ..Reference::moving(course.map(|share| hover_point * share), Phase::TakeOff)
        }
    }

    /// The turn to the first waypoint's heading, the shorter way \[rad\].
    fn first_turn_rad(&self) -> f64 {
        shorter_turn(self.first_yaw_rad)
    }
}

/// A minimum-jerk descent straight down.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Landing {
    /// Start of the descent, from the start of the flight \[s\].
    start_s: f64,
    duration_s: f64,
    from: StartPoint,
    depth_m: f64,
}

impl Landing {
    /// No landing yet.
    const NEVER: Self = Self {
        start_s: f64::INFINITY,
        duration_s: LEAST_DESCENT_S,
        from: StartPoint { position: Vector3::new(0.0, 0.0, 0.0), yaw_rad: 0.0 },
        depth_m: 0.0,
    };

    fn sample(&self, t_s: f64) -> Reference {
        let mut unit_s = 1.0;
        let mut course = minimum_jerk((t_s - self.start_s) / self.duration_s, 1.0).map(|share| {
            let down = self.depth_m * share / unit_s;
            unit_s *= self.duration_s;
            -Vector3::z() * down
        });
        course[0] += self.from.position;
        Reference { yaw_rad: self.from.yaw_rad, ..Reference::moving(course, Phase::Landing) }
    }
}

/// The minimum-jerk course from rest at 0 to rest at 1 in `duration_s` \[s\], with its first four derivatives by time, for `progress`
/// 0..1: the polynomial of fifth degree whose first and second derivatives vanish at both ends (Flash and Hogan, J. Neurosci. 5
/// (1985) 1688).
fn minimum_jerk(progress: f64, duration_s: f64) -> [f64; 5] {
    let x = progress.clamp(0.0, 1.0);
    let rest = 1.0 - x;
    let moves = if (0.0..1.0).contains(&progress) { 1.0 } else { 0.0 };
    [
        x * x * x * (10.0 + x * (6.0 * x - 15.0)),
        30.0 * x * x * rest * rest / duration_s,
        60.0 * x * rest * (rest - x) / duration_s.powi(2),
        moves * (60.0 - 360.0 * x * rest) / duration_s.powi(3),
        moves * 360.0 * (x - rest) / duration_s.powi(4),
    ]
}
