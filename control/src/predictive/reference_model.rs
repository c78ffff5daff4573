//! Reference model: approaches the given reference with limited speed, acceleration and jerk relative to it, without overshoot of
//! a target at rest.
//!
//! ```text
//! leader    v = min(max(w, f(d - w T_c)), f(d)) e/|e|,   |v'| <= a_max
//!           f(d) = min(k_p d, sqrt(2 a_b (d - a_b / 2 k_p^2)), v_max)
//! offset    (1 + T s)^2 offset = leader,   T = a_max / (2 j_max)
//! course    target + offset
//! ```
//!
//! The *offset* from the target starts where the target jumps: it takes up the jump of position, velocity and acceleration, so that
//! the course is continuous, and fades. A smooth target has no offset and is passed on unchanged, with its derivatives.
//!
//! A *leader* without inertia takes the offset to zero within the limits of speed and acceleration: `e` is the remaining distance
//! as a vector, `d` its length and `w` the closing speed. It brakes along `f` and accelerates only as long as it could coast for
//! `T_c` before braking. The output is the leader filtered by two equal lags. Their impulse response is non-negative, so the
//! output satisfies the leader's limits of speed and acceleration and does not overshoot where the leader does not. The jerk is
//! `(a_1 - a_2) / T`, with the accelerations behind the first and the second lag; it is at most `j_max` while the leader's own is
//! within `2 j_max T = a_max` of `a_2`.
//!
//! The motion of a distant target is scaled down: fully used up to `NEAR_M`, ignored from `FAR_M` on, linear between. Otherwise
//! the model would chase a moving target at the sum of both speeds and could leave the room. Not in the paper.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::options::{OptionError, Rule, check_options};
use crate::trajectory::Reference;

/// Steps of the integration per tick: short against the lags.
const STEPS: u32 = 4;

/// Distance below which the direction to the target is undefined \[m\].
const ARRIVED_M: f64 = 1e-9;

/// `T_c` over `T` \[-\]: after this time the limit of jerk allows the change from full acceleration to full braking.
const ROLL: f64 = 4.0;

/// Distance up to which the motion of the target is part of the course \[m\].
const NEAR_M: f64 = 0.25;

/// Distance from which on the course does not depend on the motion of the target \[m\].
const FAR_M: f64 = 2.0;

/// Greatest `a_b` as a fraction of the greatest acceleration \[-\]; the rest keeps the leader on `f`.
const BRAKING_SHARE: f64 = 0.9;

/// Options of the [`ReferenceModel`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct ReferenceModelOptions {
    /// `k_p`: speed per distance near the target \[1/s\].
    pub position_gain_per_s: f64,
    /// `a_b`: deceleration of planned braking \[m/s^2\].
    pub braking_m_s2: f64,
    /// `j_max`: greatest jerk \[m/s^3\].
    pub jerk_limit_m_s3: f64,
}

impl Default for ReferenceModelOptions {
    fn default() -> Self {
        Self { position_gain_per_s: 8.0, braking_m_s2: 2.0, jerk_limit_m_s3: 23.0 }
    }
}

impl ReferenceModelOptions {
    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("position-gain-per-s", self.position_gain_per_s, Rule::Between(0.1, 50.0)),
            ("braking-m-s2", self.braking_m_s2, Rule::Between(0.05, 20.0)),
            ("jerk-limit-m-s3", self.jerk_limit_m_s3, Rule::Between(0.1, 1000.0)),
        ])
    }
}

/// Limits of the vehicle along the axes of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionLimits {
    /// Greatest speed \[m/s\].
    pub speed: f64,
    /// Greatest acceleration \[m/s^2\].
    pub acceleration: f64,
    /// Greatest jerk \[m/s^3\]; that of the options, if less, applies.
    pub jerk: f64,
}

/// Motion of a point: the given reference, or the output of the model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Course {
    /// Position \[m, world\].
    pub position: Vector3<f64>,
    /// Velocity \[m/s, world\].
    pub velocity: Vector3<f64>,
    /// Acceleration \[m/s^2, world\].
    pub acceleration: Vector3<f64>,
    /// Jerk \[m/s^3, world\].
    pub jerk: Vector3<f64>,
    /// Snap \[m/s^4, world\].
    pub snap: Vector3<f64>,
}

impl Course {
    /// The motion of `reference`.
    pub fn of(reference: &Reference) -> Self {
        let Reference { position, velocity, acceleration, jerk, snap, .. } = *reference;
        Self { position, velocity, acceleration, jerk, snap }
    }

    /// Extrapolates the course by `dt_s` \[s\] with constant snap.
    pub fn after(&self, dt_s: f64) -> Self {
        let [half, third, fourth] = [dt_s / 2.0, dt_s / 3.0, dt_s / 4.0];
        let Self { position, velocity, acceleration, jerk, snap } = self;
        Self {
            position: position
                + (velocity + (acceleration + (jerk + snap * fourth) * third) * half) * dt_s,
            velocity: velocity + (acceleration + (jerk + snap * third) * half) * dt_s,
            acceleration: acceleration + (jerk + snap * half) * dt_s,
            jerk: jerk + snap * dt_s,
            snap: *snap,
        }
    }

    /// The same position with `share` of the motion.
    fn slowed(&self, share: f64) -> Self {
        let Self { position, velocity, acceleration, jerk, snap } = *self;
        Self {
            position,
            velocity: velocity * share,
            acceleration: acceleration * share,
            jerk: jerk * share,
            snap: snap * share,
        }
    }

    /// The course with which a first-order lag of `lag_s` \[s\] gives this one, up to the acceleration.
    fn ahead_of_lag(&self, lag_s: f64) -> Self {
        Self {
            position: self.position + self.velocity * lag_s,
            velocity: self.velocity + self.acceleration * lag_s,
            acceleration: self.acceleration + self.jerk * lag_s,
            ..*self
        }
    }

    /// The sum with `share` times `other`.
    pub(super) fn plus(&self, other: &Self, share: f64) -> Self {
        Self {
            position: self.position + other.position * share,
            velocity: self.velocity + other.velocity * share,
            acceleration: self.acceleration + other.acceleration * share,
            jerk: self.jerk + other.jerk * share,
            snap: self.snap + other.snap * share,
        }
    }

    /// Moves by `share` of the difference towards `other`: one step of a first-order lag.
    fn approach(&mut self, other: &Self, share: f64) {
        self.position += (other.position - self.position) * share;
        self.velocity += (other.velocity - self.velocity) * share;
        self.acceleration += (other.acceleration - self.acceleration) * share;
    }
}

/// The reference model along its axes; the components along other axes stay zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceModel {
    options: ReferenceModelOptions,
    limits: MotionLimits,
    target: Course,
    /// The leader, the leader filtered by one lag, and the offset: each relative to the target.
    leader: Course,
    between: Course,
    offset: Course,
}

impl ReferenceModel {
    /// A model at rest at the origin.
    pub fn new(mut options: ReferenceModelOptions, limits: MotionLimits) -> Self {
        options.jerk_limit_m_s3 = options.jerk_limit_m_s3.min(limits.jerk);
        let [target, leader, between, offset] = [Course::default(); 4];
        Self { options, limits, target, leader, between, offset }
    }

    /// The present course.
    pub fn course(&self) -> Course {
        self.target.plus(&self.offset, 1.0)
    }

    /// Restarts from `position` \[m, world\], `velocity` \[m/s, world\] and `acceleration` \[m/s^2, world\].
    pub fn restart(
        &mut self,
        position: Vector3<f64>,
        velocity: Vector3<f64>,
        acceleration: Vector3<f64>,
    ) {
        self.target = Course { position, velocity, acceleration, ..Course::default() };
        [self.leader, self.between, self.offset] = [Course::default(); 3];
    }

    /// Takes over the state of `old`, which flew until now. Options and limits are kept.
    pub fn adopt(&mut self, old: &Self) {
        *self = Self { options: self.options, limits: self.limits, ..*old };
    }

    /// Advances the model by `dt_s` \[s\] towards `target`, the target at the end of the step.
    pub fn advance(&mut self, target: &Course, dt_s: f64) {
        let distance = (target.position - self.course().after(dt_s).position).norm();
        let target = &target.slowed(((FAR_M - distance) / (FAR_M - NEAR_M)).clamp(0.0, 1.0));
        let mut jump = target.plus(&self.target.after(dt_s), -1.0);
        // Jerk and snap of the offset are those of the lags.
        (jump.jerk, jump.snap) = Default::default();
        // An acceleration above the limit cannot be continued: the vehicle does not have it.
        let acceleration = self.offset.acceleration - jump.acceleration;
        let acceleration = acceleration.cap_magnitude(self.limits.acceleration);
        jump.acceleration = self.offset.acceleration - acceleration;
        self.offset = self.offset.plus(&jump, -1.0);
        let jump = jump.ahead_of_lag(self.lag_s());
        self.between = self.between.plus(&jump, -1.0);
        self.leader = self.leader.plus(&jump.ahead_of_lag(self.lag_s()), -1.0);
        self.target = *target;
        let h = dt_s / f64::from(STEPS);
        for _ in 0..STEPS {
            self.lead(h);
            let share = h / (h + self.lag_s());
            self.between.approach(&self.leader, share);
            let Course { acceleration, jerk, .. } = self.offset;
            self.offset.approach(&self.between, share);
            self.offset.jerk = (self.offset.acceleration - acceleration) / h;
            self.offset.snap = (self.offset.jerk - jerk) / h;
        }
    }

    /// `T` \[s\].
    fn lag_s(&self) -> f64 {
        self.limits.acceleration / (2.0 * self.options.jerk_limit_m_s3)
    }

    /// Advances the leader by `h` \[s\] towards the target.
    fn lead(&mut self, h: f64) {
        let acceleration = (self.velocity() - self.leader.velocity) / h;
        let acceleration = acceleration.cap_magnitude(self.limits.acceleration);
        // Both terms are within the limit of acceleration, and therefore every value between them.
        let from = self.offset.acceleration;
        let reach = self.limits.acceleration + self.options.jerk_limit_m_s3 * h;
        self.leader.acceleration = from + (acceleration - from).cap_magnitude(reach);
        self.leader.velocity += self.leader.acceleration * h;
        self.leader.position += self.leader.velocity * h;
    }

    /// The velocity of the leader for the next step.
    fn velocity(&self) -> Vector3<f64> {
        let way = -self.leader.position;
        let distance = way.norm();
        let direction = if distance > ARRIVED_M { way / distance } else { Vector3::zeros() };
        let closing = direction.dot(&self.leader.velocity).max(0.0);
        let roll = closing * ROLL * self.lag_s();
        direction * closing.clamp(self.approach(distance - roll), self.approach(distance))
    }

    /// `f` at `distance` \[m\]: the speed of approach \[m/s\].
    fn approach(&self, distance: f64) -> f64 {
        let k_p = self.options.position_gain_per_s;
        let a_b = self.options.braking_m_s2.min(BRAKING_SHARE * self.limits.acceleration);
        let near = a_b / (k_p * k_p);
        let speed = if distance <= near {
            k_p * distance.max(0.0)
        } else {
            (2.0 * a_b * (distance - near / 2.0)).sqrt()
        };
        speed.min(self.limits.speed)
    }
}
