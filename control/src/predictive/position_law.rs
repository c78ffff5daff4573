//! The position law of `oqtal-dt`: a reference that the vehicle can follow is fed forward, and what
//! is left is corrected on the predicted motion. No integral action: what it would learn is in the
//! bias that the filters know.
//!
//! ```text
//! a = a_r + F{k_v (v_r + k_p (p_r - p) - v) - b}
//! ```
//!
//! `F` is the command filter; the vertical axis needs none, for no attitude hangs on it, and has a `k_p`
//! of its own.

use nalgebra::{Vector2, Vector3};

use super::command_filter::{CommandFilter, Smooth};
use super::flatness::Force;
use super::model::{Bias, Motion};
use super::options::PredictiveOptions;
use super::reference_model::{Course, MotionLimits, ReferenceModel};
use crate::position::PositionOptions;
use crate::trajectory::Reference;

/// Share of the tilt that the reference may take; the rest is for corrections.
const REFERENCE_SHARE: f64 = 0.9;

/// A vehicle further than this from its reference was pushed away: the reference starts anew from
/// where it is, so that the way back, too, keeps the limits \[m\].
const LEASH_M: f64 = 0.3;

/// What the law wants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint {
    /// The velocity that is aimed at \[m/s, world\].
    pub velocity: Vector3<f64>,
    /// The force per mass.
    pub force: Force,
}

/// The law and its state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionLaw {
    options: PredictiveOptions,
    gravity_m_s2: f64,
    tilt_tangent: f64,
    vertical_acceleration: f64,
    horizontal: ReferenceModel,
    vertical: ReferenceModel,
    filter: CommandFilter,
    /// The velocity of the last reference \[m/s\]; `None` while the position is not controlled.
    following: Option<Vector3<f64>>,
}

impl PositionLaw {
    /// The law within the limits of `loops`, under `gravity_m_s2` \[m/s^2\].
    #[must_use]
    pub fn new(options: &PredictiveOptions, loops: &PositionOptions, gravity_m_s2: f64) -> Self {
        let tilt_tangent = loops.tilt_limit_deg.to_radians().tan();
        let model = |speed, acceleration| {
            ReferenceModel::new(options.reference, MotionLimits { speed, acceleration })
        };
        Self {
            options: *options,
            gravity_m_s2,
            tilt_tangent,
            vertical_acceleration: loops.vertical_acceleration_limit_m_s2,
            horizontal: model(
                loops.horizontal_velocity_limit_m_s,
                REFERENCE_SHARE * gravity_m_s2 * tilt_tangent,
            ),
            vertical: model(
                loops.vertical_velocity_limit_m_s,
                REFERENCE_SHARE * loops.vertical_acceleration_limit_m_s2,
            ),
            filter: CommandFilter::new(options.command_bandwidth_rad_s),
            following: None,
        }
    }

    /// Starts anew from wherever the vehicle is next.
    pub fn reset(&mut self) {
        self.following = None;
        self.filter.reset();
    }

    /// What to do, `dt_s` \[s\] after the last step, when a command sent now acts: `delay_s` \[s\] from
    /// now, the vehicle being at `motion` then. The reference is that of now.
    pub fn update(
        &mut self,
        (motion, bias): (&Motion, &Bias),
        reference: &Reference,
        (dt_s, delay_s): (f64, f64),
    ) -> Setpoint {
        let course = self.follow(motion, reference, (dt_s, delay_s));
        let PredictiveOptions { position_gain_per_s: k, vertical_position_gain_per_s: k_z, .. } =
            self.options;
        let correction =
            (course.position - motion.position).component_mul(&Vector3::new(k, k, k_z));
        let velocity = course.velocity + correction;
        let missing = velocity - motion.velocity;
        let corrective = missing * self.options.velocity_gain_per_s - bias.acceleration;

        let limit = self.vertical_acceleration;
        let lift = self.gravity_m_s2 + (course.acceleration.z + corrective.z).clamp(-limit, limit);
        let limit = lift * self.tilt_tangent;
        let smooth = match reference.attitude {
            None => self.filter.update(&corrective.xy().cap_magnitude(limit), dt_s),
            Some(_) => Smooth::default(),
        };
        let force = Force {
            value: (course.acceleration.xy() + smooth.value).push(lift),
            slope: (course.jerk.xy() + smooth.slope).push(0.0),
            curvature: (course.snap.xy() + smooth.curvature).push(0.0),
        };
        Setpoint { velocity, force: within(force, limit) }
    }

    /// Leads the reference on and returns it. While the position is not controlled, and when the
    /// vehicle was pushed away, it starts from there.
    fn follow(
        &mut self,
        motion: &Motion,
        reference: &Reference,
        (dt_s, delay_s): (f64, f64),
    ) -> Course {
        let Reference { position, velocity, .. } = *reference;
        let target = Course { position, velocity, ..Course::default() };
        let target = Course { acceleration: self.acceleration(&velocity, dt_s), ..target };
        let target = target.after(delay_s);
        let (horizontal, vertical) = (axes(&target, HORIZONTAL), axes(&target, VERTICAL));
        let begins = self.following.is_none();
        if begins {
            self.vertical.restart(vertical.position, vertical.velocity);
        } else if strays(&self.vertical, motion, VERTICAL) {
            restart(&mut self.vertical, motion, VERTICAL);
        }
        if begins || reference.attitude.is_some() || strays(&self.horizontal, motion, HORIZONTAL) {
            self.filter.reset();
            restart(&mut self.horizontal, motion, HORIZONTAL);
        }
        if reference.attitude.is_none() {
            self.horizontal.advance(&horizontal, dt_s);
        }
        self.vertical.advance(&vertical, dt_s);
        self.following = Some(velocity);
        sum(self.horizontal.course(), self.vertical.course())
    }

    /// The acceleration of the reference, from its velocities; where those jump, it has none.
    fn acceleration(&self, velocity: &Vector3<f64>, dt_s: f64) -> Vector3<f64> {
        let last = self.following.unwrap_or(*velocity);
        let acceleration = (velocity - last) / dt_s;
        let greatest = self.gravity_m_s2 * self.tilt_tangent;
        if acceleration.norm() <= greatest { acceleration } else { Vector3::zeros() }
    }
}

const HORIZONTAL: Vector3<f64> = Vector3::new(1.0, 1.0, 0.0);
const VERTICAL: Vector3<f64> = Vector3::new(0.0, 0.0, 1.0);

/// Whether the vehicle is not where a reference that it could follow would have it.
fn strays(model: &ReferenceModel, motion: &Motion, axes: Vector3<f64>) -> bool {
    (motion.position.component_mul(&axes) - model.course().position).norm() > LEASH_M
}

fn restart(model: &mut ReferenceModel, motion: &Motion, axes: Vector3<f64>) {
    model.restart(motion.position.component_mul(&axes), motion.velocity.component_mul(&axes));
}

/// The part of a course along some axes.
fn axes(course: &Course, axes: Vector3<f64>) -> Course {
    Course {
        position: course.position.component_mul(&axes),
        velocity: course.velocity.component_mul(&axes),
        acceleration: course.acceleration.component_mul(&axes),
        jerk: course.jerk.component_mul(&axes),
        snap: course.snap.component_mul(&axes),
    }
}

fn sum(a: &Course, b: &Course) -> Course {
    Course {
        position: a.position + b.position,
        velocity: a.velocity + b.velocity,
        acceleration: a.acceleration + b.acceleration,
        jerk: a.jerk + b.jerk,
        snap: a.snap + b.snap,
    }
}

/// The same force with a horizontal part of at most `limit` \[m/s^2\]; at the limit it stands still.
fn within(force: Force, limit: f64) -> Force {
    let horizontal: Vector2<f64> = force.value.xy();
    if horizontal.norm() <= limit {
        return force;
    }
    Force {
        value: horizontal.cap_magnitude(limit).push(force.value.z),
        slope: Vector3::zeros(),
        curvature: Vector3::zeros(),
    }
}
