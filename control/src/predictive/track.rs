//! State of the motion tracker: the motion expected at an instant, with its uncertainty.
//!
//! The motion is propagated by the vehicle model through the commands in effect; close to the floor, which pushes too, velocity
//! and rate are taken as constant. Poses correct it by the gains of two Kalman filters.
//!
//! Two assumptions about the error of the model serve two purposes. *Admission* allows for every motion that wind, contact and
//! deviations of the vehicle from the model may cause: its covariance bounds the distance of a pose from the prediction
//! (Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 5.4). *Estimation*
//! assumes the noise of an undisturbed flight, which gives the best estimate for a law that uses it. A pose that the estimation
//! does not expect is a sign that the motion has changed: it is taken with the covariance of admission, from which the filter
//! settles again (the same, section 11.2). The bound on the distance of a pose is the same for every law. Laws without prediction
//! use only the filter of admission.
//!
//! Under admission, a pose with a large innovation corrects the track like one with larger noise (Huber, *Robust Statistics*,
//! 1981).

use nalgebra::Vector3;

use super::attitude_filter::AttitudeFilter;
use super::history::CommandHistory;
use super::kalman::AxisFilter;
use super::model::{Bias, Motion, VehicleModel};
use super::options::FilterOptions;
use super::position_filter::PositionFilter;
use crate::estimator::Estimate;
use crate::quantity::BodyRate;
use crate::quaternion::Attitude;

/// Height above the floor below which the floor may push \[m\].
const FLOOR_REACH_M: f64 = 0.05;

/// Innovation above which a pose corrects a filter of admission like one with larger noise \[standard deviations\].
const HUBER_SIGMA: f64 = 2.5;

/// Innovation that a filter of estimation does not expect \[standard deviations\]. A push of half the weight reaches it within a few
/// poses, before it reaches the bound of the gate. Lower thresholds change the gains of the loop while the model is still being
/// adapted: with 5, a vehicle of a lag of 10 ms and 1.3 times the authority was stopped in 24 of 32 hovers.
const UNEXPECTED_SIGMA: f64 = 20.0;

/// Standard deviation of the part of a predicted change of the rate that comes late, over the whole change \[-\].
const LATE_SHARE: f64 = 0.5;

/// Limits of the external acceleration \[m/s^2, world\]: for admission, wind of eight tenths of the weight, or that share of the thrust
/// missing; for a law that subtracts it from its command, less vertically, since most lasting vertical forces are a wrong thrust. With
/// the wider limit there, thrust that was a third too strong and late by a hidden 50 ms oscillated until the flight was ended.
const ADMISSION_LIMIT: Vector3<f64> = Vector3::new(8.0, 8.0, 8.0);
const ESTIMATION_LIMIT: Vector3<f64> = Vector3::new(8.0, 8.0, 3.0);

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
    /// Vector from the predicted position to that of the pose \[m, world\].
    pub offset: Vector3<f64>,
    /// Rotation vector from the predicted attitude to that of the pose \[rad, body\].
    pub turn: Vector3<f64>,
}

/// Distance of a pose from its prediction, normalised by the covariance used for admission.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Innovation {
    /// Distance of the position \[standard deviations\].
    pub position_sigma: f64,
    /// Distance of the attitude \[standard deviations\].
    pub attitude_sigma: f64,
}

impl Innovation {
    /// The larger of both \[standard deviations\].
    pub fn sigma(&self) -> f64 {
        self.position_sigma.max(self.attitude_sigma)
    }
}

/// Difference of a pose from its prediction, by the filters of estimation. With a correct noise model, innovations are white and
/// their normalised squares have a mean of 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterInnovation {
    /// Measured position minus the expected one \[m, world\].
    pub position: Vector3<f64>,
    /// Rotation from the expected attitude to the measured one \[rad, body axes\].
    pub attitude: Vector3<f64>,
    /// Square of the position's innovation over its expected variance, mean of the axes \[-\].
    pub position_nis: f64,
    /// Square of the attitude's innovation over its expected variance, mean of the axes \[-\].
    pub attitude_nis: f64,
}

/// Noise for the filters of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackNoise {
    /// Noise of poses and of any motion that a vehicle could make.
    pub admission: FilterOptions,
    /// Noise of poses and of an undisturbed flight, for a law that uses the track; `None` without such a law.
    pub estimation: Option<FilterOptions>,
}

/// Model, commands and floor for the propagation of a track.
#[derive(Clone, Copy, Debug)]
pub struct Propagation<'a> {
    /// Model of the vehicle.
    pub model: &'a VehicleModel,
    /// The commands sent.
    pub history: &'a CommandHistory,
    /// Height of the floor \[m, world z\].
    pub floor_m: f64,
}

/// The filters of attitude and position.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Filters {
    attitude: AttitudeFilter,
    position: PositionFilter,
}

impl Filters {
    fn new(noise: &FilterOptions, limit: Vector3<f64>) -> Self {
        Self { attitude: AttitudeFilter::new(noise), position: PositionFilter::new(noise, limit) }
    }

    fn set_noise(&mut self, noise: &FilterOptions) {
        self.attitude.axis.set_noise(noise.attitude_noise_deg.to_radians());
        self.position.axis.set_noise(noise.position_noise_mm * 1e-3);
    }

    /// Propagates the covariances over `dt_s` \[s\].
    fn predict(&mut self, model: &VehicleModel, dt_s: f64) {
        let Self { attitude, position } = self;
        attitude.axis.predict(&attitude.transition(&model.rotation, dt_s));
        position.axis.predict(&position.transition(model.drag_per_s, dt_s));
    }
}

/// Expected motion at an instant with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// The instant \[s\].
    pub t_s: f64,
    /// The motion.
    pub motion: Motion,
    /// Whether a law flies on the track and its thrust has been that of a vehicle that leaves the floor: from then on the model holds
    /// at any height, since a law needs the effect of its commands in the first centimetres.
    is_lifted: bool,
    /// The filters by which poses correct the motion.
    filters: Filters,
    /// Covariances of admission; `None` if `filters` are those of admission.
    admission: Option<Filters>,
}

impl Track {
    /// A vehicle at rest in `pose` at `t_s` \[s\], its motors off.
    pub fn at_rest(noise: &TrackNoise, t_s: f64, pose: &MeasuredPose) -> Self {
        let MeasuredPose { position, attitude } = *pose;
        let admission = Filters::new(&noise.admission, ADMISSION_LIMIT);
        let estimation =
            noise.estimation.as_ref().map(|noise| Filters::new(noise, ESTIMATION_LIMIT));
        Self {
            t_s,
            motion: Motion { position, attitude, ..Motion::default() },
            is_lifted: false,
            filters: estimation.unwrap_or(admission),
            admission: estimation.map(|_| admission),
        }
    }

    /// Corrects by further poses with the noise `noise`; walks are kept.
    pub fn set_noise(&mut self, noise: &TrackNoise) {
        self.filters.set_noise(noise.estimation.as_ref().unwrap_or(&noise.admission));
        if let Some(admission) = &mut self.admission {
            admission.set_noise(&noise.admission);
        }
    }

    /// The track for a law that uses filters of `noise`: motion and bias are kept.
    pub fn with_noise(&self, noise: &TrackNoise) -> Self {
        let Motion { position, attitude, .. } = self.motion;
        let mut next = Self::at_rest(noise, self.t_s, &MeasuredPose { position, attitude });
        let bias = self.bias();
        let filters = [Some(&mut next.filters), next.admission.as_mut()];
        for Filters { attitude, position } in filters.into_iter().flatten() {
            attitude.axis.shift_bias(&bias.demand);
            position.axis.shift_bias(&bias.acceleration);
        }
        Self { motion: self.motion, is_lifted: self.is_lifted, ..next }
    }

    /// The track at `t_s` \[s\] without a further pose; unchanged if `t_s` is not later.
    pub fn advanced(&self, t_s: f64, propagation: &Propagation) -> Self {
        let dt_s = t_s - self.t_s;
        if dt_s.is_nan() || dt_s <= 0.0 {
            return *self;
        }
        let mut next = Self { t_s, motion: self.motion_at(t_s, propagation), ..*self };
        next.filters.predict(propagation.model, dt_s);
        if let Some(admission) = &mut next.admission {
            admission.predict(propagation.model, dt_s);
        }
        // The rate changes later than predicted if rotors are at the end of their range, or commands come late.
        let change = (next.motion.rate - self.motion.rate).norm();
        let admission = next.admission.as_mut().unwrap_or(&mut next.filters);
        admission.attitude.axis.add_change(LATE_SHARE * change, dt_s);
        next
    }

    /// The motion at `t_s` \[s\], which is later.
    pub fn motion_at(&self, t_s: f64, propagation: &Propagation) -> Motion {
        let Propagation { model, history, floor_m } = *propagation;
        let flown = history.propagate(model, (&self.motion, &self.bias()), (self.t_s, t_s));
        if !self.is_held(floor_m) {
            return flown;
        }
        let Motion { position, velocity, attitude, rate, .. } = self.motion;
        let dt_s = t_s - self.t_s;
        let (position, attitude) = (position + velocity * dt_s, attitude.turned_by(rate * dt_s));
        Motion { position, attitude, thrust_n: flown.thrust_n, ..self.motion }
    }

    /// `pose`, measured at the instant of the track, relative to it.
    pub fn deviation(&self, pose: &MeasuredPose) -> Deviation {
        Deviation {
            offset: pose.position - self.motion.position,
            turn: self.motion.attitude.rotation_to(&pose.attitude),
        }
    }

    /// The innovation of a pose with this deviation.
    pub fn innovation(&self, Deviation { offset, turn }: &Deviation) -> Innovation {
        let Filters { attitude, position } = self.admission();
        let sigma =
            |off: &Vector3<f64>, axis: &AxisFilter| off.norm() / axis.sd().hypot(axis.noise());
        Innovation {
            position_sigma: sigma(offset, &position.axis),
            attitude_sigma: sigma(turn, &attitude.axis),
        }
    }

    /// The innovation of a pose with this deviation, by the filters that correct the motion.
    pub fn filter_innovation(&self, Deviation { offset, turn }: &Deviation) -> FilterInnovation {
        let Filters { attitude, position } = &self.filters;
        let nis = |off: &Vector3<f64>, axis: &AxisFilter| {
            off.norm_squared() / 3.0 / axis.innovation_variance()
        };
        FilterInnovation {
            position: *offset,
            attitude: *turn,
            position_nis: nis(offset, &position.axis),
            attitude_nis: nis(turn, &attitude.axis),
        }
    }

    /// The track corrected by a pose with this deviation.
    pub fn corrected(&self, Deviation { offset, turn }: &Deviation, floor_m: f64) -> Self {
        let mut next = *self;
        let is_held = self.is_held(floor_m);
        let Self { motion, filters: Filters { attitude, position }, admission, .. } = &mut next;
        let admitting = admission.as_mut().map(|admission| &mut admission.position.axis);
        let noise = noise_of(offset.norm(), &mut position.axis, admitting, is_held);
        position.correct(motion, offset, noise);
        let admitting = admission.as_mut().map(|admission| &mut admission.attitude.axis);
        let noise = noise_of(turn.norm(), &mut attitude.axis, admitting, is_held);
        attitude.correct(motion, turn, noise);
        if next.is_held(floor_m) {
            next.filters.position.axis.reset_bias();
            next.filters.attitude.axis.reset_bias();
        }
        next
    }

    /// Standard deviation of the position along each axis \[m\].
    pub fn position_sd_m(&self) -> f64 {
        self.admission().position.axis.sd()
    }

    /// The motion in the form that laws take.
    pub fn estimate(&self) -> Estimate {
        let Motion { position, velocity, attitude, rate, .. } = self.motion;
        Estimate { position, velocity, attitude, rate: BodyRate(rate) }
    }

    /// The estimated bias: of the demand, and an external acceleration by wind, or by a thrust or mass other than that of the model.
    pub fn bias(&self) -> Bias {
        let Filters { attitude, position } = &self.filters;
        Bias { demand: *attitude.axis.bias(), acceleration: *position.axis.bias() }
    }

    /// Whether the vehicle is close enough to a floor at `floor_m` \[m, world z\] for floor forces.
    pub fn is_at_floor(&self, floor_m: f64) -> bool {
        self.motion.position.z < floor_m + FLOOR_REACH_M
    }

    /// The track at the same instant of a vehicle that the floor at `floor_m` \[m, world z\] holds: at rest, with the horizontal position and
    /// the attitude of the track `before`, not below the floor.
    pub fn held_since(&self, before: &Self, floor_m: f64) -> Self {
        let Motion { mut position, attitude, .. } = before.motion;
        position.z = self.motion.position.z.max(floor_m);
        let (velocity, rate) = (Vector3::zeros(), Vector3::zeros());
        Self { motion: Motion { position, attitude, velocity, rate, ..self.motion }, ..*self }
    }

    /// Whether the vehicle has left the floor, or is about to.
    pub fn is_lifted(&self) -> bool {
        self.is_lifted
    }

    /// Marks the track as that of a vehicle that leaves the floor.
    pub fn lifted(&self) -> Self {
        Self { is_lifted: true, ..*self }
    }

    /// Whether the floor may hold the vehicle, so that the model does not apply.
    fn is_held(&self, floor_m: f64) -> bool {
        self.is_at_floor(floor_m) && !self.is_lifted
    }

    fn admission(&self) -> &Filters {
        self.admission.as_ref().unwrap_or(&self.filters)
    }
}

/// Measurement noise with which `filter` takes an innovation of this `distance`. Where it does not expect the innovation, and where
/// the floor may hold the vehicle, it takes over covariance and noise of `admission`, whose covariance is corrected too.
fn noise_of(
    distance: f64,
    filter: &mut AxisFilter,
    admission: Option<&mut AxisFilter>,
    is_held: bool,
) -> f64 {
    let Some(admission) = admission else { return huber_noise(distance, filter) };
    let expected = UNEXPECTED_SIGMA * filter.innovation_variance().sqrt();
    let is_expected = distance <= expected && !is_held;
    let admitted = huber_noise(distance, admission);
    if !is_expected {
        filter.set_covariance_of(admission);
    }
    admission.correct_covariance(admitted);
    if is_expected { filter.noise() } else { admitted }
}

/// Measurement noise with which an innovation of this `distance` is at most [`HUBER_SIGMA`] of `filter`.
fn huber_noise(distance: f64, filter: &AxisFilter) -> f64 {
    let (tolerated, sd) = (distance / HUBER_SIGMA, filter.sd());
    filter.noise().max((tolerated * tolerated - sd * sd).max(0.0).sqrt())
}
