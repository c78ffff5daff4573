//! What the poses and the commands already sent say together of the vehicle's motion.

use super::attitude_filter::AttitudeFilter;
use super::history::CommandHistory;
use super::model::{Bias, Motion, VehicleModel};
use super::options::FilterOptions;
use super::position_filter::PositionFilter;
use crate::estimator::Estimate;

/// With this share of its weight as thrust a vehicle is about to leave the floor.
const LIFTING: f64 = 0.9;

/// A pose further than this from where the vehicle was expected starts the filters anew \[m\].
const LOST_M: f64 = 1.0;

/// Both filters about one model of the vehicle.
///
/// On the floor the model does not hold: the floor pushes, too. Until the vehicle lifts, its motion
/// is what the poses say, differenced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionObserver {
    model: VehicleModel,
    options: FilterOptions,
    attitude: AttitudeFilter,
    position: PositionFilter,
    /// When the last pose was taken \[s\], and the motion then.
    last: Option<(f64, Motion)>,
    airborne: bool,
}

impl MotionObserver {
    /// An observer that has seen nothing.
    #[must_use]
    pub fn new(model: VehicleModel, options: FilterOptions) -> Self {
        Self {
            model,
            options,
            attitude: AttitudeFilter::new(&options),
            position: PositionFilter::new(&options),
            last: None,
            airborne: false,
        }
    }

    /// Starts anew with a vehicle that stands where it was last seen.
    pub fn reset(&mut self) {
        *self = Self { last: self.last, ..Self::new(self.model, self.options) };
    }

    /// The motion at the last pose, and when that was taken \[s\].
    #[must_use]
    pub fn latest(&self) -> Option<(f64, &Motion)> {
        self.last.as_ref().map(|(t_s, motion)| (*t_s, motion))
    }

    /// What acts besides the commands.
    #[must_use]
    pub fn bias(&self) -> Bias {
        Bias { demand: *self.attitude.bias(), acceleration: *self.position.bias() }
    }

    /// Takes the pose captured at `t_s` \[s\]: `measured` with the rates that follow from differences.
    /// One that is not finite, or not later than the last, is ignored.
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
        self.attitude.correct(&mut motion, &measured.attitude);
        let innovation = self.position.correct(&mut motion, &measured.position);
        if motion.is_finite() && innovation.norm() <= LOST_M {
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

    /// The motion at `t_s` \[s\], ahead of the last pose; `None` before the first.
    #[must_use]
    pub fn predict(&self, t_s: f64, history: &CommandHistory) -> Option<Motion> {
        let (last_s, motion) = self.last?;
        if !self.airborne {
            return Some(motion);
        }
        Some(history.propagate(&self.model, (&motion, &self.bias()), (last_s, t_s)))
    }
}
