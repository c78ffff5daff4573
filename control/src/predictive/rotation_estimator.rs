//! Recursive prediction-error estimate of the response to commanded rates: gain, lag and hidden delay.
//!
//! About each axis the state `[theta; omega; d]` follows `omega' = (g u(t - s) + d - omega) / l`, the sticks' demand `u` with
//! the gain `g`, the lag `l` and the delay `s` that no report shows. A Kalman filter estimates the state for the present
//! parameters. The sensitivity of its prediction to the parameters is propagated with the state; through it the innovations
//! correct the parameters, too (Friedland, *Treatment of bias in recursive filtering*, IEEE Trans. Automatic Control 14, 1969;
//! Ljung, *Asymptotic behavior of the extended Kalman filter as a parameter estimator*, the same, 24, 1979). Each axis has its gain;
//! the axes share lag and delay. Their coupling, of the size of the angle turned between two poses, is neglected as in the attitude
//! filter. Only roll and pitch correct the parameters: yaw, which rotors turn by their drag alone, responds more slowly on most
//! vehicles. Its gain follows theirs in part, since part of a deviation is common to all axes.

use nalgebra::{Matrix3, RowSVector, SVector, Vector3};

use super::attitude_filter::AttitudeFilter;
use super::estimator_pair::{AdaptiveEstimator, NormalisedSquare};
use super::history::CommandHistory;
use super::model::{Motion, Rotation};
use super::options::FilterOptions;
use super::parameter_estimate::{LEAST_LAG_S, ParameterEstimate};
use crate::quaternion::Attitude;

/// Walk of the body rate \[rad/s\] and of the bias of the demand \[rad/s\] per second: smaller than in a filter that must
/// compensate a wrong model.
const RATE_WALK: f64 = 0.05;
const BIAS_WALK: f64 = 0.002;

/// Relative step of the differences by which sensitivities are computed \[-\].
const STEP: f64 = 1e-4;

/// Number of axes whose innovations correct the parameters: roll and pitch \[-\].
const TEACHING_AXES: usize = 2;

/// Share of the variance of the axes' gains that is common to them \[-\]: a battery or a payload changes all, a rotor or a lever
/// arm one of them.
const COMMON_SHARE: f64 = 0.5;

/// Parameters: a gain for each axis, lag, delay.
type Parameters = SVector<f64, 5>;
const GAINS: usize = 3;
const LAG: usize = 3;
const DELAY: usize = 4;

/// Response to commanded rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateResponse {
    /// Rate over the commanded one, at rest \[-, body axes\].
    pub gain: Vector3<f64>,
    /// Time constant \[s\].
    pub lag_s: f64,
    /// Delay that no report shows \[s\].
    pub delay_s: f64,
}

impl RateResponse {
    fn vector(&self) -> Parameters {
        Parameters::new(self.gain.x, self.gain.y, self.gain.z, self.lag_s, self.delay_s)
    }

    fn of(vector: &Parameters) -> Self {
        let gain = vector.fixed_rows::<3>(0).into_owned();
        Self { gain, lag_s: vector[LAG], delay_s: vector[DELAY] }
    }
}

/// Prior knowledge of a response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ResponseBounds {
    /// Expected response.
    pub nominal: RateResponse,
    /// Greatest deviation from it; zero for a known parameter.
    pub deviation: RateResponse,
}

impl ResponseBounds {
    /// The estimate before the first pose.
    fn estimate(&self) -> ParameterEstimate<5> {
        let (nominal, bounds) = (self.nominal.vector(), self.deviation.vector());
        ParameterEstimate::new(nominal, bounds).with_common(GAINS, COMMON_SHARE)
    }
}

/// One interval between two poses.
#[derive(Clone, Copy, Debug)]
pub struct TurnInterval<'a> {
    /// Attitude measured at the end of the interval, body to world.
    pub attitude: Attitude,
    /// The commands sent.
    pub history: &'a CommandHistory,
    /// Beginning and end of the interval \[s\].
    pub interval: (f64, f64),
}

/// State and parameters of the rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotationEstimator {
    estimate: ParameterEstimate<5>,
    /// Least estimated lag \[s\].
    least_lag_s: f64,
    filter: AttitudeFilter,
    motion: Motion,
    /// Sensitivity of `[theta; omega; d]` about each axis to its gain, the lag and the delay \[units of both\].
    sensitivity: [Matrix3<f64>; 3],
}

impl RotationEstimator {
    /// An estimator within `bounds`, for poses with the attitude noise of `options`, from `attitude` on.
    pub fn new(bounds: ResponseBounds, options: &FilterOptions, attitude: Attitude) -> Self {
        let options =
            FilterOptions { rate_walk_rad_s: RATE_WALK, demand_bias_walk: BIAS_WALK, ..*options };
        let nominal_s = bounds.nominal.lag_s;
        Self {
            estimate: bounds.estimate(),
            // With a bound of 5 ms, a vehicle with that lag and no delay oscillated until it was stopped when commands were lost in
            // bursts.
            least_lag_s: nominal_s.min(LEAST_LAG_S).max(0.1 * nominal_s),
            filter: AttitudeFilter::new(&options),
            motion: Motion { attitude, ..Motion::default() },
            sensitivity: [Matrix3::zeros(); 3],
        }
    }

    /// Takes further poses with the attitude noise of `options`.
    pub fn set_noise(&mut self, options: &FilterOptions) {
        self.filter.axis.set_noise(options.attitude_noise_deg.to_radians());
    }

    /// Estimated response.
    pub fn response(&self) -> RateResponse {
        RateResponse::of(self.estimate.value())
    }

    /// Standard deviations of the estimate.
    pub fn deviations(&self) -> RateResponse {
        RateResponse::of(&self.estimate.deviations())
    }

    /// Moves the state to the value that it would have if the parameters had always differed by `change`.
    fn shift(&mut self, change: &Parameters) {
        let shifts: [Vector3<f64>; 3] = std::array::from_fn(|axis| {
            self.sensitivity[axis] * Vector3::new(change[axis], change[LAG], change[DELAY])
        });
        let part = |state: usize| Vector3::from(shifts.map(|shift| shift[state]));
        self.motion.attitude = self.motion.attitude.turned_by(part(0));
        self.motion.rate += part(1);
        self.filter.axis.shift_bias(&part(2));
    }

    /// Propagates everything over `interval` \[s\].
    fn predict(&mut self, &TurnInterval { history, interval: (from_s, to_s), .. }: &TurnInterval) {
        let dt_s = to_s - from_s;
        let response = self.response();
        let (turn, rate) = self.turned(&response, history, (from_s, to_s));
        let lag_s = response.lag_s;
        let is_fixed = self.estimate.is_fixed();
        // The gain of an axis affects that axis alone, so one step of all gains gives the sensitivities of all axes.
        let steps = [(0..GAINS, STEP), (LAG..DELAY, STEP * lag_s), (DELAY..5, STEP * lag_s)];
        let slopes: [(Vector3<f64>, Vector3<f64>); 3] = steps.map(|(stepped, step)| {
            if is_fixed {
                return Default::default();
            }
            let mut beside = *self.estimate.value();
            beside.rows_range_mut(stepped).add_scalar_mut(step);
            let beside = RateResponse::of(&beside);
            let (beside_turn, beside_rate) = self.turned(&beside, history, (from_s, to_s));
            ((beside_turn - turn) / step, (beside_rate - rate) / step)
        });
        let transition = self.filter.transition(&Rotation::RateLoop { lag_s }, dt_s);
        for axis in 0..3 {
            let mut forced = Matrix3::zeros();
            for (index, (of_turn, of_rate)) in slopes.iter().enumerate() {
                (forced[(0, index)], forced[(1, index)]) = (of_turn[axis], of_rate[axis]);
            }
            self.sensitivity[axis] = transition.f * self.sensitivity[axis] + forced;
        }
        self.filter.axis.predict(&transition);
        self.motion.attitude = self.motion.attitude.turned_by(turn);
        self.motion.rate = rate;
        self.estimate.forget(dt_s);
    }

    /// Rotation vector over an interval \[rad, body axes\] and rate at its end \[rad/s, body axes\], from the state at its
    /// beginning with this response.
    fn turned(
        &self,
        RateResponse { gain, lag_s, delay_s }: &RateResponse,
        history: &CommandHistory,
        (from_s, to_s): (f64, f64),
    ) -> (Vector3<f64>, Vector3<f64>) {
        let (mut turn, mut rate) = (Vector3::zeros(), self.motion.rate);
        let mut t_s = from_s;
        while t_s < to_s {
            let (input, until_s) = history.reported(t_s, *delay_s);
            let end_s = until_s.min(to_s);
            let duration_s = end_s - t_s;
            let aim = input.demand.component_mul(gain) + self.filter.axis.bias();
            let decay = (-duration_s / lag_s).exp();
            turn += aim * duration_s + (rate - aim) * (lag_s * (1.0 - decay));
            rate = aim + (rate - aim) * decay;
            t_s = end_s;
        }
        (turn, rate)
    }
}

impl AdaptiveEstimator for RotationEstimator {
    type Interval<'a> = TurnInterval<'a>;

    fn restarted(&self, other: &Self) -> Self {
        let estimate = self.estimate.restarted();
        Self { estimate, sensitivity: [Matrix3::zeros(); 3], ..*other }
    }

    fn take(&mut self, turn: &TurnInterval, scale: f64) -> NormalisedSquare {
        self.predict(turn);
        let innovation = self.motion.attitude.rotation_to(&turn.attitude);
        let (variance, noise) = (self.filter.axis.innovation_variance(), self.filter.axis.noise());
        let gain = self.filter.correct(&mut self.motion, &innovation, noise);
        let before = *self.estimate.value();
        for (axis, off) in innovation.iter().enumerate() {
            let slope = self.sensitivity[axis].row(0).into_owned();
            self.sensitivity[axis] -= gain * slope;
            if axis >= TEACHING_AXES {
                continue;
            }
            let mut slopes = RowSVector::<f64, 5>::zeros();
            (slopes[axis], slopes[LAG], slopes[DELAY]) = (slope.x, slope.y, slope.z);
            // Part of the innovation is explained by the corrections from the other axes.
            let explained = slopes.dot(&(self.estimate.value() - before).transpose());
            self.estimate.learn((*off - explained, scale * variance), &slopes);
            self.estimate.raise(LAG, self.least_lag_s);
            // A command does not take effect before it is sent.
            self.estimate.raise(DELAY, -turn.history.delay_s());
        }
        self.shift(&(self.estimate.value() - before));
        let sum = innovation.xy().norm_squared() / variance;
        NormalisedSquare { sum, freedom: TEACHING_AXES as f64 }
    }
}
