//! Recursive prediction-error estimate of the response to commanded thrust: gain and lag.
//!
//! Vertically the state `[z; v; a; f]` follows `z' = v`, `v' = f cos(tilt) + a - g - c v` and `f' = (k u - f) / l`: the thrust over
//! the mass, `f`, reaches the commanded one, `u`, times the gain `k` with the lag `l`. The external acceleration `a` walks. A
//! force does not depend on the command and is therefore attributed to `a`; motion that depends on it corrects the parameters, as
//! in [`super::rotation_estimator`]. Commands are assumed to take effect as reported: a hidden delay appears as a longer lag. Only the
//! lag is used in flight; the gain is estimated with it so that a wrong gain is not mistaken for a lag.

use nalgebra::{Matrix4x2, RowVector2, Vector2, Vector3, Vector4};

use super::estimator_pair::{AdaptiveEstimator, NormalisedSquare};
use super::history::CommandHistory;
use super::model::{SHORTEST_LAG_S, VehicleModel};
use super::options::FilterOptions;
use super::parameter_estimate::{LEAST_LAG_S, ParameterEstimate};
use super::position_filter::PositionFilter;

/// Limit of the external acceleration \[m/s^2\].
const ACCELERATION_LIMIT: f64 = 8.0;

/// Step of the differences by which sensitivities are computed: of the gain \[-\] and of the lag \[s\].
const STEPS: [f64; 2] = [1e-4, 1e-5];

/// Indices of the parameters.
const GAIN: usize = 0;
const LAG: usize = 1;

/// One interval between two poses.
#[derive(Clone, Copy, Debug)]
pub struct ClimbInterval<'a> {
    /// Measured height at the end of the interval \[m, world\].
    pub height_m: f64,
    /// Mean cosine of the tilt in the interval \[-\].
    pub cosine: f64,
    /// History of sent commands.
    pub history: &'a CommandHistory,
    /// Beginning and end of the interval \[s\].
    pub interval: (f64, f64),
}

/// State and parameters of the vertical motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThrustEstimator {
    model: VehicleModel,
    estimate: ParameterEstimate<2>,
    filter: PositionFilter,
    /// Height \[m, world\], velocity \[m/s\], thrust over the mass \[m/s^2\].
    motion: Vector3<f64>,
    /// Sensitivity of `[z; v; a; f]` to gain and lag \[units of both\].
    sensitivity: Matrix4x2<f64>,
}

impl ThrustEstimator {
    /// An estimator about the thrust of `model`, whose gain and lag \[s\] deviate from it by at most `deviation`, for poses with the
    /// noise of `options`, in the vertical motion `[z, v, f]` \[m, m/s, m/s^2\].
    pub fn new(
        model: &VehicleModel,
        deviation: Vector2<f64>,
        options: &FilterOptions,
        motion: Vector3<f64>,
    ) -> Self {
        let nominal = Vector2::new(1.0, model.thrust_lag_s);
        Self {
            model: *model,
            estimate: ParameterEstimate::new(nominal, deviation),
            filter: PositionFilter::new(options, Vector3::repeat(ACCELERATION_LIMIT)),
            motion,
            sensitivity: Matrix4x2::zeros(),
        }
    }

    /// Takes further poses with the position noise of `options`.
    pub fn set_noise(&mut self, options: &FilterOptions) {
        self.filter.axis.set_noise(options.position_noise_mm * 1e-3);
    }

    /// Estimated lag \[s\].
    pub fn lag_s(&self) -> f64 {
        self.estimate.value()[LAG]
    }

    /// Standard deviations of gain \[-\] and lag \[s\].
    pub fn deviations(&self) -> Vector2<f64> {
        self.estimate.deviations()
    }

    fn state(&self) -> Vector4<f64> {
        Vector4::new(self.motion.x, self.motion.y, self.filter.axis.bias().z, self.motion.z)
    }

    /// Adds to the state.
    fn shift(&mut self, by: &Vector4<f64>) {
        self.motion += Vector3::new(by.x, by.y, by.w);
        self.filter.axis.shift_bias(&(Vector3::z() * by.z));
    }

    /// Propagates everything over an interval.
    fn predict(&mut self, climb: &ClimbInterval) {
        let (state, parameters) = (self.state(), *self.estimate.value());
        let flown = self.climbed(state, &parameters, climb);
        if !self.estimate.is_fixed() {
            for (index, step) in STEPS.into_iter().enumerate() {
                let mut beside = parameters;
                beside[index] += step;
                let start = state + self.sensitivity.column(index) * step;
                let slope = (self.climbed(start, &beside, climb) - flown) / step;
                self.sensitivity.set_column(index, &slope);
            }
        }
        let dt_s = climb.interval.1 - climb.interval.0;
        self.filter.axis.predict(&self.filter.transition(self.model.drag_per_s, dt_s));
        self.motion = Vector3::new(flown.x, flown.y, flown.w);
        self.estimate.forget(dt_s);
    }

    /// The state at the end of an interval, from `state` at its beginning, with these parameters.
    fn climbed(
        &self,
        state: Vector4<f64>,
        parameters: &Vector2<f64>,
        climb: &ClimbInterval,
    ) -> Vector4<f64> {
        let [mut z, mut v, a, mut f]: [f64; 4] = state.into();
        let (gain, lag_s) = (parameters[GAIN], parameters[LAG].max(SHORTEST_LAG_S));
        let (mut t_s, to_s) = climb.interval;
        while t_s < to_s {
            let (input, until_s) = climb.history.reported(t_s, 0.0);
            let h = until_s.min(to_s) - t_s;
            let aim = gain * input.thrust_n / self.model.mass_kg;
            let (off, decay) = (f - aim, (-h / lag_s).exp());
            let gone_s = lag_s * (1.0 - decay);
            let (impulse, path) =
                (aim * h + off * gone_s, aim * h * h / 2.0 + off * lag_s * (h - gone_s));
            let other = a - self.model.gravity_m_s2 - self.model.drag_per_s * v;
            z += v * h + climb.cosine * path + other * h * h / 2.0;
            v += climb.cosine * impulse + other * h;
            f = aim + off * decay;
            t_s = until_s.min(to_s);
        }
        Vector4::new(z, v, a, f)
    }
}

impl AdaptiveEstimator for ThrustEstimator {
    type Interval<'a> = ClimbInterval<'a>;

    fn restarted(&self, other: &Self) -> Self {
        let estimate = self.estimate.restarted();
        Self { estimate, sensitivity: Matrix4x2::zeros(), ..*other }
    }

    fn take(&mut self, climb: &ClimbInterval, scale: f64) -> NormalisedSquare {
        self.predict(climb);
        let off = climb.height_m - self.motion.x;
        let (variance, noise) = (self.filter.axis.innovation_variance(), self.filter.axis.noise());
        let gain = self.filter.axis.correct(&(Vector3::z() * off), noise);
        self.motion += Vector3::new(gain.x, gain.y, 0.0) * off;
        let slope: RowVector2<f64> = self.sensitivity.row(0).into_owned();
        self.sensitivity -= Vector4::new(gain.x, gain.y, gain.z, 0.0) * slope;
        let before = *self.estimate.value();
        self.estimate.learn((off, scale * variance), &slope);
        self.estimate.raise(LAG, self.model.thrust_lag_s.min(LEAST_LAG_S));
        self.shift(&(self.sensitivity * (self.estimate.value() - before)));
        NormalisedSquare { sum: off * off / variance, freedom: 1.0 }
    }
}
