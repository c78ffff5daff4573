//! A reference that the vehicle can follow: towards the one it is given at limited speed,
//! acceleration and jerk.
//!
//! ```text
//! v_d = v_t + f(e) e/|e|,   f(e) = min(k_p |e|, sqrt(2 a_b (|e| - a_b / 2 k_p^2)), v_max)
//! a_d = k_v (v_d - v) + d v_d / dt
//! j_d = k_a (a_d - a)
//! s   = k_j (j_d - j)
//! ```
//!
//! `e` is the way left, `a_b` the deceleration with which it is braked for: near the target `f`
//! rises with slope `k_p`, further away as braking allows. Not in the paper.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::range::{OutOfRange, check_range};

/// The model is integrated in steps of this share of a tick: its quickest gain is of the order of
/// the loop's rate.
const STEPS: u32 = 4;

/// Below this the way left has no direction \[m\].
const ARRIVED_M: f64 = 1e-9;

/// Options of the [`ReferenceModel`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ReferenceModelOptions {
    /// `k_p`: speed per way left, near the target \[1/s\].
    pub position_gain_per_s: f64,
    /// `k_v`: acceleration per speed missing \[1/s\].
    pub velocity_gain_per_s: f64,
    /// `k_a`: jerk per acceleration missing \[1/s\].
    pub acceleration_gain_per_s: f64,
    /// `k_j`: snap per jerk missing \[1/s\].
    pub jerk_gain_per_s: f64,
    /// `a_b`: the deceleration that braking is planned with \[m/s^2\].
    pub braking_m_s2: f64,
    /// Greatest jerk \[m/s^3\].
    pub jerk_limit_m_s3: f64,
}

impl Default for ReferenceModelOptions {
    fn default() -> Self {
        Self {
            position_gain_per_s: 3.5,
            velocity_gain_per_s: 6.0,
            acceleration_gain_per_s: 14.0,
            jerk_gain_per_s: 25.0,
            braking_m_s2: 2.4,
            jerk_limit_m_s3: 17.0,
        }
    }
}

impl ReferenceModelOptions {
    /// # Errors
    /// The first option outside its range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        check_range("reference.position-gain-per-s", self.position_gain_per_s, 0.1..=50.0)?;
        check_range("reference.velocity-gain-per-s", self.velocity_gain_per_s, 0.1..=100.0)?;
        check_range(
            "reference.acceleration-gain-per-s",
            self.acceleration_gain_per_s,
            0.1..=100.0,
        )?;
        check_range("reference.jerk-gain-per-s", self.jerk_gain_per_s, 0.1..=100.0)?;
        check_range("reference.braking-m-s2", self.braking_m_s2, 0.05..=20.0)?;
        check_range("reference.jerk-limit-m-s3", self.jerk_limit_m_s3, 0.1..=1000.0)
    }
}

/// The limits that the vehicle sets, along the axes that a model is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Greatest speed \[m/s\].
    pub speed: f64,
    /// Greatest acceleration \[m/s^2\].
    pub acceleration: f64,
}

/// A point that moves: the reference given, or the one that is followed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Course {
    /// \[m, world\].
    pub position: Vector3<f64>,
    /// \[m/s, world\].
    pub velocity: Vector3<f64>,
    /// \[m/s^2, world\].
    pub acceleration: Vector3<f64>,
    /// \[m/s^3, world\].
    pub jerk: Vector3<f64>,
    /// \[m/s^4, world\].
    pub snap: Vector3<f64>,
}

impl Course {
    /// Where this course leads within `dt_s` \[s\] if its acceleration stays.
    #[must_use]
    pub fn after(&self, dt_s: f64) -> Self {
        Self {
            position: self.position + (self.velocity + self.acceleration * (dt_s / 2.0)) * dt_s,
            velocity: self.velocity + self.acceleration * dt_s,
            ..*self
        }
    }
}

/// The reference that is followed, along the axes for which it is made; others stay zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceModel {
    options: ReferenceModelOptions,
    limits: Limits,
    course: Course,
}

impl ReferenceModel {
    /// At rest at the origin.
    #[must_use]
    pub fn new(options: ReferenceModelOptions, limits: Limits) -> Self {
        Self { options, limits, course: Course::default() }
    }

    /// The present course.
    #[must_use]
    pub fn course(&self) -> &Course {
        &self.course
    }

    /// Goes on from here.
    pub fn restart(&mut self, position: Vector3<f64>, velocity: Vector3<f64>) {
        let velocity = velocity.cap_magnitude(self.limits.speed);
        self.course = Course { position, velocity, ..Course::default() };
    }

    /// Goes on by `dt_s` \[s\] towards `target`, as it is then; its jerk and snap are not used.
    pub fn advance(&mut self, target: &Course, dt_s: f64) {
        let h = dt_s / f64::from(STEPS);
        for step in 0..STEPS {
            let target = target.after(-h * f64::from(STEPS - step));
            let wanted = self.acceleration(&target).cap_magnitude(self.limits.acceleration);
            let Course { position, velocity, acceleration, jerk, snap } = &mut self.course;
            let change = (wanted - *acceleration) * self.options.acceleration_gain_per_s;
            let change = change.cap_magnitude(self.options.jerk_limit_m_s3);
            *snap = (change - *jerk) * self.options.jerk_gain_per_s;
            *jerk += *snap * h;
            *acceleration += *jerk * h;
            *velocity += *acceleration * h;
            *position += *velocity * h;
        }
    }

    /// `a_d`.
    fn acceleration(&self, target: &Course) -> Vector3<f64> {
        let way = target.position - self.course.position;
        let closing = target.velocity - self.course.velocity;
        let distance = way.norm();
        let (speed, slope) = self.approach(distance);
        let k_v = self.options.velocity_gain_per_s;
        if distance < ARRIVED_M {
            return closing * k_v + target.acceleration;
        }
        let direction = way / distance;
        let along = direction * direction.dot(&closing);
        let wanted = (target.velocity + direction * speed).cap_magnitude(self.limits.speed);
        (wanted - self.course.velocity) * k_v
            + along * slope
            + (closing - along) * (speed / distance)
            + target.acceleration
    }

    /// `f` and its slope at this distance \[m\].
    fn approach(&self, distance: f64) -> (f64, f64) {
        let (k_p, a_b) = (self.options.position_gain_per_s, self.options.braking_m_s2);
        let near = a_b / (k_p * k_p);
        let (speed, slope) = if distance <= near {
            (k_p * distance, k_p)
        } else {
            let speed = (2.0 * a_b * (distance - near / 2.0)).sqrt();
            (speed, a_b / speed)
        };
        if speed < self.limits.speed { (speed, slope) } else { (self.limits.speed, 0.0) }
    }
}
