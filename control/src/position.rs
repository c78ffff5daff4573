//! The outer loops of Fig. 16: from the position error to the attitude and thrust for the attitude law.
//!
//! One PID for each of X, Y and Z turns the position error into a commanded velocity, one for each of V_X, V_Y and V_Z turns the
//! velocity error into a commanded acceleration, and the acceleration determines attitude and thrust. The structure is the
//! paper's (section VII.B); gains, limits and the feed-forward of the reference velocity are not in the paper.

use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::estimator::Estimate;
use crate::options::{OptionError, Rule, check_options};
use crate::quaternion::Attitude;
use crate::scalar_pid::{Pid, PidGains, PidLimits};
use crate::tracking_error::AttitudeReference;
use crate::trajectory::Reference;

/// Greatest value allowed for the tilt limit \[deg\].
pub(crate) const GREATEST_TILT_DEG: f64 = 60.0;

/// Norm below which the direction of a vector is undefined \[unit of the vector\].
const SMALLEST_NORM: f64 = 1e-9;

/// Options of the [`PositionLoops`]. None of these values is in the paper.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct PositionOptions {
    /// PIDs of X and Y: position error \[m\] to velocity \[m/s\].
    pub horizontal_position: PidGains,
    /// Z: position error \[m\] to velocity \[m/s\].
    pub vertical_position: PidGains,
    /// PIDs of V_X and V_Y: velocity error \[m/s\] to acceleration \[m/s^2\].
    pub horizontal_velocity: PidGains,
    /// V_Z: velocity error \[m/s\] to acceleration \[m/s^2\].
    pub vertical_velocity: PidGains,
    /// Greatest integral term of each position PID \[m/s\].
    pub position_integral_limit_m_s: f64,
    /// Greatest integral term of each velocity PID \[m/s^2\].
    pub velocity_integral_limit_m_s2: f64,
    /// Cut-off of the low-pass on the derivative terms \[Hz\].
    pub derivative_cutoff_hz: f64,
    /// Greatest commanded horizontal speed \[m/s\].
    pub horizontal_velocity_limit_m_s: f64,
    /// Greatest commanded climb or descent speed \[m/s\].
    pub vertical_velocity_limit_m_s: f64,
    /// Greatest commanded vertical acceleration, below gravity \[m/s^2\]. Against a lasting force the predictive stack may use up to twice
    /// this value.
    pub vertical_acceleration_limit_m_s2: f64,
    /// Greatest commanded angle between thrust and vertical \[deg\].
    pub tilt_limit_deg: f64,
}

impl Default for PositionOptions {
    fn default() -> Self {
        // Not in the paper. Chosen from a grid over simulated squares and hovers of a quadrotor whose body rate lags by
        // 50 ms behind a delay of 35 ms, for margin as well as error: kp = 4 on the velocity is hardly stable if the lag
        // is 80 ms, and a derivative of the measured velocity is mostly noise.
        let position = PidGains { kp: 1.4, ki: 0.02, kd: 0.0 };
        let velocity = PidGains { kp: 3.0, ki: 1.0, kd: 0.0 };
        Self {
            horizontal_position: position,
            vertical_position: position,
            horizontal_velocity: velocity,
            vertical_velocity: velocity,
            position_integral_limit_m_s: 0.05,
            velocity_integral_limit_m_s2: 0.9,
            derivative_cutoff_hz: 6.0,
            horizontal_velocity_limit_m_s: 0.8,
            vertical_velocity_limit_m_s: 1.0,
            vertical_acceleration_limit_m_s2: 4.0,
            tilt_limit_deg: 15.0,
        }
    }
}

impl PositionOptions {
    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        self.horizontal_position.check().map_err(|error| error.within("horizontal-position"))?;
        self.vertical_position.check().map_err(|error| error.within("vertical-position"))?;
        self.horizontal_velocity.check().map_err(|error| error.within("horizontal-velocity"))?;
        self.vertical_velocity.check().map_err(|error| error.within("vertical-velocity"))?;
        check_options([
            (
                "position-integral-limit-m-s",
                self.position_integral_limit_m_s,
                Rule::Between(0.0, 1.0),
            ),
            (
                "velocity-integral-limit-m-s2",
                self.velocity_integral_limit_m_s2,
                Rule::Between(0.0, 5.0),
            ),
            ("derivative-cutoff-hz", self.derivative_cutoff_hz, Rule::Between(0.1, 1000.0)),
            (
                "horizontal-velocity-limit-m-s",
                self.horizontal_velocity_limit_m_s,
                Rule::Between(0.05, 20.0),
            ),
            (
                "vertical-velocity-limit-m-s",
                self.vertical_velocity_limit_m_s,
                Rule::Between(0.05, 20.0),
            ),
            // Well below gravity, so that the lift is never zero.
            (
                "vertical-acceleration-limit-m-s2",
                self.vertical_acceleration_limit_m_s2,
                Rule::Between(0.1, 9.0),
            ),
            ("tilt-limit-deg", self.tilt_limit_deg, Rule::Between(1.0, GREATEST_TILT_DEG)),
        ])
    }
}

/// Output of the outer loops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionCommand {
    /// Attitude for the attitude law. The commanded rate is zero, as in the paper's experiments, unless the reference
    /// prescribes attitude and rate.
    pub attitude: AttitudeReference,
    /// Thrust along body z \[N\].
    pub thrust_n: f64,
    /// The velocity commanded by the position PIDs \[m/s, world\].
    pub velocity: Vector3<f64>,
}

/// One of the six PIDs of Fig. 16, by the variable that it controls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OuterLoop {
    /// Position along x.
    X,
    /// Position along y.
    Y,
    /// Height.
    Z,
    /// Velocity along x.
    VelocityX,
    /// Velocity along y.
    VelocityY,
    /// Climb velocity.
    VelocityZ,
}

/// The six PIDs of Fig. 16 and their limits.
#[derive(Clone, Copy, Debug)]
pub struct PositionLoops {
    options: PositionOptions,
    mass_kg: f64,
    gravity_m_s2: f64,
    horizontal_position: HorizontalPids,
    horizontal_velocity: HorizontalPids,
    vertical_position: Pid,
    vertical_velocity: Pid,
}

impl PositionLoops {
    /// Loops at rest for a vehicle of `mass_kg` \[kg\] under `gravity_m_s2` \[m/s^2\]; the options must be valid.
    pub fn new(options: &PositionOptions, mass_kg: f64, gravity_m_s2: f64) -> Self {
        let pid = |gains, limits| Pid::new(gains, limits, options.derivative_cutoff_hz);
        let position = |output| PidLimits { integral: options.position_integral_limit_m_s, output };
        let velocity =
            |output| PidLimits { integral: options.velocity_integral_limit_m_s2, output };
        let climb = options.vertical_velocity_limit_m_s;
        let lift = options.vertical_acceleration_limit_m_s2;
        Self {
            options: *options,
            mass_kg,
            gravity_m_s2,
            horizontal_position: HorizontalPids::new(pid(
                options.horizontal_position,
                position(f64::INFINITY),
            )),
            horizontal_velocity: HorizontalPids::new(pid(
                options.horizontal_velocity,
                velocity(f64::INFINITY),
            )),
            vertical_position: pid(options.vertical_position, position(climb)),
            vertical_velocity: pid(options.vertical_velocity, velocity(lift)),
        }
    }

    /// Command for the present estimate and reference, `dt_s` \[s\] after the previous command.
    ///
    /// A reference with an attitude opens the horizontal loops: that attitude is the command, the integrals are held,
    /// and the velocity that the loops would command is still reported. The vertical loop stays closed and
    /// compensates the tilt.
    pub fn update(
        &mut self,
        estimate: &Estimate,
        reference: &Reference,
        dt_s: f64,
    ) -> PositionCommand {
        let (climb, lift) = self.vertical(estimate, reference, dt_s);
        let (velocity, acceleration) = self.horizontal(estimate, reference, dt_s, lift);
        let (attitude, specific_thrust) = match reference.attitude {
            Some(prescribed) => {
                let cosine_of_tilt = prescribed.attitude.to_world(&Vector3::z()).z;
                let least_cosine = GREATEST_TILT_DEG.to_radians().cos();
                (prescribed, lift / cosine_of_tilt.max(least_cosine))
            }
            None => {
                let specific_force = acceleration.push(lift);
                let attitude = attitude_along(&specific_force, reference.yaw_rad);
                (AttitudeReference::at_rest(attitude), specific_force.norm())
            }
        };
        PositionCommand {
            attitude,
            thrust_n: self.mass_kg * specific_thrust,
            velocity: velocity.push(climb),
        }
    }

    /// Replaces the gains of one PID; its state is kept, so that the flight can continue.
    pub fn set_gains(&mut self, which: OuterLoop, gains: PidGains) {
        let pid = match which {
            OuterLoop::X => &mut self.horizontal_position.x,
            OuterLoop::Y => &mut self.horizontal_position.y,
            OuterLoop::Z => &mut self.vertical_position,
            OuterLoop::VelocityX => &mut self.horizontal_velocity.x,
            OuterLoop::VelocityY => &mut self.horizontal_velocity.y,
            OuterLoop::VelocityZ => &mut self.vertical_velocity,
        };
        pid.set_gains(gains);
    }

    /// Takes over the state of the PIDs of `old`, which flew until now. Options are kept.
    pub fn adopt(&mut self, old: &Self) {
        self.horizontal_position.adopt(&old.horizontal_position);
        self.horizontal_velocity.adopt(&old.horizontal_velocity);
        self.vertical_position.adopt(&old.vertical_position);
        self.vertical_velocity.adopt(&old.vertical_velocity);
    }

    /// Resets the state of all PIDs. Options are kept.
    pub fn reset(&mut self) {
        self.horizontal_position.reset();
        self.horizontal_velocity.reset();
        self.vertical_position.reset();
        self.vertical_velocity.reset();
    }

    /// The climb velocity \[m/s\] and the lift per mass \[m/s^2\] commanded by the loops for Z and V_Z.
    fn vertical(&mut self, estimate: &Estimate, reference: &Reference, dt_s: f64) -> (f64, f64) {
        let limit = self.options.vertical_velocity_limit_m_s;
        let error = reference.position.z - estimate.position.z;
        let correction = self.vertical_position.update(error, dt_s);
        let climb = (reference.velocity.z + correction).clamp(-limit, limit);
        let error = climb - estimate.velocity.z;
        (climb, self.gravity_m_s2 + self.vertical_velocity.update(error, dt_s))
    }

    /// The velocity \[m/s\] and the acceleration \[m/s^2\] commanded by the loops for X, Y, V_X and V_Y, the
    /// acceleration limited as the tilt limit demands at the lift per mass `lift` \[m/s^2\].
    fn horizontal(
        &mut self,
        estimate: &Estimate,
        reference: &Reference,
        dt_s: f64,
        lift: f64,
    ) -> (Vector2<f64>, Vector2<f64>) {
        let held = reference.attitude.is_some();
        let error = (reference.position - estimate.position).xy();
        let correction = self.horizontal_position.update(error, dt_s, held);
        let limit = self.options.horizontal_velocity_limit_m_s;
        let velocity = self.horizontal_position.cap(reference.velocity.xy() + correction, limit);
        let error = velocity - estimate.velocity.xy();
        let acceleration = self.horizontal_velocity.update(error, dt_s, held);
        let limit = lift * self.options.tilt_limit_deg.to_radians().tan();
        (velocity, self.horizontal_velocity.cap(acceleration, limit))
    }
}

/// The PIDs of X and Y, or of V_X and V_Y. They are limited together, because separate limits would change the direction of the
/// command.
#[derive(Clone, Copy, Debug)]
struct HorizontalPids {
    x: Pid,
    y: Pid,
    /// Whether the last command was at its limit. The integrals are then held for one sample.
    capped: bool,
}

impl HorizontalPids {
    fn new(pid: Pid) -> Self {
        Self { x: pid, y: pid, capped: false }
    }

    fn update(&mut self, error: Vector2<f64>, dt_s: f64, held: bool) -> Vector2<f64> {
        self.x.freeze(held || self.capped);
        self.y.freeze(held || self.capped);
        Vector2::new(self.x.update(error.x, dt_s), self.y.update(error.y, dt_s))
    }

    fn cap(&mut self, command: Vector2<f64>, limit: f64) -> Vector2<f64> {
        self.capped = command.norm() > limit;
        command.cap_magnitude(limit)
    }

    fn adopt(&mut self, old: &Self) {
        self.x.adopt(&old.x);
        self.y.adopt(&old.y);
        self.capped = old.capped;
    }

    fn reset(&mut self) {
        self.x.reset();
        self.y.reset();
        self.capped = false;
    }
}

/// The attitude whose body z axis points along `force` \[any unit, world\] and whose 3-2-1 yaw is `yaw_rad` \[rad\].
///
/// With yaw and pitch alone body y would be (-sin yaw, cos yaw, 0), and roll leaves body x in place: body x is normal to
/// that direction and to the force, body y completes the triad. This fails only if the two are parallel, which needs a
/// tilt of 90 degrees; then, and without a force, the attitude is level at the given yaw.
pub fn attitude_along(force: &Vector3<f64>, yaw_rad: f64) -> Attitude {
    let level = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad);
    let side = level * Vector3::y();
    let triad = force.try_normalize(SMALLEST_NORM).and_then(|up| {
        let forward = side.cross(&up).try_normalize(SMALLEST_NORM)?;
        Some(Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[
            forward,
            up.cross(&forward),
            up,
        ])))
    });
    Attitude::from_rotation_matrix(&triad.unwrap_or(level))
}
