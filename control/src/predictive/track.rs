//! The motion expected of a vehicle under the commands sent to it, and how far a pose may be from it.
//!
//! A track is the state of a Kalman filter of its own, beside that of the autopilot: it serves every law, and its noise is
//! chosen for all motions that a vehicle could make, not for the best estimate. The motion is propagated by the vehicle
//! model through the commands in effect; the covariance grows with the time since the last pose. Close to the floor, which
//! pushes too, velocity and rate are taken as constant.
//!
//! The innovation of a pose is its distance from the prediction in standard deviations (Bar-Shalom, Li and Kirubarajan,
//! *Estimation with Applications to Tracking and Navigation*, 2001, section 5.4). A pose whose innovation is large
//! corrects the track as one of larger noise (Huber, *Robust Statistics*, 1981).

use nalgebra::Vector3;

use super::attitude_filter::AttitudeFilter;
use super::history::CommandHistory;
use super::model::{Bias, Motion, VehicleModel};
use super::options::FilterOptions;
use super::position_filter::PositionFilter;
use crate::estimator::Estimate;
use crate::quantity::BodyRate;
use crate::quaternion::Attitude;

/// Height above the floor below which the floor may push \[m\].
const FLOOR_REACH_M: f64 = 0.05;

/// Innovation above which a pose corrects the track as one of larger noise \[standard deviations\].
const HUBER_SIGMA: f64 = 2.5;

/// Limit of each component of the external acceleration \[m/s^2\]: wind of half the weight, or half of the thrust missing.
const ACCELERATION_LIMIT: f64 = 8.0;

/// A pose as measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredPose {
    /// Position \[m, world\].
    pub position: Vector3<f64>,
    /// Attitude, body to world.
    pub attitude: Attitude,
}

/// A pose relative to its prediction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    /// From the predicted position to that of the pose \[m, world\].
    pub offset: Vector3<f64>,
    /// Rotation vector from the predicted attitude to that of the pose \[rad, body\].
    pub turn: Vector3<f64>,
}

/// Distance of a pose from its prediction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Innovation {
    /// Of the position \[standard deviations\].
    pub position_sigma: f64,
    /// Of the attitude \[standard deviations\].
    pub attitude_sigma: f64,
}

impl Innovation {
    /// The larger of both \[standard deviations\].
    #[must_use]
    pub fn sigma(&self) -> f64 {
        self.position_sigma.max(self.attitude_sigma)
    }
}

/// What a track is predicted with.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings<'a> {
    /// Model of the vehicle.
    pub model: &'a VehicleModel,
    /// The commands sent.
    pub history: &'a CommandHistory,
    /// Height of the floor \[m, world z\].
    pub floor_m: f64,
}

/// Expected motion at an instant with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// The instant \[s\].
    pub t_s: f64,
    /// The motion.
    pub motion: Motion,
    options: FilterOptions,
    attitude: AttitudeFilter,
    position: PositionFilter,
}

impl Track {
    /// A vehicle at rest in `pose` at `t_s` \[s\], its motors off.
    #[must_use]
    pub fn at_rest(options: FilterOptions, t_s: f64, pose: &MeasuredPose) -> Self {
        let MeasuredPose { position, attitude } = *pose;
        Self {
            t_s,
            motion: Motion { position, attitude, ..Motion::default() },
            options,
            attitude: AttitudeFilter::new(&options),
            position: PositionFilter::new(&options).with_bias_limit(ACCELERATION_LIMIT),
        }
    }

    /// The track at `t_s` \[s\] without a pose since; unchanged if `t_s` is not later.
    #[must_use]
    pub fn advanced(&self, t_s: f64, surroundings: &Surroundings) -> Self {
        let dt_s = t_s - self.t_s;
        if dt_s.is_nan() || dt_s <= 0.0 {
            return *self;
        }
        let Surroundings { model, history, .. } = surroundings;
        let flown = history.propagate(model, (&self.motion, &self.bias()), (self.t_s, t_s));
        let mut next = Self { t_s, ..*self };
        next.motion = if self.is_at_floor(surroundings.floor_m) {
            let Motion { position, velocity, attitude, rate, .. } = self.motion;
            let (position, attitude) =
                (position + velocity * dt_s, attitude.turned_by(rate * dt_s));
            Motion { position, attitude, thrust_n: flown.thrust_n, ..self.motion }
        } else {
            flown
        };
        next.attitude.predict(&model.rotation, dt_s);
        next.position.predict(model.drag_per_s, dt_s);
        next
    }

    /// `pose`, measured at the instant of the track, relative to it.
    #[must_use]
    pub fn deviation(&self, pose: &MeasuredPose) -> Deviation {
        Deviation {
            offset: pose.position - self.motion.position,
            turn: self.motion.attitude.rotation_to(&pose.attitude),
        }
    }

    /// The innovation of a pose with this deviation.
    #[must_use]
    pub fn innovation(&self, Deviation { offset, turn }: &Deviation) -> Innovation {
        Innovation {
            position_sigma: offset.norm() / self.position_sd_m().hypot(self.position_noise()),
            attitude_sigma: turn.norm() / self.attitude_sd_rad().hypot(self.attitude_noise()),
        }
    }

    /// The track corrected by a pose with this deviation.
    #[must_use]
    pub fn corrected(&self, Deviation { offset, turn }: &Deviation, floor_m: f64) -> Self {
        let mut next = *self;
        let noise = huber_noise(offset.norm(), (self.position_sd_m(), self.position_noise()));
        next.position.correct_by(&mut next.motion, offset, noise);
        let noise = huber_noise(turn.norm(), (self.attitude_sd_rad(), self.attitude_noise()));
        next.attitude.correct_by(&mut next.motion, turn, noise);
        if next.is_at_floor(floor_m) {
            next.position.forget_bias();
            next.attitude.forget_bias();
        }
        next
    }

    /// Estimated external acceleration: wind, or a thrust or mass other than configured \[m/s^2, world\].
    #[must_use]
    pub fn external_acceleration(&self) -> &Vector3<f64> {
        self.position.bias()
    }

    /// Standard deviation of the position along each axis \[m\].
    #[must_use]
    pub fn position_sd_m(&self) -> f64 {
        self.position.covariance().0[(0, 0)].sqrt()
    }

    /// Standard deviation of the attitude about each axis \[rad\].
    #[must_use]
    pub fn attitude_sd_rad(&self) -> f64 {
        self.attitude.covariance().0[(0, 0)].sqrt()
    }

    /// The motion as the laws take it.
    #[must_use]
    pub fn estimate(&self) -> Estimate {
        let Motion { position, velocity, attitude, rate, .. } = self.motion;
        Estimate { position, velocity, attitude, rate: BodyRate(rate) }
    }

    fn bias(&self) -> Bias {
        Bias { demand: *self.attitude.bias(), acceleration: *self.position.bias() }
    }

    /// Whether the vehicle is so close to a floor at `floor_m` \[m, world z\] that the floor may push.
    #[must_use]
    pub fn is_at_floor(&self, floor_m: f64) -> bool {
        self.motion.position.z < floor_m + FLOOR_REACH_M
    }

    fn position_noise(&self) -> f64 {
        self.options.position_noise_mm * 1e-3
    }

    fn attitude_noise(&self) -> f64 {
        self.options.attitude_noise_deg.to_radians()
    }
}

/// The measurement noise that makes an innovation of this `distance` one of at most [`HUBER_SIGMA`], for a state and a
/// measurement of these standard deviations.
fn huber_noise(distance: f64, (state, noise): (f64, f64)) -> f64 {
    let tolerated = distance / HUBER_SIGMA;
    noise.max((tolerated * tolerated - state * state).max(0.0).sqrt())
}
