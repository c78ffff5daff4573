//! Estimate of the vehicle's motion from poses and from the commands already sent.

use nalgebra::Vector3;

use super::attitude_filter::AttitudeFilter;
use super::history::CommandHistory;
use super::model::{Bias, Motion, VehicleModel};
use super::options::FilterOptions;
use super::position_filter::PositionFilter;
use crate::estimator::Estimate;

/// Share of the weight that the thrust reaches when the vehicle is about to leave the floor \[-\].
const LIFTING: f64 = 0.9;

/// Distance of a pose from the predicted position beyond which the filters restart \[m\].
const LOST_M: f64 = 1.0;

/// Difference of a pose from what the filters expected of it. Of filters that know their noise, innovations are white and their
/// normalised squares 1 in the mean.
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

/// Attitude and position filter around one model of the vehicle.
///
/// On the floor the model does not hold, because the floor pushes too. Until lift-off, position and attitude are
/// those of the poses, and the rates are their differences.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionObserver {
    model: VehicleModel,
    options: FilterOptions,
    attitude: AttitudeFilter,
    position: PositionFilter,
    /// Time of the last pose \[s\] and the motion at that time.
    last: Option<(f64, Motion)>,
    /// Innovation of the last pose; `None` on the floor.
    innovation: Option<FilterInnovation>,
    airborne: bool,
}

impl MotionObserver {
    /// An observer without a pose yet.
    #[must_use]
    pub fn new(model: VehicleModel, options: FilterOptions) -> Self {
        Self {
            model,
            options,
            attitude: AttitudeFilter::new(&options),
            position: PositionFilter::new(&options),
            last: None,
            innovation: None,
            airborne: false,
        }
    }

    /// Sets the model of the vehicle from now on.
    pub fn set_model(&mut self, model: VehicleModel) {
        self.model = model;
    }

    /// Whether the vehicle has left the floor.
    #[must_use]
    pub fn is_airborne(&self) -> bool {
        self.airborne
    }

    /// Restarts with a vehicle at rest at its last position.
    pub fn reset(&mut self) {
        *self = Self { last: self.last, ..Self::new(self.model, self.options) };
    }

    /// Time of the last pose \[s\] and the motion at that time.
    #[must_use]
    pub fn latest(&self) -> Option<(f64, &Motion)> {
        self.last.as_ref().map(|(t_s, motion)| (*t_s, motion))
    }

    /// Innovation of the last pose; `None` on the floor, and after a pose from which the filters restarted.
    #[must_use]
    pub fn innovation(&self) -> Option<&FilterInnovation> {
        self.innovation.as_ref()
    }

    /// The estimated bias.
    #[must_use]
    pub fn bias(&self) -> Bias {
        Bias { demand: *self.attitude.bias(), acceleration: *self.position.bias() }
    }

    /// Takes the pose captured at `t_s` \[s\]: `measured`, with rates from differences. A pose that is not finite, or
    /// not later than the last one, is ignored.
    pub fn take(&mut self, t_s: f64, measured: &Estimate, history: &CommandHistory) {
        let Some((last_s, last)) = self.last else {
            if t_s.is_finite() && Motion::of(measured, 0.0).is_finite() {
                self.last = Some((t_s, Motion::of(measured, 0.0)));
            }
            return;
        };
        // A comparison with NaN is false.
        if t_s > last_s && Motion::of(measured, 0.0).is_finite() {
            let carried = history.propagate(&self.model, (&last, &self.bias()), (last_s, t_s));
            let motion = if self.airborne {
                self.correct(carried, t_s - last_s, measured)
            } else {
                self.stand(&carried, measured)
            };
            self.last = Some((t_s, motion));
        }
    }

    fn correct(&mut self, mut motion: Motion, dt_s: f64, measured: &Estimate) -> Motion {
        self.attitude.predict(&self.model.rotation, dt_s);
        self.position.predict(self.model.drag_per_s, dt_s);
        let expected = [self.position.innovation_variance(), self.attitude.innovation_variance()];
        let attitude = self.attitude.correct(&mut motion, &measured.attitude);
        let position = self.position.correct(&mut motion, &measured.position);
        if motion.is_finite() && position.norm() <= LOST_M {
            self.innovation = Some(FilterInnovation {
                position,
                attitude,
                position_nis: position.norm_squared() / 3.0 / expected[0],
                attitude_nis: attitude.norm_squared() / 3.0 / expected[1],
            });
            return motion;
        }
        *self = Self { airborne: true, ..Self::new(self.model, self.options) };
        Motion::of(measured, self.model.mass_kg * self.model.gravity_m_s2)
    }

    fn stand(&mut self, carried: &Motion, measured: &Estimate) -> Motion {
        let weight = self.model.mass_kg * self.model.gravity_m_s2;
        self.airborne = carried.thrust_n >= LIFTING * weight;
        Motion::of(measured, carried.thrust_n)
    }

    /// Predicts the motion at `t_s` \[s\], later than the last pose; `None` before the first pose.
    #[must_use]
    pub fn predict(&self, t_s: f64, history: &CommandHistory) -> Option<Motion> {
        let (last_s, motion) = self.last?;
        if !self.airborne {
            return Some(motion);
        }
        Some(history.propagate(&self.model, (&motion, &self.bias()), (last_s, t_s)))
    }
}
