//! Adaptation of the vehicle model in flight: response to commanded rates, and thrust.
//!
//! The response to rates is estimated by a [`RotationEstimator`], the lag of the thrust by a [`ThrustEstimator`], both within bounds
//! about the configured values; an [`EstimatorPair`] chooses between each and its configured model. The gain of the thrust follows
//! the vertical acceleration that the position filter would otherwise attribute to a force: with a wrong thrust or mass, horizontal
//! accelerations are wrong by the same factor. Forces are temporary and thrust errors permanent: the longer the flight, the more
//! slowly the gain follows.
//!
//! Parameters are not adapted until the vehicle is clear of the floor, whose forces no model contains.

use nalgebra::{Vector2, Vector3};

use super::estimator_pair::EstimatorPair;
use super::history::{CommandEffect, CommandHistory};
use super::model::{Motion, Rotation, VehicleModel};
use super::options::{AdaptationOptions, FilterOptions};
use super::rotation_estimator::{RateResponse, ResponseBounds, RotationEstimator, TurnInterval};
use super::thrust_estimator::{ClimbInterval, ThrustEstimator};
use super::track::MeasuredPose;

/// Least and greatest time constant with which the thrust estimate follows the vertical acceleration \[s\]; in between, the time
/// in flight.
const THRUST_S: [f64; 2] = [1.5, 8.0];

/// Thrust over the weight of the configured model below which the vertical acceleration contains no information on the thrust
/// \[-\].
const LEAST_THRUST: f64 = 0.7;

/// Height above the first pose in flight \[m\], or time since that pose \[s\], above which the vehicle is clear of the floor.
const CLEAR_M: f64 = 0.1;
const CLEAR_S: f64 = 3.0;

/// Model in use, relative to the configured one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdaptedModel {
    /// Rate over the commanded one \[-, body axes\].
    pub rate_gain: Vector3<f64>,
    /// Lag of the rate \[s\].
    pub rate_lag_s: f64,
    /// Delay of the rotation that is hidden from the reports \[s\].
    pub delay_s: f64,
    /// Thrust over the mass, relative to the configured one \[-\].
    pub thrust_gain: f64,
    /// Lag of the thrust \[s\].
    pub thrust_lag_s: f64,
    /// Whether the configured response to rates is used because the adapted one predicts worse.
    pub fell_back: bool,
}

impl AdaptedModel {
    /// The correction of the reported effect of commands.
    pub fn effect(&self) -> CommandEffect {
        CommandEffect { delay_s: self.delay_s, gain: self.rate_gain }
    }

    /// `nominal` with this lag and thrust.
    pub fn of(&self, nominal: &VehicleModel) -> VehicleModel {
        let rotation = match nominal.rotation {
            Rotation::RateLoop { .. } => Rotation::RateLoop { lag_s: self.rate_lag_s },
            other => other,
        };
        let mass_kg = nominal.mass_kg / self.thrust_gain;
        VehicleModel { rotation, mass_kg, thrust_lag_s: self.thrust_lag_s, ..*nominal }
    }
}

/// Adaptation of the model of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adaptation {
    options: AdaptationOptions,
    filter: FilterOptions,
    nominal: VehicleModel,
    /// Time \[s\] and height \[m, world\] of the first pose in flight.
    lift_off: Option<(f64, f64)>,
    /// Whether the vehicle is clear of the floor.
    is_clear: bool,
    /// Time of the last pose in flight \[s\], and cosine of the tilt then \[-\].
    last: Option<(f64, f64)>,
    /// Estimators of the rotation; `None` before the first pose in flight, and for a vehicle whose rates are not commanded.
    rotating: Option<EstimatorPair<RotationEstimator>>,
    /// Estimators of the thrust; `None` before the first pose in flight.
    lifting: Option<EstimatorPair<ThrustEstimator>>,
    thrust_gain: f64,
}

impl Adaptation {
    /// The adaptation of `nominal`, for poses with the noise of `filter`.
    pub fn new(
        options: &AdaptationOptions,
        filter: &FilterOptions,
        nominal: &VehicleModel,
    ) -> Self {
        let (options, filter, nominal) = (*options, *filter, *nominal);
        Self {
            options,
            filter,
            nominal,
            lift_off: None,
            is_clear: false,
            last: None,
            rotating: None,
            lifting: None,
            thrust_gain: 1.0,
        }
    }

    /// Discards the adapted parameters.
    pub fn reset(&mut self) {
        *self = Self::new(&self.options, &self.filter, &self.nominal);
    }

    /// The adaptation with the noise of `other`; `other` itself if its model or its bounds are others.
    pub fn continued_as(&self, other: &Self) -> Self {
        if (self.options, self.nominal) != (other.options, other.nominal) {
            return *other;
        }
        let mut next = *self;
        next.set_noise(&other.filter);
        next
    }

    /// Restarts the estimators at the next pose, after a motion that no model describes; their estimates are discarded. The gain of the
    /// thrust is kept.
    pub fn interrupt(&mut self) {
        self.last = None;
    }

    /// Takes further poses with the noise of `filter`.
    pub fn set_noise(&mut self, filter: &FilterOptions) {
        self.filter = *filter;
        for rotating in self.rotating.iter_mut().flat_map(EstimatorPair::each) {
            rotating.set_noise(filter);
        }
        for lifting in self.lifting.iter_mut().flat_map(EstimatorPair::each) {
            lifting.set_noise(filter);
        }
    }

    /// Takes the pose measured at `t_s` \[s\] in flight, the motion estimated with it, and the external vertical acceleration that
    /// the position filter estimates then \[m/s^2, world\].
    pub fn take(
        &mut self,
        t_s: f64,
        (pose, motion, vertical): (&MeasuredPose, &Motion, f64),
        history: &CommandHistory,
    ) {
        let height_m = motion.position.z;
        let (lifted_s, lifted_m) = *self.lift_off.get_or_insert((t_s, height_m));
        let is_clear = height_m >= lifted_m + CLEAR_M || t_s >= lifted_s + CLEAR_S;
        let cosine = motion.attitude.to_world(&Vector3::z()).z;
        let last = self.last.replace((t_s, cosine));
        // Until the vehicle is clear of the floor, the estimators measure the noise and learn nothing; then they begin again.
        if last.is_none() || is_clear && !self.is_clear {
            self.is_clear |= is_clear;
            self.start(pose, motion);
            return;
        }
        let Some((last_s, last_cosine)) = last else { return };
        let (dt_s, interval) = (t_s - last_s, (last_s, t_s));
        if dt_s <= 0.0 {
            return;
        }
        if let Some(rotating) = &mut self.rotating {
            let turn = TurnInterval { attitude: pose.attitude, history, interval };
            rotating.take(&turn, dt_s, self.is_clear);
        }
        if let Some(lifting) = &mut self.lifting {
            let cosine = 0.5 * (cosine + last_cosine);
            let climb = ClimbInterval { height_m: pose.position.z, cosine, history, interval };
            lifting.take(&climb, dt_s, self.is_clear);
        }
        let gravity = self.nominal.gravity_m_s2;
        if self.is_clear && motion.thrust_n > LEAST_THRUST * gravity * self.nominal.mass_kg {
            let [least_s, most_s] = THRUST_S;
            let share = (dt_s / (t_s - lifted_s).clamp(least_s, most_s)).clamp(0.0, 1.0);
            let most = self.options.thrust_deviation;
            let gain = self.thrust_gain + share * vertical / gravity;
            self.thrust_gain = gain.clamp(1.0 - most, 1.0 + most);
        }
    }

    /// Starts the estimators from a pose in flight.
    fn start(&mut self, pose: &MeasuredPose, motion: &Motion) {
        self.rotating = self.bounds().map(|bounds| {
            let with = |deviation| {
                let bounds = ResponseBounds { deviation, ..bounds };
                RotationEstimator::new(bounds, &self.filter, pose.attitude)
            };
            let known = RateResponse { gain: Vector3::zeros(), lag_s: 0.0, delay_s: 0.0 };
            EstimatorPair::new([bounds.deviation, known].map(with), self.rotating.as_ref())
        });
        let AdaptationOptions { thrust_deviation, thrust_lag_deviation_ms, .. } = self.options;
        let thrust = motion.thrust_n / self.nominal.mass_kg;
        let climbing = Vector3::new(motion.position.z, motion.velocity.z, thrust);
        let with = |lag_s| {
            let deviation = Vector2::new(thrust_deviation, lag_s);
            ThrustEstimator::new(&self.nominal, deviation, &self.filter, climbing)
        };
        let estimators = [thrust_lag_deviation_ms * 1e-3, 0.0].map(with);
        self.lifting = Some(EstimatorPair::new(estimators, self.lifting.as_ref()));
    }

    /// Nominal rate response and its prior standard deviations; `None` for a vehicle whose rates are not commanded.
    fn bounds(&self) -> Option<ResponseBounds> {
        let Rotation::RateLoop { lag_s } = self.nominal.rotation else { return None };
        let options = &self.options;
        Some(ResponseBounds {
            nominal: RateResponse { gain: Vector3::repeat(1.0), lag_s, delay_s: 0.0 },
            deviation: RateResponse {
                gain: Vector3::repeat(options.rate_gain_deviation),
                lag_s: options.rate_lag_deviation_ms * 1e-3,
                delay_s: options.delay_deviation_ms * 1e-3,
            },
        })
    }

    /// Adapted model; its nominal values where nothing has been estimated yet.
    pub fn model(&self) -> AdaptedModel {
        let rotating = self.rotating.as_ref().map(EstimatorPair::used);
        let nominal = self.bounds().map(|bounds| bounds.nominal);
        let response = rotating.flatten().map(RotationEstimator::response).or(nominal);
        let (rate_gain, rate_lag_s, delay_s) = match response {
            Some(RateResponse { gain, lag_s, delay_s }) => (gain, lag_s, delay_s),
            None => (Vector3::repeat(1.0), 0.0, 0.0),
        };
        let lifting = self.lifting.as_ref().and_then(EstimatorPair::used);
        AdaptedModel {
            rate_gain,
            rate_lag_s,
            delay_s,
            thrust_gain: self.thrust_gain,
            thrust_lag_s: lifting.map_or(self.nominal.thrust_lag_s, ThrustEstimator::lag_s),
            fell_back: rotating.is_some_and(|used| used.is_none()),
        }
    }
}
