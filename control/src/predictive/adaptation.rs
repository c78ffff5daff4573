//! Adaptation of the vehicle model in flight: response to commanded rates, and thrust.
//!
//! The response is estimated by a [`RotationEstimator`] within bounds about the configured one. A second estimator, whose
//! parameters are fixed, predicts the same poses. The difference of the squares of their normalised innovations about roll and
//! pitch, summed over some seconds, is the logarithm of the likelihood ratio of the two models: if the fixed model is more
//! likely, it is used and the adaptation restarts; the adapted model is used again once it has been equally good for some time.
//! The thrust estimate follows the vertical acceleration that the position filter would otherwise attribute to a force: with a
//! wrong thrust or mass, horizontal accelerations are wrong by the same factor. Forces are temporary and thrust errors permanent:
//! the longer the flight, the more slowly the thrust estimate follows.
//!
//! Parameters are not adapted until the vehicle is clear of the floor, which exerts forces.

use nalgebra::Vector3;

use super::history::{CommandEffect, CommandHistory};
use super::model::{Motion, Rotation, VehicleModel};
use super::options::{AdaptationOptions, FilterOptions};
use super::rotation_estimator::{RateResponse, ResponseBounds, RotationEstimator};
use crate::quaternion::Attitude;

/// Time constant with which evidence for one of the models decays \[s\].
const EVIDENCE_S: f64 = 3.0;

/// Logarithm of the likelihood ratio, fixed to adapted model \[-\], above which the fixed model is used, and below which the
/// adapted model may be used again.
const WORSE: f64 = 10.0;
const AS_GOOD: f64 = 4.0;

/// Time for which the adapted model must be equally good before it is used again \[s\].
const PROBATION_S: f64 = 2.0;

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
    /// Rate over the commanded one \[-\].
    pub rate_gain: f64,
    /// Lag of the rate \[s\].
    pub rate_lag_s: f64,
    /// Delay of the rotation that is hidden from the reports \[s\].
    pub delay_s: f64,
    /// Thrust over the mass, relative to the configured one \[-\].
    pub thrust_gain: f64,
    /// Whether the configured response is used because the adapted one predicts worse.
    pub fell_back: bool,
}

impl AdaptedModel {
    /// The correction of the reported effect of commands.
    pub fn effect(&self) -> CommandEffect {
        CommandEffect { delay_s: self.delay_s, gain: Vector3::repeat(self.rate_gain) }
    }

    /// `nominal` with this lag and thrust.
    pub fn of(&self, nominal: &VehicleModel) -> VehicleModel {
        let rotation = match nominal.rotation {
            Rotation::RateLoop { .. } => Rotation::RateLoop { lag_s: self.rate_lag_s },
            other => other,
        };
        VehicleModel { rotation, mass_kg: nominal.mass_kg / self.thrust_gain, ..*nominal }
    }
}

/// The two estimators of the rotation, with the evidence for each.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rotating {
    adapted: RotationEstimator,
    fixed: RotationEstimator,
    /// Logarithm of the likelihood ratio of the last seconds, fixed to adapted model \[-\].
    evidence: f64,
    /// Time for which the adapted model has been equally good while the fixed one is used \[s\]; `None` while the adapted one is
    /// used.
    probation_s: Option<f64>,
}

/// Adaptation of the model of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adaptation {
    options: AdaptationOptions,
    filter: FilterOptions,
    nominal: VehicleModel,
    /// Time \[s\] and height \[m, world\] of the first pose in flight.
    lift_off: Option<(f64, f64)>,
    /// Time of the last pose clear of the floor \[s\].
    last_s: Option<f64>,
    /// `None` on the floor, and for a vehicle whose rates are not commanded.
    rotating: Option<Rotating>,
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
            last_s: None,
            rotating: None,
            thrust_gain: 1.0,
        }
    }

    /// Discards the adapted parameters.
    pub fn reset(&mut self) {
        *self = Self::new(&self.options, &self.filter, &self.nominal);
    }

    /// Takes further poses with the attitude noise of `filter`.
    pub fn set_noise(&mut self, filter: &FilterOptions) {
        self.filter = *filter;
        if let Some(rotating) = &mut self.rotating {
            rotating.adapted.set_noise(filter);
            rotating.fixed.set_noise(filter);
        }
    }

    /// Takes the attitude measured at `t_s` \[s\] in flight, and the external vertical acceleration that the position filter
    /// estimates then \[m/s^2, world\].
    pub fn take(
        &mut self,
        t_s: f64,
        (measured, motion, vertical): (&Attitude, &Motion, f64),
        history: &CommandHistory,
    ) {
        let height_m = motion.position.z;
        let (lifted_s, lifted_m) = *self.lift_off.get_or_insert((t_s, height_m));
        if self.last_s.is_none() && height_m < lifted_m + CLEAR_M && t_s < lifted_s + CLEAR_S {
            return;
        }
        let Some(last_s) = self.last_s.replace(t_s) else {
            self.rotating = self.started(measured);
            return;
        };
        let dt_s = t_s - last_s;
        if dt_s <= 0.0 {
            return;
        }
        if let Some(rotating) = &mut self.rotating {
            rotating.take(measured, history, (last_s, t_s));
        }
        let gravity = self.nominal.gravity_m_s2;
        if motion.thrust_n > LEAST_THRUST * gravity * self.nominal.mass_kg {
            let [least_s, most_s] = THRUST_S;
            let share = (dt_s / (t_s - lifted_s).clamp(least_s, most_s)).clamp(0.0, 1.0);
            let most = self.options.thrust_deviation;
            let gain = self.thrust_gain + share * vertical / gravity;
            self.thrust_gain = gain.clamp(1.0 - most, 1.0 + most);
        }
    }

    fn started(&self, measured: &Attitude) -> Option<Rotating> {
        let bounds = self.bounds()?;
        let known = RateResponse { gain: 0.0, lag_s: 0.0, delay_s: 0.0 };
        let with = |deviation| {
            let bounds = ResponseBounds { deviation, ..bounds };
            RotationEstimator::new(bounds, &self.filter, *measured)
        };
        let (adapted, fixed) = (with(bounds.deviation), with(known));
        Some(Rotating { adapted, fixed, evidence: 0.0, probation_s: None })
    }

    /// `None` for a vehicle whose rates are not commanded.
    fn bounds(&self) -> Option<ResponseBounds> {
        let Rotation::RateLoop { lag_s } = self.nominal.rotation else { return None };
        let options = &self.options;
        Some(ResponseBounds {
            nominal: RateResponse { gain: 1.0, lag_s, delay_s: 0.0 },
            deviation: RateResponse {
                gain: options.rate_gain_deviation,
                lag_s: options.rate_lag_deviation_ms * 1e-3,
                delay_s: options.delay_deviation_ms * 1e-3,
            },
        })
    }

    /// Model to be used.
    pub fn model(&self) -> AdaptedModel {
        let fell_back = self.rotating.is_some_and(|rotating| rotating.probation_s.is_some());
        let adapted = self.rotating.filter(|_| !fell_back);
        let nominal = self.bounds().map(|bounds| bounds.nominal);
        let response = adapted.map(|rotating| rotating.adapted.response()).or(nominal);
        let response = response.unwrap_or(RateResponse { gain: 1.0, lag_s: 0.0, delay_s: 0.0 });
        AdaptedModel {
            rate_gain: response.gain,
            rate_lag_s: response.lag_s,
            delay_s: response.delay_s,
            thrust_gain: self.thrust_gain,
            fell_back,
        }
    }
}

impl Rotating {
    fn take(&mut self, measured: &Attitude, history: &CommandHistory, interval: (f64, f64)) {
        let dt_s = interval.1 - interval.0;
        let (adapted, _) = self.adapted.take(measured, history, interval);
        let (fixed, variance) = self.fixed.take(measured, history, interval);
        let kept = (1.0 - dt_s / EVIDENCE_S).clamp(0.0, 1.0);
        let squares = [adapted, fixed].map(|innovation| innovation.xy().norm_squared());
        let worse = (squares[0] - squares[1]) / (2.0 * variance);
        // A sum that does not fall below zero detects a change early (Page, Biometrika 41, 1954).
        self.evidence = (self.evidence * kept + worse).max(0.0);
        self.select_model(dt_s);
    }

    /// Selects the model to be used.
    fn select_model(&mut self, dt_s: f64) {
        self.probation_s = match self.probation_s {
            _ if self.evidence > WORSE => {
                self.adapted = self.adapted.restarted(&self.fixed);
                self.evidence = 0.0;
                Some(0.0)
            }
            None => None,
            Some(_) if self.evidence > AS_GOOD => Some(0.0),
            Some(since_s) => Some(since_s + dt_s).filter(|since_s| *since_s < PROBATION_S),
        };
    }
}
