//! Position law of `oqtal-dt`: a reference that the vehicle can follow is fed forward, and the remaining error is corrected on
//! the predicted motion. There is no integral action: the filters estimate the bias.
//!
//! ```text
//! a = a_r + D v_r + F{k_v (v_r + k_p (p_r - p) - v) - b}
//! ```
//!
//! `F` is the command filter, `D` the drag. The vertical axis does not affect the attitude; it has no filter and separate gains.
//! The limits apply to the correction and to the offset from the reference; the motion of the reference itself is fed forward up to
//! the greatest tilt. In the vertical axis the range of the correction is wider by the mean of `-b`, by up to its limit.

use nalgebra::{Vector2, Vector3};

use super::command_filter::{CommandFilter, Smooth};
use super::flatness::Force;
use super::model::{Bias, Motion, VehicleModel};
use super::options::PredictiveOptions;
use super::reference_model::{Course, MotionLimits, ReferenceModel};
use crate::position::{GREATEST_TILT_DEG, PositionOptions};
use crate::trajectory::Reference;

/// Fraction of the tilt limit available to the reference \[-\]; the rest is reserved for corrections.
const REFERENCE_SHARE: f64 = 0.9;

/// Least lift over the weight \[-\]: below, a small force would turn the vehicle over.
const LEAST_LIFT: f64 = 0.2;

/// Time constant of the mean of the vertical force \[s\]: longer than an oscillation of the height.
const LASTING_S: f64 = 0.3;

/// Distance from the reference beyond which the vehicle counts as pushed away \[m\]: the reference then restarts from the
/// vehicle, so that the return also satisfies the limits.
const LEASH_M: f64 = 0.3;

/// Output of the position law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint {
    /// Desired velocity \[m/s, world\].
    pub velocity: Vector3<f64>,
    /// Desired force per mass.
    pub force: Force,
}

/// The position law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionLaw {
    options: PredictiveOptions,
    gravity_m_s2: f64,
    drag_per_s: f64,
    tilt_tangent: f64,
    vertical_acceleration: f64,
    horizontal: ReferenceModel,
    vertical: ReferenceModel,
    filter: CommandFilter,
    /// Mean of the estimated vertical force per mass \[m/s^2\].
    lasting_force: f64,
    /// Whether there was a reference in the last step.
    is_following: bool,
    /// Whether the next step begins a stop.
    begins_stop: bool,
}

impl PositionLaw {
    /// The law for a vehicle within the limits of `loops`, which turns its thrust with a jerk of at most `turning_jerk_m_s3` \[m/s^3\].
    pub fn new(
        options: &PredictiveOptions,
        loops: &PositionOptions,
        (model, turning_jerk_m_s3): (&VehicleModel, f64),
    ) -> Self {
        let VehicleModel { gravity_m_s2, drag_per_s, .. } = *model;
        let tilt_tangent = loops.tilt_limit_deg.to_radians().tan();
        let model = |speed, acceleration, jerk| {
            ReferenceModel::new(options.reference, MotionLimits { speed, acceleration, jerk })
        };
        Self {
            options: *options,
            gravity_m_s2,
            drag_per_s,
            tilt_tangent,
            vertical_acceleration: loops.vertical_acceleration_limit_m_s2,
            horizontal: model(
                loops.horizontal_velocity_limit_m_s,
                REFERENCE_SHARE * gravity_m_s2 * tilt_tangent,
                turning_jerk_m_s3,
            ),
            vertical: model(
                loops.vertical_velocity_limit_m_s,
                REFERENCE_SHARE * loops.vertical_acceleration_limit_m_s2,
                f64::INFINITY,
            ),
            filter: CommandFilter::new(options.command_bandwidth_rad_s),
            lasting_force: 0.0,
            is_following: false,
            begins_stop: false,
        }
    }

    /// Takes over the state of `old`, which flew until now.
    pub fn adopt(&mut self, old: &Self) {
        self.horizontal.adopt(&old.horizontal);
        self.vertical.adopt(&old.vertical);
        self.filter.adopt(&old.filter);
        self.lasting_force = old.lasting_force;
        self.is_following = old.is_following;
        self.begins_stop = old.begins_stop;
    }

    /// Removes, in the next step, what moves the reference model ahead of the vehicle or accelerates it along the vehicle's velocity: a
    /// hold begins. Braking continues.
    pub fn begin_stop(&mut self) {
        self.begins_stop = true;
    }

    /// Restarts from the vehicle's position in the next step.
    pub fn reset(&mut self) {
        (self.is_following, self.begins_stop, self.lasting_force) = (false, false, 0.0);
        self.filter.reset();
    }

    /// Advances by `dt_s` \[s\] and returns the set-point for the time at which a command sent now takes effect,
    /// `delay_s` \[s\] from now. `motion` is the motion predicted for that time, `reference` the reference for now.
    pub fn update(
        &mut self,
        (motion, bias): (&Motion, &Bias),
        reference: &Reference,
        (dt_s, delay_s): (f64, f64),
    ) -> Setpoint {
        let (target, course) = self.follow(motion, reference, (dt_s, delay_s));
        let gains = &self.options;
        let [position_gain, velocity_gain] = [
            (gains.position_gain_per_s, gains.vertical_position_gain_per_s),
            (gains.velocity_gain_per_s, gains.vertical_velocity_gain_per_s),
        ]
        .map(|(horizontal, vertical)| Vector3::new(horizontal, horizontal, vertical));
        let correction = (course.position - motion.position).component_mul(&position_gain);
        let velocity = course.velocity + correction;
        let missing = velocity - motion.velocity;
        let corrective = missing.component_mul(&velocity_gain) - bias.acceleration;

        let (limit, gravity) = (self.vertical_acceleration, self.gravity_m_s2);
        let [target, own] =
            [target, course].map(|course| Force::along(&course, gravity, self.drag_per_s));
        // Against a lasting force the range of the corrections is wider; an estimate that oscillates hardly widens it.
        self.lasting_force +=
            dt_s / (dt_s + LASTING_S) * (bias.acceleration.z - self.lasting_force);
        let against = -self.lasting_force.clamp(-limit, limit);
        let lift = target.value.z
            + (own.value.z - target.value.z + corrective.z)
                .clamp(against.min(0.0) - limit, against.max(0.0) + limit)
                .max(LEAST_LIFT * gravity - target.value.z);
        let limit = lift * self.tilt_tangent;
        let smooth = match reference.attitude {
            None => self.filter.update(&corrective.xy().cap_magnitude(limit), dt_s),
            Some(_) => Smooth::default(),
        };
        let force = Force {
            value: (own.value.xy() + smooth.value).push(lift),
            slope: own.slope + smooth.slope.push(0.0),
            curvature: own.curvature + smooth.curvature.push(0.0),
        };
        let limit =
            (limit + target.value.xy().norm()).min(lift * GREATEST_TILT_DEG.to_radians().tan());
        Setpoint { velocity, force: within(force, limit) }
    }

    /// Advances the reference model and returns the motion of the reference and the output. While the position is not controlled, and when the
    /// vehicle was pushed away, the model restarts from the vehicle.
    fn follow(
        &mut self,
        motion: &Motion,
        reference: &Reference,
        (dt_s, delay_s): (f64, f64),
    ) -> (Course, Course) {
        let target = Course::of(reference).after(delay_s);
        let (horizontal, vertical) = (axes(&target, HORIZONTAL), axes(&target, VERTICAL));
        if std::mem::take(&mut self.begins_stop) {
            self.filter.stop(&motion.velocity.xy());
            stop(&mut self.horizontal, motion, HORIZONTAL);
            stop(&mut self.vertical, motion, VERTICAL);
        }
        let begins = !std::mem::replace(&mut self.is_following, true);
        if begins {
            self.vertical.restart(vertical.position, vertical.velocity, Vector3::zeros());
        } else if strays(&self.vertical, motion, VERTICAL) {
            let acceleration = self.vertical.course().acceleration;
            restart(&mut self.vertical, motion, VERTICAL, acceleration);
        }
        if begins || reference.attitude.is_some() {
            self.filter.reset();
            restart(&mut self.horizontal, motion, HORIZONTAL, Vector3::zeros());
        } else if strays(&self.horizontal, motion, HORIZONTAL) {
            let acceleration = self.horizontal.course().acceleration;
            restart(&mut self.horizontal, motion, HORIZONTAL, acceleration);
        }
        if reference.attitude.is_none() {
            self.horizontal.advance(&horizontal, dt_s);
        }
        self.vertical.advance(&vertical, dt_s);
        (target, self.horizontal.course().plus(&self.vertical.course(), 1.0))
    }
}

const HORIZONTAL: Vector3<f64> = Vector3::new(1.0, 1.0, 0.0);
const VERTICAL: Vector3<f64> = Vector3::new(0.0, 0.0, 1.0);

/// Whether the vehicle is further from the model than [`LEASH_M`] along `axes`.
fn strays(model: &ReferenceModel, motion: &Motion, axes: Vector3<f64>) -> bool {
    (motion.position.component_mul(&axes) - model.course().position).norm() > LEASH_M
}

/// Restarts the model from the vehicle with this `acceleration` \[m/s^2, world\]: without the acceleration of its course, a vehicle away
/// from its path would be level for a moment.
fn restart(
    model: &mut ReferenceModel,
    motion: &Motion,
    axes: Vector3<f64>,
    acceleration: Vector3<f64>,
) {
    let [position, velocity] = [motion.position, motion.velocity].map(|x| x.component_mul(&axes));
    model.restart(position, velocity, acceleration);
}

/// Restarts the model without the parts that lead the vehicle onward: along its velocity the model is neither ahead of it nor faster, and
/// does not accelerate. Braking continues.
fn stop(model: &mut ReferenceModel, motion: &Motion, axes: Vector3<f64>) {
    let Some(along) = motion.velocity.component_mul(&axes).try_normalize(0.0) else { return };
    let at_most = |of_model: Vector3<f64>, of_vehicle: Vector3<f64>| {
        of_model - along * (of_model - of_vehicle).dot(&along).max(0.0)
    };
    let Course { position, velocity, acceleration, .. } = model.course();
    model.restart(
        at_most(position, motion.position),
        at_most(velocity, motion.velocity),
        at_most(acceleration, Vector3::zeros()),
    );
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

/// Limits the horizontal part of the force to `limit` \[m/s^2\]; at the limit its derivatives are zero.
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
